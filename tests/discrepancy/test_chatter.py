"""Cuts that their model calls stable and that chatter. Development seeds are below 50, the benchmark's from 100."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import soundfile
from click.testing import CliRunner
from scipy.signal import decimate

from benchmarks.self_excited import RATE_HZ, draw, errors, growth_per_s, intervals_hold, record
from chatter_monitor.cli import cli
from chatter_monitor.discrepancy.chatter.conclude import conclude_chatter
from chatter_monitor.discrepancy.chatter.growth import BEYOND_WRONG_NATS, regeneration_of, vibration
from chatter_monitor.discrepancy.diagnosis import recorded_from
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.model_file import model_text, read_model
from chatter_monitor.physics.parts import Excitation, Mode, Sensor, Spindle
from chatter_monitor.physics.simulate import simulate
from tests.discrepancy.machine import Machine
from tests.discrepancy.machine import record as record_stable

SEED = 61


@pytest.fixture(scope="module")
def chattering():
    """A cut of the blind generator that chatters from 2 s on, its recording, and a model without regeneration."""
    cut, model = draw(SEED)
    return cut, record(cut, SEED, 4.0), MachiningSystem(model.modes, spindle=model.spindle, sensor=model.sensor)


def test_chatter_that_the_model_does_not_know_is_regeneration(chattering, tmp_path):
    """Files in: regeneration is named, and the written model chatters as the recording does (1 %, 20 %, 20 %)."""
    cut, samples, model = chattering
    assert growth_per_s(model) < 0.0 < growth_per_s(cut.machine(cut.coefficient))
    soundfile.write(tmp_path / "cut.wav", samples, int(RATE_HZ), subtype="DOUBLE")
    (tmp_path / "model.toml").write_text(model_text(model))
    command = [
        "diagnose",
        str(tmp_path / "cut.wav"),
        "--model",
        str(tmp_path / "model.toml"),
        "--out",
        str(tmp_path / "out"),
    ]
    result = CliRunner().invoke(cli, command, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert [term["name"] for term in report["terms"]] == ["loss_of_contact"], report["summary"]
    assert report["located"]["lag_s"] == pytest.approx(cut.spindle.delay_s, rel=0.01)
    excited = report["self_excitation"]
    assert excited["simulated_frequency_hz"] == pytest.approx(excited["frequency_hz"], rel=0.01)
    assert excited["simulated_amplitude"] == pytest.approx(excited["amplitude"], rel=0.2)
    written = read_model(tmp_path / "out" / "model.toml")
    assert growth_per_s(written) == pytest.approx(growth_per_s(cut.machine(cut.coefficient)), rel=0.2)
    assert written.terms[0].parameters["chip_thickness"] == pytest.approx(1.0, rel=0.2)


def test_too_little_regeneration_in_the_model_is_told_by_how_much(chattering):
    """A model with half of the limit's regeneration gets as much as there is, within the intervals, and is told so."""
    cut, samples, model = chattering
    weak = MachiningSystem(model.modes, cut.machine(0.5 * cut.limit).terms, spindle=model.spindle, sensor=model.sensor)
    found = conclude_chatter(recorded_from(samples, RATE_HZ), weak)
    assert found.report.terms[0].sense.endswith("times as strong as in the model")
    assert all(intervals_hold(cut, found).values())
    mode = found.report.calibration.after["mode.1.frequency_hz"]
    assert 0.0 < mode.ci95[1] - mode.value < 0.02 * mode.value
    frequency, growth, amplitude = np.abs(errors(cut, found))
    assert frequency < 0.01
    assert growth < 0.2
    assert amplitude < 0.2


def test_a_cycle_tells_what_a_short_rise_does_not():
    """Two seconds at the limit name regeneration whose rise, over within some turns, follows itself at any delay."""
    cut, model = draw(12)
    whole = recorded_from(record(cut, 12, 4.0), RATE_HZ)
    rise = regeneration_of(whole, model, vibration(whole, model))
    assert not rise.sure
    assert rise.gain_nats < rise.wrong_nats + BEYOND_WRONG_NATS
    found = conclude_chatter(whole, model)
    assert [term.name for term in found.report.terms] == ["loss_of_contact"]
    assert all(intervals_hold(cut, found).values())
    assert np.all(np.abs(errors(cut, found)) < [0.01, 0.2, 0.2])


def test_what_excites_itself_without_a_delay_is_no_regeneration():
    """A force that pushes along the velocity until that is large: no delay has anything to do with it."""
    rng = np.random.default_rng(0)
    mode, over, fine = Mode(420.0, 0.02), 2.2, 4
    w, step = mode.omega, 1.0 / (RATE_HZ * fine)
    push = np.arange(round(4.0 * RATE_HZ) * fine) > 1.5 * RATE_HZ * fine
    noise = 0.03 * np.sqrt(4.0 * mode.damping_ratio * w**3 / step) * rng.standard_normal(push.size)
    velocity, x, v = np.empty(push.size), 0.0, 0.0
    for i in range(push.size):
        damping = 2.0 * mode.damping_ratio * w * (1.0 - over * push[i] * (1.0 - (v / w) ** 2))
        v += step * (noise[i] - damping * v - w * w * x)
        x += step * v
        velocity[i] = v
    samples = decimate(velocity, fine, ftype="fir")
    samples += 0.01 * np.std(samples) * rng.standard_normal(samples.size)
    model = MachiningSystem((Mode(422.0, 0.018),), spindle=Spindle(1500.0), sensor=Sensor("velocity"))
    report = conclude_chatter(recorded_from(samples, RATE_HZ), model).report
    assert report.verdict == "unknown", report.summary
    assert "Regeneration is not named" in report.summary


def test_without_a_spindle_chatter_is_unknown(chattering):
    """The vibration is located, and the reason why regeneration is not named is that its delay is not known."""
    _, samples, model = chattering
    report = conclude_chatter(recorded_from(samples, RATE_HZ), MachiningSystem(model.modes, sensor=model.sensor)).report
    assert report.verdict == "unknown"
    assert "[spindle]" in report.summary
    assert report.located.band_hz


def test_a_speed_that_is_far_off_is_no_regeneration(chattering):
    """With a delay that is none of the cut's regeneration is not named."""
    _, samples, model = chattering
    wrong = MachiningSystem(model.modes, spindle=Spindle(model.spindle.speed_rpm * 1.23), sensor=model.sensor)
    assert conclude_chatter(recorded_from(samples, RATE_HZ), wrong).report.verdict == "unknown"


def test_a_machine_in_noise_does_not_chatter():
    """A stable machine, also with a hard joint or a weak regeneration, is no case for this."""
    for effect in ("none", "hardening", "delay"):
        machine = Machine(effect, 0.03, frequency_hz=220.0, seconds=6.0, quantity="velocity")
        model = MachiningSystem((Mode(220.0, 0.02),), spindle=Spindle(3000.0), sensor=Sensor("velocity"))
        assert conclude_chatter(recorded_from(record_stable(machine, 130), 12800.0), model) is None


def test_a_stable_cut_near_its_limit_does_not_chatter():
    """At nine tenths of its limit it is coherent for longer than the mode is, and the tool never leaves the cut."""
    cut, model = draw(6)
    stable = replace(cut.machine(0.9 * cut.limit), excitation=Excitation("white_noise", intensity=1.0))
    recorded = recorded_from(simulate(stable, 8.0, 0, RATE_HZ, settle_s=2.0).signal, RATE_HZ)
    lacking = MachiningSystem(model.modes, spindle=model.spindle, sensor=model.sensor)
    assert vibration(recorded, lacking) is not None
    assert conclude_chatter(recorded, lacking) is None


def test_a_tone_that_was_always_there_is_not_called_self_excited():
    """A second machine that hums near the mode from beginning to end is no chatter."""
    samples = record_stable(Machine(frequency_hz=220.0, seconds=6.0), 131)
    t = np.arange(samples.size) / 12800.0
    model = MachiningSystem((Mode(220.0, 0.02),), spindle=Spindle(3000.0))
    assert conclude_chatter(recorded_from(samples + 4.0 * np.sin(2.0 * np.pi * 233.0 * t), 12800.0), model) is None
