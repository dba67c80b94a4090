"""Several recordings of one machine. Development seeds are below 100, these above."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import soundfile
from click.testing import CliRunner

from chatter_monitor.cli import cli
from chatter_monitor.discrepancy.together.shared import Seen, share
from chatter_monitor.errors import InputError
from chatter_monitor.physics.model_file import model_text, read_model
from chatter_monitor.physics.parts import Cut, Mode
from tests.discrepancy.machine import Machine, record

STRUCTURE = Mode(220.0, 0.02)
WIDTH_M, SPEEDS = 0.002, (0.5, 1.0, 3.0)
C = 2.0 * STRUCTURE.damping_ratio * STRUCTURE.omega * SPEEDS[0] / WIDTH_M  # the slowest cut has twice the damping


def in_cut(speed: float) -> float:
    """Damping ratio of the machine at a cutting speed, eq. (4)."""
    return STRUCTURE.damping_ratio + C * WIDTH_M / speed / (2.0 * STRUCTURE.omega)


def cut(speed: float) -> Cut:
    return Cut(f"at_{speed:g}.wav", 400.0 * speed, speed, WIDTH_M)


def seen(speed: float, damping_ratio: float, rng: np.random.Generator, frequency_hz: float = 220.0) -> Seen:
    """What a recording of 20 s shows of a machine, with the errors that such a recording has."""
    sd = np.array([2e-4, 2.0])
    values = np.array([math.log(frequency_hz), 4.0 * math.pi * frequency_hz * damping_ratio])
    return Seen(cut(speed), values + sd * rng.standard_normal(2), np.diag(sd**2), (STRUCTURE,))


def test_process_damping_is_told_from_structural_damping():
    """Over many machines the intervals of C and of the structure's damping hold the truth, and C is found."""
    rng = np.random.default_rng(1)
    found = [share([seen(speed, in_cut(speed), rng) for speed in SPEEDS]) for _ in range(200)]
    away = np.array([[f.process_damping[0] - C, f.modes[0].damping_ratio - 0.02] for f in found])
    sd = np.array([[f.process_damping[1], f.damping_sd[0]] for f in found])
    assert np.all(np.abs(np.mean(np.abs(away) < 1.96 * sd, axis=0) - 0.95) < 0.05)
    assert all(f.process_damped for f in found)
    assert np.mean([f.disagreement["damping"] < 0.05 for f in found]) < 0.12


def test_damping_that_is_the_same_at_all_speeds_is_no_process_damping():
    """A machine that only its structure damps gets no process damping."""
    rng = np.random.default_rng(2)
    found = [share([seen(speed, 0.02, rng) for speed in SPEEDS]) for _ in range(300)]
    assert sum(f.process_damped for f in found) <= 1
    assert np.mean([f.p_value < 0.05 for f in found]) == pytest.approx(0.05, abs=0.04)


def test_damping_that_rises_with_the_speed_is_a_disagreement():
    """What is against eq. (4) is not fitted by it, but told."""
    rng = np.random.default_rng(3)
    found = share([seen(speed, 0.02 + 0.01 * speed, rng) for speed in SPEEDS])
    assert not found.process_damped
    assert found.disagreement["damping"] < 1e-5


def test_machines_of_two_frequencies_are_not_one():
    """Recordings whose natural frequency differs do not share it, and the damping is not blamed."""
    rng = np.random.default_rng(4)
    found = share([seen(v, 0.02, rng, f) for v, f in zip(SPEEDS, (220.0, 221.0, 219.0), strict=True)])
    assert found.disagreement["frequency"] < 1e-5
    assert found.disagreement["damping"] > 1e-3


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Two recordings with process damping, and the model file that knows their speeds."""
    folder = tmp_path_factory.mktemp("cuts")
    text = '[sensor]\nquantity = "velocity"\n[[mode]]\nfrequency_hz = 220.5\ndamping_ratio = 0.02\n'
    for seed, speed in ((120, 0.5), (121, 3.0)):
        machine = Machine(
            damping_ratio=in_cut(speed), frequency_hz=220.0, seconds=8.0, quantity="velocity", rate_hz=6400.0
        )
        soundfile.write(folder / cut(speed).recording, record(machine, seed), 6400, subtype="FLOAT")
        text += f'[[cut]]\nrecording = "{cut(speed).recording}"\nspeed_rpm = {400 * speed}\n'
        text += f"cutting_speed_m_s = {speed}\nwidth_m = {WIDTH_M}\n"
    (folder / "model.toml").write_text(text)
    return folder


def run(folder, *names):
    command = ["diagnose", *(str(folder / name) for name in names), "--model", str(folder / "model.toml")]
    result = CliRunner().invoke(cli, [*command, "--out", str(folder / "out")], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return json.loads((folder / "out" / "report.json").read_text()), result.output


def test_recordings_at_two_speeds_name_process_damping(recordings):
    """Files in: process damping is named with its coefficient, each cut has its report, the model runs as each cut."""
    report, said = run(recordings, "at_0.5.wav", "at_3.wav")
    assert [term["name"] for term in report["terms"]] == ["process_damping"], said
    low, high = report["terms"][0]["parameters"]["coefficient"]["ci95"]
    assert low < C < high
    assert "Two cutting speeds" in said
    assert [each["speed_rpm"] for each in report["recordings"]] == [200.0, 1200.0]
    for each in report["recordings"]:
        assert (recordings / "out" / each["report"]).stat().st_size > 10_000
    model = read_model(recordings / "out" / "model.toml")
    assert model.modes[0].damping_ratio == pytest.approx(0.02, rel=0.25)
    assert model.in_cut("at_3.wav").terms[0].parameters["cutting_speed_m_s"] == 3.0


def test_one_recording_cannot_tell_who_damps(recordings):
    """A single slow cut has more damping than the model; the report says that structure or cut may do that."""
    report, _ = run(recordings, "at_0.5.wav")
    assert report["verdict"] == "parameters"
    assert any("process damping" in warning for warning in report["warnings"])


CUTS = """[[mode]]
frequency_hz = 220.0
damping_ratio = 0.02
[spindle]
speed_rpm = 1000.0
teeth = 3
[[term]]
name = "process_damping"
coefficient = 1e4
width_m = 0.001
cutting_speed_m_s = 1.0
[[cut]]
recording = "slow.wav"
speed_rpm = 200.0
cutting_speed_m_s = 0.2
"""


def test_a_cut_gives_speed_and_geometry(tmp_path):
    """In a cut the machine has that cut's speeds, and what the cut does not say stays; what is written reads back."""
    (tmp_path / "model.toml").write_text(CUTS)
    system = read_model(tmp_path / "model.toml")
    slow = system.in_cut("slow.wav")
    assert (slow.spindle.speed_rpm, slow.spindle.teeth) == (200.0, 3)
    assert slow.terms[0].parameters == {"coefficient": 1e4, "width_m": 0.001, "cutting_speed_m_s": 0.2}
    (tmp_path / "again.toml").write_text(model_text(system))
    assert read_model(tmp_path / "again.toml") == system


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ('[[cut]]\nrecording = "slow.wav"\nspeed_rpm = 300.0\ncutting_speed_m_s = 1.0\n', "same recording"),
        ('[[cut]]\nrecording = "b.wav"\nspeed_rpm = 300.0\n', "for some cuts only"),
        ('[[cut]]\nrecording = "b.wav"\n', "speed_rpm is missing"),
        ('[[cut]]\nrecording = "b.wav"\nspeed_rpm = -1.0\n', "speed_rpm is out of range"),
    ],
)
def test_cuts_that_make_no_sense_are_refused(tmp_path, more, said):
    """A model file whose cuts contradict each other is refused with what to do."""
    (tmp_path / "model.toml").write_text(CUTS + more)
    with pytest.raises(InputError, match=said):
        read_model(tmp_path / "model.toml")


def test_a_recording_that_the_model_does_not_know_is_refused(tmp_path):
    """With cuts in the model file a recording that is none of them is an error that names them."""
    (tmp_path / "model.toml").write_text(CUTS)
    with pytest.raises(InputError, match=r"slow\.wav"):
        read_model(tmp_path / "model.toml").in_cut("fast.wav")
