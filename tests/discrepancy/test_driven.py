"""Diagnosis with a measured force, on machines that an integrator of the test's own drives."""

from __future__ import annotations

import numpy as np
import pytest
import soundfile
from numba import njit
from scipy import signal

from chatter_monitor.discrepancy.diagnosis import recorded_from
from chatter_monitor.discrepancy.driven.case import examine_driven
from chatter_monitor.discrepancy.driven.conclude import conclude_driven
from chatter_monitor.errors import InputError
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.model_file import read_model
from chatter_monitor.physics.parts import Mode, Sensor
from chatter_monitor.service.diagnosing import diagnose_file, lines

RATE_HZ, SECONDS = 500.0, 14.0
FREQUENCY_HZ, DAMPING_RATIO, MASS = 20.0, 0.03, 4.0
STIFFNESS = MASS * (2.0 * np.pi * FREQUENCY_HZ) ** 2
DAMPING = 2.0 * DAMPING_RATIO * np.sqrt(STIFFNESS * MASS)


FINER = 8


@njit(cache=True)
def _acceleration(x, v, push, cubic, friction, notch):
    force = DAMPING * v + STIFFNESS * (x + cubic * x**3 + friction * np.tanh(v / 0.05))
    force += STIFFNESS * notch * x * np.exp(-(((x - 0.8) / 0.2) ** 2))
    return (push - force) / MASS


@njit(cache=True)
def _run(push, dt, cubic, friction, notch):
    """Runge-Kutta steps over two samples of the force each."""
    xs = np.zeros(push.size // 2)
    x = v = 0.0
    for k in range(xs.size):
        xs[k] = x
        ends = push[2 * k], push[2 * k + 1], push[min(2 * k + 2, push.size - 1)]
        a1 = _acceleration(x, v, ends[0], cubic, friction, notch)
        a2 = _acceleration(x + 0.5 * dt * v, v + 0.5 * dt * a1, ends[1], cubic, friction, notch)
        v3 = v + 0.5 * dt * a2
        a3 = _acceleration(x + 0.5 * dt * (v + 0.5 * dt * a1), v3, ends[1], cubic, friction, notch)
        a4 = _acceleration(x + dt * v3, v + dt * a3, ends[2], cubic, friction, notch)
        x += dt * (v + dt * (a1 + a2 + a3) / 6.0)
        v += dt * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0
    return xs


def driven(seed, cubic=0.0, friction=0.0, notch=0.0):
    """Displacement of about 1 rms and the force below 60 Hz that drives it; shares of the spring's force at 1 u."""
    rng = np.random.default_rng(seed)
    n = int(RATE_HZ * SECONDS)
    low = signal.butter(6, 60.0, fs=RATE_HZ, output="sos")
    force = signal.sosfiltfilt(low, rng.standard_normal(n))
    force *= 0.35 * STIFFNESS / np.std(force)
    fine = signal.resample_poly(force, 2 * FINER, 1)
    x = _run(fine, 1.0 / (RATE_HZ * FINER), cubic, friction, notch)[::FINER]
    return x + 1e-3 * np.std(x) * rng.standard_normal(n), force


def diagnosed(x, force, frequency_hz=FREQUENCY_HZ):
    model = MachiningSystem((Mode(frequency_hz, DAMPING_RATIO),))
    return conclude_driven(examine_driven(recorded_from(x, RATE_HZ), recorded_from(force, RATE_HZ), model))


def test_a_linear_machine_needs_nothing_and_its_mass_is_weighed():
    """Nothing is named; mass and mode are those of the machine, and a wrong mode is corrected."""
    x, force = driven(201)
    report = diagnosed(x, force).report
    assert report.terms == []
    assert report.verdict in ("none", "parameters")
    assert report.calibration.after["input.mass"].value == pytest.approx(MASS, rel=0.01)
    report = diagnosed(x, force, 1.05 * FREQUENCY_HZ).report
    assert report.verdict == "parameters"
    assert report.calibration.after["mode.1.frequency_hz"].value == pytest.approx(FREQUENCY_HZ, rel=0.003)
    assert report.calibration.after["mode.1.damping_ratio"].value == pytest.approx(DAMPING_RATIO, rel=0.1)


def test_a_hardening_spring_is_named_with_its_coefficient_and_the_model_runs_beside_the_recording():
    """Cubic stiffness of 2 % at 1 u: named, in units of the model and of the input; driven freely the model follows."""
    cubic = 0.02
    x, force = driven(202, cubic=cubic)
    found = diagnosed(x, force)
    [term] = found.report.terms
    assert (term.name, term.sense) == ("cubic_stiffness", "hardening")
    assert term.parameters["coefficient"].value == pytest.approx(cubic, rel=0.05)
    assert term.parameters["coefficient_as_force"].value == pytest.approx(cubic * STIFFNESS, rel=0.05)
    closed = found.report.force_balance
    assert closed.residual_after < 0.5 * closed.residual_before
    assert closed.free_run_error_after < 0.2 * closed.free_run_error_before
    assert found.model.terms[0].parameters["coefficient"] == pytest.approx(cubic, rel=0.03)


def test_dry_friction_is_named_in_units_of_the_input():
    """Coulomb friction of 5 % of the spring's force is found within 5 %."""
    friction = 0.05
    x, force = driven(203, friction=friction)
    report = diagnosed(x, force).report
    assert [term.name for term in report.terms] == ["coulomb_friction"]
    assert report.terms[0].parameters["coefficient_as_force"].value == pytest.approx(friction * STIFFNESS, rel=0.05)


def test_a_balance_without_a_mode_leaves_the_model_its_own():
    """A mass that only friction holds has no mode: it is said so, and the model file keeps the mode that it had."""
    rng = np.random.default_rng(206)
    low = signal.butter(4, 5.0, fs=RATE_HZ, output="sos")
    x = signal.sosfiltfilt(low, rng.standard_normal(6000))
    v, a = np.gradient(x) * RATE_HZ, np.gradient(np.gradient(x)) * RATE_HZ**2
    force = MASS * a - 0.5 * v + 0.4 * np.std(MASS * a) * np.sign(v)
    found = diagnosed(x, force + 1e-3 * np.std(force) * rng.standard_normal(x.size))
    assert [term.name for term in found.report.terms][:1] == ["coulomb_friction"]
    assert found.model.modes[0].frequency_hz == FREQUENCY_HZ
    assert any("no vibrating mode" in warning for warning in found.report.warnings)


def test_what_no_term_explains_stays_unknown():
    """A notch in the stiffness is in no catalogue: nothing is named, and the map says that something is there."""
    x, force = driven(204, notch=0.5)
    report = diagnosed(x, force).report
    assert report.verdict == "unknown", report.summary
    assert report.terms == []
    assert report.located.statistic.p_value < 1e-5


def test_files_in_report_page_and_model_out(tmp_path):
    """Two channels of one file are recording and force; report, page and a model that is read back are written."""
    x, force = driven(202, cubic=0.02)
    soundfile.write(tmp_path / "both.wav", np.column_stack([x, force]), int(RATE_HZ), subtype="DOUBLE")
    (tmp_path / "model.toml").write_text("[[mode]]\nfrequency_hz = 20.0\ndamping_ratio = 0.03\n")
    both, model, out = tmp_path / "both.wav", tmp_path / "model.toml", tmp_path / "out"
    report, written = diagnose_file(both, model, out, driven_by=both, input_channel=1)
    assert [path.name for path in written] == ["report.json", "report.html", "model.toml"]
    assert "Force balance" in written[1].read_text()
    assert [a.term.name for a in read_model(written[2]).terms] == ["cubic_stiffness"]
    assert any("driven by the measured force" in line for line in lines(report))


def test_what_does_not_belong_together_is_refused():
    """A force of another length, and a sensor that does not measure the displacement, are errors that say so."""
    x, force = np.random.default_rng(205).standard_normal((2, 5000))
    whole, part = recorded_from(x, RATE_HZ), recorded_from(force[:4000], RATE_HZ)
    mode = (Mode(FREQUENCY_HZ, DAMPING_RATIO),)
    with pytest.raises(InputError, match="do not belong together"):
        examine_driven(whole, part, MachiningSystem(mode))
    with pytest.raises(InputError, match="displacement only"):
        examine_driven(whole, recorded_from(force, RATE_HZ), MachiningSystem(mode, sensor=Sensor(quantity="velocity")))
