"""What the truth calls unstable and what it calls chatter."""

import json

import pytest

from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Drift, Excitation, Mode, Spindle
from chatter_monitor.physics.simulate import simulate
from chatter_monitor.physics.terms import CATALOGUE


def applied(name, **parameters):
    return AppliedTerm(CATALOGUE[name], parameters)


def test_a_forced_cut_that_leaves_the_material_is_not_chatter():
    """Run-out that throws the tool out of a stable cut is neither instability nor chatter."""
    system = MachiningSystem(
        (Mode(500.0, 0.03),),
        (
            applied("loss_of_contact", coefficient=0.02, chip_thickness=1e-3),
            applied("periodic_forcing", coefficient=1e5, order=1.3),
        ),
        Excitation(intensity=0.0),
        Spindle(6000.0),
    )
    run = simulate(system, 1.0, seed=0)
    assert run.out_of_cut.mean() > 0.2
    assert run.truth.unstable_s == []
    assert run.truth.chatter_s == []


def test_negative_damping_is_unstable_and_chatter_from_the_start():
    """A self-excited mode without a cut to leave counts as chatter wherever its root is unstable."""
    system = MachiningSystem(
        (Mode(300.0, -0.01),),
        (applied("energy_damping", coefficient=100.0),),
        drifts=(Drift("mode.1.damping_ratio", (0.49, 0.51), (0.02, -0.01)),),
    )
    truth = simulate(system, 1.0, seed=0, settle_s=0.7).truth
    assert truth.unstable_s == truth.chatter_s == [(0.5, 1.0)]
    assert truth.roots[0].damping_ratio == pytest.approx(0.02)
    assert truth.roots[-1].damping_ratio == pytest.approx(-0.01)


def test_the_sidecar_is_plain_json():
    """The truth survives JSON, holds speed, teeth and model, and an interval for every 50 ms."""
    system = MachiningSystem((Mode(300.0, 0.02),), spindle=Spindle(1200.0, 3))
    truth = simulate(system, 0.52, seed=5).truth.to_json()
    assert json.loads(json.dumps(truth)) == truth
    assert (truth["spindle_rpm"], truth["teeth"], truth["seed"]) == (1200.0, 3, 5)
    assert [interval["t0"] for interval in truth["intervals"]] == [round(0.05 * i, 2) for i in range(10)]
    assert truth["model"]["mode"] == [{"frequency_hz": 300.0, "damping_ratio": 0.02}]
