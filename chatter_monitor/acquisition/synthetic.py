"""Signals that are computed instead of recorded: for tests, demonstrations and simulations."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Self

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.acquisition.source import Source
from chatter_monitor.records import Block

Signal = Callable[[NDArray[np.int64]], NDArray[np.float64]]


class Synthetic(Source):
    """A source whose samples are a function of the sample index.

    Parameters
    ----------
    signal : callable
        Takes consecutive sample indices, shape (n,), and returns the samples, shape (n, channels).
    sample_rate_hz : float
        Rate of the samples.
    channels : int
        Columns that `signal` returns.
    length : int or None
        Samples in total; None for a source without end.
    block_samples : int
        Samples in each block but the last.
    """

    clipped_samples = non_finite_samples = 0  # as a recording counts them

    def __init__(
        self,
        signal: Signal,
        sample_rate_hz: float,
        *,
        channels: int = 1,
        length: int | None = None,
        block_samples: int = 4096,
    ) -> None:
        self.sample_rate_hz = float(sample_rate_hz)
        self.channels = channels
        self.length = length
        self._signal = signal
        self._block_samples = block_samples

    @classmethod
    def from_array(cls, samples: NDArray[np.float64], sample_rate_hz: float, *, block_samples: int = 4096) -> Self:
        """Source of the samples of an array, shape (n,) or (n, channels)."""
        columns = samples.reshape(len(samples), 1) if samples.ndim == 1 else samples
        return cls(
            lambda index: columns[index],
            sample_rate_hz,
            channels=columns.shape[1],
            length=len(columns),
            block_samples=block_samples,
        )

    def blocks(self) -> Iterator[Block]:
        """Yield the signal block by block."""
        first = 0
        while self.length is None or first < self.length:
            end = first + self._block_samples if self.length is None else min(first + self._block_samples, self.length)
            yield Block(first, self._signal(np.arange(first, end)), self.sample_rate_hz)
            first = end

    def close(self) -> None:
        """Nothing to give back."""


def counter(index: NDArray[np.int64]) -> NDArray[np.float64]:
    """Signal whose every sample is its own index, so that loss, duplication and reordering show."""
    return index[:, np.newaxis].astype(np.float64)
