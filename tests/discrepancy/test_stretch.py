"""Where in a recording columns gain most, on columns of random numbers whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.in_part.stretch import stretch

BLOCKS, BLOCK = 20, 500
FREE = np.array([-np.inf, -np.inf])


@pytest.fixture
def random_columns():
    """Errors and three columns of white noise, the first of which is nuisance."""
    rng = np.random.default_rng(7)
    return rng.standard_normal(BLOCKS * BLOCK), rng.standard_normal((3, BLOCKS * BLOCK))


def evidence_of(errors, columns):
    return Evidence(errors, columns, np.ones(errors.size), [0], BLOCK)


def test_two_columns_are_found_in_the_blocks_in_which_they_act(random_columns):
    """Both columns act in blocks 6 to 11; together they gain what their regression there does."""
    errors, columns = random_columns
    there = slice(6 * BLOCK, 12 * BLOCK)
    errors[there] += 0.1 * columns[1, there] - 0.15 * columns[2, there]
    first, last, gain = stretch(evidence_of(errors, columns), [1, 2], FREE)
    assert (first, last) == (6, 12)
    confined = columns.copy()
    confined[1:, : there.start] = confined[1:, there.stop :] = 0.0
    assert gain == pytest.approx(evidence_of(errors, confined).regress([1, 2]).gain, rel=1e-3)


def test_what_physics_forbids_gains_nothing(random_columns):
    """Where a column acts with the wrong sign, it is not found."""
    errors, columns = random_columns
    there = slice(6 * BLOCK, 12 * BLOCK)
    errors[there] -= 0.15 * columns[1, there]
    evidence = evidence_of(errors, columns)
    assert stretch(evidence, [1], FREE[:1])[2] > 20.0
    assert stretch(evidence, [1], np.zeros(1))[2] < 10.0


def test_a_force_that_hardly_acts_in_a_run_gains_nothing_there(random_columns):
    """A column that is as good as zero but in two blocks is not divided by nothing elsewhere."""
    errors, columns = random_columns
    columns[1, : 14 * BLOCK] *= 1e-160
    columns[1, 16 * BLOCK :] *= 1e-160
    first, last, gain = stretch(evidence_of(errors, columns), [1], FREE[:1])
    assert np.isfinite(gain)
    assert first <= 15
    assert last >= 15
