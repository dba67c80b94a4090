"""The ring between two threads, with a signal that carries the sample number."""

from __future__ import annotations

import threading
import tracemalloc

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from chatter_monitor.acquisition.ring import Ring
from chatter_monitor.records import Flag

CAPACITY = 13


def numbered(first: int, count: int) -> np.ndarray:
    """Two channels: the sample number, and its negative."""
    index = np.arange(first, first + count, dtype=np.float64)
    return np.stack([index, -index], axis=1)


class AnyInterleaving(RuleBasedStateMachine):
    """Writes and reads of any size in any order, against a list of the sample numbers that found room."""

    def __init__(self) -> None:
        super().__init__()
        self.ring = Ring(CAPACITY, 2, 48000.0)
        self.offered = 0
        self.dropped = 0
        self.waiting: list[int] = []
        self.heard_until = 0

    @rule(count=st.integers(0, 2 * CAPACITY))
    def write(self, count: int) -> None:
        kept = min(count, CAPACITY - len(self.waiting))
        self.ring.write(numbered(self.offered, count).astype(np.float32))
        self.waiting += range(self.offered, self.offered + kept)
        self.offered += count
        self.dropped += count - kept

    @rule(max_samples=st.integers(1, 2 * CAPACITY))
    def read(self, max_samples: int) -> None:
        block = self.ring.read(max_samples)
        if block is None:
            assert not self.waiting
            return
        n = len(block.samples)
        assert 1 <= n <= max_samples
        assert np.array_equal(block.samples, numbered(block.first_sample, n))
        assert list(range(block.first_sample, block.first_sample + n)) == self.waiting[:n]
        assert block.first_sample == self.heard_until + block.lost
        del self.waiting[:n]
        self.heard_until = block.first_sample + n

    @invariant()
    def nothing_is_unaccounted_for(self) -> None:
        assert self.ring.fill == len(self.waiting) / CAPACITY
        assert self.ring.dropped == self.dropped


AnyInterleaving.TestCase.settings = settings(max_examples=150, stateful_step_count=40, derandomize=True, deadline=None)
TestAnyInterleaving = AnyInterleaving.TestCase


def test_a_full_ring_shows_as_a_gap_of_the_right_size():
    """Samples without room are dropped and counted, and the next block says where and how many."""
    ring = Ring(8, 2, 48000.0)
    ring.write(numbered(0, 11))
    ring.write(numbered(11, 4))
    first = ring.read(100)
    assert first is not None
    assert np.array_equal(first.samples, numbered(0, 8))
    ring.write(numbered(15, 5))
    block = ring.read(100)
    assert block is not None
    assert (block.first_sample, block.lost) == (15, 7)
    assert block.channel_flags(0) == Flag.GAP
    assert ring.dropped == 7


def test_two_threads_lose_nothing_unseen():
    """With a writer that overruns the reader, every sample is read in order or counted as lost, never both."""
    total = 400_000
    ring = Ring(2048, 2, 48000.0, dtype=np.float64)
    rng = np.random.default_rng(3)
    overrun = threading.Event()

    def capture() -> None:
        first = 0
        while first < total:
            count = min(int(rng.integers(1, 700)), total - first)
            ring.write(numbered(first, count))
            first += count
            if ring.dropped:
                overrun.set()
        ring.close()

    writer = threading.Thread(target=capture)
    writer.start()
    assert overrun.wait(10.0)
    heard = lost = expected = 0
    while not ring.finished:
        assert ring.wait(10.0)
        while (block := ring.read(500)) is not None:
            n = len(block.samples)
            assert block.first_sample == expected + block.lost
            assert np.array_equal(block.samples, numbered(block.first_sample, n))
            expected = block.first_sample + n
            heard += n
            lost += block.lost
    writer.join(10.0)
    assert not writer.is_alive()
    lost_at_the_end = total - expected
    assert heard + lost + lost_at_the_end == total
    assert 0 < ring.dropped == lost + lost_at_the_end


def test_waiting_ends_when_samples_or_the_end_come():
    """The reader wakes up for samples and for the end, and reports when neither came."""
    ring = Ring(16, 2, 48000.0)
    assert not ring.wait(0.001)
    ring.write(numbered(0, 3))
    assert ring.wait(1000.0), "samples that are there already are not waited for"
    ring.read(3)
    assert not ring.wait(0.0)
    threading.Timer(0.01, ring.close).start()
    assert ring.wait(10.0)
    assert ring.finished


def test_a_closed_ring_is_emptied_before_it_is_finished():
    """What was written before the end can still be read after it."""
    ring = Ring(16, 2, 48000.0)
    ring.write(numbered(0, 3))
    ring.close()
    assert not ring.finished
    assert ring.read(16) is not None
    assert ring.finished


@pytest.mark.parametrize("room", [True, False])
def test_writing_allocates_no_samples(room):
    """A write costs no memory of the size of its samples, with room and without."""
    ring = Ring(1_000_000 if room else 10, 2, 48000.0)
    samples = numbered(0, 100_000).astype(np.float32)
    tracemalloc.start()
    try:
        ring.write(samples)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 4096


def test_an_overflow_stands_at_its_place():
    """A block ends before samples that follow an overflow of the device, and the next one carries the flag."""
    ring = Ring(100, 2, 48000.0)
    ring.write(numbered(0, 5))
    ring.write(numbered(5, 4), overflow=True)
    ring.write(numbered(9, 3))
    blocks = [ring.read(100), ring.read(100)]
    assert [(block.first_sample, len(block.samples), block.flags) for block in blocks] == [
        (0, 5, ()),
        (5, 7, (Flag.OVERFLOW, Flag.OVERFLOW)),
    ]
    assert ring.read(100) is None


def test_an_overflow_without_room_is_not_forgotten():
    """The flag of samples that found no room is on the next ones that do."""
    ring = Ring(4, 2, 48000.0)
    ring.write(numbered(0, 4))
    ring.write(numbered(4, 2), overflow=True)
    assert ring.read(100).flags == ()
    ring.write(numbered(6, 2))
    block = ring.read(100)
    assert (block.first_sample, block.lost, block.flags) == (6, 2, (Flag.OVERFLOW, Flag.OVERFLOW))


def test_a_block_knows_when_its_last_sample_came():
    """Of several deliveries in a block the last one counts, also of those that are read in part."""
    ring = Ring(10, 2, 48000.0)
    ring.write(numbered(0, 4), 1.0)
    ring.write(numbered(4, 4), 2.0)
    assert [ring.read(6).arrived_s, ring.read(6).arrived_s] == [2.0, 2.0]
    ring.write(numbered(8, 4), 3.0)  # around the end of the buffer
    assert [ring.read(6).arrived_s, ring.read(6).arrived_s] == [3.0, 3.0]
