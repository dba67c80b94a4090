"""What the observer says it does not know of the tool's state, against motion that is known at every instant."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.innovations import Innovations
from chatter_monitor.discrepancy.observer import Linear, observer, unbent
from chatter_monitor.kernels.observer import (
    AFTER,
    AHEAD,
    BEFORE,
    NODES,
    SEEN,
    SUBSTEPS,
    delayed,
    either_side,
    share_above,
)
from chatter_monitor.physics.parts import AppliedTerm, Mode
from chatter_monitor.physics.terms import CATALOGUE
from tests.discrepancy.machine import OVERSAMPLING, Machine, coefficient, record, states

DECIMATION = 2  # so that a period of 400 Hz has 16 samples


def along(s, x0, v0, x1, v1, step_s):
    """Velocity on the cubic through both ends."""
    return (
        6.0 * s * (1.0 - s) * (x1 - x0) / step_s
        + (1.0 - s) * (1.0 - 3.0 * s) * v0
        + s * (3.0 * s - 2.0) * v1
    )  # fmt: skip


def test_the_spread_is_that_of_the_errors():
    """Along a step the velocity is off by as much as the observer says, before its end is seen and after."""
    machine = Machine(seconds=20.0)
    x, v, _ = states(machine, 0.0, 7)
    every = DECIMATION * OVERSAMPLING
    noise = 1e-2
    seen = x[::every] + noise * np.random.default_rng(7).standard_normal(x[::every].size)
    recorded = Recorded(seen, np.zeros(seen.size, dtype=bool), machine.rate_hz / DECIMATION)
    mode = Mode(machine.frequency_hz, machine.damping_ratio)
    inn = Innovations(recorded, Linear((mode,), "displacement", noise**2))
    o, motion = inn.observer, inn.motion
    inner = slice(500, -500)
    known_x, known_v = motion.x[0], motion.v[0]

    def spread_of(row: int) -> float:
        return float(np.hypot(*o.spread[row][1]))

    def off(error) -> float:
        return float(np.std(error[inner]))

    true_v = v[::every]
    assert off(true_v - known_v) == pytest.approx(spread_of(SEEN), rel=0.05)
    assert off(true_v[1:] - motion.v[1, :-1]) == pytest.approx(spread_of(AHEAD), rel=0.05)
    back_x, back_v = (o.back[i] * inn.errors[1:] for i in range(2))
    for i, s in enumerate(NODES[:SUBSTEPS]):
        there = v[round(s * every) :: every][: seen.size - 1]
        before = along(s, known_x[:-1], known_v[:-1], motion.x[1, :-1], motion.v[1, :-1], o.step_s)
        after = along(s, known_x[:-1] + back_x, known_v[:-1] + back_v, known_x[1:], known_v[1:], o.step_s)
        assert off(there - before) == pytest.approx(spread_of(BEFORE + i), rel=0.05)
        assert off(there - after) == pytest.approx(spread_of(AFTER + i), rel=0.05)


def observed(machine: Machine, samples: NDArray[np.float64], friction: float) -> Innovations:
    """Errors of an observer that knows so much dry friction."""
    recorded = Recorded(samples, np.zeros(samples.size, dtype=bool), machine.rate_hz)
    linear = Linear((Mode(machine.frequency_hz, machine.damping_ratio),), machine.quantity, 1e-4)
    known = AppliedTerm(CATALOGUE["coulomb_friction"], {"coefficient": friction, "width": 0.0})
    return Innovations(recorded, linear, [known])


def test_what_the_tool_does_beyond_the_band_is_not_known():
    """With little noise the velocity lacks what the anti-alias filter took off, and the observer says so."""
    machine = Machine(frequency_hz=900.0, quantity="velocity", seconds=4.0, snr_db=60.0)
    inn = observed(machine, record(machine, 8), 1e-3)
    _, v, _ = states(machine, 0.0, 8)
    left = (v[::OVERSAMPLING] - inn.motion.v[0])[500:-500]
    assert inn.observer.spread[SEEN][1, 0] == pytest.approx(np.std(left), rel=0.2)


def test_errors_change_smoothly_with_a_force_that_jumps():
    """So that slopes are slopes: along 4 % of dry friction the likelihood is a parabola to a twentieth of a nat."""
    machine = Machine("coulomb", 0.08, quantity="velocity", seconds=5.0)
    samples, whole = record(machine, 9), coefficient(machine)
    share = np.linspace(-0.02, 0.02, 11)
    runs = [observed(machine, samples, (1.0 + by) * whole) for by in share]
    loss = np.array([0.5 * np.count_nonzero(inn.used) * np.log(np.mean(inn.white[inn.used] ** 2)) for inn in runs])
    assert np.max(np.abs(loss - np.polyval(np.polyfit(share, loss, 2), share))) < 0.05


@pytest.mark.parametrize("expected", [-3.0, -0.7, 0.0, 0.2, 3.0])
def test_either_side_of_a_normal_variable(expected):
    """Chance, mean and scatter are those of the truncated normal distribution."""
    below, above = stats.truncnorm(-np.inf, -expected), stats.truncnorm(-expected, np.inf)
    wanted = [(stats.norm.cdf(s * expected), side.mean(), side.std()) for s, side in ((-1, below), (1, above))]
    np.testing.assert_allclose(either_side(expected), wanted, atol=2e-3)


@pytest.mark.parametrize(("x", "v"), [(1.0, 0.0), (0.0, 1000.0), (0.8, -700.0), (0.2, 900.0)])
def test_the_chance_of_being_above_an_amplitude(x, v):
    """That of a normal state about the one that is expected, by Monte Carlo."""
    omega = 1000.0
    spread = np.array([[0.01, 0.02], [100.0, 0.0]])
    drawn = np.array([[x], [v]]) + spread @ np.random.default_rng(3).standard_normal((2, 100_000))
    amplitude = np.hypot(drawn[0], drawn[1] / omega)
    for above in (0.9, 1.0, 1.1):
        assert share_above(above, x, v, omega, spread) == pytest.approx(np.mean(amplitude > above), abs=0.05)
    assert share_above(0.0, x, v, omega, spread) == 1.0


def test_a_force_acts_between_two_times():
    """The filter knows it there only: errors before are those of the machine without it."""
    machine = Machine("clearance", 0.06, frequency_hz=220.0, seconds=4.0, between_s=(1.0, 2.0))
    samples = record(machine, 5)
    recorded = Recorded(samples, np.zeros(samples.size, dtype=bool), machine.rate_hz)
    linear = Linear((Mode(machine.frequency_hz, machine.damping_ratio),), "displacement", 1e-3)
    omega = linear.modes[0].omega
    term = AppliedTerm(CATALOGUE["clearance"], {"coefficient": coefficient(machine) / omega**2, "gap": 1.0})
    knows = Innovations(recorded, linear, [term], between_s=[(1.0, 2.0)])
    never = Innovations(recorded, linear, [term], between_s=[(9.0, 9.0)])
    begin = round(1.0 * machine.rate_hz)
    np.testing.assert_array_equal(knows.errors[:begin], never.errors[:begin])
    there, gone = slice(begin, 2 * begin), slice(round(2.2 * machine.rate_hz), None)
    assert np.std(knows.errors[there]) < np.std(never.errors[there])
    np.testing.assert_allclose(knows.errors[gone], never.errors[gone], atol=1e-6 * np.std(samples))


def test_a_delay_between_samples_takes_nothing_off_a_vibration():
    """At 14 samples a period, wherever the delay lies between two samples."""
    turn = 2.0 * np.pi / 14.0
    x = np.sin(turn * np.arange(60))
    for delay in (2.0, 2.5, 7.25, 20.5, 33.9):
        found = [delayed(x, now, delay) for now in range(40, 60)]
        assert found == pytest.approx(np.sin(turn * (np.arange(40, 60) - delay)), abs=2e-3)
    assert delayed(x, 40, 1.5) == pytest.approx(0.5 * (x[38] + x[39]))
    assert delayed(x, 3, 5.0) == 0.0


@pytest.mark.parametrize("quantity", ["acceleration", "pressure"])
@pytest.mark.parametrize("samples_per_period", [8.0, 14.0, 40.0])
def test_a_force_moves_the_tool_as_it_moves_the_machine(quantity, samples_per_period):
    """A force that the observer knows is felt at the mode's frequency as a linear machine feels it, within 0.1 %."""
    linear = Linear((Mode(400.0, 0.01),), quantity, 1e-3)
    rate_hz = samples_per_period * 400.0
    o = observer(linear, rate_hz)
    z = np.exp(2j * np.pi * 400.0 / rate_hz)
    state = np.linalg.solve(z * np.eye(o.gain.size) - o.transition, o.begin + z * o.end)
    felt = o.output @ state + o.feed
    at = np.array([400.0])
    true = -(linear.receptance(at) * linear.sensed(at))[0]  # a positive force pushes back
    assert abs(felt / true - 1.0) < 1e-3


@pytest.mark.parametrize("turn", [1e-3, 0.449, 2.8])
def test_straight_lines_are_made_up_for_at_the_mode_and_at_rest(turn):
    """The weights are 1 at 0 Hz and for the newest sample, and undo what straight lines lose of that turn."""
    weights = unbent(turn)
    response = weights @ np.exp(-1j * turn * np.arange(4))
    assert weights[0] == 1.0
    assert weights.sum() == pytest.approx(1.0, abs=1e-9)
    assert response == pytest.approx(1.0 / np.sinc(0.5 * turn / np.pi) ** 2, abs=1e-6)
