"""A stretch that is read in step with one of its lines: what turns along is narrow, and what does not is blurred."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chatter_monitor.kernels.in_step import BLOCK, new_work, read_in_step
from tests.signals import RATE_HZ

SAMPLES = 32_640
T = np.arange(SAMPLES) / RATE_HZ
WIDTH_HZ = 4.0


def read(samples, line_hz, width_hz=WIDTH_HZ):
    """The stretch in step with a line, and the mean frequency of that (Hz)."""
    out = np.empty(len(samples))
    mean = read_in_step(samples, line_hz / RATE_HZ, width_hz / RATE_HZ, new_work(len(samples)), out)
    return out, mean * RATE_HZ


def wandering(hertz, share=0.003, swing_hz=0.6):
    """Angle of what turns at so many Hz and wanders, and its mean speed (Hz)."""
    speed = hertz * (1.0 + share * np.sin(2 * np.pi * swing_hz * T + 0.4))
    return 2 * np.pi * np.cumsum(speed) / RATE_HZ, speed.mean()


def peak(samples, hertz, around_hz):
    """Frequency (Hz) and power of the highest crest near a frequency."""
    power = np.abs(np.fft.rfft(samples * np.hanning(len(samples)), 1 << 18)) ** 2
    f = np.fft.rfftfreq(1 << 18, 1 / RATE_HZ)
    near = np.abs(f - hertz) < around_hz
    i = int(np.argmax(np.where(near, power, 0.0)))
    return f[i], power[i]


@pytest.mark.parametrize("line_hz", [95.0, 316.0, 1500.0])
def test_what_turns_along_keeps_its_frequency(line_hz):
    """The fourth multiple and the third part of a line that wanders by 0.3 % are as narrow as without wandering."""
    angle, mean_hz = wandering(line_hz)
    times = 4 if line_hz < 1000.0 else 1 / 3
    samples = np.cos(angle) + 0.1 * np.cos(times * angle + 1.0)
    out, leader_hz = read(samples, line_hz, max(WIDTH_HZ, 0.012 * line_hz))
    assert leader_hz == pytest.approx(mean_hz, rel=2e-4)
    steady = np.cos(2 * np.pi * mean_hz * T) + 0.1 * np.cos(2 * np.pi * times * mean_hz * T)
    hertz, power = peak(out, times * line_hz, 0.01 * times * line_hz)
    assert hertz == pytest.approx(times * leader_hz, abs=0.05)
    assert power > 0.9 * peak(steady, times * line_hz, 0.01 * times * line_hz)[1]
    assert peak(samples, times * line_hz, 0.01 * times * line_hz)[1] < 0.7 * power


def test_what_does_not_turn_along_is_blurred():
    samples = np.cos(wandering(316.0)[0]) + 0.1 * np.cos(2 * np.pi * 1071.4 * T)
    out, _ = read(samples, 316.0)
    assert peak(out, 1071.4, 15.0)[1] < 0.5 * peak(samples, 1071.4, 15.0)[1]


def test_a_steady_line_changes_nothing():
    """Samples are as before, later by half of a block: there the first phase is known."""
    samples = np.cos(2 * np.pi * 316.0 * T) + 0.1 * np.cos(2 * np.pi * 811.0 * T + 1.0)
    out, mean_hz = read(samples, 316.0)
    assert mean_hz == pytest.approx(316.0, abs=1e-3)
    shift = 0.5 * (BLOCK - 1) / RATE_HZ
    later = np.cos(2 * np.pi * 316.0 * (T + shift)) + 0.1 * np.cos(2 * np.pi * 811.0 * (T + shift) + 1.0)
    assert np.max(np.abs(out - later)[:-BLOCK]) < 0.01
    assert np.all(out[-BLOCK:] == 0.0)


def test_a_line_need_not_be_told_exactly():
    angle, mean_hz = wandering(316.0)
    out, leader_hz = read(np.cos(angle) + 0.1 * np.cos(3 * angle), 316.9)
    assert leader_hz == pytest.approx(mean_hz, rel=2e-4)
    assert peak(out, 3 * mean_hz, 10.0)[0] == pytest.approx(3 * leader_hz, abs=0.05)


def test_nothing_is_in_step_with_noise():
    """Its phase goes backwards sooner or later."""
    noises = [np.random.default_rng(seed).standard_normal(SAMPLES) for seed in range(8)]
    assert any(math.isnan(read(noise, 20.0)[1]) for noise in noises)
