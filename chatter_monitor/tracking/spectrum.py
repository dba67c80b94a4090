"""Short-time spectrum of one channel over the last second, and the lines that stand out in it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.kernels import lines
from chatter_monitor.kernels.engagement import ALONE, ENTERED, LIMIT, LONGEST, SINCE
from chatter_monitor.kernels.kinds import COHERENCE_LAG_S, coherence_damping, steady_share
from chatter_monitor.kernels.narrowband import FRAME_HOPS

# 25 ms tell lines 40 Hz apart and follow an amplitude that grows e-fold within that time. What is compared for the
# coherence has no samples in common.
WINDOW_S = COHERENCE_LAG_S
# How far back the amplitude of a line is looked at.
HISTORY_S = 1.0
LONG_S = 8.0
DECIBELS = 10.0 / math.log(10.0)
# Lines looked at in a frame.
LINES = 5
# What is below is offset and drift.
LOWEST_HZ = 50.0


class Line(NamedTuple):
    """A line of the short-time spectrum and how it has behaved.

    Attributes
    ----------
    frequency_hz : float
        Where it is, interpolated between the bins.
    share : float
        Of the power, over the last 50 ms.
    prominence_db : float
        Over the level around it.
    variation : float
        Coefficient of variation of its amplitude over half a second, zero as long as it is not known.
    growth_per_s : float
        Rate at which its amplitude grows, over the last 150 ms.
    rise, long_rise : float
        Logarithm of its present amplitude over the median of the last second, and of the last eight, beyond what its
        surroundings have risen: a cut that begins or grows louder lifts everything.
    absolute_rise : float
        The long rise with what the surroundings have risen.
    coherence : float
        Largest correlation of its complex amplitude after 25 to 75 ms: exp(-zeta omega t) after 25 ms for a mode that
        noise drives; what beats regains it later.
    news : float
        Logarithm of its present amplitude over that in the cuts before this one and in the air between, beyond what its
        surroundings have risen; 0 where that has not been heard.
    arrival : float
        The same over all that was heard before the tool entered, cuts or air: what came with the tool.
    """

    frequency_hz: float
    share: float
    prominence_db: float
    variation: float
    growth_per_s: float
    rise: float
    long_rise: float
    absolute_rise: float
    coherence: float
    news: float = 0.0
    arrival: float = 0.0

    @property
    def steady_share(self) -> float:
        """Share of the power that is in this line and does not come and go as that of noise does."""
        return float(steady_share(self.share, self.variation))

    @property
    def damping_ratio(self) -> float:
        """Damping that the loss of coherence within 25 ms would have; what else there is in the line adds to it."""
        return float(coherence_damping(self.coherence, self.frequency_hz))


class Cycle(NamedTuple):
    """What the loudest band of the last second keeps: its amplitude, its phase (`kernels.limit_cycle`).

    Attributes
    ----------
    frequency_hz : float
        Middle of the band.
    share : float
        Of the power.
    dispersion : float
        Of its amplitude: 1 as that of noise, 0 of a steady one.
    foretold : float
        How alike its phase advances from one moment to the next: 1 where a force keeps it.
    """

    frequency_hz: float
    share: float
    dispersion: float
    foretold: float


class Spectrum:
    """The latest transforms of a signal that comes in frames, and the lines that stand out in them.

    Parameters
    ----------
    sample_rate_hz : float
        Of the signal.
    interval : int
        Samples of a whole frame.
    """

    def __init__(self, sample_rate_hz: float, interval: int) -> None:
        hop = interval // FRAME_HOPS
        hop_s = hop / sample_rate_hz
        hops = round(HISTORY_S / hop_s)
        window = np.hanning(round(WINDOW_S * sample_rate_hz) + 1)[:-1]
        self._state = lines.new_state(window, interval, hops, round(LONG_S * hops / HISTORY_S) // FRAME_HOPS)
        self._measures = np.zeros((LINES, lines.MEASURES))
        self._bin_hz = bin_hz = sample_rate_hz / len(self._state.turns)
        self._units = np.ones(lines.MEASURES)  # of the kernel, which counts in bins and hops
        self._units[[lines.BIN, lines.PROMINENCE, lines.GROWTH]] = bin_hz, DECIBELS, 1.0 / hop_s
        self._find = lines.finding(
            hop, round(LOWEST_HZ / bin_hz), self._state, np.zeros(LINES, np.int64), self._measures
        )

    @property
    def cutting(self) -> bool:
        """Whether the tool is in the cut, as far as is known (`kernels.engagement`)."""
        return bool(self._state.air[ENTERED] >= LONGEST)

    @property
    def entering(self) -> bool:
        """Whether it is not in the cut yet, but in the air no more: louder than that, from the frame on that tells."""
        state = self._state
        power = state.totals[(state.counts[lines.FRAMES] - 1) % len(state.totals)]
        return not self.cutting and bool(state.air[SINCE] > 0 or power > state.air[LIMIT])

    @property
    def alone(self) -> bool:
        """Whether of the cut before this air nothing was heard but lines: they came and left with the tool."""
        return bool(self._state.air[ALONE])

    @property
    def grown(self) -> bool:
        """Whether the line that stands out most in the newest frame has grown out of a mode (`kernels.hump`)."""
        return bool(self._state.counts[lines.GROWN])

    @property
    def cycle(self) -> Cycle | None:
        """What the loudest band of the last second keeps; None where it is not worth asking."""
        middle, *told = self._state.cycle.tolist()
        return None if math.isnan(middle) else Cycle(middle * self._bin_hz, *told)

    def take(
        self,
        signal: NDArray[np.float64],
        *,
        alike: bool = True,
        turns: bool = False,
        whole: float = 1.0,
        repeating: float = 0.0,
        fainter: bool = False,
    ) -> NDArray[np.float64]:
        """Take the samples of the next frame and return its lines, rows of `Line`, most prominent first.

        Parameters
        ----------
        signal : ndarray of float64, shape (n,)
            NaN where samples are missing.
        alike : bool
            Whether it is the signal that it was: not if what had been taken out of it is in it again. Then nothing has
            risen out of what was before.
        turns : bool
            Whether something that turns has been taken out of it.
        whole : float
            Power with that, before it was taken out: where it is as much as before, the tool has not left.
        repeating : float
            Share of this that repeats.
        fainter : bool
            Whether it has got fainter and the tool has not left: the cut is lighter, or a comb is taken out of it now.
        """
        heard = alike, turns, whole, repeating, fainter
        count = self._find(np.ascontiguousarray(signal, np.float64), *heard)
        lines: NDArray[np.float64] = self._measures[:count] * self._units
        return lines
