"""Chatter that noise shakes: it keeps its amplitude though nothing keeps its phase (`kernels.limit_cycle`).

Where a tool leaves the cut again and again just beyond the limit, or while it gets there slowly, no line is coherent
and none is seen to rise: what began was no louder than the noise that began it. But what noise drives does not keep its
amplitude, and what a force drives keeps its phase. That alone would nearly be enough; that the cut has got louder since
it began is asked for besides, for lines which a spindle takes along, or several tones in one band, may look like that
for a moment.
"""

from __future__ import annotations

import math
from collections import deque
from statistics import fmean, median

from chatter_monitor.kernels.kinds import LOUDER
from chatter_monitor.kernels.limit_cycle import LEAST_SHARE, MOST_REPEATING
from chatter_monitor.tracking.spectrum import Cycle
from chatter_monitor.verdict.cumulative import CumulativeSum
from chatter_monitor.verdict.irregularity import TINY
from chatter_monitor.verdict.recent import Recent

# The level of a cut is the lowest median of so many seconds; what is held against it the mean of so many, after that.
LEVEL_S, NOW_S = 1.0, 0.5
# A load has jumped where the median of so many seconds is so much above (natural logarithm of the amplitude) that of as
# many before, with so many between: nothing is known of the level then but from there on.
BESIDE_S, BETWEEN_S, JUMPED = 0.3, 0.1, 0.55
# A phase that is foretold better is a force's; and where most of the power repeats no alarm begins.
FORETOLD, REPEATING = 0.85, 0.5
# Dispersion of noise, and between that and a cycle's; by how much it has to be below that, summed over the intervals,
# until it is certain.
NOISE, BETWEEN, ENOUGH = 1.0, 0.65, 2.0


class LimitCycle:
    """Follows one channel from interval to interval.

    Parameters
    ----------
    interval_s : float
        Length of an interval.
    """

    def __init__(self, interval_s: float) -> None:
        self._now = round(NOW_S / interval_s)
        self._enough = round(LEVEL_S / interval_s)
        self._beside = round(BESIDE_S / interval_s)
        self._step = 2 * self._beside + round(BETWEEN_S / interval_s)
        self._levels = Recent(self._enough)
        self._lowest = deque[float](maxlen=self._now)  # up to each of the latest intervals
        self._alarm = CumulativeSum(ENOUGH)  # of what the dispersion was below

    def rest(self) -> None:
        """Nothing is cut, or a cut begins."""
        self._forget_level()
        self._alarm.clear()

    def _forget_level(self) -> None:
        self._levels.clear()
        self._lowest.clear()

    def hear(self, cycle: Cycle | None, power: float, rest: float, repeating: float) -> float:
        """Hear an interval of cutting.

        Parameters
        ----------
        cycle : Cycle or None
            What the loudest band keeps of amplitude and phase.
        power, rest : float
            Of the signal, and of what does not turn.
        repeating : float
            Share of the former that repeats.

        Returns
        -------
        float
            How many times its lowest power the cut has, if this is an alarm; 0 if not.
        """
        rise = self._rise(power)
        dispersion = NOISE
        if cycle is not None and rise >= LOUDER and repeating <= (MOST_REPEATING if self._alarm.certain else REPEATING):
            own = cycle.share * rest >= LEAST_SHARE * power and cycle.foretold <= FORETOLD
            dispersion = cycle.dispersion if own else NOISE
        self._alarm.add(BETWEEN - dispersion)
        return math.exp(2.0 * rise) if self._alarm.certain else 0.0

    def _rise(self, power: float) -> float:
        """By how much it is louder than at its lowest before (natural logarithm of the amplitude); 0 if unknown."""
        self._levels.append(0.5 * math.log(max(power, TINY)))
        if not self._alarm.certain and self._has_jumped():
            self._forget_level()
            return 0.0
        before = self._lowest[0] if len(self._lowest) == self._now else math.inf
        if len(self._levels) == self._enough:
            self._lowest.append(min(self._levels.median, self._lowest[-1] if self._lowest else math.inf))
        return max(fmean(self._levels.last(self._now)) - before, 0.0)

    def _has_jumped(self) -> bool:
        """Whether it got louder by a load, which is there at once: what gets there with the load takes seconds."""
        latest = self._levels.last(self._step)
        return len(latest) == self._step and median(latest[-self._beside :]) - median(latest[: self._beside]) > JUMPED
