"""Amplitude and phase of bands whose nature is known: noise, modes that it drives, forces, limit cycles."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import digamma

from chatter_monitor.kernels.limit_cycle import LEAST_SHARE, MOST_REPEATING, below_its_mean
from chatter_monitor.tracking.spectrum import Spectrum
from tests.signals import RATE_HZ, vibration

INTERVAL = 640
SECONDS = 12.0
COUNT = round(SECONDS * RATE_HZ)
HERTZ = 800.0


def limit_cycle(diffusion_hz, seed=3):
    """Steady in amplitude, while noise turns its phase: a line as wide as that at half its height."""
    steps = np.random.default_rng(seed).standard_normal(COUNT) * np.sqrt(2.0 * np.pi * diffusion_hz / RATE_HZ)
    return np.sqrt(2.0) * np.sin(2.0 * np.pi * HERTZ * np.arange(COUNT) / RATE_HZ + np.cumsum(steps))


def tone(gliding=0.0):
    """A force whose frequency changes by so much in a second."""
    t = np.arange(COUNT) / RATE_HZ
    return np.sqrt(2.0) * np.sin(2.0 * np.pi * (HERTZ * t + 0.5 * gliding * t * t))


def heard(signal, *, noise=0.1, missing=0, **about):
    """Mean of what is told of a signal in noise."""
    signal = signal + noise * np.random.default_rng(1).standard_normal(len(signal))
    signal[len(signal) - 2 * INTERVAL :][:missing] = np.nan
    spectrum, told = Spectrum(RATE_HZ, INTERVAL), []
    for first in range(0, len(signal), INTERVAL):
        spectrum.take(signal[first : first + INTERVAL], **about)
        told.append(spectrum.cycle)
    assert all(cycle is None for cycle in told[:20])  # a second is heard first
    told = told[20:]
    return None if told[-1] is None else np.array(told).mean(axis=0)


@pytest.mark.parametrize("shape", [1.0, 1.3, 2.0, 7.0])
def test_by_how_much_a_mean_logarithm_is_below(shape):
    """A gamma variable's (Abramowitz and Stegun, 6.3), by another implementation of psi."""
    assert below_its_mean(shape) == pytest.approx(np.log(shape) - digamma(shape), rel=1e-4)


@pytest.mark.parametrize("damping", [0.004, 0.01, 0.03])
def test_the_amplitude_of_a_mode_disperses_as_that_of_noise(damping):
    """However broad its line is: what noise drives is Gaussian."""
    _, share, dispersion, _ = heard(vibration(COUNT, [(HERTZ, damping)], seed=5))
    assert share > 0.7
    assert dispersion == pytest.approx(1.0, abs=0.25)


def test_two_modes_in_a_band_disperse_as_noise_too():
    """Their power together varies less than that of one, and the covariance tells by how much."""
    both = vibration(COUNT, [(HERTZ - 40.0, 0.02)], seed=5) + vibration(COUNT, [(HERTZ + 40.0, 0.02)], seed=6)
    assert heard(both)[2] == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize("gliding", [0.0, 10.0, 40.0])
def test_a_force_keeps_its_amplitude_and_its_phase(gliding):
    """The phase also where its frequency glides, as that of a spindle does."""
    hertz, _, dispersion, foretold = heard(tone(gliding))
    assert hertz == pytest.approx(HERTZ + 0.5 * gliding * SECONDS, abs=30.0)
    assert dispersion < 0.1
    assert foretold > 0.9


@pytest.mark.parametrize("diffusion_hz", [6.0, 12.0, 20.0])
def test_a_limit_cycle_keeps_its_amplitude_and_not_its_phase(diffusion_hz):
    """With the width of a mode of 0.4 to 1.3 % damping, which disperses as noise."""
    _, share, dispersion, foretold = heard(limit_cycle(diffusion_hz))
    assert share > 0.7
    assert dispersion < 0.35
    assert foretold < 0.8


def test_what_is_not_worth_asking():
    """A band with little of the power, a signal that repeats, and one in which samples are missing."""
    assert heard(limit_cycle(12.0), noise=0.1) is not None
    assert heard(limit_cycle(12.0), noise=2.5 / LEAST_SHARE) is None
    assert heard(limit_cycle(12.0), repeating=1.01 * MOST_REPEATING) is None
    assert heard(limit_cycle(12.0), missing=1) is None
    assert heard(limit_cycle(12.0), missing=2 * INTERVAL) is None
