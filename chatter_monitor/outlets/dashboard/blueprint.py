"""Which view lies where, and what part of time each shows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from chatter_monitor.outlets.dashboard import pole_plane, spectrogram
from chatter_monitor.outlets.dashboard.stream import TIMELINE, Clock

TRAIL_S = 2.0
DAMPING_AXIS_PERCENT = (-2.0, 10.0)
LIKELY_AXIS_PERCENT = (-2.0, 102.0)  # a line along the edge would not be seen


def blueprint(channels: Sequence[str], clock: Clock, span_s: float) -> rrb.Blueprint:
    """Arrangement for some channels.

    Parameters
    ----------
    channels : sequence of str
        Entity of each channel.
    clock : "wall" or "recording"
        A live view shows the last seconds before the cursor, that of a recording all of it.
    span_s : float
        How many seconds.
    """
    lanes = rrb.StateTimelineView(origin="verdict", name="Verdict", time_view=_axis(clock, span_s))
    tabs = [_channel(path, clock, span_s) for path in channels]
    body = tabs[0] if len(tabs) == 1 else rrb.Tabs(*tabs)
    events = rrb.TextLogView(
        origin="events",
        name="Events, with what to change",
        columns=rrb.TextLogColumns(timeline_columns=[TIMELINE], text_log_columns=["body"]),
    )
    latency = rrb.TimeSeriesView(
        origin="health/latency",
        name="Latency of a block / ms",
        axis_x=_axis(clock, span_s),
        axis_y=rrb.ScalarAxis(range=(0.0, 20.0)),
    )
    lower: rrb.View | rrb.Container = events
    if clock == "wall":
        health = rrb.TextDocumentView(origin="health/now", name="Health")
        lower = rrb.Horizontal(events, health, latency, column_shares=[5, 2, 3])
    return rrb.Blueprint(
        rrb.Vertical(lanes, body, lower, row_shares=[1.0 + 0.4 * len(tabs), 8.0, 2.0]),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _channel(path: str, clock: Clock, span_s: float) -> Any:
    axis = _axis(clock, span_s)
    upper = rrb.Horizontal(
        rrb.TextDocumentView(origin=f"{path}/evidence", name="What it is, and why"),
        rrb.Spatial2DView(
            origin=f"{path}/spectrogram",
            name="Spectrogram, with orders (white) and modes",
            visual_bounds=_bounds(-spectrogram.WIDTH, 0.0, spectrogram.HEIGHT),
        ),
        rrb.Spatial2DView(
            origin=f"{path}/poles",
            name="Poles: growth (across), frequency",
            visual_bounds=_bounds(pole_plane.LEFT_HZ, pole_plane.RIGHT_HZ, pole_plane.HEIGHT),
            overrides={
                f"{path}/poles/trail": rrb.VisibleTimeRanges(
                    [
                        rr.VisibleTimeRange(
                            TIMELINE,
                            start=rr.TimeRangeBoundary.cursor_relative(seconds=-TRAIL_S),
                            end=rr.TimeRangeBoundary.cursor_relative(),
                        )
                    ]
                )
            },
        ),
        column_shares=[2.2, 5, 3],
    )
    lower = rrb.Horizontal(
        _curves(f"{path}/frequency", "Frequency of each mode / Hz, with 95 %", axis),
        _curves(f"{path}/damping", "Damping ratio / %, with 95 %", axis, DAMPING_AXIS_PERCENT),
        _curves(f"{path}/chatter", "How likely it chatters / %", axis, LIKELY_AXIS_PERCENT),
        _curves(f"{path}/waveform", "Waveform, smallest and largest / unit", axis),
    )
    return rrb.Vertical(upper, lower, row_shares=[1.15, 1.0], name=path.replace("_", " "))


def _curves(
    origin: str, name: str, axis: rrb.TimeAxis | None, limits: tuple[float, float] | None = None
) -> rrb.TimeSeriesView:
    """Curves over time, from one value to another, or as far as they go."""
    height = None if limits is None else rrb.ScalarAxis(range=limits)
    return rrb.TimeSeriesView(
        origin=origin, name=name, axis_x=axis, axis_y=height, plot_legend=rrb.PlotLegend(visible=False)
    )


def _bounds(left: float, right: float, height: float) -> rrb.VisualBounds2D:
    """The plot with room for its labels."""
    width = right - left
    return rrb.VisualBounds2D(
        x_range=(left - 0.08 * width, right + 0.04 * width), y_range=(-0.04 * height, 1.1 * height)
    )


def _axis(clock: Clock, span_s: float) -> rrb.TimeAxis | None:
    if clock == "recording":
        return None
    return rrb.TimeAxis(
        view_range=rr.TimeRange(
            start=rr.TimeRangeBoundary.cursor_relative(seconds=-span_s), end=rr.TimeRangeBoundary.cursor_relative()
        )
    )
