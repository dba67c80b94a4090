"""How loud cutting has been: of the last cuts, not of one, so that chatter that nobody told is not soon the usual."""

from __future__ import annotations

import math

from chatter_monitor.verdict.recent import Recent

# What is now is held against the median of so many seconds of cutting without an alarm; with fewer there is no telling.
REMEMBERED_S, LEAST_S = 20.0, 1.0


def louder(power: float, before: float) -> float:
    """By how much a power is louder than another (natural logarithm of the amplitude); 0 where one of them is none."""
    return 0.5 * math.log(power / before) if before > 0.0 and power > 0.0 else 0.0


class Level:
    """Power of one channel while it cut without an alarm.

    Parameters
    ----------
    interval_s : float
        Length of an interval.
    """

    def __init__(self, interval_s: float) -> None:
        self._power = Recent(round(REMEMBERED_S / interval_s))
        self._least = round(LEAST_S / interval_s)

    def remember(self, power: float) -> None:
        """Take an interval of cutting without an alarm as usual."""
        self._power.append(power)

    def louder(self, power: float) -> float:
        """By how much so much power is louder than usual (natural logarithm of the amplitude); 0 if that is unknown."""
        return louder(power, self._power.median) if len(self._power) >= self._least else 0.0
