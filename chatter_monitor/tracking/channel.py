"""One channel from samples to what there is to see in each interval: orders out, recursion, lines."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.records import Flag, OdpFrame
from chatter_monitor.tracking.front_end import FrontEnd, Tracked
from chatter_monitor.tracking.margin import Margin
from chatter_monitor.tracking.margin_tracker import MarginSettings, MarginTracker
from chatter_monitor.tracking.orders import Orders, OrderSettings
from chatter_monitor.tracking.spectrum import Cycle, Spectrum
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.tracking.tracker import INTERVAL_S, TrackerSettings


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
    grown : bool
        Whether the first of the lines has grown out of a mode that sounded in the cut before.
    cycle : Cycle or None
        What the loudest band keeps of amplitude and phase.
    """

    odp: OdpFrame
    orders: Orders
    lines: NDArray[np.float64]
    cutting: bool
    margin: Margin
    entering: bool = False
    alone: bool = False
    grown: bool = False
    cycle: Cycle | None = None


class BackEnd:
    """Looks at the lines and the margin of what a front end has tracked.

    Parameters
    ----------
    rate_hz : float
        Of the signal.
    spindle : SpindleSettings
        Speed and teeth, where known.
    channel : int
        Its number.
    """

    def __init__(self, rate_hz: float, spindle: SpindleSettings, channel: int = 0) -> None:
        self._rate_hz = rate_hz
        self._spectrum = Spectrum(rate_hz, round(INTERVAL_S * rate_hz))
        self._channel = channel
        self._teeth = spindle.teeth
        self._margin = self._new_margin()
        self._last_margin = Margin(reason="too little signal yet")

    def set_spindle(self, spindle: SpindleSettings) -> None:
        """Go by another number of teeth from now on."""
        if spindle.teeth != self._teeth:
            self._teeth = spindle.teeth
            self._margin = self._new_margin()

    def observe(self, tracked: list[Tracked]) -> Iterator[Observation]:
        """Yield what there is to see in intervals."""
        # One stage after the other over all frames of a block, so that each finds its code and data in the cache.
        lines = [lines_of(self._spectrum, odp, turned) for odp, turned in tracked]
        margins = [
            self._margin_of(odp, turned, cutting=cutting)
            for (odp, turned), (_, cutting, *_) in zip(tracked, lines, strict=True)
        ]
        for (odp, turned), told, margin in zip(tracked, lines, margins, strict=True):
            found, cutting, entering, alone, grown, cycle = told
            yield Observation(odp, turned, found, cutting, margin, entering, alone, grown, cycle)

    def digest(self) -> None:
        """Go on with a fit of the margin: before the next sample in any case, better when nobody waits."""
        self._margin.digest()

    def _new_margin(self) -> MarginTracker:
        return MarginTracker(MarginSettings(), self._rate_hz, self._teeth, turn=self._channel)

    def _margin_of(self, frame: OdpFrame, orders: Orders, *, cutting: bool) -> Margin:
        """Margin at the end of a frame; the delay is known only with the spindle, not with any comb."""
        for margin in self._margin.process(frame.signal, *orders.spindle, cutting=cutting):
            self._last_margin = margin
        return self._last_margin


class Channel:
    """Follows one channel: both ends in one. Parameters as of `FrontEnd`."""

    def __init__(
        self,
        tracker: TrackerSettings,
        orders: OrderSettings,
        spindle: SpindleSettings,
        channel: int = 0,
        source_rate_hz: float | None = None,
    ) -> None:
        self._front = FrontEnd(tracker, orders, spindle, channel, source_rate_hz)
        self._back = BackEnd(tracker.sample_rate_hz, spindle, channel)

    def set_spindle(self, spindle: SpindleSettings) -> None:
        """Go by another speed or number of teeth from now on."""
        self._front.set_spindle(spindle)
        self._back.set_spindle(spindle)

    def process(
        self, first_sample: int, samples: NDArray[np.float64], flags: Flag = Flag.NONE
    ) -> Iterator[Observation]:
        """Take samples, as `FrontEnd.process` does, and yield the intervals that they complete."""
        return self._back.observe(self._front.process(first_sample, samples, flags))

    def digest(self) -> None:
        """Do what an interval leaves to be done: learn from it, look for combs, fit the margin.

        Nothing that is told of that interval depends on it. It is done before the next sample in any case; whoever
        calls this chooses a moment when nobody waits for a verdict.
        """
        self._front.digest()
        self._back.digest()

    def finish(self) -> Iterator[Observation]:
        """Yield what remains as a last, shorter interval."""
        return self._back.observe(self._front.finish())


def lines_of(
    spectrum: Spectrum, frame: OdpFrame, orders: Orders
) -> tuple[NDArray[np.float64], bool, bool, bool, bool, Cycle | None]:
    """Lines of a frame, and what `Observation` tells of the cut: cutting, entering, alone, grown and cycle."""
    found = spectrum.take(
        frame.signal,
        alike=not orders.returned,
        turns=orders.heard,
        whole=orders.power,
        repeating=orders.repeating_share,
        fainter=orders.fainter,
    )
    return found, spectrum.cutting, spectrum.entering, spectrum.alone, spectrum.grown, spectrum.cycle
