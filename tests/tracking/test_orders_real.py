"""Combs of real machines, where the recordings are at hand: they are not part of the project."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from chatter_monitor.acquisition.recording import Recording
from chatter_monitor.acquisition.resample import Resampled
from chatter_monitor.tracking.orders import OrderSettings, OrderTracker
from chatter_monitor.tracking.spindle import SpindleSettings
from tests.signals import RATE_HZ

DATA = Path(__file__).parents[3] / "shared" / "data"


@pytest.fixture(scope="module")
def heard():
    """Samples, residual and frames of a recording without any speed given; each once."""
    done = {}

    def heard(name, seconds):
        if not (DATA / name).is_file():
            pytest.skip(f"{name} is not in ../shared/data: recordings of real machines are not part of the project")
        if name not in done:
            source = Resampled(Recording(DATA / name), RATE_HZ)
            samples = np.concatenate([block.samples[:, 0] for block in source.blocks()])[: round(seconds * RATE_HZ)]
            tracker = OrderTracker(OrderSettings(), RATE_HZ, SpindleSettings())
            done[name] = (samples, *tracker.process(0, samples))
        return done[name]

    return heard


def level(samples, frequency_hz, begin_s, end_s):
    """Amplitude of a line, by a Hann window."""
    piece = samples[round(begin_s * RATE_HZ) : round(end_s * RATE_HZ)]
    window = np.hanning(len(piece))
    turning = np.exp(-2j * np.pi * frequency_hz * np.arange(len(piece)) / RATE_HZ)
    return 2 * abs(np.sum(piece * window * turning)) / window.sum()


def test_forced_milling_has_its_comb(heard):
    """From 4 s on the comb of 91.6 Hz is found, with orders 1, 4, 8, 11 and 12; its lines fall by 12 dB at least."""
    samples, residual, frames = heard("ubc_milling_no_chatter.flac", 9.0)
    late = frames[80:170]
    assert all(frame.source == "found" and abs(frame.rotation_hz - 91.6) < 0.5 for frame in late)
    assert {1, 4, 8, 11, 12} <= {line.order for line in late[20].lines}
    for frequency_hz in (91.61, 366.44, 732.85):
        assert level(residual, frequency_hz, 5, 8) < 0.25 * level(samples, frequency_hz, 5, 8)


def test_milling_chatter_stays(heard):
    """From 8 to 16.5 s the chatter between 1060 and 1080 Hz and its sidebands keep 95 % of the power of their bands."""
    samples, residual, _ = heard("ubc_milling_chatter.flac", 18.0)
    frequency = np.fft.rfftfreq(round(8.5 * RATE_HZ), 1 / RATE_HZ)
    there = slice(round(8 * RATE_HZ), round(16.5 * RATE_HZ))
    before, after = (abs(np.fft.rfft(signal[there])) ** 2 for signal in (samples, residual))
    for middle_hz in (1070.0, 1070.0 + 215.5):
        band = abs(frequency - middle_hz) < 10
        assert after[band].sum() > 0.95 * before[band].sum()


def test_the_burst_is_not_on_the_mains_comb(heard):
    """The accelerometer's steady lines are multiples of 50 Hz; the burst at 684 Hz between 4 and 5 s passes."""
    samples, residual, frames = heard("ubc_milling_accelerometer_5k.wav", 8.0)
    assert all(abs(frame.rotation_hz - 50.0) < 0.1 for frame in frames[60:80])
    assert level(residual, 150.0, 5.5, 7.5) < 0.1 * level(samples, 150.0, 5.5, 7.5)
    assert level(residual, 684.0, 4.2, 4.8) > 0.95 * level(samples, 684.0, 4.2, 4.8)


@pytest.mark.parametrize(
    "name", ["turning_s_320_030_10k.wav", "turning_s_320_040_10k.wav", "turning_c_770_005_10k.wav"]
)
def test_one_second_of_turning_passes(heard, name):
    """A second is too short to find a comb of an unknown speed: nothing is taken out."""
    samples, residual, _ = heard(name, 1.0)
    np.testing.assert_array_equal(residual, samples)
