"""Whether what an alarm is about has grown out of a mode of this very cut, and whether what turns explains it then.

A mode that noise drives comes and goes where it will chatter; a line of something that turns is steady, or is not there
before the tool is. So a comb that is found after something has grown out of a mode does not explain that, if a cut that
repeated was heard before, or if the comb is that of the vibration itself: its overtones, and nothing else of any power.
An idle machine rings, too, and teeth may meet its mode when they enter; then the other lines of the comb tell.
"""

from __future__ import annotations

import math

from chatter_monitor.tracking.orders import Orders
from chatter_monitor.verdict.opinion import SAME_VIBRATION
from chatter_monitor.verdict.vibrations import Told

# What has grown is an alarm within so many seconds.
SOON_S = 0.5
# A comb is a vibration's own if so much of its power is in that and its overtones.
OWN = 0.99


class Origin:
    """What grew out of a mode in one channel, and whether the alarm that goes on is about that.

    Parameters
    ----------
    interval_s : float
        Length of an interval.
    """

    def __init__(self, interval_s: float) -> None:
        self._soon = round(SOON_S / interval_s)
        self._grown_hz, self._since = math.nan, 0  # what grew last, and intervals since
        self._hertz = math.nan  # of what the alarm is about
        self._in_cut = False  # whether that repeated, before it grew
        self._is_mode = False  # whether the alarm, which may just have ended, is about what grew

    def rest(self) -> None:
        """Nothing is cut, or a cut begins: what grew before is over."""
        self._grown_hz = math.nan

    def hear(self, grown_hz: float | None, told: Told, *, is_cut: bool, by_line: bool, goes_on: bool) -> None:
        """Hear another interval of cutting.

        Parameters
        ----------
        grown_hz : float or None
            Frequency of what has just grown out of a mode, if anything has.
        told : Told
            Of its vibrations.
        is_cut : bool
            Whether what was usual until now was a cut's, for all that is known.
        by_line, goes_on : bool
            Whether a line makes it an alarm, and whether the interval before was one.
        """
        self._since += 1
        if grown_hz is not None:
            self._grown_hz, self._since, self._in_cut = grown_hz, 0, is_cut
        alarm = told.alarm
        if alarm is not None:
            self._hertz = alarm.frequency_hz
        self._is_mode = (self._is_mode and goes_on) or (by_line and self._has_grown)

    @property
    def _has_grown(self) -> bool:
        """Whether the alarm is about what grew just now."""
        return self._since <= self._soon and abs(math.log(self._hertz / self._grown_hz)) < SAME_VIBRATION

    def outlasts(self, orders: Orders) -> bool:
        """Whether the alarm goes on whatever is found that turns: that does not explain it."""
        return self._is_mode and (self._in_cut or self._own_share(orders) >= OWN)

    def _own_share(self, orders: Orders) -> float:
        """Share of what turns that is in orders which the vibration has itself, as far as that is known."""
        turning = sum(line.rms**2 for line in orders.lines)
        if orders.rotation_hz is None or not turning > 0.0:
            return 0.0
        first = max(round(self._hertz / orders.rotation_hz), 1)
        return sum(line.rms**2 for line in orders.lines if line.order % first == 0) / turning
