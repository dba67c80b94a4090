"""Whether cutting is as it was earlier, in this pass and in those before, but for power that is new.

Where it is the same cut as before (`verdict.same_cut`), power that is new is forced by nothing that was there. No speed
has to be told for that, nor a comb to be found, nor does it matter whether chatter is near an order, or what of it is
coherent.

- *Within a pass:* a deeper cut makes all of it louder alike. What gets louder beyond that has begun by itself, also
  where it swings onto the orders at once, or is in no line.
- *From pass to pass:* who goes on with a job, a little deeper, may hear chatter as soon as the tool is in the cut. Then
  nothing is seen to grow, and a line that comes with a tool may be forced.

Nothing is told in the first seconds of a first pass, nor in those of a new job, nor where nothing that can be heard
forces the cut. And nothing new is believed while a spindle that was heard in this pass has not been for longer than
chatter needs to drown it and to be told: it may turn at another speed, and wake another mode.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from statistics import fmean, median

import numpy as np

from chatter_monitor.tracking.long_spectrum import LENGTH_S, OVERLAP, SILENCE, Power
from chatter_monitor.verdict.comparison import Comparison
from chatter_monitor.verdict.same_cut import New, SameCut

# A tool enters, or leaves, within so long; what is heard in a spectrum is to be cut, or air, all along.
ENTERING_S = 0.1
# A pass of which so many spectra are calm can be compared with, by itself with so many; so many of the latest are
# remembered.
FEWEST, FEWEST_HERE, REMEMBERED = 5, 10, 40
# A speed that is told is as near (natural logarithm) to the one that is heard.
SAME_ROTATION = 0.04
# A comb that chatter drowns is lost for no longer when that is told.
LOST_S = 1.25
# What comes within so many seconds before an alarm may have been chatter, too.
BEFORE_ALARM_S = 1.0


class Earlier:
    """Passes of one channel, and the air between.

    Parameters
    ----------
    interval_s : float
        Length of an interval.
    """

    def __init__(self, interval_s: float) -> None:
        self._whole = round((LENGTH_S + ENTERING_S) / interval_s)
        self._cutting, self._since = False, 0  # and for how many intervals
        self._entering = False
        self._air: Power | None = None  # largest powers in the last air
        self._remembered: list[Power] = []
        self._turned_hz: float | None = None  # the spindle, where it was heard last in those passes
        self._turns_hz: float | None = None  # the same of this one
        self._lost_for, self._drowned = 0, round(LOST_S / interval_s)  # intervals since; as many as may be chatter's
        self._calm = deque[Power](maxlen=REMEMBERED)  # of this pass
        self._renewed = 0  # so many of them ago its own comparison was
        self._unsure = deque[Power](maxlen=round(BEFORE_ALARM_S / LENGTH_S * OVERLAP))  # until nothing follows
        self._powers = deque[float](maxlen=round(LENGTH_S / interval_s))  # of the intervals of a spectrum
        self._passes: Comparison | None = None  # with the passes before
        self._here: Comparison | None = None  # with the same pass
        self._goes_on = False  # whether what is new is an alarm

    def begin_job(self) -> None:
        """Forget all but the air: what follows is another cut, however alike a few of its lines may be."""
        self._remembered = []
        self._turned_hz = None
        self._passes = None
        self._forget_pass()

    def rest(self, spectrum: Power | None) -> None:
        """Nothing is cut: hear the air, if there is a spectrum (`tracking.long_spectrum`)."""
        if self._cutting:
            self._end()
        self._since += 1
        if spectrum is not None and self._since >= self._whole:
            self._hear_air([spectrum])

    def cut(
        self, spectrum: Power | None, power: float, rotation_hz: float | None, *, calm: bool, entering: bool = False
    ) -> None:
        """Hear an interval of cutting.

        Parameters
        ----------
        spectrum : ndarray of float64, shape (bins,), or None
            That until the interval before, if there is one (`tracking.long_spectrum`).
        power : float
            Of the interval.
        rotation_hz : float or None
            Of the spindle, where it is heard.
        calm : bool
            Whether there was no alarm just now.
        entering : bool
            Whether the tool enters just now: what was heard until it did was none of this cut, but the air.
        """
        if not self._cutting:
            if self._remembered and self._air is not None:
                self._passes = Comparison(SameCut(self._remembered, self._air))
            self._cutting, self._since = True, 0
        elif entering and not self._entering:
            self._hear_air(self._calm)
            self._forget_pass()
        self._entering = entering
        if rotation_hz is not None:
            self._turns_hz, self._lost_for = rotation_hz, 0
        elif self._turns_hz is not None:
            self._lost_for += 1
        self._since += 1
        if not calm:
            self._unsure.clear()
        if spectrum is not None and self._since >= self._whole:
            # a blow makes single intervals louder, and what chatters all of them
            blows = 1.0 - min(median(self._powers) / max(fmean(self._powers), SILENCE), 1.0)
            for comparison in self._comparisons:
                comparison.hear(spectrum, blows)
            if calm:
                self._learn(spectrum, rotation_hz)
        self._powers.append(power)
        self._goes_on = self._alarm is not None and (self._goes_on or self._lost_for <= self._drowned)

    def _hear_air(self, spectra: Iterable[Power]) -> None:
        for spectrum in spectra:
            self._air = spectrum if self._air is None else np.maximum(self._air, spectrum)

    @property
    def same(self) -> bool:
        """Whether this pass is the same cut as those before, for all that is heard just now."""
        return self._passes is not None and self._passes.same

    def turns_the_same(self, rotation_hz: float | None) -> bool:
        """Whether it is the same cut, and the spindle was heard in the passes before to turn as it is said to now."""
        if rotation_hz is None or self._turned_hz is None:
            return False
        return self.same and abs(math.log(rotation_hz / self._turned_hz)) < SAME_ROTATION

    @property
    def new(self) -> New | None:
        """What is new in this pass, beside those before or beside what it was like, if that is an alarm."""
        return self._alarm.new if self._alarm is not None and self._goes_on else None

    @property
    def within(self) -> bool:
        """Whether that is new beside what this pass itself was like."""
        return self._alarm is not None and self._alarm is self._here

    @property
    def _comparisons(self) -> list[Comparison]:
        return [each for each in (self._passes, self._here) if each is not None]

    @property
    def _alarm(self) -> Comparison | None:
        return next((each for each in self._comparisons if each.new is not None), None)

    def _end(self) -> None:
        """Remember a pass, besides those before if it was the same cut, or else instead of them."""
        calm = [*self._calm, *self._unsure]
        if len(calm) >= FEWEST:
            same = self._passes is not None and self._passes.was_same
            before = self._remembered if same else []
            self._turned_hz = self._turns_hz or (self._turned_hz if same else None)
            self._remembered = [*before, *calm][-REMEMBERED:]
        self._forget_pass()
        self._air = None
        self._cutting, self._turns_hz, self._lost_for = False, None, 0
        self._passes = None

    def _forget_pass(self) -> None:
        """Forget what was heard of this pass."""
        self._calm.clear()
        self._unsure.clear()
        self._here, self._goes_on = None, False
        self._since = self._renewed = 0

    def _learn(self, spectrum: Power, rotation_hz: float | None) -> None:
        """Remember what was calm for long enough afterwards."""
        if len(self._unsure) == self._unsure.maxlen:
            self._calm.append(self._unsure[0])
            self._renewed += 1
            if self._renewed == FEWEST_HERE:
                self._renewed = 0
                before = SameCut(self._calm, self._air, rotation_hz)
                if self._here is None:
                    self._here = Comparison(before)
                else:
                    self._here.before = before
        self._unsure.append(spectrum)
