"""The front ends of all channels, as the monitor sees them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

from chatter_monitor.config import Settings
from chatter_monitor.records import Block, Flag
from chatter_monitor.tracking.front_end import FrontEnd, Tracked
from chatter_monitor.tracking.spindle import SpindleSettings


@dataclass(frozen=True, slots=True, eq=False)
class Taken:
    """What was taken from the source in one go, and what was known then.

    Attributes
    ----------
    block : Block
        The samples.
    spindle : SpindleSettings or None
        What the spindle is taken to turn like from this block on, if that was told since the last one.
    marks : tuple of str
        What was to be noted meanwhile.
    clipped, non_finite : int
        Samples counted by the source so far.
    taken_s : float
        When that was, on the monitor's clock.
    """

    block: Block
    spindle: SpindleSettings | None
    marks: tuple[str, ...]
    clipped: int
    non_finite: int
    taken_s: float


class FrontEnds(Protocol):
    """The front ends of all channels."""

    def through(self, taken: Iterable[Taken]) -> Iterator[tuple[Taken, Iterable[list[Tracked]]]]:
        """Yield each with the intervals that it completes, channel by channel; these are there to be taken once."""
        ...

    def finish(self) -> Iterable[list[Tracked]]:
        """What remains of each channel as a last, shorter interval."""
        ...

    def digest(self) -> None:
        """Do what nobody waits for, now that all verdicts are out."""


class FrontEndsHere:
    """In this process and thread: an interval is told as soon as its last sample is there.

    Parameters
    ----------
    settings : Settings
        The machine configuration.
    channels : int
        How many.
    source_rate_hz : float
        Rate at which the signal was sampled before it was converted.
    """

    def __init__(self, settings: Settings, channels: int, source_rate_hz: float) -> None:
        self._channels = [
            FrontEnd(settings.tracker, settings.orders, settings.spindle, channel, source_rate_hz)
            for channel in range(channels)
        ]

    def through(self, taken: Iterable[Taken]) -> Iterator[tuple[Taken, Iterable[list[Tracked]]]]:
        """As of `FrontEnds`; a channel's work is done when its intervals are asked for."""
        for each in taken:
            yield each, self.track(each.block, each.spindle)

    def track(self, block: Block, spindle: SpindleSettings | None) -> Iterator[list[Tracked]]:
        """Yield the intervals that a block completes, channel by channel; before it a spindle may have been told."""
        for number, channel in enumerate(self._channels):
            if spindle is not None:
                channel.set_spindle(spindle)
            # The tracker flags a gap before the block where it lies; the block's length is chance.
            flags = block.flags[number] if block.flags else Flag.NONE
            yield channel.process(block.first_sample, block.samples[:, number], flags)

    def finish(self) -> Iterator[list[Tracked]]:
        """As of `FrontEnds`."""
        return (channel.finish() for channel in self._channels)

    def digest(self) -> None:
        """As of `FrontEnds`."""
        for channel in self._channels:
            channel.digest()
