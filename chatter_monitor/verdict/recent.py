"""The latest numbers of a series, in order: who asks for their median at each interval does not sort them each time."""

from __future__ import annotations

from bisect import bisect_left, insort
from collections import deque


class Recent:
    """So many of the latest numbers.

    Parameters
    ----------
    most : int
        What is older than so many is forgotten.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._in_time = deque[float]()
        self._in_size: list[float] = []

    def __len__(self) -> int:
        return len(self._in_size)

    def append(self, number: float) -> None:
        """Take one, not NaN, which is in no order."""
        if len(self._in_size) == self._most:
            del self._in_size[bisect_left(self._in_size, self._in_time.popleft())]
        self._in_time.append(number)
        insort(self._in_size, number)

    def clear(self) -> None:
        """Forget all."""
        self._in_time.clear()
        self._in_size.clear()

    def last(self, count: int) -> list[float]:
        """Return the latest ones, oldest first, at most so many."""
        return list(self._in_time)[-count:]

    @property
    def median(self) -> float:
        """The one in the middle, or the mean of both; IndexError if there is none."""
        half, odd = divmod(len(self._in_size), 2)
        return self._in_size[half] if odd else (self._in_size[half - 1] + self._in_size[half]) / 2
