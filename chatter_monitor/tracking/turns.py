"""Work that is too much for one frame, shared out over frames.

A frame's verdict has to come within milliseconds, and the channels of a monitor end their frames at the same sample.
So each channel has its turn in another frame of a round to do what is dear, a piece at a time. What comes out of a
piece counts from the end of its round on: results depend on the sample index, never on whose turn it was.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from typing import TypeVar

T = TypeVar("T")

TURNS = 4  # frames of a round

# Goes on when a frame has ended.
Piecemeal = Generator[None, None, T]


def in_turn(turn: int, piece: Callable[[], T]) -> Piecemeal[T]:
    """Do a piece of work in the round that begins; returns its result when the round is over."""
    for frame in range(TURNS):
        if frame == turn % TURNS:
            result = piece()
        yield
    return result
