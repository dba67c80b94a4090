"""Work shared out over frames: whose turn it was changes nothing."""

from __future__ import annotations

import numpy as np

from chatter_monitor.config import load
from chatter_monitor.tracking.channel import Channel
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.tracking.turns import TURNS, in_turn
from tests.signals import RATE_HZ


def test_a_piece_is_done_in_its_turn_and_counts_when_the_round_is_over():
    """Whatever the turn, the result is there after as many frames; the work is done in one of them."""

    def kept(work, results):
        results.append((yield from work))

    for turn in range(2 * TURNS):
        done, results = [], []
        work = kept(in_turn(turn, lambda done=done: done.append(True) or 42), results)
        for frame in range(TURNS):
            next(work)
            assert bool(done) == (frame >= turn % TURNS)
        assert not results
        assert next(work, "over") == "over"
        assert results == [42]


def test_channels_that_hear_the_same_see_the_same():
    """Combs, margins and all else are the same in every channel, in every frame, whatever its turn."""
    settings, n = load([]), round(9.0 * RATE_HZ)
    angle = 2.0 * np.pi * 28.0 * np.arange(n) / RATE_HZ
    vibration = np.random.default_rng(1).standard_normal(n)
    for _ in range(2):  # a mode
        vibration = np.convolve(vibration, np.exp(-np.arange(800) / 90.0) * np.sin(0.5 * np.arange(800)), "same")
    comb = sum(np.cos(order * angle) for order in (1, 2, 4, 8, 12))
    samples = comb + vibration / np.std(vibration)
    seen = []
    for number in range(TURNS):
        channel = Channel(settings.tracker, settings.orders, SpindleSettings(60 * 27.6, 4), number)
        seen.append([(each.orders, each.lines.tolist(), each.margin) for each in channel.process(0, samples)])
    assert seen[0][-1][0].source == "refined"
    assert seen[0][-1][2].frequency_hz is not None
    for each in seen[1:]:
        np.testing.assert_equal(each, seen[0])
