"""A simulation beside the recording that is replayed: what a subscriber and a person are told."""

from __future__ import annotations

import numpy as np
import pytest
import soundfile

from chatter_monitor.config import load
from chatter_monitor.discrepancy.live.settings import ModelSettings
from chatter_monitor.errors import InputError
from chatter_monitor.service.watching import Watching
from chatter_monitor.tracking.spindle import SpindleSettings
from tests.discrepancy.machine import Machine, record
from tests.replaying import replay

MODEL = '[sensor]\nquantity = "displacement"\n\n[[mode]]\nfrequency_hz = 400.0\ndamping_ratio = 0.02\n'


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    file = tmp_path_factory.mktemp("model") / "model.toml"
    file.write_text(MODEL)
    return file


@pytest.fixture(scope="module")
def outcome(model, tmp_path_factory):
    """A joint that hardens after 8 s of 16 s, on the first of two channels; the second stays linear."""
    directory = tmp_path_factory.mktemp("replayed")
    changed, same = (
        record(Machine(effect=effect, seconds=16.0, between_s=(8.0, 16.0)), 11) for effect in ("hardening", "none")
    )
    soundfile.write(directory / "cut.wav", 0.1 * np.column_stack([changed, same]), 12800, subtype="FLOAT")
    return replay(directory / "cut.wav", directory, model={"file": str(model)})


def test_a_mismatch_is_told_when_it_begins(outcome):
    """One message tells what the simulation lacks, where and since when; a channel like the simulation has none."""
    told = outcome.of("mismatch")
    assert {message["channel"] for message in told} == {0}
    assert all(message["t"] > 8.0 for message in told)
    last = told[-1]
    assert (last["outcome"], last["effect"], last["sense"]) == ("missing_physics", "cubic_stiffness", "hardening")
    assert abs(last["since_s"] - 8.0) < 2.5
    assert last["evidence_nats"] > 10.0
    assert last["summary"].startswith("The simulation lacks a spring")
    assert len(told) <= 3


def test_the_summary_has_what_was_told(outcome):
    """What `replay --json` prints in the end holds the same messages."""
    assert [message["sample"] for message in outcome.summary["mismatches"]] == [
        message["sample"] for message in outcome.of("mismatch")
    ]


def test_a_model_that_the_signal_does_not_reach_is_refused(tmp_path):
    """Modes beyond the tracker's band are an error of the input, told before anything runs."""
    file = tmp_path / "fast.toml"
    file.write_text(MODEL.replace("400.0", "6200.0"))
    with pytest.raises(InputError, match="does not reach"):
        Watching(ModelSettings(str(file)), SpindleSettings(), 1, 12800.0)


def test_no_model_is_no_comparison():
    """Without a file in the table nothing is compared."""
    assert load([]).model.file is None
