# ruff: noqa: ARG005 - every term has the same arguments
"""The catalogue of terms: complete, compiled as written, physically right, open to new entries."""

import ctypes
import math

import numpy as np
import pytest

from chatter_monitor.errors import InputError
from chatter_monitor.kernels.forces import MOST_PARAMETERS, force_along
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.model_file import model_text, read_model
from chatter_monitor.physics.parts import AppliedTerm, Mode
from chatter_monitor.physics.simulate import simulate
from chatter_monitor.physics.terms import CATALOGUE, Parameter, Term

W = 10.0
# name, parameters, (x, v, lagged, angle, memory), force by hand from MATHS.md section 5 and the paper, w = 10
BY_HAND = [
    ("cubic_stiffness", {"coefficient": 0.5}, (2.0, 1.0, 0.0, 0.0, 0.0), 0.5 * 100 * 8),
    ("quadratic_stiffness", {"coefficient": 0.5}, (-2.0, 1.0, 0.0, 0.0, 0.0), 0.5 * 100 * 4),
    ("clearance", {"coefficient": 0.5, "gap": 0.3}, (0.2, 1.0, 0.0, 0.0, 0.0), 0.0),
    ("clearance", {"coefficient": 0.5, "gap": 0.3}, (-0.5, 1.0, 0.0, 0.0, 0.0), -0.5 * 100 * 0.2),
    ("coulomb_friction", {"coefficient": 3.0}, (0.0, -0.1, 0.0, 0.0, 0.0), -3.0),
    ("coulomb_friction", {"coefficient": 3.0}, (1.0, 0.0, 0.0, 0.0, 0.0), 0.0),
    ("coulomb_friction", {"coefficient": 3.0, "width": 0.2}, (0.0, 0.1, 0.0, 0.0, 0.0), 3.0 * math.tanh(0.5)),
    (
        "stribeck_friction",
        {"coulomb": 2.0, "stiction": 1.0, "stribeck_velocity": 0.5},
        (0.0, -0.5, 0.0, 0.0, 0.0),
        -2.0 - 1.0 / math.e,
    ),
    ("hysteresis", {"coefficient": 0.5, "yield_displacement": 0.1}, (1.0, 1.0, 0.0, 0.0, 0.04), 0.5 * 100 * 0.04),
    ("quadratic_damping", {"coefficient": 0.5}, (1.0, -3.0, 0.0, 0.0, 0.0), -4.5),
    ("energy_damping", {"coefficient": -0.5}, (2.0, 3.0, 0.0, 0.0, 0.0), -6.0),
    ("regenerative_delay", {"coefficient": 0.1}, (0.5, 0.0, 0.2, 0.0, 0.0), 0.1 * 100 * 0.3),
    ("loss_of_contact", {"coefficient": 0.1, "chip_thickness": 0.4}, (0.5, 0.0, 0.2, 0.0, 0.0), 0.1 * 100 * 0.3),
    ("loss_of_contact", {"coefficient": 0.1, "chip_thickness": 0.2}, (0.5, 0.0, 0.2, 0.0, 0.0), 0.1 * 100 * 0.2),
    (
        "process_damping",
        {"coefficient": 5.0, "width_m": 0.002, "cutting_speed_m_s": 4.0},
        (0.0, 3.0, 0.0, 0.0, 0.0),
        5.0 * 0.002 / 4.0 * 3.0,
    ),
    (
        "cutting_force_nonlinearity",
        {"square": 8.0, "cube": 3.0, "cutting_speed_m_s": 2.0},
        (0.0, 1.0, 0.0, 0.0, 0.0),
        8.0 / 4.0 - 3.0 / 8.0,
    ),
    (
        "periodic_forcing",
        {"coefficient": 2.0, "order": 3.0, "phase_rad": 0.5},
        (0.0, 0.0, 0.0, 0.2, 0.0),
        -2.0 * math.cos(1.1),
    ),
]


@pytest.mark.parametrize(("name", "parameters", "state", "expected"), BY_HAND)
def test_force_has_the_value_worked_out_by_hand(name, parameters, state, expected):
    """Each term has the force and the sign of its published formula."""
    applied = AppliedTerm(CATALOGUE[name], parameters)
    x, v, lagged, angle, memory = state
    assert applied.term.force(x, v, lagged, angle, W, memory, applied.values) == pytest.approx(expected, rel=1e-12)


def test_every_term_of_the_catalogue_is_worked_out_by_hand():
    """No entry of the catalogue escapes the table above."""
    assert {row[0] for row in BY_HAND} == set(CATALOGUE)


@pytest.mark.parametrize("term", CATALOGUE.values(), ids=lambda term: term.name)
def test_term_says_what_it_is(term):
    """Every term has an equation that names all its parameters, a source, and parameters with unit and meaning."""
    assert term.source
    for parameter in term.parameters:
        assert parameter.name in term.equation
        assert parameter.unit
        assert parameter.meaning
        assert parameter.default is None or parameter.allows(parameter.default)
    assert any(parameter.linear for parameter in term.parameters)


@pytest.mark.parametrize("term", CATALOGUE.values(), ids=lambda term: term.name)
def test_compiled_force_is_the_python_force_and_linear_where_it_says_so(term):
    """The compiled function repeats the Python one, and doubling the linear parameters doubles the force."""
    rng = np.random.default_rng(5)
    states = rng.normal(size=(5, 200))
    p = np.array([0.3 + 0.4 * rng.random() for _ in term.parameters])
    doubled = np.array([2.0 * v if q.linear else v for v, q in zip(p, term.parameters, strict=True)])
    out, twice = np.empty(200), np.empty(200)
    for values, result in ((p, out), (doubled, twice)):
        force_along(term.compiled_force.address, *states[:4], W, states[4], values, result)
    python = [term.force(x, v, lag, angle, W, z, tuple(p)) for x, v, lag, angle, z in states.T]
    np.testing.assert_allclose(out, python, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(twice, 2.0 * out, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("term", [term for term in CATALOGUE.values() if not term.needs_spindle], ids=lambda t: t.name)
def test_above_an_amplitude_a_force_is_what_it_was_and_below_it_nothing(term):
    """Compiled and in Python, at a state within and a state beyond; and it is another function than all along."""
    above = term.above_amplitude
    p = (*(0.3 for _ in term.parameters), 1.5)
    out = np.empty(2)
    x, v = np.array([1.0, 1.0]), np.array([1.0, 2.0]) * W
    nothing = np.zeros(2)
    force_along(above.compiled_force.address, x, v, nothing, nothing, W, nothing + 0.2, np.array(p), out)
    expected = term.force(x[1], v[1], 0.0, 0.0, W, 0.2, p[:-1])
    assert (out[0], out[1]) == (0.0, pytest.approx(expected, rel=1e-12))
    assert above.force(x[1], v[1], 0.0, 0.0, W, 0.2, p) == pytest.approx(expected, rel=1e-12)
    force_along(term.compiled_force.address, x, v, nothing, nothing, W, nothing + 0.2, np.array(p), out)
    assert out[0] == pytest.approx(term.force(x[0], v[0], 0.0, 0.0, W, 0.2, p[:-1]), rel=1e-12)


def test_a_force_above_an_amplitude_travels_through_a_model_file(tmp_path):
    """The amplitude is a parameter of the term in the file; a force of the spindle has none."""
    applied = AppliedTerm(CATALOGUE["clearance"].above_amplitude, {"coefficient": 0.2, "gap": 0.5, "above": 1.2})
    system = MachiningSystem((Mode(100.0, 0.02),), (applied,))
    file = tmp_path / "model.toml"
    file.write_text(model_text(system), encoding="utf-8")
    again = read_model(file).terms[0]
    assert again.parameters == applied.parameters
    assert again.term.equation == applied.term.equation
    file.write_text(model_text(system).replace("clearance", "periodic_forcing"), encoding="utf-8")
    with pytest.raises(InputError, match="above"):
        read_model(file)


def test_hysteresis_sticks_then_slips():
    """Bouc-Wen: the state follows small motions, saturates at the yield displacement, and its loop takes energy."""
    term = CATALOGUE["hysteresis"]
    p = (1.0, 0.1, 0.5)

    def loop(amplitude):
        time = np.linspace(0.0, 4.0 * math.pi, 40001)
        z, states = 0.0, []
        for v in amplitude * np.cos(time):
            states.append(z)
            z += (time[1] - time[0]) * term.memory_rate(0.0, v, 0.0, 0.0, W, z, p)
        last = slice(20000, 40001)
        work = np.trapezoid(np.array(states)[last] * amplitude * np.cos(time[last]), time[last])
        return np.max(np.abs(states)), work

    small, work_small = loop(0.001)
    large, work_large = loop(2.0)
    assert small == pytest.approx(0.001, rel=0.02)
    assert large == pytest.approx(0.1, rel=0.01)
    assert work_small < 0.02 * math.pi * 0.001**2
    assert work_large == pytest.approx(4 * 0.1 * 2.0, rel=0.15)


TOY = Term(
    name="toy_wall",
    equation="w^2 stiffness max(x - distance, 0)",
    source="this test",
    parameters=(
        Parameter("stiffness", "1", "of the wall", lower=0.0, linear=True),
        Parameter("distance", "u", "to the wall", lower=0.0),
    ),
    force=lambda x, v, lagged, angle, w, memory, p: p[0] * w * w * max(x - p[1], 0.0),
)


def test_a_new_term_needs_nothing_but_itself(tmp_path):
    """A term written in this file is read from a model file, written back, and felt in the simulation."""
    text = """
        [[mode]]
        frequency_hz = 200.0
        damping_ratio = 0.02
        [[term]]
        name = "toy_wall"
        stiffness = 400
        distance = 0.2
    """
    file = tmp_path / "toy.toml"
    file.write_text(text)
    system = read_model(file, {"toy_wall": TOY})
    file.write_text(model_text(system))
    assert read_model(file, {"toy_wall": TOY}) == system
    free = simulate(MachiningSystem((Mode(200.0, 0.02),)), 1.0, seed=4).displacement
    walled = simulate(system, 1.0, seed=4).displacement
    assert free.max() > 1.0
    assert walled.max() < 0.4
    assert walled.min() < -0.5


@pytest.mark.parametrize(
    ("name", "parameters", "words"),
    [
        ("clearance", {"coefficient": -0.5, "gap": 0.1}, ["coefficient of clearance", "-0.5", ">= 0"]),
        ("clearance", {"coefficient": 0.5, "gap": 0.0}, ["gap of clearance", "> 0"]),
        ("clearance", {"coefficient": 0.5}, ["lacks", "gap", "half of the clearance"]),
        ("hysteresis", {"coefficient": 1.0, "yield_displacement": 1.0, "sharpness": 2.0}, ["sharpness", "<= 1"]),
        ("cubic_stiffness", {"coefficient": math.nan}, ["coefficient of cubic_stiffness", "any finite number"]),
        ("cubic_stiffness", {"coefficient": 1.0, "gap": 1.0}, ["no parameter gap", "coefficient"]),
    ],
)
def test_parameters_outside_physics_are_refused(name, parameters, words):
    """A parameter that is missing, unknown or out of bounds is named with what is allowed."""
    with pytest.raises(InputError) as caught:
        AppliedTerm(CATALOGUE[name], parameters)
    assert all(word in str(caught.value) for word in words), str(caught.value)


@pytest.mark.parametrize("term", CATALOGUE.values(), ids=lambda term: term.name)
def test_rows_are_the_force_at_each_state(term):
    """The force inlined into a loop gives what the term gives state by state, with all of its parameters."""
    states = np.random.default_rng(5).standard_normal((5, 50))
    values = np.linspace(0.5, 0.9, len(term.parameters))
    padded, result = np.zeros(MOST_PARAMETERS), np.empty(50)
    padded[: values.size] = values
    x, v, lagged, angle, memory, p, out = (
        each.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for each in (*states, padded, result)
    )
    term.compiled_row.ctypes(x, v, lagged, angle, 3.0, memory, p, 50, out)
    expected = [term.force(*state[:4], 3.0, state[4], values) for state in states.T]
    np.testing.assert_allclose(result, expected, rtol=1e-12, atol=1e-12)
