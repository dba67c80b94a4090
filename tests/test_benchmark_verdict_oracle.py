"""The detector that is told the truth: it knows what it is told, and decides the rest from the samples."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.verdict.cut import INTERVAL_S, Stretch, Truth
from benchmarks.verdict.families import FAMILIES
from benchmarks.verdict.generator import cut
from benchmarks.verdict.oracle import CHANGES, DRIVING, LEAST, _forward, _vibration, held, log_odds, recipe_of

STEP = list(FAMILIES).index("step")


@pytest.fixture(scope="module")
def step():
    """The first cut of the development split that chatters from one moment to the next."""
    return cut("development", STEP)


def odds_of(white, pole):
    noise = -np.log(np.pi) - np.abs(white) ** 2
    poles = np.full(white.size, pole)
    limited = poles / np.abs(poles)
    return _forward(
        np.array([noise, _vibration(white, poles, DRIVING), _vibration(white, limited, DRIVING)]), CHANGES, LEAST
    )


def test_noise_is_no_vibration():
    """White noise of the level that it had is taken for a vibration in less than one step of a hundred."""
    rng = np.random.default_rng(1)
    white = (rng.standard_normal(4000) + 1j * rng.standard_normal(4000)) / np.sqrt(2.0)
    assert np.mean(odds_of(white, 1.02 * np.exp(0.3j)) > 0.0) < 0.01


def test_growth_is_told_soon_after_it_stands_out():
    """A vibration that grows with its root is told within ten steps of being twice as large as the noise."""
    rng = np.random.default_rng(2)
    white = (rng.standard_normal(400) + 1j * rng.standard_normal(400)) / np.sqrt(2.0)
    pole = 1.05 * np.exp(0.7j)
    k = np.arange(200)
    white[200:] += 0.1 * pole**k
    odds = odds_of(white, pole)
    stands_out = 200 + int(np.log(2.0 / 0.1) / np.log(1.05))
    assert np.all(odds[:200] < 0.0)
    assert np.all(odds[stands_out + 10 :] > 0.0)


def test_the_recipe_is_that_of_the_cut(step):
    """The recipe that is told belongs to the cut of the same split and number."""
    recipe = recipe_of("development", STEP)
    assert (recipe.snr_db, recipe.teeth, recipe.sensor) == (step.snr_db, step.teeth, step.sensor)


@pytest.mark.parametrize("load_told", [False, True])
def test_a_crossing_is_told_and_nothing_before_it(step, load_told):
    """In a cut that is unstable suddenly, the odds are against it before, and for it within half a second."""
    odds = log_odds(step, recipe_of("development", STEP), load_told=load_told)
    crossing = step.truth.unstable[0].crossing_s / INTERVAL_S
    assert odds.size == len(step.truth)
    assert np.all(odds[6 : int(crossing)] < 0.0)
    assert odds[int(crossing) : int(crossing) + 10].max() > 7.0


def test_held_is_the_largest_so_far_while_it_is_due():
    """Held scores do not fall within an unstable stretch, and are as they were outside of it."""
    label = np.array([0, 0, 3, 2, 2, 2, 3, 0, 0], np.int8)
    blank = np.zeros(label.size)
    stretch = Stretch(zero_s=2.2 * INTERVAL_S, crossing_s=2.5 * INTERVAL_S)
    truth = Truth(label, blank, blank, blank, blank, blank, blank, blank, (stretch,))
    score = np.array([5.0, 1.0, 0.0, 4.0, 2.0, 3.0, 1.0, 2.0, 1.0])
    assert held(truth, score).tolist() == [5.0, 1.0, 0.0, 4.0, 4.0, 4.0, 4.0, 2.0, 1.0]
