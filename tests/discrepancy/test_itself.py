"""What a filter leaves of the model that it was given, and that no law of the machine's is made of that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chatter_monitor.discrepancy import itself as module
from chatter_monitor.discrepancy.all_along import REST_NATS
from chatter_monitor.discrepancy.augment import as_it_stands
from chatter_monitor.discrepancy.band import Recorded, at_rate
from chatter_monitor.discrepancy.itself import Itself
from chatter_monitor.discrepancy.unnamed import Rest
from chatter_monitor.physics.parts import AppliedTerm
from chatter_monitor.physics.terms import CATALOGUE
from tests.discrepancy.machine import Machine
from tests.discrepancy.test_diagnosis import SHORT, diagnosed

DRAG = "quadratic_damping", "velocity_power"


@pytest.fixture(scope="module")
def strongly_damped():
    """Drag that damps a machine ten times as much as it damps itself, seen as a displacement."""
    return diagnosed(Machine("v|v|", 0.2, frequency_hz=1000.0, damping_ratio=0.01, snr_db=39.0, seconds=14.0), 150)


def test_strong_damping_keeps_its_name(strongly_damped):
    """The filter leaves of it what looks like another power of the velocity, of a simulation as of the recording."""
    report = strongly_damped.report
    assert [term.name for term in report.terms] == ["quadratic_damping"], report.summary
    case, fit = strongly_damped.case, strongly_damped.augmented
    rest, usual = Rest(case, fit.innovations, fit.columns, fit.system.terms), Itself(case, fit).rests
    assert rest.examined().variations[DRAG] > REST_NATS  # which would have been called another law
    assert rest.examined(usual).variations[DRAG] < 0.5 * REST_NATS
    assert np.mean([each.examined().variations[DRAG] for each in usual]) > 3.0  # 0.5 by chance


def test_what_else_was_fitted_to_the_recording_is_not_asked_of_a_simulation(strongly_damped):
    """A column that the recording has alone, as for another machine's tone, changes next to nothing."""
    case, fit = strongly_damped.case, strongly_damped.augmented
    usual = Itself(case, fit).rests
    tone = np.sin(0.3 * np.arange(case.recorded.samples.size))
    alone, beside = (Rest(case, fit.innovations, c, fit.system.terms) for c in (fit.columns, [*fit.columns, tone]))
    expected = alone.examined(usual).variations[DRAG]
    assert beside.examined(usual).variations[DRAG] == pytest.approx(expected, abs=0.1)


def test_a_model_as_it_stands_is_that_of_its_fit(strongly_damped):
    """On the recording that it was fitted to it leaves the same errors."""
    fit = strongly_damped.augmented
    again = as_it_stands(strongly_damped.case, fit)
    np.testing.assert_allclose(again.innovations.white, fit.innovations.white, rtol=0.05, atol=0.05)
    assert again.parameters[0]["coefficient"][0] == fit.parameters[0]["coefficient"][0]


def test_a_model_that_runs_away_says_nothing_of_itself(strongly_damped):
    """A spring that softens until it pushes outwards has no simulation; then the recording counts as it is."""
    fit, case = strongly_damped.augmented, strongly_damped.case
    softening = AppliedTerm(CATALOGUE["cubic_stiffness"], {"coefficient": -1.0})
    nothing = Itself(case, replace(fit, system=replace(fit.system, terms=(softening,))))
    assert nothing.rests == []
    assert nothing.damping_bias == 0.0


def test_nothing_is_simulated_where_nothing_is_left(monkeypatch):
    """A spring that explains all takes no simulation."""
    monkeypatch.setattr(module, "free_run", lambda *_: pytest.fail("a simulation was made"))
    report = diagnosed(Machine("hardening", 0.06, **SHORT), 104).report
    assert [term.name for term in report.terms] == ["cubic_stiffness"], report.summary


def test_a_recording_is_brought_to_a_fraction_of_its_rate():
    """A tone within the new band stays what it is; a rate that it has changes nothing."""
    rate_hz = 12800.0
    time_s = np.arange(12800) / rate_hz
    whole = Recorded(np.sin(2.0 * np.pi * 100.0 * time_s), np.zeros(12800, dtype=bool), rate_hz)
    lower = at_rate(whole, rate_hz * 3 / 14)
    assert lower.rate_hz == pytest.approx(rate_hz * 3 / 14)
    inner = slice(100, -100)
    there = np.sin(2.0 * np.pi * 100.0 * np.arange(lower.samples.size) / lower.rate_hz)
    np.testing.assert_allclose(lower.samples[inner], there[inner], atol=2e-3)
    assert at_rate(whole, rate_hz) is whole
