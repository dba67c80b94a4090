"""Stiffness and damping by energy, as the report draws them."""

import numpy as np
import pytest

from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Mode, Sensor
from chatter_monitor.physics.simulate import simulate
from chatter_monitor.physics.terms import CATALOGUE
from chatter_monitor.reports.diagnosis.by_energy import identified

RATE_HZ = 4000.0


def run(coefficient, seed):
    """20 s of a mode at 200 Hz; its spring hardens by the coefficient times the square of the deflection."""
    hardening = AppliedTerm(CATALOGUE["cubic_stiffness"], {"coefficient": coefficient})
    system = MachiningSystem(modes=(Mode(200.0, 0.02),), terms=(hardening,), sensor=Sensor("displacement"))
    return simulate(system, 20.0, seed, RATE_HZ).signal


def test_what_hardens_is_seen_to_harden_and_what_does_not_is_not():
    """Each run is identified by itself: stiffness rises with the deflection in one alone, damping is that put in."""
    found = identified({"recording": run(0.1, 1), "base": run(0.0, 2)}, RATE_HZ, "displacement")
    assert list(found) == ["recording", "base"]
    recording, base = found["recording"].stiffness, found["base"].stiffness
    assert recording.k3_ci95[0] > 0.0
    assert base.k3_ci95[0] < 0.0 < base.k3_ci95[1] or base.k3 == 0.0
    for result in found.values():
        low, high = result.damping.damping_ratio_ci95
        assert low < 0.02 < high
        assert result.damping.damping_ratio == pytest.approx(0.02, rel=0.25)


def test_what_cannot_be_identified_is_left_out():
    """A recording without a mode is not drawn, nor is anything beside it; a simulation without one is left out."""
    vibration, short = run(0.0, 3), np.sin(np.arange(300.0))
    assert identified({"recording": short, "base": vibration}, RATE_HZ, "displacement") == {}
    assert list(identified({"recording": vibration, "base": short}, RATE_HZ, "displacement")) == ["recording"]
