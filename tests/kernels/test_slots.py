"""Modes in their slots, against sorting."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.kernels import slots
from chatter_monitor.tracking.bands import homes
from tests import naive

HOMES = np.array(homes(12_800.0, range(4)))


def frames(seed):
    """Modes of 400 frames: vibrations that wander over octaves' edges, and come and go, each seen by two of them."""
    rng = np.random.default_rng(seed)
    hertz = np.exp(rng.uniform(np.log(60.0), np.log(6000.0), 4))
    for _ in range(400):
        hertz *= np.exp(0.02 * rng.standard_normal(4))
        hertz = np.where(rng.random(4) < 0.02, np.exp(rng.uniform(np.log(60.0), np.log(6000.0), 4)), hertz)
        seen = hertz[np.stack([rng.permutation(4)[:2] for _ in HOMES])] * np.exp(0.005 * rng.standard_normal((4, 2)))
        yield np.where(rng.random((4, 2)) < 0.1, np.nan, seen), rng.integers(1, 9, (4, 2)) / 8.0


@pytest.mark.parametrize(("seed", "count"), [(1, 4), (2, 4), (3, 2)])
def test_slots_are_those_of_the_twin(seed, count):
    """Octave, mode and power in each slot are the twin's, frame by frame, equal powers included."""
    known, twin = slots.new_slots(HOMES, 2, count), naive.NaiveSlots(HOMES, count)
    taken_over = 0
    for hertz, powers in frames(seed):
        before = known.last["octave"].copy()
        known.frequencies[:], known.powers[:] = hertz, powers
        slots.assign(known)
        expected = twin.assign(hertz, powers)
        assert known.chosen.tolist() == [[-1, -1] if mode is None else [mode.octave, mode.mode] for mode in expected]
        assert known.power.tolist() == [0.0 if mode is None else mode.power for mode in expected]
        taken_over += np.sum(known.last["octave"] != before)
    assert taken_over > 20
