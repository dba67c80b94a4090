"""The report of one event: what happened, when, how sure, a picture, what to change."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.outlets.event_files import RecordedEvent
from chatter_monitor.outlets.look import GREY, STATES, damping, hertz, percent
from chatter_monitor.records import Verdict
from chatter_monitor.reports.page import answer, facts, hex_colour, numbers, page, picture, table, text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SPECTRUM_S = 0.1
RANGE_DB = 70.0
DAMPING_SHOWN_PERCENT = (-2.0, 8.0)


def event_page(recorded: RecordedEvent, verdicts: Sequence[Verdict], samples: NDArray[np.float64]) -> str:
    """HTML page of a recorded event.

    Parameters
    ----------
    recorded : RecordedEvent
        What is known of it.
    verdicts : sequence of Verdict
        That were given while it was recorded, on its channel.
    samples : ndarray of float64, shape (n,)
        Signal of its channel; NaN where samples are missing.
    """
    lasted_s = recorded.end_s - recorded.onset_s
    alarms = [v for v in verdicts if v.state == "self_excited"]
    sure = float(np.median([v.confidence for v in alarms]))
    if recorded.withdrawn:
        what, did, is_called, look = "Withdrawn alarm", "there was", "was called", STATES["forced"]
    else:
        what, did, is_called, look = "Chatter", "the cut fed", "is called", STATES["self_excited"]
    at = "" if recorded.peak_frequency_hz is None else f" at {hertz(recorded.peak_frequency_hz)}"
    told = (
        f"on {recorded.machine}, channel {recorded.channel}: for {lasted_s:.1f} s {did} a vibration{at}. "
        f"{_remedy(recorded)}"
    )
    speed_rpm = recorded.settings.get("spindle", {}).get("speed_rpm")
    named = [
        ("began (UTC)", _clock(recorded.onset_utc)),
        ("lasted", f"{lasted_s:.2f} s"),
        ("frequency", hertz(recorded.peak_frequency_hz)),
        ("least damping", damping(recorded.min_damping_ratio)),
        ("sure", percent(sure)),
        ("spindle", "unknown" if speed_rpm is None else f"{speed_rpm:.0f} rpm"),
    ]
    parts = [
        f"<h1>{what}{at}</h1>",
        f'<p class="soft">{text(recorded.machine)}, {text(recorded.onset_utc[:19].replace("T", " "))} UTC, '
        f"{text(recorded.id)}</p>",
        answer(what, told, look.colour),
        numbers(named),
        picture(
            _figure(recorded, verdicts, samples),
            "Verdict as it was given, signal, spectrogram and damping ratio with its 95 % interval; the vertical line"
            " is the onset.",
        ),
        "<h2>What to change</h2>",
        _changes(recorded),
        f"<h2>Why it {is_called} chatter</h2>",
        "<ul>" + "".join(f"<li>{text(reason)}</li>" for reason in alarms[0].reasons) + "</ul>",
        "<h2>The recording</h2>",
        _about(recorded),
    ]
    return page(f"{what}{at}, {recorded.machine}", parts)


def _remedy(recorded: RecordedEvent) -> str:
    if recorded.advice:
        return f"Try {recorded.advice[0].spindle_rpm:.0f} rpm."
    return f"{recorded.remedy[:1].upper()}{recorded.remedy[1:]}." if recorded.remedy else ""


def _clock(utc: str) -> str:
    return datetime.fromisoformat(utc).strftime("%H:%M:%S")


def _changes(recorded: RecordedEvent) -> str:
    now_rpm = recorded.settings.get("spindle", {}).get("speed_rpm")
    rows = [
        (
            f"{advice.spindle_rpm:.0f} rpm",
            "-" if not now_rpm else f"{100 * (advice.spindle_rpm / now_rpm - 1.0):+.0f} %",
            f"{advice.lobe}",
        )
        for advice in recorded.advice
    ]
    listed = table(("spindle speed", "against now", "whole waves between two teeth"), rows) if rows else ""
    return f"{listed}<p>{text(recorded.remedy)}.</p>" if recorded.remedy else listed


def _about(recorded: RecordedEvent) -> str:
    remarks = []
    if recorded.truncated:
        remarks.append("The event went on after the recording ends.")
    if recorded.missing_samples:
        remarks.append(f"{recorded.missing_samples} samples were never received; they are left out, not made up.")
    speed = recorded.settings.get("spindle", {})
    rpm, teeth = speed.get("speed_rpm"), speed.get("teeth", 1)
    turning = "unknown speed" if rpm is None else f"{rpm:g} rpm"
    rows = [
        ("file", recorded.recording or "-"),
        ("first sample (UTC)", recorded.utc),
        ("length", f"{recorded.samples / recorded.sample_rate_hz:.1f} s at {recorded.sample_rate_hz:.0f} Hz"),
        (
            "spindle",
            f"{turning}, {teeth} {'tooth' if teeth == 1 else 'teeth'}",
        ),
        ("sensor", str(recorded.settings.get("input", {}).get("sensor", "-"))),
    ]
    return facts(rows) + "".join(f"<p>{text(remark)}</p>" for remark in remarks)


def _figure(recorded: RecordedEvent, verdicts: Sequence[Verdict], samples: NDArray[np.float64]) -> Figure:
    from matplotlib.figure import Figure

    rate_hz, onset_s = recorded.sample_rate_hz, recorded.onset_s
    before_s = onset_s - recorded.first_sample / rate_hz  # the first sample is so long before the onset

    figure = Figure(figsize=(6.6, 7.4), layout="constrained")
    axes = figure.subplots(4, 1, sharex=True, height_ratios=[0.35, 1.6, 2.2, 2.2])
    _draw_lane(axes[0], verdicts, onset_s)
    _draw_signal(axes[1], samples, rate_hz, before_s)
    _draw_spectrogram(axes[2], samples, rate_hz, before_s, recorded.peak_frequency_hz)
    _draw_damping(axes[3], verdicts, onset_s)
    for each in axes[1:]:
        each.axvline(0.0, color=hex_colour(STATES["self_excited"].colour), lw=1.0)
    axes[3].set(xlabel="time after the onset / s", xlim=(-before_s, samples.size / rate_hz - before_s))
    return figure


def _draw_lane(axes: Axes, verdicts: Sequence[Verdict], onset_s: float) -> None:
    """The verdicts as a coloured lane with a legend of what occurs."""
    from matplotlib.patches import Patch

    begin = 0
    for end in range(1, len(verdicts) + 1):
        if end == len(verdicts) or verdicts[end].state != verdicts[begin].state:
            span = (verdicts[begin].t0 - onset_s, verdicts[end - 1].t1 - verdicts[begin].t0)
            axes.broken_barh([span], (0.0, 1.0), color=hex_colour(STATES[verdicts[begin].state].colour))
            begin = end
    occurring = [state for state in STATES if any(v.state == state for v in verdicts)]
    patches = [Patch(color=hex_colour(STATES[state].colour), label=STATES[state].word) for state in occurring]
    axes.legend(
        handles=patches,
        ncols=len(patches),
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        frameon=False,
        fontsize="x-small",
    )
    axes.set_yticks([])
    axes.tick_params(bottom=False)
    axes.spines[:].set_visible(False)


def _draw_signal(axes: Axes, samples: NDArray[np.float64], rate_hz: float, before_s: float) -> None:
    part = max(1, samples.size // 2000)
    whole = samples[: samples.size // part * part].reshape(-1, part)
    t = (np.arange(len(whole)) + 0.5) * part / rate_hz - before_s
    axes.fill_between(t, whole.min(axis=1), whole.max(axis=1), color="#4a6fa5", lw=0.3)
    axes.set(ylabel="signal / unit")


def _draw_spectrogram(
    axes: Axes, samples: NDArray[np.float64], rate_hz: float, before_s: float, chatter_hz: float | None
) -> None:
    points = round(SPECTRUM_S * rate_hz)
    hop = max(points // 2, samples.size // 800)
    if samples.size < points:
        return
    pieces = np.lib.stride_tricks.sliding_window_view(np.nan_to_num(samples), points)[::hop]
    window = np.hanning(points + 1)[:-1]
    level = 20.0 * np.log10(np.abs(np.fft.rfft(pieces * window, axis=1)) * np.sqrt(2.0) / window.sum() + 1e-9)
    top_hz = min(rate_hz / 2.0, max(2000.0, 3.0 * (chatter_hz or 0.0)))
    level = level[:, : int(top_hz * SPECTRUM_S) + 1].T
    extent = (-before_s, len(pieces) * hop / rate_hz - before_s, 0.0, top_hz)
    axes.imshow(
        level,
        origin="lower",
        aspect="auto",
        extent=extent,
        cmap="cividis",
        vmin=level.max() - RANGE_DB,
        vmax=level.max(),
    )
    axes.set(ylabel="frequency / Hz", ylim=(0.0, top_hz))


def _draw_damping(axes: Axes, verdicts: Sequence[Verdict], onset_s: float) -> None:
    known = [v for v in verdicts if v.damping_ratio is not None and v.damping_ratio_ci95 is not None]
    t = np.array([v.t0 - onset_s for v in known])
    damping = 100.0 * np.array([v.damping_ratio for v in known], float)
    ends = 100.0 * np.array([v.damping_ratio_ci95 for v in known], float).reshape(-1, 2)
    axes.vlines(t, ends[:, 0], ends[:, 1], color=hex_colour(GREY), lw=0.7, alpha=0.6, label="95 %")
    axes.plot(t, damping, ".", ms=3.0, color="#1d1d1d", label="damping ratio")
    axes.axhline(0.0, color=hex_colour(STATES["self_excited"].colour), lw=1.2, label="stability limit")
    axes.set(ylabel="damping ratio / %", ylim=DAMPING_SHOWN_PERCENT)
    axes.legend(loc="upper right", ncols=3, frameon=False, fontsize="x-small")
