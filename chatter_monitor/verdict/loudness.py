"""How loud a cut is before an alarm and after it: chatter is over when it gets quieter, not when it gets irregular.

What chatters is limited by the tool leaving the cut, and then jumps between lines and loses its coherence for a while.
None of that ends it. As long as the power that does not turn with the spindle stays far above what it was before, and
does not fall far below what it was in the alarm, the alarm goes on.
"""

from __future__ import annotations

import statistics
from collections import deque

from chatter_monitor.kernels.vibrations import AVERAGING

# Seconds of cutting without an alarm that "before" is the median of; with fewer there is no telling.
BEFORE_S, LEAST_S = 5.0, 1.0
# An alarm as long as this, in seconds, has told how loud what chatters is.
TELLING_S = 0.5
# How many times the power of before it is still; and which share of that in the alarm.
STILL_LOUD, STILL_THERE = 8.0, 0.25
# Least weight of an interval in the average of the power in an alarm.
LASTING = 0.02


class Loudness:
    """Power of what does not turn, of one channel, from interval to interval.

    Parameters
    ----------
    interval_s : float
        Length of an interval.
    """

    def __init__(self, interval_s: float) -> None:
        self._calm = deque[float](maxlen=round(BEFORE_S / interval_s))
        self._least, self._telling = round(LEAST_S / interval_s), round(TELLING_S / interval_s)
        self._now: float | None = None
        self._before: float | None = None
        self._alarmed, self._in_alarm = 0, 0.0

    def rest(self) -> None:
        """Nothing is cut, or a cut begins: no alarm goes on."""
        self._alarmed, self._now = 0, None

    def alarm(self, power: float) -> None:
        """Hear an interval of alarm."""
        if self._alarmed == 0:
            self._before = statistics.median(self._calm) if len(self._calm) >= self._least else None
        self._follow(power)
        self._alarmed += 1
        self._in_alarm += max(1.0 / self._alarmed, LASTING) * (power - self._in_alarm)

    def goes_on(self, power: float) -> bool:
        """Hear an interval of cutting without one; whether the alarm before it goes on all the same."""
        now = self._follow(power)
        if self.rise > STILL_LOUD and now > STILL_THERE * self._in_alarm:
            return True
        self._alarmed = 0
        self._calm.append(power)
        return False

    @property
    def rise(self) -> float:
        """How many times the power before the alarm it is now; 0 where no alarm told, or nothing before it."""
        if self._alarmed < self._telling or not self._before or self._now is None:
            return 0.0
        return self._now / self._before

    def _follow(self, power: float) -> float:
        self._now = power if self._now is None else self._now + AVERAGING * (power - self._now)
        return self._now
