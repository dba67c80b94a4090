"""Whether an alarm is withdrawn: what it was about turns out to be on the orders of a spindle that was not heard yet.

A tool that enters its first cut brings a forced line out of nothing, within a tenth of a second. Where that line may be
told from an order only by a speed that is known to some per cent, or not at all, it is taken for chatter, because
chatter may be as quick, and nobody can wait for the second in which the spindle becomes heard. Then it can be told. But
chatter slips onto orders, too, and a comb may be found in its overtones: what was seen to climb stays an alarm, and so
does what grew out of a mode.
"""

from __future__ import annotations

from chatter_monitor.tracking.orders import Source
from chatter_monitor.verdict.vibrations import Told


class Withdrawal:
    """What is known of the alarm of one channel that goes on."""

    def __init__(self) -> None:
        self._heard_since = self._climbed = False  # since the alarm began

    def hear(
        self, sources: tuple[Source | None, Source | None], told: Told, *, by_line: bool, goes_on: bool, outlasts: bool
    ) -> bool:
        """Hear another interval of cutting.

        Parameters
        ----------
        sources : tuple of str or None
            How the speed was known in the interval before, and is in this one.
        told : Told
            Of its vibrations.
        by_line, goes_on : bool
            Whether a line makes it an alarm, and whether the interval before was one.
        outlasts : bool
            Whether what turns does not explain it, by its `Origin`.

        Returns
        -------
        bool
            Whether the alarm is withdrawn.
        """
        begins_to_be_heard = newly_found(*sources) or sources == ("given", "refined")
        self._heard_since = (self._heard_since and goes_on) or begins_to_be_heard
        self._climbed = (self._climbed and goes_on) or (by_line and told.climbs)
        over = goes_on and not by_line
        return over and self._heard_since and not (self._climbed or outlasts) and told.only_orders_chattered


def newly_found(before: Source | None, now: Source | None) -> bool:
    """Whether a comb is found that was not, of a speed that nobody told or that is not the one that was told."""
    return now == "found" and before != "found"
