"""The integrator against closed forms, energy and a naive twin."""

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

from chatter_monitor.kernels.forces import compile_force, force_along
from chatter_monitor.kernels.oscillator import OK, integrate, oscillator
from chatter_monitor.physics.terms import CATALOGUE

W = 2.0 * np.pi * 50.0


def make(modes, terms=(), speed=0.0, teeth=1, chip_thickness=np.inf):
    """An oscillator with `modes` of (w, zeta, g) and `terms` of (name, parameters)."""
    columns = np.cumsum([3 * len(modes) + 2, *(len(values) for _, values in terms)])
    table = np.zeros((1, columns[-1]))
    table[0, : 3 * len(modes)] = np.ravel(modes)
    table[0, 3 * len(modes)] = speed
    table[0, 3 * len(modes) + 1] = chip_thickness
    for column, (_, values) in zip(columns, terms, strict=False):
        table[0, column : column + len(values)] = values
    entries = [CATALOGUE[name] for name, _ in terms]
    forces = np.array([t.compiled_force.address for t in entries], np.int64)
    rates = np.array([t.compiled_rate.address if t.compiled_rate else 0 for t in entries], np.int64)
    return oscillator(np.zeros(1), table, len(modes), teeth, forces, columns[:-1], rates)


def run(system, drive, step_s, history=0):
    x, v, a = np.zeros((3, drive.size - 1))
    surface = np.zeros((2, history + drive.size - 1))
    assert integrate(system, drive, step_s, history, surface, x, v, a) == OK
    return x, v, a


def order_of(error):
    """Observed orders between successive halvings of the step."""
    return np.log2(np.array(error[:-1]) / np.array(error[1:]))


def test_free_vibration_of_a_nonlinear_oscillator_converges_with_order_four():
    """Halving the step divides the error of a hardening, damped oscillator by 16."""

    def end(steps):
        system = make([(W, 0.02, 1.0)], [("cubic_stiffness", (0.3,)), ("energy_damping", (20.0,))])
        system.y[0] = 1.0
        x, _, _ = run(system, np.zeros(steps + 2), 0.1 / steps)
        return x[steps]

    reference = end(64000)
    errors = [abs(end(steps) - reference) for steps in (200, 400, 800)]
    np.testing.assert_allclose(order_of(errors), 4.0, atol=0.2)


def test_delay_follows_the_method_of_steps_with_order_four():
    """A ramp on x'' + W^2 x = k x(t - tau) + t, solved by hand over two delays, is met with order four."""
    kappa, tau, speed = 0.4, 0.017, 2.0 * np.pi / 0.017
    big = W * np.sqrt(1.0 + kappa)
    errors = []
    for steps in (100, 200, 400, 800):
        step = 2.0 * tau * 0.9 / steps  # tau is no whole number of steps
        history = int(np.ceil(tau / step)) + 2
        time = step * np.arange(steps + 1)
        system = make([(W, 0.0, 1.0)], [("regenerative_delay", (kappa,))], speed)
        x, _, _ = run(system, time, step, history)
        t = time[:-1]
        s = np.maximum(t - tau, 0.0)
        first = (t - np.sin(big * t) / big) / big**2
        second = (s - np.sin(big * s) / big + 0.5 * s * np.cos(big * s) - 0.5 * np.sin(big * s) / big) / big**2
        errors.append(np.max(np.abs(x - first - kappa * W**2 / big**2 * second)) / np.max(np.abs(first)))
    np.testing.assert_allclose(order_of(errors), 4.0, atol=0.3)
    assert errors[-1] < 1e-8


def test_energy_is_what_was_put_in_less_what_was_dissipated():
    """Kinetic plus potential energy equals the work of the drive minus that of damper and friction."""
    step = 5e-6
    time = step * np.arange(80001)
    drive = 1e4 * np.sin(2.0 * np.pi * 43.0 * time) + 3e3 * np.cos(2.0 * np.pi * 111.0 * time)
    zeta, k3, c2 = 0.03, 0.5, 0.4
    system = make([(W, zeta, 1.0)], [("cubic_stiffness", (k3,)), ("quadratic_damping", (c2,))])
    x, v, _ = run(system, drive, step)
    energy = 0.5 * v**2 + 0.5 * W**2 * x**2 + 0.25 * k3 * W**2 * x**4
    power = drive[:-1] * v - 2.0 * zeta * W * v**2 - c2 * np.abs(v) ** 3
    work = cumulative_simpson(power, dx=step, initial=0.0)
    np.testing.assert_allclose(energy, work, atol=5e-6 * energy.max())


def naive_run(modes, force, drive, step, tau, chip_thickness):
    """Runge-Kutta in plain Python; the surface is kept as a list of positions and slopes and read by a cubic."""
    w, zeta, g = (np.array(column) for column in zip(*modes, strict=True))
    q, p, past, motion = np.zeros(len(modes)), np.zeros(len(modes)), [], []

    def lagged(time):
        if time < 0.0:
            return 0.0, 0.0
        i = int(time / step)
        s = time / step - i
        (x0, v0), (x1, v1) = past[i], past[i + 1]
        slope0, slope1, rise = step * v0, step * v1, x1 - x0
        square, cube = 3 * rise - 2 * slope0 - slope1, slope0 + slope1 - 2 * rise
        return x0 + s * (slope0 + s * (square + s * cube)), (slope0 + s * (2 * square + s * 3 * cube)) / step

    def rates(q, p, push, time):
        push = push - force(g @ q, g @ p, lagged(time - tau)[0])
        return p, g * push - 2 * zeta * w * p - w**2 * q

    for n in range(drive.size - 1):
        motion.append((g @ q, g @ p))
        before, slope = lagged(n * step - tau)
        in_cut = g @ q - before <= chip_thickness
        past.append(motion[-1] if in_cut else (before + chip_thickness, slope))
        half = 0.5 * (drive[n] + drive[n + 1])
        a1, b1 = rates(q, p, drive[n], n * step)
        a2, b2 = rates(q + step / 2 * a1, p + step / 2 * b1, half, (n + 0.5) * step)
        a3, b3 = rates(q + step / 2 * a2, p + step / 2 * b2, half, (n + 0.5) * step)
        a4, b4 = rates(q + step * a3, p + step * b3, drive[n + 1], (n + 1) * step)
        q = q + step / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        p = p + step / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
    return np.array(motion)


def test_the_kernel_agrees_with_its_naive_twin():
    """Two modes, a delay that loses contact and friction: the kernel repeats the plain Python integration."""
    modes = [(W, 0.02, 1.0), (3.3 * W, 0.03, -0.6)]
    terms = [("loss_of_contact", (0.3, 2e-4)), ("coulomb_friction", (0.5, 0.01))]
    step, teeth, speed = 5e-5, 3, 2.0 * np.pi * 40.0
    tau = 1.0 / (40.0 * teeth)
    drive = np.random.default_rng(0).normal(0.0, 100.0, 1500)
    x, v, _ = run(make(modes, terms, speed, teeth, 2e-4), drive, step, int(tau / step) + 3)

    def force(x, v, lagged):
        return 0.3 * W**2 * min(x - lagged, 2e-4) + 0.5 * np.tanh(v / 0.01)

    twin = naive_run(modes, force, drive, step, tau, 2e-4)
    assert np.any(np.abs(x) > 2e-4)
    np.testing.assert_allclose(x, twin[:, 0], atol=1e-12)
    np.testing.assert_allclose(v, twin[:, 1], atol=1e-9)


def test_stretches_continue_bit_identically():
    """Integrating in pieces gives the same bits as in one go, delay and hysteresis included."""
    terms = [("regenerative_delay", (0.05,)), ("hysteresis", (0.2, 1e-4, 0.5)), ("periodic_forcing", (30.0, 2.0, 0.1))]
    step, speed = 5e-5, 2.0 * np.pi * 120.0
    history = int(1.0 / 120.0 / step) + 3
    drive = np.random.default_rng(1).normal(0.0, 100.0, 3001)
    whole, _, _ = run(make([(W, 0.02, 1.0)], terms, speed), drive, step, history)
    system = make([(W, 0.02, 1.0)], terms, speed)
    x, v, a = np.zeros((3, 3000))
    surface = np.zeros((2, history + 3000))
    first = 0
    for size in (1, 700, 13, 2286):
        past, part = surface[:, first : history + first + size], slice(first, first + size)
        assert integrate(system, drive[first : first + size + 1], step, history, past, x[part], v[part], a[part]) == OK
        first += size
    np.testing.assert_array_equal(x, whole)


def test_parameters_drift_linearly_between_their_knots():
    """A frequency that rises from 50 to 60 Hz turns the phase by the integral of the frequency."""
    knots, none = np.array([0.0, 1.0]), np.zeros(0, np.int64)
    table = np.array([[2 * np.pi * 50.0, 0.0, 1.0, 0.0, np.inf], [2 * np.pi * 60.0, 0.0, 1.0, 0.0, np.inf]])
    system = oscillator(knots, table, 1, 1, none, none, none)
    system.y[0] = 1.0
    x, v, _ = run(system, np.zeros(10002), 1e-4)
    cycles = np.unwrap(np.arctan2(-v / (2 * np.pi * (50.0 + np.linspace(0.0, 10.0, x.size))), x)) / (2.0 * np.pi)
    assert cycles[10000] == pytest.approx(55.0, abs=0.01)


def test_a_motion_that_leaves_the_range_of_numbers_is_reported():
    """Unlimited growth ends the run with the step at which it happened, not with NaN in the output."""
    system = make([(W, -0.9, 1.0)])
    system.y[0] = 1.0
    x, v, a = np.zeros((3, 100000))
    stop = integrate(system, np.zeros(100001), 1e-4, 0, np.zeros((2, 0)), x, v, a)
    assert 0 < stop < 100000
    assert np.all(np.isfinite(x[:stop]))


def test_force_along_evaluates_any_compiled_function():
    """A function compiled here and now is evaluated at every state through its address."""
    compiled = compile_force(lambda x, v, lagged, angle, w, memory, p: p[0] * x * v + lagged - angle + w * memory)
    states = np.random.default_rng(2).normal(size=(5, 50))
    out = np.empty(50)
    force_along(compiled.address, states[0], states[1], states[2], states[3], 7.0, states[4], np.array([3.0]), out)
    np.testing.assert_allclose(out, 3.0 * states[0] * states[1] + states[2] - states[3] + 7.0 * states[4])
