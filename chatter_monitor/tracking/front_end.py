"""The first stages of one channel: what turns is taken out, and the rest goes through the recursion."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.records import Flag, OdpFrame
from chatter_monitor.tracking.orders import Orders, OrderSettings, OrderTracker
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.tracking.tracker import Tracker, TrackerSettings


class Tracked(NamedTuple):
    """One interval of one channel: operational dynamic parameters of what does not turn, and what does."""

    odp: OdpFrame
    orders: Orders


class FrontEnd:
    """Does half of the work on a channel. Nothing in it depends on what comes later: it may run ahead of that.

    Parameters
    ----------
    tracker : TrackerSettings
        Of the recursion.
    orders : OrderSettings
        Of the spindle-synchronous part.
    spindle : SpindleSettings
        Speed and teeth, where known.
    channel : int
        Number that the frames carry.
    source_rate_hz : float, optional
        Rate at which the signal was sampled first.
    """

    def __init__(
        self,
        tracker: TrackerSettings,
        orders: OrderSettings,
        spindle: SpindleSettings,
        channel: int = 0,
        source_rate_hz: float | None = None,
    ) -> None:
        self._orders = OrderTracker(orders, tracker.sample_rate_hz, spindle, turn=channel)
        self._tracker = Tracker(tracker, channel, source_rate_hz)
        self._waiting: deque[Orders] = deque()

    def set_spindle(self, spindle: SpindleSettings) -> None:
        """Go by another speed or number of teeth from now on."""
        self._orders.set_spindle(spindle)

    def process(self, first_sample: int, samples: NDArray[np.float64], flags: Flag = Flag.NONE) -> list[Tracked]:
        """Take samples and return the intervals that they complete.

        Parameters
        ----------
        first_sample : int
            Index of the first one; what was skipped since the last call is lost.
        samples : ndarray of float64, shape (n,)
            The signal.
        flags : Flag
            What is wrong with these samples.
        """
        if flags & Flag.NON_FINITE:
            samples = np.full(len(samples), np.nan)  # they are placeholders, not measurements
        residual, orders = self._orders.process(first_sample, samples)
        self._waiting.extend(orders)
        return self._tracked(self._tracker.process(first_sample, residual, flags))

    def digest(self) -> None:
        """Learn from the interval and look for combs: before the next sample in any case, better when nobody waits."""
        self._orders.digest()

    def finish(self) -> list[Tracked]:
        """Return what remains as a last, shorter interval, if anything does."""
        self._waiting.extend(self._orders.finish())
        return self._tracked(self._tracker.finish())

    def _tracked(self, frames: Iterator[OdpFrame]) -> list[Tracked]:
        return [Tracked(odp, self._waiting.popleft()) for odp in frames]
