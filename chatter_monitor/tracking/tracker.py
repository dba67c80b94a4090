"""One channel's tracker: samples in, frames of operational dynamic parameters out."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from chatter_monitor.kernels import octaves as kernel
from chatter_monitor.kernels.slots import new_slots
from chatter_monitor.records import Flag, OdpFrame
from chatter_monitor.tracking.bands import homes

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
        Orders of A, 2, 4, 6 or 8, and of C, up to 6. (4, 3) is the paper's choice: two modes, and zeros for
        what is between them.
    memory_ms : float
        Time constant of the exponential forgetting. The effective window is twice as long. At least
        ten samples for each coefficient.
    sample_rate_hz : float
        Rate at which the tracker runs; inputs are converted to it.
    bands : int
        Octaves that have a recursion of their own, at most, from the top downwards; each answers for the middle of
        its band. Those in which the memory is too short for the coefficients are left out.
    high_pass_hz : float
        Corner, below half the rate, under which the signal is offset and drift, not vibration. A first-order high-pass
        costs C one zero and frees a pair of poles that would otherwise be spent on the offset.
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
        first_octave = 0 if source_rate_hz is None else max(0, math.ceil(math.log2(rate / source_rate_hz)))
        known = math.floor(math.log2(settings.samples_per_coefficient / SAMPLES_PER_COEFFICIENT))
        end = min(first_octave + settings.bands, known + 1)
        octaves = range(first_octave, max(end, first_octave + 1))
        self._octaves = kernel.new_state(*settings.orders, octaves, settings.memory_ms * 1e-3, rate, self._interval)
        self._slots = new_slots(np.array(homes(rate, octaves)), settings.orders[0] // 2, settings.modes)
        corner = 2 * np.pi * settings.high_pass_hz / rate
        self._advance = kernel.advancing(*settings.orders, first_octave, corner, self._octaves)
        self._complete = kernel.completing(*settings.orders, first_octave, self._octaves, self._slots)
        self._next_sample = 0
        self._filled = 0
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
            if flags:  # an enumeration takes its time to join nothing to nothing
                self._flags |= flags
            self._lost += min(lost, size)
            lost -= min(lost, size)
            begin += size
            if self._filled == self._interval:
                yield self._frame()

    def _track(self, samples: NDArray[np.float64]) -> None:
        """Fill in the ODPs of consecutive samples that fit into the frame."""
        self._advance(np.ascontiguousarray(samples, np.float64), self._filled)
        self._filled += len(samples)
        self._next_sample += len(samples)

    def _frame(self) -> OdpFrame:
        first_sample = self._next_sample - self._filled
        signal = self._octaves.signal[: self._filled].copy()
        rms = kernel.root_mean_square(signal)
        odps = kernel.new_columns(self._settings.modes, self._filled)
        self._complete(first_sample, odps)
        powers = self._slots.power
        total = max(rms * rms, sum(powers.tolist()))  # of four numbers NumPy's sum takes ten times as long
        frame = OdpFrame(
            channel=self._channel,
            first_sample=first_sample,
            sample_rate_hz=self._settings.sample_rate_hz,
            frequency_hz=odps.frequency.T,
            damping_ratio=odps.damping.T,
            frequency_sd_hz=odps.frequency_sd.T,
            damping_sd=odps.damping_sd.T,
            status=odps.status.T,
            share=powers / total if total > 0.0 else powers.copy(),
            signal=signal,
            hold=self._slots.hold.copy(),
            rms=rms,
            lost=self._lost,
            flags=self._flags,
        )
        self._filled = 0
        self._lost = 0
        self._flags = Flag.NONE
        return frame
