"""The spindle-synchronous part: found, followed, taken out, and nothing else with it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chatter_monitor.tracking.orders import OrderSettings, OrderTracker
from chatter_monitor.tracking.spindle import SpindleSettings
from tests.signals import RATE_HZ

UNKNOWN = SpindleSettings()


def comb(seconds, rotation_hz, amplitudes, noise=0.1, seed=1):
    """Harmonics {order: amplitude} of a constant speed in white noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    parts = [a * np.cos(2 * np.pi * rotation_hz * h * t + rng.uniform(0, 6)) for h, a in amplitudes.items()]
    return sum(parts) + noise * rng.standard_normal(len(t))


MILLING = {1: 0.3, 2: 0.1, 4: 1.0, 8: 0.7, 12: 0.5, 16: 0.2}


def take_out(samples, spindle=UNKNOWN, block=3200):
    tracker = OrderTracker(OrderSettings(), RATE_HZ, spindle)
    residuals, frames = [], []
    for first in range(0, len(samples), block):
        residual, ended = tracker.process(first, samples[first : first + block])
        residuals.append(residual)
        frames += ended
    return np.concatenate(residuals), [*frames, *tracker.finish()]


@pytest.mark.parametrize(("spindle", "source"), [(UNKNOWN, "found"), (SpindleSettings(1656.0, 4), "refined")])
def test_a_comb_is_found_and_taken_out(spindle, source):
    """With the speed unknown or 2 % off, the comb is found within 3 s and only the noise remains."""
    rotation_hz = 27.6 * 1.02
    residual, frames = take_out(comb(6, rotation_hz, MILLING), spindle)
    late = frames[80:]
    assert {frame.source for frame in late} == {source}
    assert all(abs(frame.rotation_hz - rotation_hz) < 5e-3 * rotation_hz for frame in late)
    assert {line.order for line in late[-1].lines} == set(MILLING)
    assert np.std(residual[4 * 12800 :]) < 0.15


def test_nothing_is_found_in_noise():
    """White noise has no comb, and passes untouched."""
    noise = np.random.default_rng(2).standard_normal(80_000)
    residual, frames = take_out(noise)
    np.testing.assert_array_equal(residual, noise)
    assert {frame.source for frame in frames} == {None}


@settings(max_examples=10, derandomize=True, deadline=None)
@given(st.lists(st.integers(1, 30_000), min_size=1, max_size=8))
def test_any_blocks_give_the_same_bits(sizes):
    """Residual and frames are the same for any cuts between the blocks, missing samples included."""
    samples = comb(4, 40.0, MILLING)
    samples[45_000:45_100] = np.nan
    whole, frames = take_out(samples, block=len(samples))
    tracker = OrderTracker(OrderSettings(), RATE_HZ, UNKNOWN)
    edges = [0, *np.minimum(np.cumsum(sizes), len(samples)).tolist(), len(samples)]
    pieces = [tracker.process(a, samples[a:b]) for a, b in pairwise(edges)]
    assert np.concatenate([residual for residual, _ in pieces]).tobytes() == whole.tobytes()
    assert [frame for _, ended in pieces for frame in ended] + tracker.finish() == frames
