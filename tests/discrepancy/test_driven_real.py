"""Machines with published answers, force and motion recorded."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.driven import DATA, emps, rig
from chatter_monitor.discrepancy.driven.case import examine_driven
from chatter_monitor.discrepancy.driven.conclude import conclude_driven

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="the real recordings are not here (../shared/data)")


def test_a_drive_has_dry_friction():
    """EMPS: Coulomb friction leads, 20.4 N within 5 %; 17 % of the force is left without terms, under 3.96 % with."""
    found = conclude_driven(examine_driven(*emps())).report
    assert found.terms[0].name == "coulomb_friction"
    assert found.terms[0].parameters["coefficient_as_force"].value == pytest.approx(20.39, rel=0.05)
    assert found.calibration.after["input.mass"].value == pytest.approx(95.11, rel=0.01)
    assert found.force_balance.residual_before == pytest.approx(0.17, abs=0.005)
    assert found.force_balance.residual_after < 0.0396


def test_a_band_brake_is_no_plain_friction():
    """Friction with backlash is named hysteresis, and Coulomb friction is not even near."""
    found = conclude_driven(
        examine_driven(*rig(DATA / "friction_backlash" / Path("1Hz36lbtension1amplitude.npz")))
    ).report
    assert [term.name for term in found.terms] == ["hysteresis"]
    others = {each.name: each.evidence_nats for each in found.alternatives}
    assert others["coulomb_friction"] < 0.2 * found.terms[0].evidence_nats
