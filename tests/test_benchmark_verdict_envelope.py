"""The lines that `benchmarks.verdict.envelope` makes are what theory says of them, and so is what it tells of them."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.verdict.envelope import energies, measures, recall, together

EULER = 0.5772


def test_a_mode_that_noise_drives_has_an_exponential_energy():
    """Its amplitude is that of Rayleigh; the logarithm of its energy is Euler's constant below that of the mean."""
    told = measures(energies(np.random.default_rng(1), 40, 60.0, chatters=False))
    assert np.median(told["variation of the amplitude"]) == pytest.approx(-0.5227, abs=0.03)
    assert np.median(told["potential: shape k"]) == pytest.approx(-EULER, abs=0.04)
    assert np.median(told["potential: time near rest"]) == pytest.approx(np.exp(-0.25) - 1.0, abs=0.02)


def test_a_limit_cycle_is_seldom_near_rest():
    """Its amplitude varies as it was asked to, by 5 to 40 %, a little less within the window of a transform."""
    told = measures(energies(np.random.default_rng(1), 40, 60.0, chatters=True))
    assert -0.45 < told["variation of the amplitude"].min() < -0.2
    assert -0.1 < told["variation of the amplitude"].max() < -0.02
    assert told["potential: time near rest"].min() > -0.12


def test_recall_at_few_false_ones():
    stable, chatter = np.arange(1000.0), np.array([500.0, 995.0, 2000.0, 3000.0])
    assert recall(stable, chatter) == 0.75
    rng = np.random.default_rng(2)
    apart = rng.standard_normal((4000, 2)) + np.array([0.0, 3.0])
    assert together(rng.standard_normal((4000, 2)), apart) == pytest.approx(0.75, abs=0.05)
