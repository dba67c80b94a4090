# ruff: noqa: ARG005 - every term has the same arguments
"""Characteristic roots against closed forms, among them the Lambert W function."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.special import lambertw

from chatter_monitor.physics import cuts
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Mode, Spindle
from chatter_monitor.physics.stability import (
    characteristic_roots,
    linear_force,
    rightmost_root,
    rightmost_roots_along,
)
from chatter_monitor.physics.terms import CATALOGUE, Parameter, Term

FREE_DELAY = Term(
    name="free_delay",
    equation="stiffness x - lag x(t - tau)",
    source="this test: a delayed spring of either sign",
    parameters=(Parameter("stiffness", "1/s^2", "spring"), Parameter("lag", "1/s^2", "delayed spring")),
    force=lambda x, v, lagged, angle, w, memory, p: p[0] * x - p[1] * lagged,
    delayed=True,
)


def applied(name, **parameters):
    return AppliedTerm(CATALOGUE[name], parameters)


@pytest.mark.parametrize("speed_rpm", [900.0, 3000.0, 12000.0])
@pytest.mark.parametrize("lag", [5e4, 6e5, -4e5])
def test_roots_of_a_perfect_square_are_those_of_lambert_w(speed_rpm, lag):
    """(s + a)^2 = b exp(-s tau) has the roots W_k(+-sqrt(b) tau/2 exp(a tau/2)) 2/tau - a; both ways agree to 1e-9."""
    mode = Mode(300.0, 0.03)
    a = mode.damping_ratio * mode.omega
    square = {"stiffness": a**2 - mode.omega**2, "lag": lag}
    system = MachiningSystem((mode,), (AppliedTerm(FREE_DELAY, square),), spindle=Spindle(speed_rpm))
    tau = 60.0 / speed_rpm
    root_b = np.sqrt(complex(lag))
    exact = np.array(
        [
            2.0 / tau * lambertw(sign * root_b * tau / 2.0 * math.exp(a * tau / 2.0), k) - a
            for sign in (1.0, -1.0)
            for k in range(-12, 13)
        ]
    )
    exact = exact[exact.imag >= -1e-9]
    exact = exact[np.argsort(-exact.real)]
    found = characteristic_roots(system)
    known = min(found.size, 6)
    assert known >= 5
    np.testing.assert_allclose(found[:known].real, exact[:known].real, rtol=0.0, atol=1e-9 * abs(exact[0]))
    assert found[0] == pytest.approx(exact[0], rel=1e-9)


def test_without_delay_the_roots_are_those_of_the_modes():
    """Two uncoupled modes give their own frequencies and damping ratios."""
    modes = (Mode(300.0, 0.02), Mode(800.0, 0.001))
    roots = characteristic_roots(MachiningSystem(modes))
    expected = [m.omega * complex(-m.damping_ratio, math.sqrt(1.0 - m.damping_ratio**2)) for m in modes]
    np.testing.assert_allclose(sorted(roots, key=abs), expected, rtol=1e-9)
    root = rightmost_root(MachiningSystem((Mode(412.0, 0.021),)))
    assert root.frequency_hz == pytest.approx(412.0)
    assert root.damping_ratio == pytest.approx(0.021)
    assert root.stable


def test_slopes_at_rest_are_those_of_the_terms():
    """Linear parts count, curvature and jumps do not: w^2 (kappa + Bouc-Wen), C b / v_c, and -kappa w^2 for the lag."""
    mode = Mode(100.0, 0.02)
    system = MachiningSystem(
        (mode,),
        (
            applied("loss_of_contact", coefficient=0.1, chip_thickness=1e-3),
            applied("hysteresis", coefficient=0.2, yield_displacement=1e-3),
            applied("process_damping", coefficient=50.0, width_m=0.002, cutting_speed_m_s=4.0),
            applied("cubic_stiffness", coefficient=5.0),
            applied("clearance", coefficient=5.0, gap=1e-4),
            applied("coulomb_friction", coefficient=5.0),
            applied("periodic_forcing", coefficient=5.0, order=1.0),
        ),
        spindle=Spindle(1000.0),
    )
    force = linear_force(system)
    assert force.stiffness == pytest.approx(0.3 * mode.omega**2, rel=1e-6)
    assert force.damping == pytest.approx(50.0 * 0.002 / 4.0, rel=1e-6)
    assert force.lag == pytest.approx(-0.1 * mode.omega**2, rel=1e-6)


def test_every_root_solves_the_characteristic_equation_and_none_is_missing():
    """Roots of a two-mode cut are zeros of D(s), and as many as the argument principle counts in a rectangle."""
    modes = (Mode(400.0, 0.02), Mode(900.0, 0.03, 0.7))
    system = MachiningSystem(modes, (applied("regenerative_delay", coefficient=0.08),), spindle=Spindle(1700.0))
    force, tau = linear_force(system), 60.0 / 1700.0

    def characteristic(s):
        P = [s**2 + 2.0 * m.damping_ratio * m.omega * s + m.omega**2 for m in modes]
        Q = P[1] + 0.49 * P[0]
        return P[0] * P[1] + Q * (force.stiffness + force.lag * np.exp(-s * tau))

    roots = characteristic_roots(system)
    scale = modes[0].omega ** 4
    assert np.max(np.abs(characteristic(roots[:40]))) < 1e-6 * scale
    left, right, low, high = -100.0, 400.0, 10.0, 8000.0
    corners = [left + 1j * low, right + 1j * low, right + 1j * high, left + 1j * high, left + 1j * low]
    path = np.concatenate([np.linspace(a, b, 40001) for a, b in pairwise(corners)])
    turns = np.unwrap(np.angle(characteristic(path)))
    inside = (roots.real > left) & (roots.real < right) & (roots.imag > low) & (roots.imag < high)
    assert inside.sum() > 10
    assert inside.sum() == round((turns[-1] - turns[0]) / (2.0 * math.pi))


def test_roots_followed_along_a_cut_are_those_found_afresh():
    """Following the roots of the bar by Newton's method gives what collocation gives at each time."""
    bar = cuts.bar_turning()
    times = [0.05 * i + 0.025 for i in range(60, 220)]
    path = rightmost_roots_along(bar, times)
    for i in (7, 39, 99, 130, 159):
        fresh = rightmost_root(bar.at(times[i]))
        assert path[i].frequency_hz == pytest.approx(fresh.frequency_hz, rel=1e-9)
        assert path[i].damping_ratio == pytest.approx(fresh.damping_ratio, rel=1e-6)
