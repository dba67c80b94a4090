"""The simulated recordings in replay_data and their truth."""

import json
from pathlib import Path

import numpy as np
import pytest
import soundfile

from chatter_monitor.physics import cuts
from chatter_monitor.physics.model_file import as_tables
from chatter_monitor.physics.stability import rightmost_root, rightmost_roots_along

DIRECTORY = Path(__file__).parents[2] / "replay_data"
SYSTEMS = {
    "stable_turning": cuts.stable_turning(),
    "bar_turning": cuts.bar_turning(),
    "forced_milling": cuts.forced_milling(),
}


def load(name):
    samples, rate = soundfile.read(DIRECTORY / f"{name}.flac")
    truth = json.loads((DIRECTORY / f"{name}.json").read_text())
    return samples, rate, truth


@pytest.mark.parametrize("name", SYSTEMS)
def test_recording_and_truth_belong_together(name):
    """16-bit FLAC at 12.8 kHz, not clipped, with the model of today and a root for every 50 ms of it."""
    samples, rate, truth = load(name)
    assert soundfile.info(DIRECTORY / f"{name}.flac").subtype == "PCM_16"
    assert rate == truth["sample_rate_hz"] == 12800
    assert 0.1 < np.max(np.abs(samples)) < 0.95
    assert samples.size == truth["duration_s"] * rate
    assert len(truth["intervals"]) == truth["duration_s"] / truth["interval_s"]
    assert truth["model"] == json.loads(json.dumps(as_tables(SYSTEMS[name])))


def test_all_recordings_together_stay_small():
    """What the repository carries is less than 5 MB."""
    assert sum(file.stat().st_size for file in DIRECTORY.iterdir() if file.is_file()) < 5e6


@pytest.mark.parametrize("name", SYSTEMS)
def test_truth_is_that_of_the_model(name):
    """The roots in the sidecar are the rightmost roots of the model, frozen in the middle of the interval."""
    truth = load(name)[2]
    for i in (0, 70, 150, 199):
        interval = truth["intervals"][i]
        root = rightmost_root(SYSTEMS[name].at(interval["t0"] + 0.025))
        assert interval["frequency_hz"] == pytest.approx(root.frequency_hz, rel=1e-4)
        assert interval["damping_ratio"] == pytest.approx(root.damping_ratio, abs=1e-6)
        assert interval["stable"] == root.stable


def test_the_bar_chatters_in_the_middle_and_recovers():
    """The bar loses its stability before it gets loud, by more than 20 dB, and is quiet again at the end."""
    samples, rate, truth = load("bar_turning")
    ((lost, regained),) = truth["unstable_s"]
    ((loud, quiet),) = truth["chatter_s"]
    assert 4.0 < lost < loud < 10.0 < regained < quiet < 16.0
    level = 20.0 * np.log10(np.std(samples.reshape(-1, rate // 2), axis=1))
    assert level[20] - level[:8].max() > 20.0
    assert level[20] - level[-8:].max() > 20.0
    roots = rightmost_roots_along(cuts.bar_turning(), [10.0])
    spectrum = np.abs(np.fft.rfft(samples[9 * rate : 11 * rate] * np.hanning(2 * rate)))
    assert np.argmax(spectrum) / 2.0 == pytest.approx(roots[0].frequency_hz, rel=0.02)


def test_the_quiet_cuts_are_stable_throughout():
    """Neither the stable turning nor the forced milling ever chatters, and they say so."""
    for name in ("stable_turning", "forced_milling"):
        truth = load(name)[2]
        assert truth["unstable_s"] == truth["chatter_s"] == []
        assert all(interval["stable"] and interval["damping_ratio"] > 0.015 for interval in truth["intervals"])


def test_the_forced_cut_has_its_lines_on_tooth_harmonics():
    """The six strongest lines of the milling recording are multiples of the tooth passing, the strongest the sixth."""
    samples, rate, truth = load("forced_milling")
    tooth_hz = truth["spindle_rpm"] / 60.0 * truth["teeth"]
    spectrum = np.abs(np.fft.rfft(samples * np.hanning(samples.size)))
    resolution = rate / samples.size
    strongest = []
    for _ in range(6):
        peak = int(np.argmax(spectrum))
        strongest.append(peak * resolution / tooth_hz)
        spectrum[max(0, peak - 40) : peak + 41] = 0.0
    np.testing.assert_allclose(strongest, np.round(strongest), atol=0.002)
    assert round(strongest[0]) == 6
