"""How loud a cut is, against what it was: what is suspected is chatter when it gets loud, and is so until it is quiet.

A line that is suspected takes its time to be certain; where all that does not turn with the spindle has grown many
times louder with it, there is nothing to wait for. And what chatters is limited by the tool leaving the cut, and then
jumps between lines and loses its coherence for a while, or catches on the teeth, and is taken out with what turns. None
of that ends it: as long as the power stays far above what it was before, and does not fall far below what it was in the
alarm, the alarm goes on; and again, where it has been quieter for a moment only.
"""

from __future__ import annotations

import statistics
from collections import deque

from chatter_monitor.kernels.vibrations import AVERAGING
from chatter_monitor.verdict.irregularity import REPEATED
from chatter_monitor.verdict.recent import Recent

# Seconds of calm cutting that "usual" is the median of; with fewer there is no telling.
USUAL_S, LEAST_S = 5.0, 1.0
# The odds that something is chatter, times how many times as loud as usual it is: from so many on, for so many seconds,
# an alarm begins, if it is so many times as loud at all. The surer it is, the less loud it has to be.
SURE_ENOUGH, SUSPECTED_S, LOUD = 6.0, 0.25, 4.0
# What is so many times as loud as in the last intervals has not grown, but where a cut was heard: it is another one, or
# the first. A cut repeats; noise of a room does not.
LEAP, AT_ONCE = 16.0, 2
# An alarm as long as this, in seconds, has told how loud what chatters is.
TELLING_S = 0.5
# How many times the usual power it is still; and which share of that in the alarm.
STILL_LOUD, STILL_THERE = 5.0, 0.3
# Seconds within which an alarm that has got quieter goes on if it is as loud again.
QUIETER_S = 1.0
# What turns with up to so many times its usual power is no chatter that has caught on the teeth.
AS_TURNING = 2.0
# Least weight of an interval in the average of the power in an alarm.
LASTING = 0.02


class Loudness:
    """Power of what does not turn, of one channel, from interval to interval.

    Parameters
    ----------
    interval_s : float
        Length of an interval.

    Attributes
    ----------
    usual : float
        Power of calm cutting, of this cut if enough of it was heard, or of the one before; 0 where it is not known.
    rise : float
        How many times that it is now, with what has caught on the teeth if that keeps an alarm; 0 where that is not
        known.
    """

    def __init__(self, interval_s: float) -> None:
        self.usual = self._usual_turning = 0.0
        kept = round(USUAL_S / interval_s)
        self._calm, self._turning, self._repeating = (Recent(kept) for _ in range(3))  # of this cut
        self._since = 0  # how many of them, the newest, came since a leap
        self._last = deque[float](maxlen=AT_ONCE)
        self._least, self._telling = round(LEAST_S / interval_s), round(TELLING_S / interval_s)
        self._enough = round(SUSPECTED_S / interval_s)
        self._now: float | None = None
        self._with_caught = 0.0  # the same with what has caught on the teeth
        self.rise = 0.0
        self._moment = round(QUIETER_S / interval_s)
        self._suspected = 0
        self._alarmed, self._in_alarm = 0, 0.0
        self._quieter = 0  # intervals since an alarm was as loud

    def rest(self) -> None:
        """Nothing is cut, or a cut begins."""
        self._calm.clear()
        self._turning.clear()
        self._repeating.clear()
        self._since = 0
        self.forget()

    def forget(self) -> None:
        """Take what is loud as explained: no alarm goes on for it."""
        self._suspected, self._alarmed, self._now, self.rise = 0, 0, None, 0.0

    def hear(
        self, power: float, turning: float, repeating: float, *, alarm: bool, odds: float, calm: bool, outlasts: bool
    ) -> bool:
        """Hear an interval of cutting.

        Parameters
        ----------
        power, turning : float
            Of what does not turn, and of what does.
        repeating : float
            Share of all power that repeats.
        alarm, calm : bool
            Whether a line is an alarm; or none is at all likely to be chatter: only that is usual.
        odds : float
            That what has got louder is chatter; 0 for nothing.
        outlasts : bool
            Whether what turns does not explain the alarm, by its `Origin`: all of it may be chatter.

        Returns
        -------
        bool
            Whether it is an alarm for its loudness.
        """
        if self._last and power > LEAP * max(self._last) and not self.is_cut:
            self._since = 0
        self._last.append(power)
        # of a cut that was not heard without an alarm since it leapt nobody knows what turns anyway, or how loud it is
        known = self._since >= self._least
        caught = turning - AS_TURNING * self._usual_turning if known or outlasts else 0.0
        with_caught = power + max(caught, 0.0)
        if self._now is None:
            self._now, self._with_caught = power, with_caught
        self._now += AVERAGING * (power - self._now)
        self._with_caught += AVERAGING * (with_caught - self._with_caught)
        # it has grown if it is loud against what this cut was since it leapt
        grown = known and odds > 0.0 and self._now > max(LOUD, SURE_ENOUGH / odds) * self._usual_since_leap()
        self._suspected = self._suspected + 1 if grown else 0
        begins = self._suspected >= self._enough
        loud = self._now if alarm or begins else self._with_caught
        self.rise = loud / self.usual if self.usual > 0.0 else 0.0
        if alarm or begins:
            self._quieter = 0
            self._alarmed += 1
            self._in_alarm += max(1.0 / self._alarmed, LASTING) * (with_caught - self._in_alarm)
            return begins
        told = self._alarmed >= self._telling
        if told and self.rise > STILL_LOUD and self._with_caught > STILL_THERE * self._in_alarm:
            self._quieter = 0
            return True
        self._quieter += 1
        if told and self._quieter < self._moment:
            return False
        self._alarmed = 0
        if calm:
            self._calm.append(power)
            self._turning.append(turning)
            self._repeating.append(repeating)
            self._since += 1
            if len(self._calm) >= self._least:
                self.usual, self._usual_turning = self._calm.median, self._turning.median
        return False

    @property
    def is_cut(self) -> bool:
        """Whether what was usual so far is a cut's."""
        return len(self._repeating) >= self._least and self._repeating.median >= REPEATED

    def _usual_since_leap(self) -> float:
        """Power of calm cutting since it leapt, or of all that is kept."""
        return statistics.median(self._calm.last(self._since))
