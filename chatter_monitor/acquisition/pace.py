"""A recording played at the speed of life."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from chatter_monitor.acquisition.source import Source
from chatter_monitor.records import Block


class Paced(Source):
    """A source whose blocks come no earlier than a sensor could have delivered them.

    Each block waits for its own time since the first one was asked for, so that late blocks are caught up and
    nothing adds up.

    Parameters
    ----------
    source : Source
        Where the blocks come from; closed with this one.
    clock : callable
        Seconds on a clock that never jumps, such as `time.monotonic`.
    sleep : callable
        Waits for some seconds, such as `time.sleep`; may return too early or too late.
    """

    def __init__(self, source: Source, clock: Callable[[], float], sleep: Callable[[float], object]) -> None:
        self.sample_rate_hz = source.sample_rate_hz
        self.channels = source.channels
        self.length = source.length
        self._source = source
        self._clock = clock
        self._sleep = sleep

    def blocks(self) -> Iterator[Block]:
        """Yield the blocks of the source, each when its last sample is due."""
        start_s = self._clock()
        for block in self._source.blocks():
            due_s = start_s + (block.first_sample + len(block.samples)) / self.sample_rate_hz
            while (wait_s := due_s - self._clock()) > 0:
                self._sleep(wait_s)
            yield block

    def close(self) -> None:
        """Close the source."""
        self._source.close()
