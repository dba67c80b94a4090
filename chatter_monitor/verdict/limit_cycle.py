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
from statistics import fmean
from typing import NamedTuple

from chatter_monitor.kernels.kinds import LOUDER
from chatter_monitor.kernels.limit_cycle import LEAST_SHARE, MOST_REPEATING
from chatter_monitor.tracking.spectrum import Cycle
from chatter_monitor.verdict.recent import Recent

# What is now is the mean over so many seconds; the level of a cut the lowest median of so many, before that.
NOW_S, LEVEL_S = 0.5, 1.0


class Rules(NamedTuple):
    """What is asked for.

    Attributes
    ----------
    dispersion, foretold, repeating : float
        Of the amplitude, of the phase, and the share of all power that repeats: at most.
    share : float
        Of all power that is in the band, at least.
    louder : float
        By how much louder than its level the cut is, at least (natural logarithm of the amplitude).
    """

    dispersion: float
    foretold: float
    repeating: float
    share: float
    louder: float


# An amplitude that varies half as much as that of noise; and for as long as the alarm goes on.
BEGINS = Rules(dispersion=0.5, foretold=0.85, repeating=0.5, share=0.5, louder=LOUDER)
GOES_ON = Rules(dispersion=0.65, foretold=0.9, repeating=MOST_REPEATING, share=LEAST_SHARE, louder=0.5 * LOUDER)


class Heard(NamedTuple):
    """Numbers of an interval: those of its band, its share of all power, what repeats of that, and how loud it is."""

    dispersion: float
    foretold: float
    repeating: float
    share: float
    level: float


class LimitCycle:
    """Follows one channel from interval to interval.

    Parameters
    ----------
    interval_s : float
        Length of an interval.
    """

    def __init__(self, interval_s: float) -> None:
        self._now = deque[Heard](maxlen=round(NOW_S / interval_s))
        self._levels = Recent(round(LEVEL_S / interval_s))
        self._enough = round(LEVEL_S / interval_s)
        self._lowest = deque[float](maxlen=round(NOW_S / interval_s))
        self._goes_on = False

    def rest(self) -> None:
        """Nothing is cut, or a cut begins."""
        self._now.clear()
        self._levels.clear()
        self._lowest.clear()
        self._goes_on = False

    def hear(self, cycle: Cycle | None, power: float, rest: float, repeating: float) -> float:
        """Hear an interval of cutting.

        Parameters
        ----------
        cycle : Cycle or None
            What the loudest band keeps.
        power, rest : float
            Of the signal, and of what does not turn.
        repeating : float
            Share of the former that repeats.

        Returns
        -------
        float
            How many times its lowest power the cut has, if this is an alarm; 0 if not.
        """
        level = 0.5 * math.log(power) if power > 0.0 else -math.inf
        rise = self._rise(level)
        if cycle is None:
            self._now.clear()
            self._goes_on = False
            return 0.0
        self._now.append(Heard(cycle.dispersion, cycle.foretold, repeating, cycle.share * rest / power, level))
        if len(self._now) < (self._now.maxlen or 0):
            return 0.0
        now = Heard(*map(fmean, zip(*self._now, strict=True)))
        self._goes_on = _keeps(now, rise, GOES_ON if self._goes_on else BEGINS)
        return math.exp(2.0 * rise) if self._goes_on else 0.0

    def _rise(self, level: float) -> float:
        """By how much the mean level of now is above the lowest before; 0 as long as that is not known."""
        before = self._lowest[0] if len(self._lowest) == self._lowest.maxlen else math.inf
        self._levels.append(level)
        if len(self._levels) >= self._enough:
            self._lowest.append(min(self._levels.median, self._lowest[-1] if self._lowest else math.inf))
        return max(0.0, fmean(self._levels.last(self._lowest.maxlen or 0)) - before) if before < math.inf else 0.0


def _keeps(now: Heard, rise: float, rules: Rules) -> bool:
    """Whether a vibration keeps its amplitude and not its phase, takes the power, and has made the cut louder."""
    return (
        now.dispersion <= rules.dispersion
        and now.foretold <= rules.foretold
        and now.repeating <= rules.repeating
        and now.share >= rules.share
        and rise >= rules.louder
    )
