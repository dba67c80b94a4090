"""Numbers side by side in a vector: each as if it were alone."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from chatter_monitor.kernels import track
from chatter_monitor.kernels.lanes import as_lanes, bits, floor, fma, larger, part, select, smaller, spread
from chatter_monitor.kernels.options import EXACT
from tests.kernels.test_rarma import FORGETTING, RATE, cut

ROWS = 13


@njit(**{**EXACT, "cache": False})
def _compute(numbers: NDArray[np.float64], results: NDArray[np.float64]) -> int:
    """Everything that lanes can do."""
    given, out = as_lanes(numbers, 8), as_lanes(results, 8)
    x, y, z = given[0], given[1], given[2]
    out[0] = x + y
    out[1] = 1.0 - x
    out[2] = 2 * y
    out[3] = x / y
    out[4] = -x
    out[5] = abs(x)
    out[6] = fma(x, y, z)
    out[7] = floor(x)
    out[8] = larger(x, y)
    out[9] = smaller(x, 0.25)
    out[10] = select((x < y) & ~(z > 0.0), x, 7.0)
    out[11] = select((x == y) | (z > 0.0), spread(3, x), y)
    out[12] = given[0:3][2]
    return bits(x < y)


def test_lanes_compute_as_numpy_does() -> None:
    """Operators, functions, comparisons and slices give in each lane what NumPy gives for its numbers."""
    numbers = np.random.default_rng(0).standard_normal((3, 8))
    numbers[0, 3] = numbers[1, 3]
    numbers[2, 3] = -1.0
    x, y, z = numbers
    out = np.zeros((ROWS, 8))
    below = _compute(numbers, out)
    expected = [
        x + y, 1.0 - x, 2 * y, x / y, -x, abs(x), x * y + z, np.floor(x), np.maximum(x, y), np.minimum(x, 0.25),
        np.where((x < y) & ~(z > 0), x, 7.0), np.where((x == y) | (z > 0), 3.0, y), z,
    ]  # fmt: skip
    np.testing.assert_allclose(out, expected, rtol=0.0, atol=1e-15)
    assert [below >> lane & 1 for lane in range(8)] == (x < y).tolist()


@njit(**{**EXACT, "cache": False})
def _double(numbers: NDArray[np.float64], table: NDArray[np.float64]) -> None:
    """Part of a part of a row of lanes, and rows of a table."""
    row = part(part(as_lanes(numbers, 2), 1, 4), 1, 3)
    for i in range(row.shape[0]):
        row[i] = row[i] + row[i]
    rows = part(table, 1, 3)
    for i in range(rows.shape[0]):
        rows[i, 1] *= 2.0


def test_a_part_is_what_a_slice_is() -> None:
    """Of lanes and of rows of a table, within kernels and outside."""
    numbers, table = np.arange(12.0), np.arange(8.0).reshape(4, 2)
    wanted, wanted_table = numbers.copy(), table.copy()
    wanted[4:8] *= 2.0
    wanted_table[1:3, 1] *= 2.0
    _double(numbers, table)
    np.testing.assert_array_equal(numbers, wanted)
    np.testing.assert_array_equal(table, wanted_table)
    assert part(numbers, 2, 5).base is numbers
    np.testing.assert_array_equal(part(numbers, 2, 5), numbers[2:5])


@pytest.mark.parametrize(("p", "q"), [(4, 3), (6, 2)])
def test_whoever_goes_beside_a_recursion_changes_no_bit_of_it(p: int, q: int) -> None:
    """A cut, silence, a cut with gaps, a pure tone and impacts, side by side or each alone: the same bits."""
    n = 3000
    signals = np.array([cut(n, seed) for seed in range(5)])
    signals[1] = 0.0
    signals[2, [5, 700, 701]] = np.nan
    signals[2, 1500:2500] = np.nan
    signals[3] = np.sin(np.arange(n))
    signals[4, ::300] *= 1e4
    forgetting = np.array([FORGETTING, FORGETTING, 1 - 1 / 256, FORGETTING, 1 - 1 / 512])

    def run(which: slice) -> tuple[NDArray[np.generic], ...]:
        chosen = signals[which]
        state = track.new_state(p, q, forgetting[which], np.full(len(chosen), RATE), 0)
        shape = (len(chosen), p // 2, n)
        out = (*(np.zeros(shape, np.float32) for _ in range(4)), np.zeros(shape, np.uint8))
        track.track(p, q, chosen, state, out)
        return (*out, state.memory)

    together = run(slice(None))
    for k in range(len(signals)):
        for every, own in zip(together, run(slice(k, k + 1)), strict=True):
            assert every[k].tobytes() == own[0].tobytes()
