"""Whether a pass is as the ones before, but for power that is new: chatter from the first contact on.

Who goes on with a job, a little deeper, may hear chatter as soon as the tool is in the cut. Nothing is seen to grow
then, and a line that comes with a tool may be forced. But where it is the same cut as before (`verdict.same_cut`),
power that is new is forced by nothing that was there. No speed has to be told for that, nor a comb to be found, nor
does it matter whether chatter is near an order.

Nothing is told in a first pass, nor in that of a new job, nor where nothing that can be heard forces the cut.
"""

from __future__ import annotations

import math
from collections import deque
from statistics import fmean, median

import numpy as np

from chatter_monitor.tracking.long_spectrum import LENGTH_S, OVERLAP, SILENCE, Power
from chatter_monitor.verdict.cumulative import CumulativeSum
from chatter_monitor.verdict.same_cut import New, SameCut

# A tool enters, or leaves, within so long; what is heard in a spectrum is to be cut, or air, all along.
ENTERING_S = 0.1
# A pass of which so many spectra are calm can be compared with; so many of the latest are remembered.
FEWEST, REMEMBERED = 5, 40
# What comes within so many seconds before an alarm may have been chatter, too.
BEFORE_ALARM_S = 1.0
# What a spectrum counts in which the cut is the same, and one in which it is not heard to be; and within which bounds
# their sum stays. A pass is the same as long as that is positive.
SAME, NOT_SAME, SURELY = 2, -1, 5
# A share of new power that speaks for chatter, and by how much it has to be beyond that, summed over spectra.
BETWEEN, ENOUGH = 0.2, 0.25


class FormerPasses:
    """Passes of one channel, and the air between.

    Parameters
    ----------
    interval_s : float
        Length of an interval.
    """

    def __init__(self, interval_s: float) -> None:
        self._whole = round((LENGTH_S + ENTERING_S) / interval_s)
        self._cutting, self._since = False, 0  # and for how many intervals
        self._air: Power | None = None  # largest powers in the last air
        self._remembered: list[Power] = []
        self._before: SameCut | None = None
        self._calm = deque[Power](maxlen=REMEMBERED)  # of this pass
        self._unsure = deque[Power](maxlen=round(BEFORE_ALARM_S / LENGTH_S * OVERLAP))  # until nothing follows
        self._powers = deque[float](maxlen=round(LENGTH_S / interval_s))  # of the intervals of a spectrum
        self._alarm = CumulativeSum(ENOUGH)
        self._begin()

    def rest(self, spectrum: Power | None) -> None:
        """Nothing is cut: hear the air, if there is a spectrum (`tracking.long_spectrum`)."""
        if self._cutting:
            self._end()
        self._since += 1
        if spectrum is not None and self._since >= self._whole:
            self._air = spectrum if self._air is None else np.maximum(self._air, spectrum)

    def cut(self, spectrum: Power | None, power: float, *, calm: bool) -> None:
        """Hear an interval of cutting.

        Parameters
        ----------
        spectrum : ndarray of float64, shape (bins,), or None
            That until the interval before, if there is one (`tracking.long_spectrum`).
        power : float
            Of the interval.
        calm : bool
            Whether there was no alarm just now.
        """
        if not self._cutting:
            if self._remembered and self._air is not None:
                self._before = SameCut(self._remembered, self._air)
            self._cutting, self._since = True, 0
            self._begin()
        self._since += 1
        if not calm:
            self._unsure.clear()
        if spectrum is not None and self._since >= self._whole:
            if self._before is not None:
                self._compare(spectrum, self._before)
            if calm:
                self._learn(spectrum)
        self._powers.append(power)

    @property
    def same(self) -> bool:
        """Whether this pass is the same cut as before, for all that is heard just now."""
        return self._sameness > 0

    @property
    def new(self) -> New | None:
        """What is new in this pass, if that is an alarm."""
        return self._new if self._alarm.certain else None

    def _begin(self) -> None:
        """Nothing is known of a pass."""
        self._sameness, self._was_same, self._gain = 0, False, 1.0
        self._alarm.clear()
        self._new = New(0.0, math.nan)

    def _end(self) -> None:
        """Remember a pass, besides those before if it was the same cut, or else instead of them."""
        calm = [*self._calm, *self._unsure]
        if len(calm) >= FEWEST:
            before = self._remembered if self._was_same else []
            self._remembered = [*before, *calm][-REMEMBERED:]
        self._calm.clear()
        self._unsure.clear()
        self._air = None
        self._cutting, self._since = False, 0
        self._begin()

    def _learn(self, spectrum: Power) -> None:
        """Remember what was calm for long enough afterwards."""
        if len(self._unsure) == self._unsure.maxlen:
            self._calm.append(self._unsure[0])
        self._unsure.append(spectrum)

    def _compare(self, spectrum: Power, before: SameCut) -> None:
        """Tell whether it is the same cut, and what is new in it."""
        gain = before.gain(spectrum)
        if gain is not None:
            self._sameness, self._gain = min(self._sameness + SAME, SURELY), gain
        elif not self._alarm.certain:  # what chatters may drown the rest
            self._sameness = max(self._sameness + NOT_SAME, -SURELY)
        if not self.same:
            self._alarm.clear()
            return
        self._was_same = True
        self._new = before.new(spectrum, self._gain)
        # a blow makes single intervals louder, and what chatters all of them
        blows = 1.0 - min(median(self._powers) / max(fmean(self._powers), SILENCE), 1.0)
        self._alarm.add(self._new.share - blows - BETWEEN)
