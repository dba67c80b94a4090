"""Medians against sorting."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.kernels.median import median, median_of_many, medians_where


@pytest.mark.parametrize("middle", [median, median_of_many])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("size", [1, 2, 3, 4, 11, 64, 639, 640])
def test_median_is_the_upper_one_of_the_sorted(size, dtype, middle):
    """The median is the one that sorting finds: of random, equal, ascending, descending values, and some far apart."""
    rng = np.random.default_rng(size)
    random = rng.standard_normal(size).astype(dtype)
    wild = np.sign(random) * np.exp(np.minimum(9.0 * random**2, 80.0))
    for values in (random, np.round(random), np.zeros(size, dtype), np.sort(random), -np.sort(random), wild):
        assert middle(values.copy()) == np.sort(values)[size // 2]


@pytest.mark.parametrize("middle", [median, median_of_many])
@pytest.mark.parametrize("times", [1, 9])
def test_infinite_values_are_values(middle, times):
    """Infinities take their places at the ends."""
    assert middle(np.array([np.inf, -np.inf, 1.0, np.inf, 2.0] * times)) == 2.0
    assert middle(np.array([np.inf, 1.0, np.inf] * times)) == np.inf


def test_values_that_stand_for_several_rows_are_looked_at_once():
    """Medians over the wanted rows are those of every row by itself; each status counts its rows."""
    rng = np.random.default_rng(4)
    hold, rows = np.array([1, 4, 8]), 96
    status = np.column_stack([np.repeat(rng.random(rows // step) < 0.2, step) for step in hold]).astype(np.uint8)
    columns = tuple(
        np.column_stack([np.repeat(rng.standard_normal(rows // step), step) for step in hold]).astype(np.float32)
        for _ in range(2)
    )
    columns[1][:16] = np.nan
    medians, counts = np.empty((3, 2)), np.empty((3, 2), np.int64)
    medians_where(columns, status, hold, 0, np.empty(rows, np.float32), medians, counts)
    for m in range(3):
        assert counts[m].tolist() == [np.sum(status[:, m] == 0), np.sum(status[:, m] == 1)]
        for i in range(2):
            values = np.sort(columns[i][status[:, m] == 0, m])
            values = values[np.isfinite(values)]
            assert medians[m, i] == values[len(values) // 2]
