"""The newest stretch of a signal, by the numbers of its samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy.band import Recorded


class History:
    """Keeps the newest samples.

    Parameters
    ----------
    capacity : int
        How many, at least.
    rate_hz : float

    Attributes
    ----------
    end : int
        Number of the sample that comes next.
    """

    def __init__(self, capacity: int, rate_hz: float) -> None:
        self._samples = np.zeros(2 * capacity)
        self._missing = np.zeros(2 * capacity, dtype=bool)
        self._capacity, self._rate_hz = capacity, rate_hz
        self._filled = 0
        self.end = 0

    @property
    def start(self) -> int:
        """Number of the oldest sample that is kept for sure."""
        return max(self.end - self._capacity, 0)

    def append(self, samples: NDArray[np.float64], missing: NDArray[np.bool_]) -> None:
        """Append samples."""
        if self._filled + samples.size > self._samples.size:
            kept = slice(self._filled - self._capacity, self._filled)
            self._samples[: self._capacity] = self._samples[kept]
            self._missing[: self._capacity] = self._missing[kept]
            self._filled = self._capacity
        self._samples[self._filled : self._filled + samples.size] = samples
        self._missing[self._filled : self._filled + samples.size] = missing
        self._filled += samples.size
        self.end += samples.size

    def between(self, begin: int, end: int) -> Recorded:
        """Samples `begin` to `end` - 1, as they are kept; the arrays are copies."""
        offset = self._filled - self.end
        part = slice(begin + offset, end + offset)
        return Recorded(self._samples[part].copy(), self._missing[part].copy(), self._rate_hz)
