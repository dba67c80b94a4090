"""`diagnose` over a folder: every recording by itself, once, as if it had been alone."""

from __future__ import annotations

import json
import subprocess
import sys
from multiprocessing import Pipe

import pytest

from chatter_monitor.service.archive.dataset import open_table
from chatter_monitor.service.archive.diagnoses import Diagnoses
from chatter_monitor.service.modelling import simulate_to_file

RATE_HZ = 2000
MODEL = '[sensor]\nquantity = "displacement"\n[[mode]]\nfrequency_hz = 200.0\ndamping_ratio = 0.02\n'
JOINT = '[[term]]\nname = "cubic_stiffness"\ncoefficient = 0.1\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A recording that the model explains, one with a joint in it, and one that is none."""
    folder = tmp_path_factory.mktemp("diagnosed")
    (folder / "cuts").mkdir()
    for name, text in (("model", MODEL), ("joint", MODEL + JOINT)):
        (folder / f"{name}.toml").write_text(text)
        simulate_to_file(folder / f"{name}.toml", 6.0, 3, folder / f"cuts/{name}.wav", RATE_HZ)
    (folder / "cuts/broken.wav").write_text("this is no sound")
    return folder


@pytest.fixture
def diagnosed(folder, run, monkeypatch):
    """What the command ends with; the first time it does the work."""
    monkeypatch.chdir(folder)
    return run("diagnose", "cuts", "--model", "model.toml", "--out", "out", "--jobs", "1")


def test_each_as_if_it_were_alone(diagnosed, folder):
    """The answers are those of `diagnose RECORDING`; pages and parameters lie in the data set; the rest is told."""
    code, out, err = diagnosed
    assert code == 2
    assert "a recording could not be diagnosed; got 'cuts/broken.wav'" in err
    assert "Physics missing in 1 of 2 recordings; 1 could not be diagnosed." in out
    rows = {row.pop("source"): row for row in open_table(folder / "out", "summary").to_table().to_pylist()}
    assert rows["cuts/model.wav"]["verdict"] == "none"
    joint = rows["cuts/joint.wav"]
    assert (joint["verdict"], joint["effects"][0], joint["senses"][0]) == (
        "missing_physics", "cubic_stiffness", "hardening",
    )  # fmt: skip
    # A process of its own, as the workers are: last bits depend on the threads of OpenBLAS.
    alone = [sys.executable, "-m", "chatter_monitor", "diagnose", "cuts/joint.wav", "--model", "model.toml"]
    subprocess.run([*alone, "--out", "alone"], check=True, capture_output=True, timeout=200)
    pages = (folder / "alone/report.html", folder / "out" / joint["page"])
    reports = [json.loads(page.with_name("report.json").read_text()) for page in pages]
    for report in reports:
        del report["elapsed_s"]
    assert reports[0] == reports[1]
    coefficient, *_ = open_table(folder / "out", "parameter").to_table().to_pylist()
    assert coefficient.pop("source") == "cuts/joint.wav"
    estimate = reports[0]["terms"][0]["parameters"]["coefficient"]
    assert coefficient == {
        "effect": "cubic_stiffness",
        "name": "coefficient",
        "value": estimate["value"],
        "low": estimate["ci95"][0],
        "high": estimate["ci95"][1],
        "unit": estimate["unit"],
    }


def test_what_is_done_is_not_done_again(diagnosed, folder, run):  # noqa: ARG001  it has done the work
    """A second time no result is touched; against another model the same directory is refused."""
    files = {path: path.stat().st_mtime_ns for path in (folder / "out").glob("*/*/*")}
    assert len(files) == 6
    code, out, _ = run("diagnose", "cuts", "--model", "model.toml", "--out", "out", "--json")
    assert code == 2
    assert set(json.loads(out)["done"]) == {"cuts/joint.wav", "cuts/model.wav"}
    assert {path: path.stat().st_mtime_ns for path in files} == files
    code, _, err = run("diagnose", "cuts", "--model", "joint.toml", "--out", "out")
    assert code == 2
    assert "results of other settings" in err


def test_what_cannot_be(folder, run, monkeypatch):
    """A force beside many recordings, processes for one, a model that is none: refused before any work."""
    monkeypatch.chdir(folder)
    for reason, *arguments in (
        ("--input does not go with folders", "cuts", "--input", "cuts/model.wav"),
        ("--jobs does not go with single recordings", "cuts/model.wav", "--jobs", "2"),
        ("there is no recording", "cuts/*.flac"),
    ):
        code, out, err = run("diagnose", *arguments, "--model", "model.toml", "--out", "new")
        assert (code, out) == (2, "")
        assert reason in err
    code, _, err = run("diagnose", "cuts", "--model", "absent.toml", "--out", "new")
    assert code == 2
    assert not (folder / "new").exists()


def test_a_diagnosis_travels():
    """What all recordings are diagnosed against reaches a worker that does not see the model file."""
    kind = Diagnoses(MODEL, 1, (0.0, 2.0))
    here, there = Pipe()
    here.send(kind)
    assert there.recv() == kind
