"""What every input looks like to the rest of the program."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

from chatter_monitor.records import Block


@dataclass(frozen=True, slots=True)
class Condition:
    """How well a source hears at the moment.

    Attributes
    ----------
    hearing : bool
        Whether samples come that tell what the sensor feels.
    problems : tuple of str
        What is wrong, as reasons for the health message.
    overflows : int
        How often so far a device had lost samples before they could be taken.
    ring_fill : float
        Share of the buffer that waits for the worker, 0 to 1.
    clock_ppm : float or None
        By how many millionths a sound card runs faster than the computer's clock; None until it is known.
    """

    hearing: bool = True
    problems: tuple[str, ...] = ()
    overflows: int = 0
    ring_fill: float = 0.0
    clock_ppm: float | None = None


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

    def condition(self) -> Condition:
        """How well it hears at the moment; a recording always does."""
        return Condition()

    def close(self) -> None:
        """Give back what the source holds; may be called more than once."""
        ...

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
