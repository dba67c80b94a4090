"""How a cut goes on, held against what it was like: whether it still is the same, and whether power is new in it."""

from __future__ import annotations

from chatter_monitor.tracking.long_spectrum import Power
from chatter_monitor.verdict.cumulative import CumulativeSum
from chatter_monitor.verdict.same_cut import New, SameCut

# What a spectrum counts in which the cut is the same, and one in which it is not heard to be; and within which bounds
# their sum stays. It is the same as long as that is positive.
SAME, NOT_SAME, SURELY = 2, -1, 5
# A share of new power that speaks for chatter, and by how much it has to be beyond that, summed over spectra.
BETWEEN, ENOUGH = 0.2, 0.25
# What was new a spectrum before counts so much for where it is: its overtones may have most of it for a moment.
STILL = 0.7


class Comparison:
    """Follows a cut from spectrum to spectrum.

    Attributes
    ----------
    before : SameCut
        What it is held against.
    was_same : bool
        Whether it ever was the same.
    """

    def __init__(self, before: SameCut) -> None:
        self.before = before
        self.was_same = False
        self._sameness, self._gain = 0, 1.0
        self._alarm = CumulativeSum(ENOUGH)
        self._new: New | None = None

    def hear(self, spectrum: Power, blows: float) -> None:
        """Hear the next spectrum (`tracking.long_spectrum`), of which blows have such a share of the power."""
        gain = self.before.gain(spectrum)
        if gain is not None:
            self._sameness, self._gain = min(self._sameness + SAME, SURELY), gain
        elif self.before.gone(spectrum):
            self._sameness = min(self._sameness, 0)
        elif not self._alarm.certain:  # what chatters may drown the rest
            self._sameness = max(self._sameness + NOT_SAME, -SURELY)
        if not self.same:
            self._alarm.clear()
            return
        self.was_same = True
        new = self.before.new(spectrum, self._gain)
        self._new = new if self._new is None else New(new.share, new.bands + STILL * self._new.bands)
        self._alarm.add(new.share - blows - BETWEEN)

    @property
    def same(self) -> bool:
        """Whether it is the same cut, for all that is heard just now."""
        return self._sameness > 0

    @property
    def new(self) -> New | None:
        """What is new in it, if that is an alarm."""
        return self._new if self._alarm.certain else None
