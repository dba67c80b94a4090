"""How much of a signal comes back after whole rotations."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chatter_monitor.kernels.recurrence import AROUND, LONGEST, new_past, recurring_share
from chatter_monitor.kernels.repeats import new_repeats, repeating_share
from tests.kernels.test_repeats import FRAME, RATE, noise, teeth


def listen(samples, rotation_hz):
    """Share of each frame once enough has been heard."""
    past = new_past(FRAME)
    rotation = RATE / rotation_hz if rotation_hz else 0.0
    shares = [
        recurring_share(frame, past, rotation) for frame in samples[: len(samples) // FRAME * FRAME].reshape(-1, FRAME)
    ]
    return np.array(shares[LONGEST + 1 :])


def ringing(seconds, hertz=400.0, zeta=0.005, seed=3):
    """A mode that noise drives, with a power of 1."""
    t = np.arange(round(0.3 * RATE)) / RATE
    response = np.exp(-2 * np.pi * hertz * zeta * t) * np.sin(2 * np.pi * hertz * t)
    x = np.convolve(np.random.default_rng(seed).standard_normal(round(seconds * RATE) + len(t)), response, "valid")
    return x / x.std()


@pytest.mark.parametrize("rotation_hz", [5.1, 17.3, 28.15, 149.0])
@pytest.mark.parametrize("share", [0.2, 0.5, 0.9, 1.0])
def test_it_is_the_share_of_what_turns(rotation_hz, share):
    """In the mean of seconds, whatever the speed; of noise some is alike at one lag or another of a long rotation."""
    samples = math.sqrt(share) * teeth(8, rotation_hz) + math.sqrt(1.0 - share) * noise(8) + 7.0
    shares = listen(samples, rotation_hz)
    assert -0.05 < shares.mean() - share < 0.05 + 0.1 * (1.0 - share)
    assert np.all((shares >= 0.0) & (shares <= 1.0))


def test_a_mode_that_noise_drives_does_not_come_back():
    """Half of a lightly damped one repeats at some lag; after a rotation, no multiple of its period, hardly any."""
    samples = ringing(10)
    repeats = new_repeats(FRAME)
    anyhow = [repeating_share(frame, repeats) for frame in samples[: len(samples) // FRAME * FRAME].reshape(-1, FRAME)]
    assert np.median(anyhow[5:]) > 0.5
    assert np.median(listen(samples, 11.0)) < 0.2


def test_a_load_that_jumps_comes_back_after_a_rotation():
    samples = teeth(3, 28.15) * np.where(np.arange(3 * RATE) < 1.5 * RATE, 1.0, 3.0)
    shares = listen(samples, 28.15)
    assert np.sum(shares < 0.95) <= 3
    assert np.all(shares[-20:] > 0.95)


@pytest.mark.parametrize(("off", "back"), [(0.8 * AROUND, True), (6.0 * AROUND, False)])
def test_the_speed_need_not_be_exact(off, back):
    shares = listen(teeth(3, 28.15), 28.15 * (1.0 + off))
    assert bool(np.median(shares) > 0.95) is back


@pytest.mark.parametrize("rotation_hz", [0.0, 4.9])
def test_nothing_is_known_without_a_rotation_or_of_too_long_a_one(rotation_hz):
    assert np.all(np.isnan(listen(noise(2), rotation_hz)))


def test_missing_samples_and_silence_are_no_error():
    samples = teeth(3, 28.15)
    samples[RATE : RATE + 13] = np.nan
    assert np.all(np.isfinite(listen(samples, 28.15)))
    assert np.all(listen(np.zeros(2 * RATE), 28.15) == 0.0)
