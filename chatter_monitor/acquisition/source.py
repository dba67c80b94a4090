"""What every input looks like to the rest of the program."""

from __future__ import annotations

from collections.abc import Iterator
from types import TracebackType
from typing import Protocol, Self

from chatter_monitor.records import Block


class Source(Protocol):
    """Something that yields blocks of samples, once, in order.

    Attributes
    ----------
    sample_rate_hz : float
        Rate of the blocks and of their sample indices.
    channels : int
        Columns of each block's samples.
    length : int or None
        Samples to be expected in total, for a progress bar; None where nobody knows.
    """

    sample_rate_hz: float
    channels: int
    length: int | None

    def blocks(self) -> Iterator[Block]:
        """Yield blocks of any size until the source ends; the samples belong to whoever takes them."""
        ...

    def close(self) -> None:
        """Give back what the source holds; may be called more than once."""
        ...

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
