"""Vibrations with sidebands and combs as explanations of lines, against naive twins."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import binom, gammaln

from chatter_monitor.kernels import sidebands as kernel
from tests import naive

FACTORIALS = gammaln(np.arange(30) + 1.0)
MULTIPLES = np.arange(-200, 201)


def family(seed):
    """A vibration with sidebands, its double with some, forced lines at their spacing, and others; the first is it."""
    rng = np.random.default_rng(seed)
    spacing = rng.uniform(60.0, 120.0)
    carrier = (rng.integers(8, 12) + rng.uniform(0.38, 0.46)) * spacing
    hertz = [
        carrier + spacing * np.array([0, -2, -1, 1, 2, 3, -4]),
        2.0 * carrier + spacing * np.array([-1, 0, 2]),
        spacing * np.array([1, 2, 5]),
        rng.uniform(50.0, 5000.0, 3),
    ]
    hertz = np.concatenate(hertz)
    off = 0.3 + 3e-4 * hertz
    return carrier, spacing, hertz + 0.3 * off * rng.uniform(-1.0, 1.0, len(hertz)), off


@pytest.mark.parametrize("seed", range(5))
def test_the_best_sidebands_are_those_that_are_there(seed):
    """Vibration and spacing are found to a tolerance, and their odds are the twin's."""
    carrier, spacing, hertz, off = family(seed)
    best = np.empty(3)
    evidence = kernel.best_sidebands(hertz, off, 1, 5.0, math.inf, 1, 3, FACTORIALS, best)
    assert best[:2] == pytest.approx([carrier, spacing], abs=0.3)
    at = best[1] * MULTIPLES
    sidebands = np.concatenate([best[0] + at, 2.0 * best[0] + at])
    expected = naive.explained(hertz[1:], off[1:], (at[at > 0.0], best[1]), (sidebands, 0.5 * best[1]))
    assert evidence + best[2] == pytest.approx(expected)
    assert math.log(20.0) < best[2] < math.log(3 * len(hertz))
    narrow = kernel.best_sidebands(hertz, off, 1, 0.99 * spacing, 1.01 * spacing, 1, 1 << 30, FACTORIALS, best)
    assert evidence < narrow < expected


def test_more_is_said_by_lines_of_the_teeth():
    """With three teeth told, a line at a multiple of their passing, off the vibration, is three times rarer."""
    hertz = 1003.0 + 30.0 * np.array([0.0, 3.0, 6.0, -3.0, -9.0, 1.0])
    off, best = np.full(6, 0.5), np.empty(3)
    told, blind = (
        kernel.best_sidebands(hertz, off, 1, 29.9, 30.1, teeth, 1 << 30, FACTORIALS, best) for teeth in (3, 1)
    )
    assert told - blind == pytest.approx(3.0 * math.log(3.0))  # of the four, the rarest made the spacing


def test_a_multiple_of_the_spacing_is_none():
    """Nor is what is near one, in tolerances and relatively: a speed that wanders blurs multiples. Nor the reverse."""
    assert kernel.is_clear(605.0, 60.0, 0.3)
    assert not kernel.is_clear(604.0, 60.0, 0.3)
    assert not kernel.is_clear(605.0, 60.0, 0.5)
    assert kernel.is_clear(125.0, 60.0, 0.3)
    assert kernel.is_clear(273.8, 553.0, 0.36)
    assert not kernel.is_clear(273.8, 549.7, 0.36)


def twin_of_a_comb(hertz, off, spacing, teeth):
    """Odds of lines that are multiples of the rotation, those of the teeth counted apart: fitted to those near one."""
    rotation = spacing / teeth
    order = np.round(hertz / rotation)
    near = (order > 0) & (np.abs(hertz - order * rotation) <= 2.0 * off)
    weight = off[near] ** -2.0
    rotation = np.sum(weight * order[near] * hertz[near]) / np.sum(weight * order[near] ** 2)
    multiples = np.arange(1, 2000)
    at_teeth = multiples % teeth == 0
    sets = [(rotation * multiples[at_teeth], rotation * teeth)]
    if teeth > 1:
        sets.append((rotation * multiples[~at_teeth], rotation * teeth / (teeth - 1)))
    return naive.explained(hertz, off, *sets)


@pytest.mark.parametrize("teeth", [1, 2, 4])
def test_a_comb_of_teeth_with_its_rotation_is_that_of_the_twin(teeth):
    """Whatever the number of teeth; among all that there may be it is found, but for what the search costs."""
    rng = np.random.default_rng(teeth)
    hertz = 31.0 * np.concatenate([teeth * np.arange(1, 7), np.arange(1, teeth)])
    hertz = np.concatenate([hertz + 0.1 * rng.uniform(-1.0, 1.0, len(hertz)), rng.uniform(50.0, 3000.0, 3)])
    off = 0.3 + 3e-4 * hertz
    expected = max(twin_of_a_comb(hertz, off, 31.0 * teeth, t) for t in range(1, kernel.MOST_TEETH + 1))
    beside = kernel.Beside(31.0 * teeth, 0.0, 1)
    assert kernel.comb_of(hertz, off, -1, beside, 1, FACTORIALS) == pytest.approx(expected)
    three = kernel.comb_of(hertz, off, -1, beside._replace(teeth=3), 1, FACTORIALS)  # of three teeth, or alone
    assert three == pytest.approx(max(twin_of_a_comb(hertz, off, 31.0 * teeth, t) for t in (1, 3)))
    tried = math.log(6 * sum(math.floor(f / 5.0) for f in hertz))
    best = kernel.best_comb(hertz, off, -1, 5.0, hertz.max(), 1, beside, FACTORIALS)
    assert expected - tried <= best < expected
    least = kernel.best_comb(hertz, off, 2, 5.0, hertz.max(), 1, beside, FACTORIALS)
    assert least < best - 2.0  # without one of its lines


def ways(multiples, parts, places):
    """Logarithm of the ways to choose multiples among so many places, of which one in so many parts is a tooth's."""
    whole = sum(m % parts == 0 for m in multiples)
    of_teeth = max(places / parts, whole)
    others = max(places - of_teeth, len(multiples) - whole)
    return math.log(binom(of_teeth, whole) * binom(others, len(multiples) - whole))


@pytest.mark.parametrize(
    ("apart", "known", "machine"), [(4.0, 1, True), (4.0, 4, True), (4.0, 2, False), (7.0, 1, False), (7.0, 7, True)]
)
def test_a_comb_tells_why_it_has_these_lines_unless_it_is_a_machines(apart, known, machine):
    """Of three ranges with lines at some of the multiples; beside a spacing of as many teeth as may be nobody asks."""
    orders = [20, 22, 23, 60, 61, 64, 101, 103]
    hertz = 31.0 * np.array([*orders, 20.0, 7.5])  # a multiple twice, and another line
    off = np.full(len(hertz), 0.3)
    anyway = kernel.best_comb(hertz, off, -1, 30.9, 31.1, 4, kernel.Beside(31.0, 0.0, 1), FACTORIALS)
    beside = kernel.Beside(31.0 * apart, 2.0, known)
    told = kernel.best_comb(hertz, off, -1, 30.9, 31.1, 4, beside, FACTORIALS)
    assert anyway - told == pytest.approx(0.0 if machine else ways(orders, 1, 4 + 5 + 3) - 2.0)


@pytest.mark.parametrize("teeth", [1, 3, 8])
def test_how_scattered_sidebands_are(teeth):
    """Those around the vibration, those around its overtone, and the forced lines, each as so many teeth tell best."""
    around = {0.0: [3, 6, 9, 12, 13], 1003.0: [-6, -3, 0, 2, 3], 2006.0: [-4, 0]}
    hertz = np.concatenate([middle + 30.0 * np.array(multiples) for middle, multiples in around.items()])
    got = kernel.scattered_sidebands(hertz, np.full(len(hertz), 0.3), 1003.0, 30.0, teeth)
    among = range(1, kernel.MOST_TEETH + 1) if teeth == 1 else (1, teeth)
    expected = sum(min(ways(m, parts, max(m) - min(m) + 1) for parts in among) for m in around.values())
    assert got == pytest.approx(expected)
