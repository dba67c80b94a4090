"""The gain of the true model, on recordings of an independent simulator."""

from __future__ import annotations

import soundfile

from chatter_monitor.discrepancy.diagnosis import recorded_from
from chatter_monitor.discrepancy.oracle import gain_of
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Mode
from chatter_monitor.physics.terms import CATALOGUE
from chatter_monitor.service.diagnosing import true_gain
from tests.discrepancy.machine import Machine, coefficient, record

SHORT = {"frequency_hz": 220.0, "seconds": 8.0}
BASE = MachiningSystem((Mode(221.0, 0.022),))


def with_cubic(value):
    return MachiningSystem((Mode(220.0, 0.02),), (AppliedTerm(CATALOGUE["cubic_stiffness"], {"coefficient": value}),))


def test_the_truth_gains_and_what_is_not_true_does_not():
    """On a hardening machine the true term gains far more than friction does; on a linear machine it gains nothing."""
    machine = Machine("hardening", 0.05, **SHORT)
    hardening = recorded_from(record(machine, 121), machine.rate_hz)
    gain = gain_of(hardening, BASE, with_cubic(coefficient(machine)))
    assert gain > 20.0
    friction = (AppliedTerm(CATALOGUE["coulomb_friction"], {"coefficient": 1e4}),)
    assert gain_of(hardening, BASE, MachiningSystem((Mode(220.0, 0.02),), friction)) < 0.2 * gain
    linear = recorded_from(record(Machine(**SHORT), 122), machine.rate_hz)
    assert gain_of(linear, BASE, with_cubic(coefficient(machine))) < 2.0


def test_the_better_of_filter_and_regression_counts():
    """Where the stated coefficient is of the wrong sign the filter loses, and the regression finds the right one."""
    machine = Machine("hardening", 0.05, **SHORT)
    hardening = recorded_from(record(machine, 121), machine.rate_hz)
    wrong = gain_of(hardening, BASE, with_cubic(-coefficient(machine)))
    assert 20.0 < wrong <= gain_of(hardening, BASE, with_cubic(coefficient(machine)))


def test_what_acts_in_part_gains_where_it_acts():
    """A clearance that opens for 3 of 8 s gains more told so than all along, and nothing told another stretch."""
    machine = Machine("clearance", 0.06, between_s=(4.0, 7.0), **SHORT)
    recording = recorded_from(record(machine, 125), machine.rate_hz)
    clearance = AppliedTerm(CATALOGUE["clearance"], {"coefficient": coefficient(machine), "gap": 1.0})
    true = MachiningSystem((Mode(220.0, 0.02),), (clearance,))
    there = gain_of(recording, BASE, true, between_s=(4.0, 7.0))
    assert there > 10.0
    assert gain_of(recording, BASE, true) < there
    assert gain_of(recording, BASE, true, between_s=(0.5, 3.5)) < 0.2 * there


def test_the_truth_of_a_key_is_weighed_from_files(tmp_path):
    """A case of the proof: recording, base model, and the truth in the words of the key."""
    machine = Machine("cutting", 0.08, **SHORT)
    soundfile.write(tmp_path / "x.wav", record(machine, 123), int(machine.rate_hz), subtype="FLOAT")
    (tmp_path / "m.toml").write_text("[[mode]]\nfrequency_hz = 221.0\ndamping_ratio = 0.022\n")
    w = Mode(220.0, 0.02).omega
    square = coefficient(machine)
    truth = {"names": ["cutting_force_nonlinearity"], "frequency_hz": 220.0, "damping_ratio": 0.02}
    both = {"square": square, "cube": -0.5 * square / w}
    gain = true_gain(tmp_path / "x.wav", tmp_path / "m.toml", truth | {"parameters": both})
    assert gain > 10.0
    drag = truth | {"names": ["quadratic_damping"], "parameters": {}}
    assert true_gain(tmp_path / "x.wav", tmp_path / "m.toml", drag) < 0.5 * gain


def test_a_delay_is_weighed_at_its_true_length(tmp_path):
    """The speed in the model file is 3 % off; the true delay gains what one of another length does not."""
    machine = Machine("delay", 0.03, **SHORT)
    soundfile.write(tmp_path / "x.wav", record(machine, 124), int(machine.rate_hz), subtype="FLOAT")
    mode = "[[mode]]\nfrequency_hz = 221.0\ndamping_ratio = 0.022\n"
    (tmp_path / "m.toml").write_text(f"{mode}[spindle]\nspeed_rpm = {60.0 / machine.delay_s * 1.03}\n")
    size = coefficient(machine)
    truth = {"names": ["regenerative_delay"], "parameters": {"coefficient": size}, "frequency_hz": 220.0}
    gains = [
        true_gain(
            tmp_path / "x.wav", tmp_path / "m.toml", truth | {"damping_ratio": 0.02, "amplitude": [size, delay_s]}
        )
        for delay_s in (machine.delay_s, 1.3 * machine.delay_s)
    ]
    assert gains[0] > 10.0
    assert gains[1] < 0.5 * gains[0]
