"""Finding samples that are no numbers or at full scale."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.acquisition.faults import HOLD_SAMPLES, FaultFinder, block_flags, equal_runs
from chatter_monitor.records import Flag


def naive_clipped(samples, ceiling):
    """Indices of the third and later samples of each run at the ceiling, and how many samples such runs have."""
    third_or_later, in_runs, run = [], 0, 0
    for index, value in enumerate(samples):
        run = run + 1 if ceiling <= abs(value) <= 1.0 else 0
        if run >= 3:
            third_or_later.append(index)
            in_runs += 3 if run == 3 else 1
    return third_or_later, in_runs


@pytest.mark.parametrize("seed", range(5))
def test_clipping_agrees_with_a_plain_loop_for_any_cut(seed):
    """Flags and count of clipping are those of a loop over the samples, however the stream is cut."""
    rng = np.random.default_rng(seed)
    samples = rng.choice([0.5, -1.0, 1.0, 0.999, 3.0], size=4000, p=[0.5, 0.15, 0.2, 0.1, 0.05])
    samples[100:3000] = 0.1  # long enough for the flag to come down
    samples[1500:1504] = -0.999
    third_or_later, in_runs = naive_clipped(samples, 0.999)
    assert in_runs > 20
    expected = np.zeros(4000, dtype=bool)
    for index in third_or_later:
        expected[index : index + HOLD_SAMPLES] = True

    finder = FaultFinder(1, 0.999)
    cuts = np.sort(rng.choice(np.arange(1, 4000), size=900, replace=False))
    flags = np.concatenate([finder.inspect(piece.copy()) for piece in np.split(samples[:, np.newaxis], cuts)])
    assert np.array_equal(flags[:, 0] == Flag.CLIPPED, expected)
    assert finder.clipped_samples == in_runs


def test_what_is_not_finite_becomes_zero_and_is_flagged_on_its_channel():
    """NaN and infinity are replaced, counted and flagged for a while, and the other channel is left alone."""
    samples = np.full((1000, 2), 0.25)
    samples[[100, 101, 400], [1, 1, 1]] = np.nan, np.inf, -np.inf
    finder = FaultFinder(2, 1.0)
    flags = finder.inspect(samples)
    assert finder.non_finite_samples == 3
    assert np.array_equal(np.flatnonzero(samples[:, 1] == 0.0), [100, 101, 400])
    assert np.array_equal(
        np.flatnonzero(flags[:, 1]), [*range(100, 101 + HOLD_SAMPLES), *range(400, 400 + HOLD_SAMPLES)]
    )
    assert not flags[:, 0].any()


def test_runs_cover_everything_once():
    """Equal rows stay together, different ones do not, and no row is left out."""
    rows = np.array([[0, 0], [0, 0], [4, 0], [4, 8], [4, 8]], dtype=np.uint8)
    assert list(equal_runs(rows)) == [slice(0, 2), slice(2, 3), slice(3, 5)]
    assert list(equal_runs(rows[:0])) == []
    assert block_flags(rows[0]) == ()
    assert block_flags(rows[4]) == (Flag.CLIPPED, Flag.NON_FINITE)


@pytest.mark.parametrize("seed", range(5))
def test_dead_channels_agree_with_a_plain_loop_for_any_cut(seed):
    """A sample is dead when so many before it have been the same, however the stream is cut; noise never is."""
    rng = np.random.default_rng(seed)
    stuck = rng.standard_normal(3000)
    stuck[200:700] = 0.0
    stuck[1000:1100] = stuck[1000]  # just one short
    stuck[2500:] = -0.3
    samples = np.stack([stuck, rng.standard_normal(3000)], axis=1)
    expected, run = [], 0
    for index in range(3000):
        run = run + 1 if index and stuck[index] == stuck[index - 1] else 0
        expected.append(run >= 100)
    finder = FaultFinder(2, 1.0, dead_after=100)
    cuts = np.sort(rng.choice(np.arange(1, 3000), size=300, replace=False))
    flags = np.concatenate([finder.inspect(piece.copy()) for piece in np.split(samples, cuts)])
    assert sum(expected) == 400 + 400
    assert np.array_equal(flags[:, 0] & Flag.DEAD_CHANNEL != 0, expected)
    assert not flags[:, 1].any()
    assert finder.dead.tolist() == [True, False]


def test_silence_in_a_recording_is_meant():
    """Without a limit nothing is dead."""
    finder = FaultFinder(1, 1.0)
    assert not finder.inspect(np.zeros((100_000, 1))).any()
    assert not finder.dead.any()
