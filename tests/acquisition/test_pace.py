"""Playing at the speed of life."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.acquisition.pace import Paced
from chatter_monitor.acquisition.synthetic import Synthetic, counter


class Time:
    """A clock that only moves when somebody sleeps or works, and a sleep that misses by a factor."""

    def __init__(self, sleep_factor: float) -> None:
        self.now_s = 1000.0
        self._sleep_factor = sleep_factor

    def clock(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        assert seconds > 0
        self.now_s += max(seconds * self._sleep_factor, 1e-9)


def paced(time: Time, length: int) -> Paced:
    return Paced(Synthetic(counter, 1000, length=length, block_samples=100), time.clock, time.sleep)


@pytest.mark.parametrize("sleep_factor", [0.5, 1.0, 1.5])
def test_blocks_come_no_earlier_than_their_last_sample_and_delay_does_not_add_up(sleep_factor):
    """However wrong the sleep, block n comes after its last sample and within one block of it."""
    time = Time(sleep_factor)
    late_s = [time.now_s - 1000.0 - (n + 1) * 0.1 for n, _ in enumerate(paced(time, 20_000).blocks())]
    assert len(late_s) == 200
    assert min(late_s) >= -1e-9
    assert max(late_s) <= 0.1


def test_a_stall_is_caught_up():
    """After the consumer was busy for ten blocks, these come at once and the next one is on time again."""
    time = Time(1.0)
    came_s = []
    for n, _ in enumerate(paced(time, 2000).blocks()):
        came_s.append(time.now_s - 1000.0)
        if n == 4:
            time.now_s += 1.0
    assert came_s[:5] == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5])
    assert came_s[5:15] == pytest.approx([1.5] * 10)
    assert came_s[15:] == pytest.approx([1.6, 1.7, 1.8, 1.9, 2.0])


def test_the_samples_pass_untouched(hear):
    """Pacing changes no sample, no length and no rate."""
    source = paced(Time(1.0), 1234)
    assert (source.sample_rate_hz, source.channels, source.length) == (1000.0, 1, 1234)
    assert np.array_equal(hear(source).samples[:, 0], np.arange(1234))
