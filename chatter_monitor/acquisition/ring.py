"""The ring between the thread that captures samples and the one that works on them."""

from __future__ import annotations

import threading

import numpy as np
from numpy.typing import DTypeLike, NDArray

from chatter_monitor.records import Block, Flag


class Ring:
    """Ring of samples for one writing and one reading thread.

    The writer never waits for the reader: what finds no room is dropped, counted, and seen by the reader as a gap
    at its exact place. Nothing is overwritten. A block tells when its last sample was written.

    One thread owns each piece of state. `write` and `close` belong to the writer; `read` and `wait` to the reader;
    the properties may be asked by anyone. Each thread publishes its progress by storing one integer after the
    samples have been copied, and the interpreter keeps that order, so no lock guards the samples.

    Parameters
    ----------
    capacity : int
        Samples that find room.
    channels : int
        Columns of the samples.
    sample_rate_hz : float
        Rate of the samples, for the blocks.
    dtype : dtype
        What the ring stores: float32 for sound cards, float64 otherwise.
    """

    def __init__(self, capacity: int, channels: int, sample_rate_hz: float, dtype: DTypeLike = np.float32) -> None:
        self._capacity = capacity
        self._sample_rate_hz = sample_rate_hz
        self._samples = np.zeros((capacity, channels), dtype=dtype)
        self._lost_before = np.zeros(capacity, dtype=np.int64)  # per slot: samples dropped just before it
        self._overflow_before = np.zeros(capacity, dtype=bool)  # per slot: the device had lost samples just before it
        self._arrived_s = np.zeros(capacity)  # per slot: when it was written
        self._news = threading.Event()
        # The writer's:
        self._stored = 0
        self._dropped = 0
        self._dropped_unmarked = 0  # since the last sample that found room
        self._overflow_unmarked = False  # since the last sample that found room
        self._closed = False
        # The reader's:
        self._taken = 0
        self._next_sample = 0

    @property
    def capacity(self) -> int:
        """Samples that find room."""
        return self._capacity

    @property
    def dropped(self) -> int:
        """Samples that found no room since the start."""
        return self._dropped

    @property
    def fill(self) -> float:
        """Share of the ring that waits for the reader, 0 to 1."""
        return (self._stored - self._taken) / self._capacity

    @property
    def finished(self) -> bool:
        """Whether the writer has closed the ring and the reader has taken everything."""
        return self._closed and self._taken == self._stored

    def write(self, samples: NDArray[np.floating], arrived_s: float = float("nan"), *, overflow: bool = False) -> None:
        """Copy samples, shape (n, channels), into the ring as far as there is room, and count the rest.

        Allocates nothing and does not wait for the reader, so an audio callback may call it.

        Parameters
        ----------
        samples : ndarray of floats, shape (n, channels)
            The next samples of the device.
        arrived_s : float
            Time on a steady clock.
        overflow : bool
            Whether the device has lost samples just before these, nobody knows how many.
        """
        self._overflow_unmarked |= overflow
        kept = min(len(samples), self._capacity - (self._stored - self._taken))
        if kept:
            start = self._stored % self._capacity
            until_wrap = min(kept, self._capacity - start)
            self._samples[start : start + until_wrap] = samples[:until_wrap]
            self._samples[: kept - until_wrap] = samples[until_wrap:kept]
            self._lost_before[start : start + until_wrap] = 0
            self._lost_before[: kept - until_wrap] = 0
            self._lost_before[start] = self._dropped_unmarked
            self._dropped_unmarked = 0
            self._overflow_before[start : start + until_wrap] = False
            self._overflow_before[: kept - until_wrap] = False
            self._overflow_before[start] = self._overflow_unmarked
            self._overflow_unmarked = False
            self._arrived_s[start : start + until_wrap] = arrived_s
            self._arrived_s[: kept - until_wrap] = arrived_s
            self._stored += kept
        self._dropped_unmarked += len(samples) - kept
        self._dropped += len(samples) - kept
        self._news.set()

    def close(self) -> None:
        """Tell the reader that nothing more will come."""
        self._closed = True
        self._news.set()

    def wait(self, timeout_s: float) -> bool:
        """Wait until there is something to read or the ring is closed; False if neither happened in time."""
        self._news.clear()
        if self._stored == self._taken and not self._closed:
            self._news.wait(timeout_s)
        return self._stored != self._taken or self._closed

    def read(self, max_samples: int) -> Block | None:
        """Take up to `max_samples` samples that follow each other without a gap; None if there are none.

        A block ends at a gap, at an overflow and at the end of the buffer, so there may be more to read at once. One
        that begins after an overflow carries `Flag.OVERFLOW`.
        """
        waiting = self._stored - self._taken
        if waiting == 0:
            return None
        start = self._taken % self._capacity
        count = min(waiting, max_samples, self._capacity - start)
        behind_first = slice(start + 1, start + count)
        gaps = np.flatnonzero((self._lost_before[behind_first] != 0) | self._overflow_before[behind_first])
        if gaps.size:
            count = 1 + int(gaps[0])
        lost = int(self._lost_before[start])
        samples = self._samples[start : start + count].astype(np.float64)
        flags = (Flag.OVERFLOW,) * samples.shape[1] if self._overflow_before[start] else ()
        arrived_s = float(self._arrived_s[start + count - 1])
        first_sample = self._next_sample + lost
        self._next_sample = first_sample + count
        self._taken += count
        return Block(first_sample, samples, self._sample_rate_hz, lost, flags, arrived_s)
