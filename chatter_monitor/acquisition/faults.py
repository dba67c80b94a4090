"""Samples that do not tell what the sensor felt: no numbers, those at the ceiling, and those of a dead channel."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.records import Flag

CLIPPED_RUN = 3
"""Consecutive samples at the ceiling that make clipping: a crest that only just reaches it has one or two."""

HOLD_SAMPLES = 256
"""How long a flag stays up after a faulty sample, so that a riddled stretch is a handful of blocks, not thousands."""


class FaultFinder:
    """Finds faulty samples in a stream, wherever the stream is cut into pieces.

    Parameters
    ----------
    channels : int
        Columns of the samples.
    ceiling : float
        Magnitude from which on a sample is at full scale. Magnitudes above 1 are not: a file of floating-point
        numbers that holds more than ±1 is in physical units and has no ceiling.
    dead_after : int or None
        Unchanged samples in a row from which on a channel counts as dead: all-zero or stuck, which noise never lets
        happen to a sensor that lives. None where silence may be meant, as in a recording.

    Attributes
    ----------
    non_finite_samples, clipped_samples : int
        How many were found so far, over all channels.
    dead : ndarray of bool, shape (channels,)
        Which channels are dead at the moment.
    """

    def __init__(self, channels: int, ceiling: float, dead_after: int | None = None) -> None:
        self.non_finite_samples = 0
        self.clipped_samples = 0
        self.dead = np.zeros(channels, dtype=bool)
        self._ceiling = ceiling
        self._dead_after = dead_after
        self._position = 0
        self._at_ceiling = np.zeros((CLIPPED_RUN, channels), dtype=bool)
        self._last_non_finite = np.full(channels, -HOLD_SAMPLES)
        self._last_clipped = np.full(channels, -HOLD_SAMPLES)
        self._latest = np.full(channels, np.nan)  # sample: differs from every first one
        self._last_change = np.zeros(channels, dtype=np.int64)

    def inspect(self, samples: NDArray[np.float64]) -> NDArray[np.uint8]:
        """Replace what is not finite by 0, in place, and say which samples are under a flag.

        A run at the ceiling is known as clipping from its third sample on, and flagged from there.

        Parameters
        ----------
        samples : ndarray of float64, shape (n, channels)
            The next samples of the stream, at least one.

        Returns
        -------
        ndarray of uint8, shape (n, channels)
            A `Flag` for each sample.
        """
        unchanged = self._unchanged(samples)
        non_finite = ~np.isfinite(samples)
        samples[non_finite] = 0.0
        clipped = self._clipped(samples)
        self.non_finite_samples += int(np.count_nonzero(non_finite))

        flags = np.zeros(samples.shape, dtype=np.uint8)
        self._raise(flags, Flag.NON_FINITE, non_finite, self._last_non_finite)
        self._raise(flags, Flag.CLIPPED, clipped, self._last_clipped)
        if self._dead_after is not None:
            dead = unchanged >= self._dead_after
            flags[dead] |= np.uint8(Flag.DEAD_CHANNEL)
            self.dead = dead[-1]
        self._position += len(samples)
        return flags

    def _unchanged(self, samples: NDArray[np.float64]) -> NDArray[np.int64]:
        """For how many samples before each one nothing has changed."""
        changed = samples != np.concatenate([self._latest[np.newaxis], samples[:-1]])
        index = np.arange(self._position, self._position + len(samples))[:, np.newaxis]
        last_change = np.maximum.accumulate(np.where(changed, index, self._last_change), axis=0)
        self._latest = samples[-1].copy()
        self._last_change = last_change[-1]
        return np.asarray(index - last_change)

    def _clipped(self, samples: NDArray[np.float64]) -> NDArray[np.bool_]:
        magnitude = np.abs(samples)
        now = (magnitude >= self._ceiling) & (magnitude <= 1.0)
        at_ceiling = np.concatenate([self._at_ceiling, now])
        self._at_ceiling = at_ceiling[-CLIPPED_RUN:]
        # Row 0 belongs to the sample before these: it tells a run that begins from one that goes on.
        in_run: NDArray[np.bool_] = at_ceiling[2:] & at_ceiling[1:-1] & at_ceiling[:-2]
        begins = in_run[1:] & ~in_run[:-1]
        self.clipped_samples += int(np.count_nonzero(in_run[1:]) + (CLIPPED_RUN - 1) * np.count_nonzero(begins))
        return in_run[1:]

    def _raise(self, flags: NDArray[np.uint8], flag: Flag, faulty: NDArray[np.bool_], last: NDArray[np.int64]) -> None:
        """Set a flag from each fault on for `HOLD_SAMPLES`; `last` is each channel's latest fault, and is updated."""
        if not faulty.any() and self._position - last.max() >= HOLD_SAMPLES:
            return
        index = np.arange(self._position, self._position + len(faulty))[:, np.newaxis]
        latest = np.maximum.accumulate(np.where(faulty, index, last), axis=0)
        last[:] = latest[-1]
        flags[index - latest < HOLD_SAMPLES] |= np.uint8(flag)


def equal_runs(rows: NDArray[np.uint8]) -> Iterator[slice]:
    """Cut an array, shape (n, m), into the longest slices within which all rows are equal."""
    changes = np.unique(np.nonzero(rows[1:] != rows[:-1])[0]) + 1
    edges = [0, *changes.tolist(), len(rows)]
    for start, stop in pairwise(edges):
        if stop > start:
            yield slice(start, stop)


def block_flags(row: NDArray[np.uint8]) -> tuple[Flag, ...]:
    """Flags of a block from those of any of its samples, shape (channels,)."""
    return tuple(Flag(int(flag)) for flag in row) if row.any() else ()
