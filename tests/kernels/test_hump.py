"""What sounded before: humps of the noise, out of which a vibration has grown, and a hum."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.kernels.engagement import DECIBEL
from chatter_monitor.kernels.hump import what_sounded

BINS, LOWEST, FRAMES, HERE = 120, 5, 40, 60
COLOURS = {"white": np.zeros(BINS), "rumbling": 40.0 * np.exp(-np.arange(BINS) / 15.0)}


def sounded(before, *, at=HERE, louder=20.0, stands_out=30.0, heard=FRAMES, power=None):
    """What sounded before a line of such a power stood out at a bin.

    In each bin there are so many dB, shape (BINS,) or (BINS, FRAMES).
    """
    rng = np.random.default_rng(7)
    before = before.reshape(BINS, -1)
    powers = DECIBEL * (before + rng.standard_normal((BINS, FRAMES)))
    reliefs, totals = np.zeros((BINS, FRAMES)), np.zeros(FRAMES)
    newest = (heard - 1) % FRAMES
    reliefs[at, newest], totals[newest] = DECIBEL * stands_out, DECIBEL * louder
    if power is not None:
        powers[at, newest] = DECIBEL * power
    return what_sounded(reliefs, powers, totals, LOWEST, heard, np.zeros(BINS + 1))


def grew(*before, **how):
    """Whether that line grew out of a hump."""
    return sounded(*before, **how)[0]


def mode(*before, **how):
    """Whether that came and went."""
    return sounded(*before, **how)[1]


def quiet(*before, **how):
    """Whether there was no hump, but for a steady tone."""
    return sounded(*before, **how)[2]


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
    assert not quiet(hump(8.0, width=1), louder=6.0)
    assert not quiet(hump(8.0, width=1), heard=19)


@pytest.mark.parametrize("colour", COLOURS)
@pytest.mark.parametrize("at", [30, HERE, 90])
def test_a_room_is_noise_and_maybe_a_steady_tone(colour, at):
    """Of a pump, whatever the colour of the room; where there is a mode, too, something drives it."""
    tone = COLOURS[colour] + hump(15.0, width=1, at=at)
    tool = {"at": at + 10, "power": 50.0}
    assert quiet(COLOURS[colour], **tool)
    assert quiet(tone, **tool)
    assert not quiet(tone + hump(8.0, at=at + 15), **tool)


@pytest.mark.parametrize(
    ("louder", "stands_out", "elsewhere", "is_room"),
    [
        (10.0, 25.0, 0.0, False),
        (10.0, 12.0, 0.0, False),
        (10.0, 8.0, 0.0, True),  # the noise around it is louder than it was
        (10.0, 25.0, 40.0, True),
    ],
)
def test_a_tone_that_is_the_loudest_by_now_and_not_drowned_is_no_pumps(louder, stands_out, elsewhere, is_room):
    """It grew, or came back. A tool drowns a pump, or is louder somewhere else."""
    before = np.repeat(hump(15.0, width=1)[:, np.newaxis], FRAMES, axis=1)
    before[HERE, -1] += louder
    before[HERE + 2, -1] += elsewhere
    assert quiet(before, stands_out=stands_out) is is_room


@pytest.mark.parametrize(("varies", "is_room"), [(1.0, True), (4.0, False)])
def test_what_comes_and_goes_is_no_pumps(varies, is_room):
    """A mode that noise drives does, by several dB."""
    level = 15.0 + varies * np.random.default_rng(3).standard_normal(FRAMES)
    line = hump(1.0, width=1)[:, np.newaxis] * level
    assert quiet(line, at=HERE + 10, power=50.0) is is_room


@pytest.mark.parametrize(("varies", "is_mode"), [(1.0, False), (4.0, True)])
def test_what_comes_and_goes_is_a_mode_and_no_force(varies, is_mode):
    """A line that something forces was steady before it grew; where nothing sounded there was no mode."""
    level = 15.0 + varies * np.random.default_rng(3).standard_normal(FRAMES)
    line = hump(1.0, width=1)[:, np.newaxis] * level
    assert grew(line)
    assert mode(line) is is_mode
    assert not mode(line, at=HERE + 12)
