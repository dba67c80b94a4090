"""Accuracy over many records. `benchmarks/identification.py` prints the same over more; seeds from 700 on."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.energy import identify
from tests.energy.reference import damping, dry, energy_quantiles, excitation_case, noise_driven, simulate, turbulent

RATE = 12800.0
FIRST_SEED = 700
SHARES = [0.025, 0.1, 0.25, 0.5, 0.75, 0.9, 0.975]

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]


@pytest.mark.parametrize(("damping_ratio", "allowed"), [(0.001, 0.02), (0.01, 0.05)])
def test_stiffness_and_its_intervals(damping_ratio, allowed):
    """U(x) stays within 2 % (5 % at 1 % damping) in each of 30 records, and the intervals of k1, k3 cover 95 %."""
    oscillator = noise_driven(damping_ratio, k3=0.0375)
    x = np.linspace(0.05, 2.3, 40)
    true = 0.5 * oscillator.k1 * x**2 + 0.25 * oscillator.k3 * x**4
    caught = np.zeros(2)
    for seed in range(FIRST_SEED, FIRST_SEED + 30):
        s = identify(simulate(oscillator, 60.0, seed, settle_s=2.0), RATE).stiffness
        for side in (-1.0, 1.0):
            np.testing.assert_allclose(s.potential.energy(side * x), true, rtol=allowed)
        caught += [s.k1_ci95[0] < oscillator.k1 < s.k1_ci95[1], s.k3_ci95[0] < oscillator.k3 < s.k3_ci95[1]]
    # 24 or fewer of 30 has a probability of 0.3 % at 95 %. The 93 of 100 of the issue is the benchmark's to show.
    assert (caught >= 25).all()


@pytest.mark.parametrize(
    ("oscillator", "allowed"),
    [(noise_driven(0.01), 0.05), (dry(), 0.15), (turbulent(), 0.15)],
    ids=["linear", "dry", "v|v|"],
)
def test_damping_and_intensity(oscillator, allowed):
    """Over 12 records h(E) is right on average over 95 % of the time, and S0 is within 10 % in each."""
    at = energy_quantiles(oscillator, SHARES)
    found = []
    for seed in range(FIRST_SEED, FIRST_SEED + 12):
        d = identify(simulate(oscillator, 60.0, seed), RATE).damping
        found.append(np.interp(at, d.energy, d.h) / damping(oscillator, at))
        assert d.s0 == pytest.approx(oscillator.intensity, rel=0.1)
    np.testing.assert_allclose(np.mean(found, axis=0), 1.0, atol=allowed)


@pytest.mark.parametrize("kind", ["noise_driven", "negative_damping", "regenerative"])
def test_self_excited_and_noise_driven_are_told_apart(kind):
    """At most one of 50 random five-second records is taken for the other kind."""
    truth = "noise_driven" if kind == "noise_driven" else "self_excited"
    seeds = range(FIRST_SEED, FIRST_SEED + 50)
    found = [identify(excitation_case(kind, seed), RATE, replicates=20).excitation.kind for seed in seeds]
    assert found.count(truth) >= 49
