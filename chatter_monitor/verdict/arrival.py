"""Whether what was an alarm had come with the tool, as it enters or leaves: then it was nothing that grew in a cut.

A tool that enters its first cut beside a pump, or out of a room that was never heard without it, may be taken for
chatter, for all that is known. When it leaves there is more to go by: where all is as loud again as it was before the
alarm, nothing was cut then. Chatter comes out of a cut, and a cut that is heard leaves something quieter behind. A cut
of which nothing is heard but lines, in a room as loud between them, may be no cut, unless it was there before them.

And a tool is heard to enter a moment after it has: an alarm may be sooner.
"""

from __future__ import annotations

import math
import statistics
from collections import deque

from chatter_monitor.kernels.vibrations import FORGOTTEN_CHATTER

# Before an alarm is from so many seconds before it on, but for the last, in which it may have been growing already; at
# least as many have to be left.
BEFORE_S, GROWING_S = 2.0, 0.5
# What is within so many times the power is as loud.
AS_LOUD = 2.0
# A tool enters or leaves within a tenth of a second: so many intervals, the first or last with little of it maybe.
ENTERING = 2


class Arrival:
    """Power of one channel before the first alarm of a cut.

    Parameters
    ----------
    interval_s : float
        Length of an interval.
    """

    def __init__(self, interval_s: float) -> None:
        self._past = deque[float](maxlen=round(BEFORE_S / interval_s))
        self._growing = round(GROWING_S / interval_s)
        self._alarmed = False
        self._before: float | None = None  # power before the first alarm, if known
        self._known = True  # whether that alarm, if there was one, needed the memory of an earlier cut
        self._resting_for = 0  # intervals
        self._since_alarm = math.inf  # intervals
        self._began_at_once = False  # whether an alarm has, in the last interval, as the only one that is remembered

    def rest(self) -> None:
        """Nothing is cut, or a cut begins."""
        self._past.clear()
        self._since_alarm += 1
        self._resting_for += 1
        self._began_at_once = False

    def hear(self, power: float, *, alarm: bool, recalled: bool = False) -> None:
        """Hear an interval of cutting: its power, and whether it is an alarm, by the memory of another."""
        if not self._past:
            self._alarmed, self._before, self._known, self._resting_for = False, None, True, 0
        if alarm and not self._alarmed:
            self._alarmed, self._known = True, recalled
            before = list(self._past)[: -self._growing]
            self._before = statistics.median(before) if len(before) >= self._growing else None
        self._past.append(power)
        self._since_alarm += 1
        self._began_at_once = alarm and self._since_alarm > FORGOTTEN_CHATTER and self._was_calm()
        if alarm:
            self._since_alarm = 0

    def began_with_tool(self) -> bool:
        """Whether a tool that is heard to enter made the alarm that has just begun, the only one that is remembered.

        A tool needs a tenth of a second to enter. What grows has been louder for longer when it is taken for one.
        """
        return self._began_at_once

    def _was_calm(self) -> bool:
        """Whether it was as loud as usual just before: a tool may have begun to enter in the interval before this."""
        before = list(self._past)[:-ENTERING]
        return len(before) >= self._growing and before[-1] < AS_LOUD * statistics.median(before)

    def came_with_tool(self, power: float, *, alone: bool) -> bool:
        """Whether what the last alarm was about came with the tool, as is known while so much is heard without it.

        It came out of that, or out of nothing that is louder where the cut was heard by its lines alone. What an
        earlier cut has shown needs not to be shown by each.
        """
        if self._resting_for <= ENTERING:
            return False
        before = self._before
        if alone:
            return not (self._known if before is None else before >= power * AS_LOUD)
        return before is not None and before / AS_LOUD < power < before * AS_LOUD
