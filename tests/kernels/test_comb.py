"""Lines of a spectrum and what explains them, against naive twins."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.kernels import comb as kernel
from tests import naive


@pytest.mark.parametrize("seed", range(3))
def test_crests_are_those_of_the_twin(seed):
    """In noise with lines, one at each edge among them, the same bins stand out as by the plain definition."""
    power = np.random.default_rng(seed).exponential(size=8 * kernel.FLOOR_BINS)
    power[[1, 60, 127, 128, 500, 1022, 1023]] += 100.0
    peaks = np.empty(len(power), np.int64)
    for factor in (2.0, 17.0):
        count = kernel.crests(power, factor, 50, np.empty(kernel.FLOOR_BINS // 2), peaks)
        expected = naive.crests(power, factor, 50)
        assert len(expected) > 3
        np.testing.assert_array_equal(peaks[:count], expected)


@pytest.mark.parametrize("seed", range(3))
def test_crests_beside_stronger_ones_are_those_of_the_twin(seed):
    """Beside a line with skirts, at the edges, in noise: the same bins as by the plain definition."""
    power = np.random.default_rng(seed).exponential(size=1000)
    power += 1e6 / (1.0 + np.abs(np.arange(1000) - 500.0)) ** 4
    power[[0, 1, 5, 470, 530, 980, 998, 999]] += np.array([300, 40, 300, 40, 300, 40, 300, 300])
    peaks = np.empty(len(power), np.int64)
    for factor, lowest, least in ((4.0, 0, 0.0), (4.0, 3, 0.0), (17.0, 0, 0.0), (17.0, 0, 200.0)):
        count = kernel.crests_beside(power, factor, lowest, least, peaks)
        expected = naive.crests_beside(power, factor, lowest, least)
        assert len(expected) > 1
        assert peaks[:count].tolist() == expected


def test_crests_of_one_line_are_one():
    """Of lines in order of strength those too near a stronger one are left out, and no more are kept than wanted."""
    frequency = np.array([100.0, 101.0, 200.0, 99.0, 203.0, 300.0, 400.0])
    kept = np.empty(3, np.int64)
    assert kernel.apart(frequency, np.full(7, 2.5), kept) == 3
    assert kept.tolist() == [0, 2, 4]


@pytest.mark.parametrize("seed", range(5))
def test_the_best_family_is_that_of_the_twin(seed):
    """Of all carriers and spacings that lines suggest, the one with most evidence wins, forced lines left out of it."""
    rng = np.random.default_rng(seed)
    carrier, spacing = rng.uniform(600.0, 1200.0), rng.uniform(40.0, 90.0)
    hertz = np.concatenate([carrier + spacing * np.array([-2, -1, 0, 1]), [2 * carrier], spacing * np.array([1, 2, 5])])
    hertz = np.concatenate([hertz, rng.uniform(50.0, 5000.0, 3)])[rng.permutation(11)]
    off = 0.3 + 3e-4 * hertz
    surprises, choices = rng.uniform(1.0, 4.0, 11), np.arange(11.0)
    best = np.empty((2, 11), bool)
    evidence = kernel.best_family(hertz, off, surprises, choices, best)
    most, winner, tried = -np.inf, set(), 0
    for second in range(11):
        for first in range(11):
            for part in range(1, kernel.PARTS + 1):
                between = abs(hertz[second] - hertz[first]) / part
                if between <= 10.0 * off.max():
                    continue
                if abs(hertz[first] - round(hertz[first] / between) * between) <= 2.0 * off[first]:
                    continue
                tried += 1
                brought, forced = naive.family(hertz, off, hertz[first], between)
                on = sorted(surprises[list(brought | forced)])
                if len(brought) >= 3 and sum(on[:-2]) - choices[len(on) - 2] > most:
                    most, winner = sum(on[:-2]) - choices[len(on) - 2], brought - forced
    assert set(np.flatnonzero(best[0])) == winner
    assert winner
    assert evidence == pytest.approx(most - np.log(tried))


def test_no_family_without_lines_apart():
    """Where no two lines are far enough apart there is no evidence, and no line is left out."""
    best = np.ones((2, 3), bool)
    lines = np.array([100.0, 100.5, 101.0]), np.full(3, 0.3)
    assert kernel.best_family(*lines, np.ones(3), np.zeros(3), best) == -np.inf
    assert not best[0].any()
