"""The latest numbers, in order of time and of size."""

from __future__ import annotations

import statistics
from collections import deque

import numpy as np
import pytest

from chatter_monitor.verdict.recent import Recent


@pytest.mark.parametrize("most", [1, 2, 7, 100])
def test_the_median_is_that_of_the_latest(most):
    """After each of many numbers, some of them the same."""
    recent, naive = Recent(most), deque(maxlen=most)
    for number in np.random.default_rng(most).integers(0, 40, 300).tolist():
        recent.append(number)
        naive.append(number)
        assert recent.median == statistics.median(naive)
        assert recent.last(5) == list(naive)[-5:]
        assert len(recent) == len(naive)


def test_what_is_forgotten_does_not_count():
    recent = Recent(3)
    recent.append(5.0)
    recent.clear()
    assert len(recent) == 0
    recent.append(7.0)
    assert recent.median == 7.0
