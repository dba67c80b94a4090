"""How much louder a cut gets from one moment to the next: the first that is heard of chatter that comes suddenly.

A line needs some periods to be told from noise, and a while to be told from what turns. How loud it is needs neither,
and tells less: a harder spot makes a cut louder, too. So that is worth a warning, as long as it is news, and no alarm.
A tool that enters gets louder as well; what repeats in the room that it comes out of is next to nothing.
"""

from __future__ import annotations

from chatter_monitor.verdict.level import louder
from chatter_monitor.verdict.recent import Recent

# What is now is held against the median of so many seconds before; half of it later it is no news any more.
BEFORE_S = 0.5
# Of what a cut sounds like so much is forced at least: of the noise of a room 0.06 to 0.1 seems so.
OF_A_CUT = 0.2


class Surge:
    """Power of one channel in the last intervals of a cut.

    Parameters
    ----------
    interval_s : float
        Length of an interval.
    """

    def __init__(self, interval_s: float) -> None:
        self._enough = round(BEFORE_S / interval_s)
        self._power, self._forced_share = Recent(self._enough), Recent(self._enough)

    def rest(self) -> None:
        """Nothing is cut, or a cut begins."""
        self._power.clear()
        self._forced_share.clear()

    def hear(self, power: float, forced_share: float) -> float:
        """Hear an interval of cutting: the power of the signal, and the share of it that is forced.

        Returns
        -------
        float
            By how much it is louder than just before (natural logarithm of the amplitude); 0 where that is not known,
            or was no cut.
        """
        known = len(self._power) == self._enough and self._forced_share.median >= OF_A_CUT
        rise = louder(power, self._power.median) if known else 0.0
        self._power.append(power)
        self._forced_share.append(forced_share)
        return rise
