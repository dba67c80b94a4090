"""Models that have forces already: they are calibrated, and nothing is found that they explain."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.discrepancy.conclude import conclude
from chatter_monitor.discrepancy.diagnosis import examine, recorded_from
from chatter_monitor.discrepancy.report import Report
from chatter_monitor.errors import InputError
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Drift, Mode, Sensor, Spindle
from chatter_monitor.physics.simulate import simulate
from chatter_monitor.physics.terms import CATALOGUE
from tests.discrepancy.machine import Machine, coefficient, record

SHORT = {"frequency_hz": 220.0, "seconds": 10.0}
# An effect of the independent simulator, its strength, the term that it is, and the term's other parameters.
SAME = {
    "hardening": (0.06, "cubic_stiffness", {}),
    "quadratic": (0.06, "quadratic_stiffness", {}),
    "clearance": (0.06, "clearance", {"gap": 1.0}),
    "coulomb": (0.06, "coulomb_friction", {}),
    "v|v|": (0.04, "quadratic_damping", {}),
    "delay": (0.03, "regenerative_delay", {}),
}


def diagnosed(effect: str, seed: int, *, share: float = 1.0, quantity: str = "displacement") -> tuple[Report, float]:
    """A recording against the model that has its force, the coefficient times a share; and the true coefficient."""
    strength, name, shapes = SAME[effect]
    machine = Machine(effect, strength, quantity=quantity, **SHORT)
    true = coefficient(machine)
    model = MachiningSystem(
        (Mode(221.0, 0.02),),
        (AppliedTerm(CATALOGUE[name], {"coefficient": share * true, **shapes}),),
        spindle=Spindle(60.0 / machine.delay_s),
        sensor=Sensor(quantity=quantity),
    )
    return conclude(examine(recorded_from(record(machine, seed), machine.rate_hz), model)).report, true


@pytest.mark.parametrize("quantity", ["displacement", "acceleration"])
@pytest.mark.parametrize("effect", SAME)
def test_a_model_that_has_the_force_lacks_nothing(effect, quantity):
    """The force is not found a second time, its harmonics are no second mode, and the mode is that of the machine."""
    report, _ = diagnosed(effect, 151, quantity=quantity)
    assert report.verdict in ("none", "parameters"), report.summary
    assert report.calibration.after["mode.1.frequency_hz"].value == pytest.approx(220.0, rel=0.01)
    assert report.calibration.after["mode.1.damping_ratio"].value == pytest.approx(0.02, rel=0.3)


@pytest.mark.parametrize("effect", ["hardening", "clearance", "delay"])
def test_a_wrong_coefficient_is_a_wrong_parameter(effect):
    """A force that the model has with half its strength is corrected, and the report says from what to what."""
    report, true = diagnosed(effect, 152, share=0.5)
    assert report.verdict == "parameters", report.summary
    assert f"coefficient of {SAME[effect][1]} is " in report.summary
    assert report.calibration.before["term.1.coefficient"] == pytest.approx(0.5 * true)
    assert report.calibration.after["term.1.coefficient"].value == pytest.approx(true, rel=0.35)


def test_what_is_missing_beside_a_known_force_is_named():
    """A hardening spring is found in a model that has the dry friction."""
    w = 2.0 * np.pi * 220.0
    friction = AppliedTerm(CATALOGUE["coulomb_friction"], {"coefficient": 0.04 * w**2})
    spring = AppliedTerm(CATALOGUE["cubic_stiffness"], {"coefficient": 0.04})
    signal = simulate(MachiningSystem((Mode(220.0, 0.02),), (friction, spring)), 10.0, 153, settle_s=1.0).signal
    model = MachiningSystem((Mode(221.0, 0.02),), (friction,))
    diagnosis = conclude(examine(recorded_from(signal, 12800.0), model))
    [found] = diagnosis.report.terms
    assert (found.name, found.sense) == ("cubic_stiffness", "hardening"), diagnosis.report.summary
    assert found.parameters["coefficient"].value == pytest.approx(0.04, rel=0.25)
    assert [applied.term.name for applied in diagnosis.model.terms] == ["coulomb_friction", "cubic_stiffness"]


def test_a_model_that_drifts_is_refused():
    """What changes along the cut is followed by nothing here, so nothing is said."""
    drift = Drift("mode.1.frequency_hz", (0.0, 10.0), (220.0, 230.0))
    model = MachiningSystem((Mode(220.0, 0.02),), drifts=(drift,))
    with pytest.raises(InputError, match="drift"):
        examine(recorded_from(record(Machine(frequency_hz=220.0, seconds=1.0), 50), 12800.0), model)


def test_regeneration_beside_a_spring_is_named_with_it():
    """Both are missing, the model that fits best has both, and both are said."""
    delayed = AppliedTerm(CATALOGUE["regenerative_delay"], {"coefficient": 0.02})
    spring = AppliedTerm(CATALOGUE["cubic_stiffness"], {"coefficient": 0.03})
    spindle, sensor = Spindle(3000.0, 2), Sensor("velocity")
    machine = MachiningSystem((Mode(420.0, 0.02),), (delayed, spring), spindle=spindle, sensor=sensor)
    signal = simulate(machine, 15.0, 8, settle_s=1.0).signal
    model = MachiningSystem((Mode(421.0, 0.02),), spindle=spindle, sensor=sensor)
    diagnosis = conclude(examine(recorded_from(signal, 12800.0), model))
    assert {found.name for found in diagnosis.report.terms} == {"regenerative_delay", "cubic_stiffness"}
    assert {applied.term.name for applied in diagnosis.model.terms} == {"regenerative_delay", "cubic_stiffness"}
