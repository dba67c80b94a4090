"""How much of a signal repeats, against its naive twin and against what is true."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.kernels import repeats
from tests import naive

RATE, FRAME = 12_800, 640


def listen(samples, frame=FRAME):
    """What is heard frame by frame: share that repeats, and whether it has got fainter."""
    state = repeats.new_repeats(frame)
    return np.array(
        [
            (repeats.repeating_share(part, state), repeats.got_fainter(state))
            for part in samples[: len(samples) // frame * frame].reshape(-1, frame)
        ]
    ).T


def teeth(seconds, rotation_hz, seed=1):
    """Lines at the multiples of a rotation up to 2 kHz, with a power of 1."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * RATE)) / RATE
    orders = np.arange(1, int(2000 / rotation_hz) + 1)
    waves = rng.standard_normal(len(orders)) @ np.sin(
        2 * np.pi * (np.outer(orders, rotation_hz * t) + rng.random((len(orders), 1)))
    )
    return waves / waves.std()


def noise(seconds, seed=2):
    """Noise below some 2 kHz, with a power of 1."""
    white = np.random.default_rng(seed).standard_normal(round(seconds * RATE) + 4)
    smooth = np.convolve(white, np.ones(5), mode="valid")
    return smooth / smooth.std()


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("frame", [FRAME, 642, 644, 646])
def test_it_is_that_of_the_twin(seed, frame):
    """The share is that of the plain definition, whatever is left of a frame's samples when they are taken by fours."""
    samples = teeth(0.6, 40.0, seed) + noise(0.6, seed) + 3.0
    samples = samples[: len(samples) // frame * frame]
    constants = frame, repeats.THINNED, repeats.AVERAGING, repeats.LOUDER
    for gain in (1.0, np.where(np.arange(len(samples)) < 7.5 * frame, 0.01, 1.0)):  # a tool that enters
        told = listen(gain * samples, frame)[0][-1]
        assert told == pytest.approx(naive.repeating(gain * samples, *constants), abs=1e-9)


@pytest.mark.parametrize("rotation_hz", [10.0, 13.7, 60.0, 149.0])
@pytest.mark.parametrize("share", [0.25, 0.6, 0.9])
def test_it_is_about_the_share_that_turns(rotation_hz, share):
    """A rotation of any speed is heard, without being told, after half a second, however loud."""
    samples = np.sqrt(share) * teeth(1.0, rotation_hz) + np.sqrt(1.0 - share) * noise(1.0)
    assert listen(1e-4 * samples)[0][10:] == pytest.approx(share, abs=0.15)


def test_a_tool_that_enters_is_heard_within_three_frames():
    """Air is not averaged into what repeats: its share is that of the cut as soon as that has two whole frames."""
    entry = 20 * FRAME + FRAME // 3
    samples = np.sqrt(0.8) * teeth(2.0, 40.0) + np.sqrt(0.2) * noise(2.0)
    samples = np.where(np.arange(len(samples)) < entry, 0.01, 1.0) * samples
    assert listen(samples)[0][23] == pytest.approx(0.8, abs=0.15)


def test_little_of_noise_repeats():
    """Nor of a mode of 3 % damping that noise drives."""
    assert listen(noise(20.0))[0].max() < 0.35
    angle, radius = 2 * np.pi * 600 / RATE, np.exp(-0.03 * 2 * np.pi * 600 / RATE)
    mode = np.zeros(20 * RATE)
    drive = noise(20.0)
    for i in range(2, len(mode)):
        mode[i] = 2 * radius * np.cos(angle) * mode[i - 1] - radius**2 * mode[i - 2] + drive[i]
    assert np.median(listen(mode)[0]) < 0.5


def test_a_lighter_cut_is_told_from_a_tool_that_leaves():
    """Teeth that go on fainter are the same cut; teeth that stop are not, nor is a pump that goes on as loud."""
    cut = teeth(2.0, 40.0) + 0.3 * noise(2.0)
    gain = np.where(np.arange(len(cut)) < RATE + 100, 1.0, 0.25)
    room = 0.01 * noise(2.0, 3)
    pump = 0.3 * np.sin(2 * np.pi * 333.0 * np.arange(len(cut)) / RATE)
    after = slice(20, 28)
    assert listen(gain * cut)[1][after].any()
    assert not listen(np.where(gain < 1.0, 0.0, cut) + room)[1][after].any()
    assert not listen(np.where(gain < 1.0, 0.0, cut) + room + pump)[1][after].any()
    assert not listen(cut)[1].any()


def test_samples_that_are_missing_do_not_undo_it():
    """A millisecond without samples costs little; whole frames without any are nothing that repeats."""
    samples = teeth(1.0, 40.0)
    samples[RATE // 2 : RATE // 2 + 13] = np.nan
    assert listen(samples)[0][7:].min() > 0.8
    samples[RATE // 2 :] = np.nan
    assert listen(samples)[0][-1] < 0.1
    assert listen(np.zeros(RATE))[0].max() == 0.0
