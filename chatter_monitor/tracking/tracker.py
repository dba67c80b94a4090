"""One channel's tracker: samples in, frames of operational dynamic parameters out."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from chatter_monitor.kernels import conditioning, odp, poles, rarma, track
from chatter_monitor.kernels.share import modal_shares
from chatter_monitor.records import Flag, OdpFrame

# One frame is one verdict interval: long enough for a stable median, short enough for an alarm in time.
INTERVAL_S = 0.05

# frequency, damping, their standard deviations (float32), status (uint8); shape (samples, modes) each
Columns = tuple[NDArray[Any], ...]
Order = Annotated[int, msgspec.Meta(ge=0)]


class TrackerSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the model is fitted: the table ``[tracker]`` of a machine configuration.

    Attributes
    ----------
    orders : (int, int)
        Orders of A and C. (4, 3) is the paper's choice: two modes, and zeros for what is between them.
    memory_ms : float
        Time constant of the exponential forgetting. The effective window is twice as long.
    sample_rate_hz : float
        Rate at which the tracker runs; inputs are converted to it.
    high_pass_hz : float
        Corner below which the signal is offset and drift, not vibration. A first-order high-pass costs C one zero and
        frees a pair of poles that would otherwise be spent on the offset.
    """

    orders: tuple[Order, Order] = (4, 3)
    memory_ms: Annotated[float, msgspec.Meta(gt=0)] = 80.0
    sample_rate_hz: Annotated[float, msgspec.Meta(gt=0)] = 12800.0
    high_pass_hz: Annotated[float, msgspec.Meta(ge=0)] = 20.0

    def __post_init__(self) -> None:
        p, q = self.orders
        if p % 2 or not 2 <= p <= 8 or q > 6:
            msg = f"orders must be [2, 4, 6 or 8, 0 to 6], got {list(self.orders)}"
            raise ValueError(msg)
        if self.memory_ms * 1e-3 * self.sample_rate_hz < 10 * (p + q):
            msg = f"memory_ms must hold at least ten samples for each of the {p + q} coefficients, got {self.memory_ms}"
            raise ValueError(msg)
        if self.high_pass_hz >= self.sample_rate_hz / 2:
            msg = f"high_pass_hz must be below half of sample_rate_hz, got {self.high_pass_hz}"
            raise ValueError(msg)

    @property
    def modes(self) -> int:
        """Mode slots of each frame."""
        return self.orders[0] // 2


class Tracker:
    """Recursive identification of one channel (paper, section 5.1).

    Frames lie on a fixed grid of `INTERVAL_S` on the sample index, whatever blocks the samples come in; their contents
    do not depend on the blocks either. Lost samples appear in the frames as held values under their flags.

    Parameters
    ----------
    settings : TrackerSettings
        Orders, memory, rate.
    channel : int
        Number that the frames carry.
    source_rate_hz : float, optional
        Rate at which the signal was sampled first. Where it is lower than the tracker's, the upper part of the band is
        empty, and the model is fitted to a decimated signal; its values are then held in between.
    """

    def __init__(self, settings: TrackerSettings, channel: int = 0, source_rate_hz: float | None = None) -> None:
        self._settings = settings
        self._channel = channel
        rate = settings.sample_rate_hz
        self._interval = round(INTERVAL_S * rate)
        self._halvers = []
        while source_rate_hz is not None and rate > source_rate_hz:
            self._halvers.append(conditioning.new_half_band())
            rate /= 2
        self._rate_hz = rate
        p, q = settings.orders
        self._recursion = rarma.new_state(p, q)
        self._poles = poles.new_state(p)
        self._tile = odp.new_tile(p)
        self._forgetting = 1.0 - 1.0 / (settings.memory_ms * 1e-3 * rate)
        self._high_pass = np.zeros(2)
        self._shares = np.zeros(settings.modes)
        self._next_sample = 0
        self._columns = self._new_columns(self._interval)
        self._filled = 0
        self._last = self._new_columns(1)  # before the first value: nothing known
        for column in self._last[:4]:
            column.fill(np.nan)
        self._last[4].fill(track.STARTING)
        self._signal = np.empty(self._interval)
        self._lost = 0
        self._flags = Flag.NONE

    def process(self, first_sample: int, samples: NDArray[np.float64], flags: Flag = Flag.NONE) -> Iterator[OdpFrame]:
        """Take samples and yield the frames that they complete.

        Parameters
        ----------
        first_sample : int
            Index of the first one, not below that of the last one taken; what is skipped counts as lost.
        samples : ndarray of float64, shape (n,)
            The signal.
        flags : Flag
            What is wrong with these samples.
        """
        for missing in self._chunks(first_sample - self._next_sample):
            yield from self._take(np.full(missing, np.nan), Flag.GAP, lost=missing)
        if flags & Flag.NON_FINITE:
            samples = np.full(len(samples), np.nan)  # they are placeholders, not measurements
        yield from self._take(samples, flags)

    def finish(self) -> Iterator[OdpFrame]:
        """Yield what remains as a last, shorter frame."""
        if self._filled:
            yield self._frame()

    def _chunks(self, samples: int) -> Iterator[int]:
        while samples > 0:
            yield min(samples, self._interval)
            samples -= self._interval

    def _take(self, samples: NDArray[np.float64], flags: Flag, lost: int = 0) -> Iterator[OdpFrame]:
        begin = 0
        while begin < len(samples):
            size = min(len(samples) - begin, self._interval - self._filled)
            self._track(samples[begin : begin + size])
            self._flags |= flags
            self._lost += min(lost, size)
            lost -= min(lost, size)
            begin += size
            if self._filled == self._interval:
                yield self._frame()

    def _track(self, samples: NDArray[np.float64]) -> None:
        """Fill in the ODPs of consecutive samples that fit into the frame."""
        corner = 2 * np.pi * self._settings.high_pass_hz / self._settings.sample_rate_hz
        rows = slice(self._filled, self._filled + len(samples))
        signal = self._signal[rows]
        conditioning.high_pass(np.ascontiguousarray(samples), corner, self._high_pass, signal)
        if self._halvers:
            for column, held in zip(self._columns, self._held(signal), strict=True):
                column[rows] = held
        else:
            self._run(signal, tuple(column[rows] for column in self._columns))
        self._filled += len(samples)
        self._next_sample += len(samples)

    def _run(self, signal: NDArray[np.float64], out: Columns) -> None:
        p, q = self._settings.orders
        track.track(p, q, signal, self._recursion, self._poles, self._tile, self._forgetting, self._rate_hz, out)

    def _held(self, signal: NDArray[np.float64]) -> Columns:
        """ODPs of a decimated signal, each held until the next."""
        samples = np.arange(self._next_sample, self._next_sample + len(signal))
        for halver in self._halvers:
            halved = np.empty(len(signal) // 2 + 1)
            signal = halved[: conditioning.halve(signal, halver, halved)]
        out = self._new_columns(len(signal))
        self._run(signal, out)
        known = tuple(np.concatenate(pair) for pair in zip(self._last, out, strict=True))
        self._last = tuple(column[-1:] for column in known)
        decimation = 2 ** len(self._halvers)  # the first of so many samples makes an output
        made = samples // decimation + 1
        made_before = (self._next_sample - 1) // decimation + 1
        return tuple(column[made - made_before] for column in known)

    def _frame(self) -> OdpFrame:
        frequency, damping, frequency_sd, damping_sd, status = (column[: self._filled] for column in self._columns)
        p, q = self._settings.orders
        if self._poles.known[0]:
            modal_shares(p, q, self._recursion.theta, self._poles.factors, self._poles.roots, self._shares)
        frame = OdpFrame(
            channel=self._channel,
            first_sample=self._next_sample - self._filled,
            sample_rate_hz=self._settings.sample_rate_hz,
            frequency_hz=frequency,
            damping_ratio=damping,
            frequency_sd_hz=frequency_sd,
            damping_sd=damping_sd,
            status=status,
            share=self._shares.copy(),
            rms=self._rms(),
            lost=self._lost,
            flags=self._flags,
        )
        self._columns = self._new_columns(self._interval)
        self._filled = 0
        self._lost = 0
        self._flags = Flag.NONE
        return frame

    def _rms(self) -> float:
        """Root mean square of what was measured in the frame; summed at once, or the cuts between blocks would show."""
        signal = self._signal[: self._filled]
        usable = np.abs(signal) < rarma.LARGEST_SAMPLE
        if not usable.all():
            signal = signal[usable]
        return float(np.sqrt(np.mean(signal * signal))) if len(signal) else 0.0

    def _new_columns(self, n: int) -> Columns:
        """Room for frequency, damping, their standard deviations, and status of n samples."""
        shape = (n, self._settings.modes)
        return (*(np.empty(shape, np.float32) for _ in range(4)), np.empty(shape, np.uint8))
