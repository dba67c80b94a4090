"""The commands simulate and identify."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import soundfile
from click.testing import CliRunner

from chatter_monitor.cli import cli
from chatter_monitor.errors import InputError

MODEL = """
[sensor]
quantity = "displacement"
[[mode]]
frequency_hz = 412.0
damping_ratio = 0.01
[excitation]
kind = "white_noise"
[[term]]
name = "cubic_stiffness"
coefficient = 0.05
"""


@pytest.fixture
def model(tmp_path: Path) -> Path:
    path = tmp_path / "model.toml"
    path.write_text(MODEL, encoding="utf-8")
    return path


def run(*arguments: object) -> str:
    result = CliRunner().invoke(cli, [str(a) for a in arguments], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_a_simulated_recording_is_identified_as_what_it_is(model: Path, tmp_path: Path) -> None:
    """`identify` finds the mode, the damping and the hardening that `simulate` was told to make, and draws them."""
    recording, out = tmp_path / "cut.wav", tmp_path / "out"
    said = json.loads(run("simulate", model, "--seconds", 20, "--seed", 3, "--out", recording, "--json"))
    assert said["unstable_s"] == []
    assert json.loads((tmp_path / "cut.json").read_text(encoding="utf-8"))["schema"] == "chatter-monitor/truth/1"
    found = json.loads(run("identify", recording, "--quantity", "displacement", "--out", out, "--json"))
    k1 = (2 * np.pi * 412.0) ** 2
    assert found["stiffness"]["k1"] == pytest.approx(k1, rel=0.02)
    assert found["stiffness"]["k3"] == pytest.approx(0.05 * k1, rel=0.2)
    low, high = found["damping"]["damping_ratio_ci95"]
    assert low < 0.01 < high
    assert found["excitation"]["kind"] == "noise_driven"
    written = {path.name for path in out.iterdir()}
    assert {"identification.json", "summary.png", "potential.png", "equivalent_damping.png"} <= written
    assert "hardening" in run("identify", recording, "--quantity", "displacement")


def test_the_same_seed_makes_the_same_recording(model: Path, tmp_path: Path) -> None:
    """Recordings of one seed are identical, those of another differ."""
    signals = []
    for name, seed in (("a.wav", 1), ("b.wav", 1), ("c.wav", 2)):
        run("simulate", model, "--seconds", 0.5, "--seed", seed, "--out", tmp_path / name)
        signals.append(soundfile.read(tmp_path / name)[0])
    assert np.array_equal(signals[0], signals[1])
    assert not np.array_equal(signals[0], signals[2])


def test_a_stretch_is_the_stretch(tmp_path: Path) -> None:
    """`--between` looks at nothing else: a tone that is elsewhere is not found."""
    rate, rng = 5000, np.random.default_rng(1)
    t = np.arange(8 * rate) / rate
    signal = np.where(t < 4, np.sin(2 * np.pi * 300 * t), np.sin(2 * np.pi * 700 * t)) + 0.01 * rng.standard_normal(
        t.size
    )
    soundfile.write(tmp_path / "two.wav", signal / 2, rate)
    for begin, end, tone_hz in ((0.5, 3.5, 300), (4.5, 7.5, 700)):
        found = json.loads(run("identify", tmp_path / "two.wav", "--between", begin, end, "--json"))
        assert found["band"]["peak_hz"] == pytest.approx(tone_hz, rel=0.01)


@pytest.mark.parametrize(
    ("name", "gain", "words"), [("cut.mp3", 1.0, "unknown format"), ("cut.flac", 100.0, "does not fit into FLAC")]
)
def test_what_cannot_be_written_is_refused(model: Path, tmp_path: Path, name: str, gain: float, words: str) -> None:
    """Formats that are unknown, or cannot hold the signal, are refused before anything is written."""
    model.write_text(MODEL.replace("[sensor]\n", f"[sensor]\ngain = {gain}\n"), encoding="utf-8")
    arguments = ["simulate", str(model), "--seconds", "0.5", "--out", str(tmp_path / name)]
    with pytest.raises(InputError, match=words):
        CliRunner().invoke(cli, arguments, catch_exceptions=False)
    assert not (tmp_path / name).exists()


@pytest.mark.parametrize(("begin", "end"), [(3, 1), (500, 600)])
def test_impossible_stretches_are_refused(begin: float, end: float, tmp_path: Path) -> None:
    """A stretch that is backwards or outside the recording is an error that says so."""
    soundfile.write(tmp_path / "short.wav", np.random.default_rng(1).standard_normal(20_000) / 10, 10_000)
    arguments = ["identify", str(tmp_path / "short.wav"), "--between", str(begin), str(end)]
    with pytest.raises(InputError, match="stretch"):
        CliRunner().invoke(cli, arguments, catch_exceptions=False)
