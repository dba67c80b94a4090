"""Median by selection against sorting."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.kernels.median import median


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("size", [1, 2, 3, 4, 11, 64, 639, 640])
def test_median_is_the_upper_one_of_the_sorted(size, dtype):
    """Of random values, many equal ones, ascending and descending ones, the median is the one that sorting finds."""
    rng = np.random.default_rng(size)
    random = rng.standard_normal(size).astype(dtype)
    for values in (random, np.round(random), np.zeros(size, dtype), np.sort(random), -np.sort(random)):
        assert median(values.copy()) == np.sort(values)[size // 2]


def test_infinite_values_are_values():
    """Infinities take their places at the ends."""
    assert median(np.array([np.inf, -np.inf, 1.0, np.inf, 2.0])) == 2.0
