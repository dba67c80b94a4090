"""By how much a line is more than it was, against naive twins."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.kernels.rise import HEARD, arrival, compared, line_rise, news, power_rise
from tests import naive
from tests.kernels.rings import BINS


def risen(heights, levels, cutting, since, head, frames, b, powers=None, turns=()):
    """Rise of a bin, over the frames that count; of its prominence, if there are powers besides.

    In the columns ``turns`` something turned.
    """
    columns, crests = np.zeros(len(levels), np.int64), np.zeros(len(levels))
    crests[list(turns)] = np.inf
    here = compared(levels, cutting, crests, head, min(frames, since), columns)
    how = columns[: compared(levels, cutting, crests, head, frames, columns)], here, b, np.zeros(len(levels))
    return power_rise(heights, *how) if powers is None else line_rise(heights, powers, *how)


@pytest.mark.parametrize(("head", "frames"), [(9, 5), (9, 9), (30, 7), (30, 12), (30, 40), (2, 12)])
@pytest.mark.parametrize(("idle", "since"), [(0.0, 99), (0.5, 99), (0.5, 4)])
@pytest.mark.parametrize("spread", [0.0, 6.0])
def test_rise_is_that_of_the_twin(head, frames, spread, idle, since):
    """Rise is taken over as many frames as asked for, as have been, and as are kept, but for silent and idle ones."""
    rows, b = 12, 20
    rng = np.random.default_rng(7)
    history, loudness = rng.standard_normal((head, BINS)), spread * rng.standard_normal(head)
    in_the_cut = np.append(rng.random(head - 1) > idle, True)
    kept, levels, cutting = np.zeros((BINS, rows)), np.zeros(rows), np.zeros(rows, bool)
    for index, relief in enumerate(history):
        kept[:, index % rows] = relief
        levels[index % rows], cutting[index % rows] = loudness[index], in_the_cut[index]
    last = slice(-min(frames, rows), None)
    expected = naive.rise(history[last], loudness[last], in_the_cut[last], since, b)
    assert risen(kept, levels, cutting, since, head, frames, b) == pytest.approx(expected)
    for seed in range(4):  # on a slope by now, or not
        powers = np.random.default_rng(seed).standard_normal((BINS, rows))
        in_order = powers[:, (np.arange(head - len(history[last]), head)) % rows].T
        expected = naive.rise(history[last], loudness[last], in_the_cut[last], since, b, in_order)
        assert risen(kept, levels, cutting, since, head, frames, b, powers) == pytest.approx(expected)


@pytest.mark.parametrize(("turns", "rise"), [((), 0.0), (range(11), 20.0)])
def test_what_gets_many_times_louder_beside_teeth_has_risen(turns, rise):
    """From 30 dB below it is heard to begin; where teeth were heard there was a cut."""
    heights = np.append(np.zeros((BINS, 11)), np.full((BINS, 1), 40.0), axis=1)
    levels = np.append(np.zeros(11), 6.9)
    assert risen(heights, levels, np.ones(12, bool), 99, 12, 12, 20, turns=turns) == pytest.approx(rise)


@pytest.mark.parametrize(("aside", "hides"), [(0, True), (1, True), (2, False), (3, False)])
def test_a_line_has_not_been_what_another_one_was(aside, hides):
    """It may wander by a bin; two bins aside it was the slope of the one that was there."""
    rows, b = 12, 20
    bins = np.arange(BINS)[:, np.newaxis]
    then = 40.0 - 6.0 * abs(bins - (b - aside)) + np.zeros(rows - 1)
    powers = np.column_stack([then, 40.0 - 6.0 * abs(bins - b)])
    reliefs = np.maximum(powers - 10.0, -3.0)
    rise = risen(reliefs, np.zeros(rows), np.ones(rows, bool), 99, rows, rows, b, powers)
    assert rise == pytest.approx(0.0 if hides else 15.0)


def test_what_is_on_a_slope_yet_has_been_there_before():
    """A faint line beside a loud one stands out there all along."""
    rows, b = 12, 20
    powers = 40.0 - 6.0 * abs(np.arange(BINS) - (b - 3))[:, np.newaxis] + np.zeros(rows)
    reliefs = np.ones((BINS, rows))
    reliefs[b] = 8.0
    assert risen(reliefs, np.zeros(rows), np.ones(rows, bool), 99, rows, rows, b, powers) == 0.0


def test_the_first_frame_has_not_risen():
    """There is nothing to have risen from."""
    assert risen(np.ones((BINS, 12)), np.ones(12), np.ones(12, bool), 99, 1, 12, 20) == 0.0


@pytest.mark.parametrize("head", [40, 57, 90])
@pytest.mark.parametrize("since", [1, 6, 30])
def test_news_is_that_of_the_twin(head, since):
    """What is new in a cut is so against the cuts before and the last air, once enough of both has been heard."""
    rows, b = 57, 20
    rng = np.random.default_rng(head + since)
    history = rng.standard_normal((head, BINS))
    in_the_cut = rng.random(head) > 0.5
    in_the_cut[-since:] = True
    kept, cutting = np.zeros((BINS, rows)), np.zeros(rows, bool)
    for index, relief in enumerate(history):
        kept[:, index % rows], cutting[index % rows] = relief, in_the_cut[index]
    expected = naive.news(history[-rows:], in_the_cut[-rows:], since, b, HEARD)
    assert news(kept, cutting, float(since), head, rows, b, np.zeros(rows)) == pytest.approx(expected)
    came = naive.arrival(history[-rows:], in_the_cut[-rows:], since, b, HEARD)
    assert arrival(kept, cutting, float(since), head, rows, b, np.zeros(rows)) == pytest.approx(came)
    assert arrival(kept, cutting, np.inf, head, rows, b, np.zeros(rows)) == 0.0
    known = min(head, rows)
    assert arrival(kept, cutting, float(known - HEARD + 1), head, rows, b, np.zeros(rows)) == 0.0  # too little heard
    in_the_air = cutting.copy()
    in_the_air[(head - 1) % rows] = False
    assert news(kept, in_the_air, float(since), head, rows, b, np.zeros(rows)) == 0.0
    assert news(kept, cutting, np.inf, head, rows, b, np.zeros(rows)) == 0.0


def test_nothing_rises_out_of_the_cut():
    """While nothing is cut no line has risen, however loud it is against the cut before."""
    loud = np.ones((BINS, 12))
    loud[:, 11] = 9.0
    cutting = np.ones(12, bool)
    cutting[11] = False
    assert risen(loud, np.ones(12), cutting, 99, 12, 12, 20) == 0.0


@pytest.mark.parametrize(("air", "arrived"), [(10, False), (80, False), (150, True)])
def test_what_was_in_the_cut_before_has_not_come_with_the_tool(air, arrived):
    """However long the air between is, as long as the cut before it is remembered for half a second."""
    heights, cutting = np.zeros((BINS, 160)), np.ones(160, bool)
    heights[20] = 6.0
    since = 5
    heights[20, 160 - since - air : 160 - since], cutting[160 - since - air : 160 - since] = 0.0, False
    came = arrival(heights, cutting, float(since), 160, 160, 20, np.zeros(160))
    assert came == (3.0 if arrived else 0.0)
