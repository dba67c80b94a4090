"""Limit and rightmost root of one delayed mode against the general solver of physics."""

import math

import numpy as np
import pytest

from chatter_monitor.kernels.delay_roots import (
    critical_coefficient,
    opposite_critical_coefficient,
    polish_root,
    rightmost_root,
)
from chatter_monitor.physics import stability
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Mode, Spindle
from chatter_monitor.physics.terms import CATALOGUE


def cuts(count, seed):
    """Frequency, damping, speed, teeth of modes with at most 60 waves between two teeth."""
    rng = np.random.default_rng(seed)
    while count:
        frequency, damping, speed = np.exp(
            rng.uniform(np.log((180.0, 0.005, 600.0)), np.log((2200.0, 0.08, 9000.0)))
        ).tolist()
        teeth = int(rng.integers(1, 7))
        if frequency * 60.0 / (speed * teeth) < 60.0:
            count -= 1
            yield frequency, damping, speed, teeth


def by_collocation(frequency, damping, speed, teeth, kappa):
    term = AppliedTerm(CATALOGUE["regenerative_delay"], {"coefficient": kappa})
    return stability.rightmost_root(
        MachiningSystem((Mode(frequency, damping),), (term,), spindle=Spindle(speed, teeth))
    )


def roots_to_the_right(real, zeta, kappa, delay):
    """How many roots over omega have a larger real part: by the argument of D along that line."""
    p = real + 1j * np.linspace(0.0, 40.0, 400_001)
    argument = np.unwrap(np.angle(p * p + 2.0 * zeta * p + 1.0 + kappa * (1.0 - np.exp(-p * delay))))
    return round(1.0 - (argument[-1] - argument[0]) / math.pi)


def test_the_critical_coefficient_separates_stable_from_unstable_roots():
    """Half a percent below it the rightmost root of an independent solver is stable, half a percent above it is not."""
    for frequency, damping, speed, teeth in cuts(40, seed=1):
        critical = critical_coefficient(2 * math.pi * frequency, damping, 60.0 / (speed * teeth))
        assert by_collocation(frequency, damping, speed, teeth, 0.995 * critical).stable
        assert not by_collocation(frequency, damping, speed, teeth, 1.005 * critical).stable


def test_the_least_limit_is_the_closed_form():
    """Over all speeds the limit is never below 2 zeta (1 + zeta) (Tlusty), and comes down to it."""
    for damping in (0.005, 0.03, 0.1):
        limits = [critical_coefficient(1.0, damping, delay) for delay in np.linspace(5.0, 60.0, 3000)]
        assert min(limits) == pytest.approx(2.0 * damping * (1.0 + damping), rel=1e-4)
        assert min(limits) >= 2.0 * damping * (1.0 + damping) * (1.0 - 1e-9)


def test_the_opposite_coefficient_separates_stable_from_unstable_roots():
    """Half a percent nearer to zero no root has a positive real part, half a percent farther some have."""
    for frequency, damping, speed, teeth in cuts(40, seed=4):
        tau = 60.0 / (speed * teeth)
        delay, critical = (
            2 * math.pi * frequency * tau,
            opposite_critical_coefficient(2 * math.pi * frequency, damping, tau),
        )
        assert roots_to_the_right(0.0, damping, 0.995 * critical, delay) == 0
        assert roots_to_the_right(0.0, damping, 1.005 * critical, delay) >= 1


def test_the_least_opposite_limit_is_the_closed_form():
    """It is never nearer to zero than 2 zeta (1 - zeta), and comes up to it, at r^2 = 1 - 2 zeta."""
    for damping in (0.005, 0.03, 0.1):
        limits = [opposite_critical_coefficient(1.0, damping, delay) for delay in np.linspace(5.0, 60.0, 3000)]
        assert max(limits) == pytest.approx(-2.0 * damping * (1.0 - damping), rel=1e-4)
        assert max(limits) <= -2.0 * damping * (1.0 - damping) * (1.0 - 1e-9)


def test_the_rightmost_root_of_an_opposite_cut_is_the_rightmost():
    """To its right there is none, and just to its left there is one."""
    rng = np.random.default_rng(5)
    for frequency, damping, speed, teeth in cuts(40, seed=6):
        omega, tau = 2 * math.pi * frequency, 60.0 / (speed * teeth)
        kappa = opposite_critical_coefficient(omega, damping, tau) * rng.uniform(0.3, 2.4)
        root = rightmost_root(omega, damping, kappa, tau)
        assert roots_to_the_right(root.real + 1e-4, damping, kappa, omega * tau) == 0
        assert roots_to_the_right(root.real - 1e-4, damping, kappa, omega * tau) >= 1


def test_the_rightmost_root_is_that_of_the_general_solver():
    """Damping and frequency agree with collocation from 1 % to 130 % of the limit."""
    rng = np.random.default_rng(2)
    for frequency, damping, speed, teeth in cuts(60, seed=3):
        omega, tau = 2 * math.pi * frequency, 60.0 / (speed * teeth)
        kappa = critical_coefficient(omega, damping, tau) * rng.uniform(0.01, 1.3)
        truth = by_collocation(frequency, damping, speed, teeth, kappa)
        root = rightmost_root(omega, damping, kappa, tau)
        assert -root.real / abs(root) == pytest.approx(truth.damping_ratio, abs=1e-7)
        assert abs(root) * frequency == pytest.approx(truth.frequency_hz, rel=1e-7)


def test_without_regeneration_the_root_is_the_modes_own():
    """Kappa of zero leaves -zeta + i sqrt(1 - zeta^2)."""
    assert rightmost_root(3000.0, 0.03, 0.0, 0.02) == pytest.approx(complex(-0.03, math.sqrt(1 - 0.03**2)))
    root, converged = polish_root(complex(-0.1, 1.2), 0.03, 0.0, 60.0)
    assert converged
    assert root == pytest.approx(complex(-0.03, math.sqrt(1 - 0.03**2)))
