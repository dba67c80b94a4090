"""The views of one channel: verdict lane, curves, waveform, spectrogram, poles, evidence."""

from __future__ import annotations

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from chatter_monitor.outlets.dashboard import words
from chatter_monitor.outlets.dashboard.pole_plane import Pole, PolePlane
from chatter_monitor.outlets.dashboard.spectrogram import Spectrogram
from chatter_monitor.outlets.dashboard.stream import Stream
from chatter_monitor.outlets.look import GREY, SKY_BLUE, STATES, VERMILLION, WHITE, mode_colour
from chatter_monitor.records import ModeStatus, OdpFrame, SignalFrame, State, Verdict

# Intervals of 50 ms that are logged together: a call costs as much as a hundred numbers.
BATCH = 10
# What a person reads, and the poles that go with it, change so often at most, in intervals.
SHOWN_EVERY = 5
# Verdicts follow each other without gaps; longer than this and the monitor was not there.
GAP_S = 0.5
# What carries less of the signal is noise that a recursion has found a name for.
SHOWN_SHARE = 0.02
SHOWN_SD = 0.1  # of the frequency, relative
# Further out a curve says no more than that it is far out, and would squeeze the others.
DAMPING_SHOWN = 0.3


class ChannelViews:
    """Draws what comes from one channel.

    Parameters
    ----------
    stream : Stream
        Where to.
    channel : int
        Index of the channel.
    span_s : float
        How much time the spectrogram is wide.
    """

    def __init__(self, stream: Stream, channel: int, span_s: float) -> None:
        self._stream = stream
        self.channel = channel
        self.path = f"channel_{channel}"
        self._spectrogram = Spectrogram(stream, f"{self.path}/spectrogram", span_s)
        self._poles = PolePlane(stream, f"{self.path}/poles")
        self._modes = 0
        self._rows: dict[str, tuple[list[float], list[NDArray[np.float64]]]] = {}
        self._newest: list[Pole] = []
        self._state: State | None = None
        self._judged_s = -np.inf
        self._count = 0
        self._style()

    def _style(self) -> None:
        """Names and colours of what does not depend on the number of modes."""
        self._stream.static(
            f"verdict/channel_{self.channel}",
            rr.StateConfiguration(
                values=list(STATES),
                labels=[look.word for look in STATES.values()],
                colors=[look.colour for look in STATES.values()],
            ),
        )
        # dots, because the verdict may turn to another vibration from one interval to the next
        self._stream.static(
            f"{self.path}/frequency/verdict",
            rr.SeriesPoints(colors=[WHITE], names=["of the verdict"], marker_sizes=[1.6], markers=["circle"]),
        )
        self._stream.static(
            f"{self.path}/damping/verdict",
            rr.SeriesPoints(
                colors=[GREY, WHITE, GREY],
                names=_names("of the verdict"),
                marker_sizes=[0.8, 1.6, 0.8],
                markers=["circle"] * 3,
            ),
        )
        self._stream.static(
            f"{self.path}/chatter",
            rr.SeriesLines(colors=[VERMILLION], names=["that it chatters"], widths=[1.8]),
        )
        self._stream.static(
            f"{self.path}/waveform",
            rr.SeriesLines(
                colors=[SKY_BLUE, SKY_BLUE], names=["smallest", "largest"], widths=[1.0], aggregation_policy="MinMax"
            ),
        )

    def _style_modes(self, modes: int) -> None:
        """Names, colours and widths of the curves of so many modes, and of the limit that is drawn with them."""
        self._modes = modes
        names = [name for mode in range(modes) for name in _names(f"mode {mode}")]
        colours = [mode_colour(mode) for mode in range(modes) for _ in range(3)]
        widths = [0.6, 1.8, 0.6] * modes
        self._stream.static(f"{self.path}/frequency/modes", rr.SeriesLines(colors=colours, names=names, widths=widths))
        self._stream.static(
            f"{self.path}/damping/modes",
            rr.SeriesLines(colors=[*colours, VERMILLION], names=[*names, "stability limit"], widths=[*widths, 2.0]),
        )

    def odp(self, time_s: float, frame: OdpFrame) -> None:
        """Draw the modes of an interval that begins at a time."""
        modes = frame.frequency_hz.shape[1]
        if modes != self._modes:
            self.flush()
            self._style_modes(modes)
        self._newest = [pole for mode in range(modes) if (pole := _pole(frame, mode)) is not None]
        frequencies = np.full((modes, 3), np.nan)
        dampings = np.full((modes, 3), np.nan)
        for pole in self._newest:
            frequencies[pole.mode] = _interval(pole.frequency_hz, pole.frequency_sd_hz)
            if abs(pole.damping_ratio) < DAMPING_SHOWN:
                dampings[pole.mode] = 100.0 * _interval(pole.damping_ratio, pole.damping_sd)
        self._row("frequency/modes", time_s, frequencies.ravel())
        self._row("damping/modes", time_s, np.append(dampings, 0.0))
        self._count += 1
        if self._count % BATCH == 0:
            self.flush()

    def signal(self, time_s: float, signal: SignalFrame) -> None:
        """Draw the waveform and the spectrum of an interval; its modes have come before."""
        seconds = signal.samples / signal.sample_rate_hz
        parts = len(signal.extremes)
        for part, extremes in enumerate(signal.extremes):
            self._row("waveform", time_s + part * seconds / parts, np.asarray(extremes, np.float64))
        modes = [(pole.mode, pole.frequency_hz) for pole in self._newest]
        self._spectrogram.column(time_s, seconds, signal.level_db[0], signal.orders_hz, modes)

    def verdict(self, begin_s: float, end_s: float, verdict: Verdict) -> None:
        """Draw a verdict."""
        if self._state is not None and begin_s - self._judged_s > GAP_S:
            self._stream.at(self._judged_s, f"verdict/channel_{self.channel}", rr.StateChange(state=""))
            self._state = None
        self._judged_s = end_s
        if verdict.state != self._state:
            self._stream.at(begin_s, f"verdict/channel_{self.channel}", rr.StateChange(state=verdict.state))
        frequency = np.array([np.nan if verdict.frequency_hz is None else verdict.frequency_hz])
        damping = np.full(3, np.nan)
        if verdict.damping_ratio is not None and verdict.damping_ratio_ci95 is not None:
            low, high = verdict.damping_ratio_ci95
            damping = 100.0 * np.array([low, verdict.damping_ratio, high])
        self._row("frequency/verdict", begin_s, frequency)
        self._row("damping/verdict", begin_s, damping)
        likely = np.nan if verdict.chatter_probability is None else 100.0 * verdict.chatter_probability
        self._row("chatter", begin_s, np.array([likely]))
        if verdict.state != self._state or self._count % SHOWN_EVERY == 0:
            text = rr.TextDocument(words.evidence(verdict), media_type=rr.MediaType.MARKDOWN)
            self._stream.at(begin_s, f"{self.path}/evidence", text)
            self._poles.show(begin_s, self._newest, _meant(verdict))
        self._state = verdict.state

    def end(self, time_s: float) -> None:
        """Bring out what has been gathered, and close the verdict lane."""
        self.flush()
        self._spectrogram.flush()
        self._stream.at(time_s, f"verdict/channel_{self.channel}", rr.StateChange(state=""))
        self._state = None

    def flush(self) -> None:
        """Log the rows that have been gathered."""
        for path, (times, rows) in self._rows.items():
            self._stream.series(f"{self.path}/{path}", times, np.array(rows))
        self._rows = {}

    def _row(self, path: str, time_s: float, values: NDArray[np.float64]) -> None:
        times, rows = self._rows.setdefault(path, ([], []))
        times.append(time_s)
        rows.append(values)


def _names(name: str) -> list[str]:
    """Names of an estimate and of the ends of its 95 % interval."""
    return [f"{name}, low", name, f"{name}, high"]


def _pole(frame: OdpFrame, mode: int) -> Pole | None:
    """Middle of a mode's estimates in an interval; None where it has none worth showing."""
    rows = frame.status[:, mode] == ModeStatus.OSCILLATORY
    if 2 * np.count_nonzero(rows) <= len(frame) or frame.share[mode] < SHOWN_SHARE:
        return None
    frequency_hz, damping, frequency_sd_hz, damping_sd = (
        float(np.median(values[rows, mode]))
        for values in (frame.frequency_hz, frame.damping_ratio, frame.frequency_sd_hz, frame.damping_sd)
    )
    if frequency_sd_hz > SHOWN_SD * frequency_hz:
        return None
    return Pole(mode, frequency_hz, damping, frequency_sd_hz, damping_sd)


def _interval(value: float, sd: float) -> NDArray[np.float64]:
    """Ends of the 95 % interval around a value."""
    return value + 1.96 * sd * np.array([-1.0, 0.0, 1.0])


def _meant(verdict: Verdict) -> Pole | None:
    """Pole of the vibration that a verdict is about: where the judge has it, which is not always where a mode is."""
    if verdict.frequency_hz is None or verdict.damping_ratio is None:
        return None
    return Pole(-1, verdict.frequency_hz, verdict.damping_ratio, 0.0, 0.0)
