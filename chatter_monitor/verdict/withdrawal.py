"""Whether an alarm is withdrawn: what it was about turns out to be on the orders of a spindle that was not heard yet.

A tool that enters its first cut brings a forced line out of nothing, within a tenth of a second. Where that line may be
told from an order only by a speed that is known to some per cent, or not at all, it is taken for chatter, because
chatter may be as quick, and nobody can wait for the second in which the spindle becomes heard. Then it can be told. But
chatter slips onto orders, too, and a comb may be found in its overtones: what was seen to climb stays an alarm.
"""

from __future__ import annotations

from chatter_monitor.tracking.orders import Orders, Source
from chatter_monitor.verdict.vibrations import Told


class Withdrawal:
    """What is known of the alarm of one channel that goes on."""

    def __init__(self) -> None:
        self._source: Source | None = None
        self._heard_since = self._climbed = False  # since the alarm began

    def hear(self, orders: Orders, told: Told, *, by_line: bool, goes_on: bool) -> bool:
        """Hear another interval of cutting.

        Parameters
        ----------
        orders : Orders
            What turns in it.
        told : Told
            Of its vibrations.
        by_line, goes_on : bool
            Whether a line makes it an alarm, and whether the interval before was one.

        Returns
        -------
        bool
            Whether the alarm is withdrawn.
        """
        before, self._source = self._source, orders.source
        found = orders.source == "found" and before != "found"
        refined = orders.source == "refined" and before == "given"
        self._heard_since = (self._heard_since and goes_on) or found or refined
        self._climbed = (self._climbed and goes_on) or (by_line and told.climbs)
        over = goes_on and not by_line
        return over and self._heard_since and not self._climbed and told.only_orders_chattered
