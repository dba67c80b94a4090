"""All views of a monitor: its channels, events and health, on one timeline."""

from __future__ import annotations

import rerun as rr

from chatter_monitor.outlets.dashboard import words
from chatter_monitor.outlets.dashboard.blueprint import blueprint
from chatter_monitor.outlets.dashboard.channel import ChannelViews
from chatter_monitor.outlets.dashboard.stream import Stream
from chatter_monitor.outlets.look import ORANGE, SKY_BLUE, VERMILLION, WHITE
from chatter_monitor.records import Announcement, Event, Health, Mismatch, OdpFrame, SignalFrame, Verdict

LIVE_SPAN_S = 20.0


class Screen:
    """Takes what a monitor publishes, or what it gives its outlets, and draws it.

    Of an interval the ODPs come first, then the signal, then the verdict.

    Parameters
    ----------
    stream : Stream
        Where to.
    span_s : float
        How many seconds the scrolling views show.
    """

    def __init__(self, stream: Stream, span_s: float = LIVE_SPAN_S) -> None:
        self._stream = stream
        self._span_s = span_s
        self._channels: dict[int, ChannelViews] = {}
        self._zero_s = 0.0
        self._now_s = 0.0
        self._said: tuple[object, ...] | None = None
        stream.static(
            "health/latency",
            rr.SeriesLines(colors=[SKY_BLUE, ORANGE], names=["median", "99 %"], widths=[1.5, 1.5]),
        )

    def set_zero(self, time_s: float) -> None:
        """Say when the first sample was, on the stream's clock: known from the newest message."""
        self._zero_s = time_s

    def odp(self, frame: OdpFrame) -> None:
        """Draw the modes of an interval."""
        self._views(frame.channel).odp(self._time(frame.first_sample / frame.sample_rate_hz), frame)

    def signal(self, signal: SignalFrame) -> None:
        """Draw waveform and spectrum of an interval."""
        self._views(signal.channel).signal(self._time(signal.first_sample / signal.sample_rate_hz), signal)

    def message(self, message: Announcement) -> None:
        """Draw a verdict, write down an event, show how well it hears."""
        match message:
            case Verdict():
                begin_s, end_s = self._time(message.t0), self._time(message.t1)
                self._views(message.channel).verdict(begin_s, end_s, message)
            case Event():
                for line in words.event(message):
                    text = rr.TextLog(line, level=rr.TextLogLevel.ERROR, color=VERMILLION)
                    self._stream.at(self._time(message.end_s), "events/chatter", text)
            case Mismatch():
                level = rr.TextLogLevel.INFO if message.outcome == "none" else rr.TextLogLevel.WARN
                self._stream.at(self._time(message.t), "events/mismatch", rr.TextLog(message.summary, level=level))
            case Health():
                self._health(self._time(message.t), message)

    def close(self) -> None:
        """Bring out what is buffered."""
        for views in self._channels.values():
            views.end(self._now_s)
        self._stream.close()

    def _health(self, time_s: float, health: Health) -> None:
        if health.latency_ms_p50 is not None and health.latency_ms_p99 is not None:
            self._stream.at(time_s, "health/latency", rr.Scalars([health.latency_ms_p50, health.latency_ms_p99]))
        self._stream.at(time_s, "health/now", rr.TextDocument(words.health(health), media_type=rr.MediaType.MARKDOWN))
        said = (health.state, tuple(health.reasons))
        if said != self._said:
            self._said = said
            bad = health.state == "not_hearing" or bool(health.reasons)
            text = "; ".join([health.state.replace("_", " "), *health.reasons])
            level, colour = (rr.TextLogLevel.WARN, ORANGE) if bad else (rr.TextLogLevel.INFO, WHITE)
            self._stream.at(time_s, "events/health", rr.TextLog(text, level=level, color=colour))

    def _time(self, signal_s: float) -> float:
        """Time on the stream's clock of a time in the signal."""
        time_s = self._zero_s + signal_s
        self._now_s = max(self._now_s, time_s)
        return time_s

    def _views(self, channel: int) -> ChannelViews:
        views = self._channels.get(channel)
        if views is None:
            views = self._channels[channel] = ChannelViews(self._stream, channel, self._span_s)
            paths = [self._channels[c].path for c in sorted(self._channels)]
            self._stream.show(blueprint(paths, self._stream.clock, self._span_s))
        return views
