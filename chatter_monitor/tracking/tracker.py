"""One channel's tracker: samples in, frames of operational dynamic parameters out."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from chatter_monitor.kernels import conditioning, rarma
from chatter_monitor.records import Flag, ModeStatus, OdpFrame
from chatter_monitor.tracking.bands import Band, Columns, Slots, Vibration, homes, new_columns

# One frame is one verdict interval: long enough for a stable median, short enough for an alarm in time.
INTERVAL_S = 0.05
# An octave whose memory holds fewer is left out: its fit would be mostly chance.
SAMPLES_PER_COEFFICIENT = 10

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
    bands : int
        Octaves that have a recursion of their own, at most, from the top downwards; each answers for the middle of
        its band. Those in which the memory is too short for the coefficients are left out.
    high_pass_hz : float
        Corner below which the signal is offset and drift, not vibration. A first-order high-pass costs C one zero and
        frees a pair of poles that would otherwise be spent on the offset.
    """

    orders: tuple[Order, Order] = (4, 3)
    memory_ms: Annotated[float, msgspec.Meta(gt=0)] = 80.0
    sample_rate_hz: Annotated[float, msgspec.Meta(gt=0)] = 12800.0
    bands: Annotated[int, msgspec.Meta(ge=1, le=5)] = 4
    high_pass_hz: Annotated[float, msgspec.Meta(ge=0)] = 20.0

    def __post_init__(self) -> None:
        p, q = self.orders
        if p % 2 or not 2 <= p <= 8 or q > 6:
            msg = f"orders must be [2, 4, 6 or 8, 0 to 6], got {list(self.orders)}"
            raise ValueError(msg)
        if self.samples_per_coefficient < SAMPLES_PER_COEFFICIENT:
            msg = f"memory_ms must hold at least ten samples for each of the {p + q} coefficients, got {self.memory_ms}"
            raise ValueError(msg)
        if self.high_pass_hz >= self.sample_rate_hz / 2:
            msg = f"high_pass_hz must be below half of sample_rate_hz, got {self.high_pass_hz}"
            raise ValueError(msg)

    @property
    def samples_per_coefficient(self) -> float:
        """Samples at the full rate that the memory holds for each coefficient; half as many in each further octave."""
        return self.memory_ms * 1e-3 * self.sample_rate_hz / sum(self.orders)

    @property
    def modes(self) -> int:
        """Mode slots of each frame: those of one recursion, twice as many where there are several."""
        return self.orders[0] // 2 * (2 if self.bands > 1 else 1)


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
        first = 0 if source_rate_hz is None else max(0, math.ceil(math.log2(rate / source_rate_hz)))
        known = math.floor(math.log2(settings.samples_per_coefficient / SAMPLES_PER_COEFFICIENT))
        octaves = range(first, max(min(first + settings.bands, known + 1), first + 1))
        self._bands = [
            Band(settings.orders, settings.memory_ms * 1e-3, rate, octave, self._interval, home_hz)
            for octave, home_hz in zip(octaves, homes(rate, octaves), strict=True)
        ]
        self._halvers = [conditioning.new_half_band() for _ in range(octaves[-1])]
        self._slots = Slots(self._bands, settings.modes)
        self._high_pass = np.zeros(2)
        self._next_sample = 0
        self._filled = 0
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
        for octave, halver in enumerate([*self._halvers, None]):
            for band in self._bands:
                if band.octave == octave:
                    band.process(signal)
            if halver is not None:
                halved = np.empty(len(signal) // 2 + 1)
                signal = halved[: conditioning.halve(signal, halver, halved)]
        self._filled += len(samples)
        self._next_sample += len(samples)

    def _frame(self) -> OdpFrame:
        first_sample = self._next_sample - self._filled
        rows = [band.rows(first_sample, self._filled) for band in self._bands]
        rms = self._rms()
        vibrations = self._slots.assign(rows)
        (frequency, damping, frequency_sd, damping_sd, status), powers = self._in_slots(vibrations, rows)
        for band in self._bands:
            band.next_frame()
        total = max(rms * rms, powers.sum())
        frame = OdpFrame(
            channel=self._channel,
            first_sample=first_sample,
            sample_rate_hz=self._settings.sample_rate_hz,
            frequency_hz=frequency,
            damping_ratio=damping,
            frequency_sd_hz=frequency_sd,
            damping_sd=damping_sd,
            status=status,
            share=powers / total if total > 0.0 else powers,
            signal=self._signal[: self._filled].copy(),
            rms=rms,
            lost=self._lost,
            flags=self._flags,
        )
        self._filled = 0
        self._lost = 0
        self._flags = Flag.NONE
        return frame

    def _in_slots(
        self, vibrations: list[Vibration | None], rows: list[NDArray[np.intp]]
    ) -> tuple[Columns, NDArray[np.float64]]:
        """Columns by slot instead of by band and mode, a row for each sample of the source; the power in each slot."""
        slotted = new_columns(self._filled, len(vibrations))
        powers = np.zeros(len(vibrations))
        for slot, vibration in enumerate(vibrations):
            if vibration is None:  # as a pair of real poles: no frequency; held or starting as its neighbours
                for column in slotted[:4]:
                    column[:, slot] = np.nan
                status = self._bands[0].columns[4][rows[0], 0]
                slotted[4][:, slot] = np.where(status == ModeStatus.OSCILLATORY, ModeStatus.REAL_PAIR, status)
            else:
                powers[slot] = vibration.power
                for into, column in zip(slotted, self._bands[vibration.band].columns, strict=True):
                    into[:, slot] = column[rows[vibration.band], vibration.mode]
        return slotted, powers

    def _rms(self) -> float:
        """Root mean square of what was measured in the frame; summed at once, or the cuts between blocks would show."""
        signal = self._signal[: self._filled]
        usable = np.abs(signal) < rarma.LARGEST_SAMPLE
        if not usable.all():
            signal = signal[usable]
        return float(np.sqrt(np.mean(signal * signal))) if len(signal) else 0.0
