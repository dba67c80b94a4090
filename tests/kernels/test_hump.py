"""Humps of the noise, out of which a vibration has grown."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.kernels.engagement import DECIBEL
from chatter_monitor.kernels.hump import grew_out_of_hump

BINS, LOWEST, FRAMES, HERE = 120, 5, 40, 60
COLOURS = {"white": np.zeros(BINS), "rumbling": 40.0 * np.exp(-np.arange(BINS) / 15.0)}


def grew(before, *, at=HERE, louder=20.0, stands_out=30.0, heard=FRAMES):
    """Whether a line that stands out at a bin grew out of what was there before, of so many dB in each bin."""
    rng = np.random.default_rng(7)
    powers = DECIBEL * (before[:, np.newaxis] + rng.standard_normal((BINS, FRAMES)))
    reliefs, totals = np.zeros((BINS, FRAMES)), np.zeros(FRAMES)
    newest = (heard - 1) % FRAMES
    reliefs[at, newest], totals[newest] = DECIBEL * stands_out, DECIBEL * louder
    return grew_out_of_hump(reliefs, powers, totals, LOWEST, heard, np.zeros(BINS))


def hump(decibels, width=3, at=HERE):
    """A hump of so many dB, and so many bins to either side."""
    return decibels * np.exp(-0.5 * ((np.arange(BINS) - at) / width) ** 2)


@pytest.mark.parametrize("colour", COLOURS)
@pytest.mark.parametrize("heard", [20, FRAMES, FRAMES + 17])
def test_a_line_that_grows_where_a_mode_sounded_was_in_the_cut(colour, heard):
    """At the mode or a lobe beside it, whatever the colour of the noise; not in a room in which nothing sounded."""
    assert grew(COLOURS[colour] + hump(8.0), heard=heard)
    assert grew(COLOURS[colour] + hump(8.0, at=HERE - 3), heard=heard)
    assert not grew(COLOURS[colour], heard=heard)
    assert not grew(COLOURS[colour] + hump(8.0, at=HERE - 12), heard=heard)


@pytest.mark.parametrize("at", range(LOWEST, BINS, 5))
def test_a_slope_is_no_hump(at):
    """Where the band ends nothing can be told apart from one."""
    assert not grew(COLOURS["rumbling"], at=at)


@pytest.mark.parametrize(("stands_out", "grown"), [(9.5, False), (12.5, True)])
def test_what_stands_out_no_more_than_before_has_not_grown(stands_out, grown):
    """All of it has got louder: another cut."""
    assert grew(hump(8.0), stands_out=stands_out) is grown


@pytest.mark.parametrize(("decibels", "is_one"), [(2.0, False), (5.0, True)])
def test_a_hump_is_higher_than_noise_is_by_chance(decibels, is_one):
    """Three decibels over the higher of its sides."""
    assert grew(hump(decibels)) is is_one


def test_what_is_not_far_louder_is_not_looked_at():
    """Nor is what begins before enough was heard."""
    assert not grew(hump(8.0), louder=6.0)
    assert not grew(hump(8.0), heard=19)
