"""Whether each rotation repeats the one before, louder and out of step."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import hilbert

from chatter_monitor.kernels.repeats import new_repeats, repeating_share
from chatter_monitor.kernels.rotations import (
    GROWN,
    another_frame,
    cosine,
    growth,
    new_rotations,
    new_slower,
    slower_growth,
)

RATE, FRAME = 12_800, 640
ROTATION = 1010  # samples: 760 rpm
CALM = 3  # rotations that are alike, before and after the louder ones


def listen(samples):
    """What is heard frame by frame."""
    repeats, rotations = new_repeats(FRAME), new_rotations()
    heard = []
    for frame in samples[: len(samples) // FRAME * FRAME].reshape(-1, FRAME):
        repeating_share(frame, repeats)
        heard.append(growth(rotations, repeats))
    return np.array(heard)


def wave(samples, seed):
    """An analytic signal around 1150 Hz that comes round after so many samples, with a power of 1."""
    rng = np.random.default_rng(seed)
    frequency = np.fft.rfftfreq(samples, 1.0 / RATE)
    band = np.exp(-0.5 * ((frequency - 1150.0) / 120.0) ** 2)
    wave = hilbert(np.fft.irfft(band * np.fft.rfft(rng.standard_normal(samples)), samples))
    return wave / np.std(wave.real)


def cut(phase, gain, seed=1, louder=5, room=0.02, rotation=ROTATION):
    """Waves around 1150 Hz that come back after a rotation, moved on by a phase; some of them louder and louder."""
    steps = np.concatenate([np.ones(CALM), np.full(louder, gain), np.ones(CALM)])
    one = wave(rotation, seed)
    samples = np.concatenate([(turn * one).real for turn in np.cumprod(steps * np.exp(1j * phase))])
    return samples + room * np.random.default_rng(100 + seed).standard_normal(len(samples))


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("phase", [-2.0, 1.7, 3.0])
def test_waves_that_regenerate_are_heard(phase, seed):
    """Five rotations each a third louder than the one before: by 1.4 e-folds, of which all but the first are seen."""
    heard = listen(cut(phase, 4 / 3, seed))
    assert heard.max() == pytest.approx(5 * np.log(4 / 3), rel=0.25)
    assert not heard[: CALM * ROTATION // FRAME].any()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_forced_comb_that_gets_louder_is_in_step(seed):
    """What a rotation forces comes back as it was: it has not grown by itself, however loud it gets."""
    assert listen(cut(0.0, 4 / 3, seed)).max() == 0.0


@pytest.mark.parametrize("phase", [0.0, 1.7, 3.0])
@pytest.mark.parametrize("gain", [0.8, 1.0])
def test_what_does_not_get_louder_has_not_grown(phase, gain):
    """The waves of a stable cut come back, too, out of step and as loud as before."""
    assert listen(cut(phase, gain)).max() == 0.0


@pytest.mark.parametrize("seed", range(1, 7))
def test_what_grows_by_a_few_decibels_is_heard(seed):
    """Five rotations each an eighth louder than the one before: 5 dB."""
    assert listen(cut(1.7, 9 / 8, seed)).max() >= GROWN


@pytest.mark.parametrize("gain", [3.0, 5.0, 10.0, 30.0])
def test_a_tool_that_enters_has_not_grown(gain):
    """From one rotation to the next it is louder, and then it stays so."""
    assert listen(cut(1.7, gain, louder=1)).max() == 0.0


@pytest.mark.parametrize("seed", range(1, 7))
def test_a_load_that_jumps_has_not_grown(seed):
    """By 5 dB from one rotation to the next, which is as much as what grows is asked for."""
    assert listen(cut(1.7, 1.8, seed, louder=1)).max() == 0.0


def test_what_has_stopped_growing_before_it_stood_alone_has_not_grown():
    """It gets 1.6 e-folds louder beside its copy within the rotation, and goes on without that, as loud as it is."""
    one, rotations = wave(ROTATION, 1), np.arange(14)
    grown = np.exp(0.28 * np.clip(rotations - CALM, 0, 6) + 1.7j * rotations)
    alone = np.concatenate([(turn * one).real for turn in grown])
    beside = 0.9 * np.roll(alone, ROTATION // 2) * (np.arange(len(alone)) < 10 * ROTATION)
    room = 0.02 * np.random.default_rng(7).standard_normal(len(alone))
    assert listen(alone + room).max() > GROWN
    assert listen(alone + beside + room).max() == 0.0


@pytest.mark.parametrize("teeth", [2, 5])
def test_what_repeats_within_a_rotation_is_not_for_this(teeth):
    """Out of step and louder from tooth to tooth: lines so far apart are told one by one."""
    one = wave(1150 // teeth, 1)
    turns = np.cumprod(np.full(16 * teeth, 1.5 ** (1 / teeth) * np.exp(1.7j)))
    assert listen(np.concatenate([(turn * one).real for turn in turns])).max() == 0.0


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("ripple", [0.2, 0.3])
def test_blows_that_repeat_and_get_louder_have_no_phase(ripple, seed):
    """A tooth that strikes: a ripple rides on what takes most of a rotation, and comes back a little otherwise."""
    steps = np.concatenate([np.ones(CALM), np.full(4, 1.2), np.ones(3 * CALM)])
    turn = np.exp(1j * np.random.default_rng(seed).uniform(2.0, 4.0, len(steps))).cumprod()
    blow = np.sin(np.pi * np.arange(ROTATION) / ROTATION) ** 8 - 0.27
    one = wave(ROTATION, seed)
    turns = zip(np.cumprod(steps), turn, strict=True)
    samples = np.concatenate([gain * (blow + ripple * (phase * one).real) for gain, phase in turns])
    assert not listen(samples + 0.01 * np.random.default_rng(seed).standard_normal(len(samples))).any()


def test_noise_and_what_it_drives_do_not_grow():
    """A minute of noise, and of a mode of 0.4 % damping that it drives."""
    noise = np.random.default_rng(5).standard_normal(60 * RATE)
    assert listen(noise).max() == 0.0
    angle = 2 * np.pi * 500.0 / RATE
    radius = np.exp(-0.004 * angle)
    mode = np.zeros(len(noise))
    for i in range(2, len(mode)):
        mode[i] = 2 * radius * np.cos(angle) * mode[i - 1] - radius**2 * mode[i - 2] + noise[i]
    assert listen(mode).max() < GROWN


@pytest.mark.parametrize("phase", np.linspace(-3.0, 3.0, 7))
@pytest.mark.parametrize("period", [4.3, 5.6, 12.0])
def test_the_phase_is_that_at_the_envelopes_crest(phase, period):
    """Of a wave under a Gaussian envelope, whose crest lies between two lags."""
    lag = np.arange(321) - 150.4
    correlation = np.exp(-0.5 * (lag / (1.2 * period)) ** 2) * np.cos(2 * np.pi * lag / period + phase)
    assert cosine(correlation) == pytest.approx(np.cos(phase), abs=0.15)


def test_where_no_envelope_has_a_crest_nothing_is_out_of_step():
    """What repeats the less the longer ago, without coming back."""
    lag = np.arange(321)
    assert cosine(np.exp(-(320 - lag) / 100.0) * np.cos(0.9 * lag)) == 1.0
    assert cosine(np.zeros(321)) == 1.0


def listen_slowly(samples):
    """What is heard of slower rotations, frame by frame."""
    slower = new_slower(FRAME)
    frames = samples[: len(samples) // FRAME * FRAME].reshape(-1, FRAME)
    return np.array([slower_growth(frame, slower) for frame in frames])


@pytest.mark.parametrize("rotation", [1400, 1800, 2400])
def test_slower_rotations_are_heard(rotation):
    """548, 427 and 320 rpm: what regenerates has grown; what is forced, as loud as before, or jumps, has not."""
    heard = listen_slowly(cut(1.7, 4 / 3, rotation=rotation))
    assert heard.max() == pytest.approx(5 * np.log(4 / 3), rel=0.35)
    assert not heard[: CALM * rotation // FRAME].any()
    assert listen(cut(1.7, 4 / 3, rotation=rotation)).max() == 0.0
    for phase, gain, louder in ((0.0, 4 / 3, 5), (1.7, 1.0, 5), (1.7, 1.8, 1), (1.7, 5.0, 1)):
        assert listen_slowly(cut(phase, gain, louder=louder, rotation=rotation)).max() == 0.0


def test_both_are_heard():
    """Frame by frame the growth is that of whichever rotations there are."""
    for rotation in (1010, 1800):
        repeats, rotations, slower = new_repeats(FRAME), new_rotations(), new_slower(FRAME)
        samples = cut(1.7, 4 / 3, rotation=rotation)
        frames = samples[: len(samples) // FRAME * FRAME].reshape(-1, FRAME)
        heard = [another_frame(frame, repeats, rotations, slower)[2] for frame in frames]
        np.testing.assert_array_equal(heard, np.maximum(listen(samples), listen_slowly(samples)))
