"""One channel from samples to what there is to see in each interval: orders out, recursion, lines."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.records import Flag, OdpFrame
from chatter_monitor.tracking.margin import Margin
from chatter_monitor.tracking.margin_tracker import MarginSettings, MarginTracker
from chatter_monitor.tracking.orders import Orders, OrderSettings, OrderTracker
from chatter_monitor.tracking.spectrum import Spectrum
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.tracking.tracker import INTERVAL_S, Tracker, TrackerSettings


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """One interval of one channel.

    Attributes
    ----------
    odp : OdpFrame
        Operational dynamic parameters of what does not turn with the spindle.
    orders : Orders
        What does.
    lines : ndarray of float64, shape (n, MEASURES)
        Lines of what does not, rows of `spectrum.Line`, most prominent first.
    cutting : bool
        Whether the tool is in the cut, as far as is known.
    margin : Margin
        How far the cut is from chatter, where the speed is known.
    entering : bool
        Whether it enters the cut just now.
    alone : bool
        Whether of the cut before nothing was heard but lines.
    """

    odp: OdpFrame
    orders: Orders
    lines: NDArray[np.float64]
    cutting: bool
    margin: Margin
    entering: bool = False
    alone: bool = False


class Channel:
    """Follows one channel.

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
        self._rate_hz = rate_hz = tracker.sample_rate_hz
        self._orders = OrderTracker(orders, rate_hz, spindle, turn=channel)
        self._tracker = Tracker(tracker, channel, source_rate_hz)
        self._spectrum = Spectrum(rate_hz, round(INTERVAL_S * rate_hz))
        self._waiting: deque[Orders] = deque()
        self._spindle = spindle
        self._channel = channel
        self._margin = MarginTracker(MarginSettings(), rate_hz, spindle.teeth, turn=channel)
        self._last_margin = Margin(reason="too little signal yet")

    def set_spindle(self, spindle: SpindleSettings) -> None:
        """Go by another speed or number of teeth from now on."""
        self._orders.set_spindle(spindle)
        if spindle.teeth != self._spindle.teeth:
            self._margin = MarginTracker(MarginSettings(), self._rate_hz, spindle.teeth, turn=self._channel)
        self._spindle = spindle

    def process(
        self, first_sample: int, samples: NDArray[np.float64], flags: Flag = Flag.NONE
    ) -> Iterator[Observation]:
        """Take samples and yield the intervals that they complete.

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
        yield from self._observations(self._tracker.process(first_sample, residual, flags))

    def digest(self) -> None:
        """Do what an interval leaves to be done: learn from it, look for combs, fit the margin.

        Nothing that is told of that interval depends on it. It is done before the next sample in any case; whoever
        calls this chooses a moment when nobody waits for a verdict.
        """
        self._orders.digest()
        self._margin.digest()

    def finish(self) -> Iterator[Observation]:
        """Yield what remains as a last, shorter interval."""
        self._waiting.extend(self._orders.finish())
        yield from self._observations(self._tracker.finish())

    def _observations(self, frames: Iterator[OdpFrame]) -> Iterator[Observation]:
        # One stage after the other over all frames of a block, so that each finds its code and data in the cache.
        odps = list(frames)
        orders = [self._waiting.popleft() for _ in odps]
        lines = [lines_of(self._spectrum, odp, turned) for odp, turned in zip(odps, orders, strict=True)]
        margins = [self._margin_of(odp, turned) for odp, turned in zip(odps, orders, strict=True)]
        for odp, turned, (found, cutting, *engaged), margin in zip(odps, orders, lines, margins, strict=True):
            yield Observation(odp, turned, found, cutting, margin, *engaged)

    def _margin_of(self, frame: OdpFrame, orders: Orders) -> Margin:
        """Margin at the end of a frame; the delay is known only with the spindle, not with any comb."""
        for margin in self._margin.process(frame.signal, *orders.spindle):
            self._last_margin = margin
        return self._last_margin


def lines_of(spectrum: Spectrum, frame: OdpFrame, orders: Orders) -> tuple[NDArray[np.float64], bool, bool, bool]:
    """Lines of a frame; whether the tool is in the cut, enters it, and nothing but lines was heard of the last one."""
    found = spectrum.take(
        frame.signal,
        alike=not orders.returned,
        turns=orders.heard,
        whole=orders.power,
        repeating=orders.repeating_share,
        fainter=orders.fainter,
        unheard=orders.spindle_unheard,
    )
    return found, spectrum.cutting, spectrum.entering, spectrum.alone
