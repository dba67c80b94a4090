"""The trend of `benchmarks.verdict.trend` is that of a weighted straight line; vibrations are kept apart."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.verdict.cut import INTERVAL_S
from benchmarks.verdict.train import CALM, GROWTH, MEASURES, NEAR, NOISE
from benchmarks.verdict.trend import AGES_S, FALSE, MEMORIES_S, SPREAD, Slope, Trends, told
from chatter_monitor.kernels.kinds import LINE

MEMORY_S = 0.5


def test_a_slope_is_that_of_least_squares_with_fading_weights():
    rng = np.random.default_rng(4)
    values = np.cumsum(rng.normal(size=30))
    heard = rng.random(30) < 0.8  # of an interval without its line nothing is taken in
    heard[-1] = True
    slope = Slope(MEMORY_S)
    for value, takes in zip(values, heard, strict=True):
        slope.age()
        if takes:
            slope.add(value)
    t = np.arange(30.0)
    weights = np.exp((t - t[-1]) * INTERVAL_S / MEMORY_S)[heard]
    t, y = t[heard], values[heard]
    away = t - np.average(t, weights=weights)
    rate = np.average(y * away, weights=weights) / np.average(away**2, weights=weights)
    left = np.average((y - np.average(y, weights=weights) - rate * away) ** 2, weights=weights)
    total = weights.sum()
    expected = rate * np.sqrt(np.average(away**2, weights=weights)) * total / np.sqrt(left * total + SPREAD**2)
    assert slope.significance == pytest.approx(expected, rel=1e-6)


def line(hertz, coherence):
    made = np.zeros(1, LINE)[0]
    made["frequency_hz"], made["coherence"], made["damping_ratio"] = hertz, coherence, 0.02
    return made


def test_each_vibration_has_a_trend_of_its_own():
    """One becomes more coherent, the other stays as it is; which comes first in an interval does not matter."""
    following = Trends()
    for i in range(40):
        falls, stays = line(500.0 + i % 3, 0.5 + 0.01 * i), line(1500.0 - i % 3, 0.5)
        found = following.follow([falls, stays] if i % 2 else [stays, falls])
    (falling, still) = found if i % 2 else found[::-1]
    by_line, by_mode = falling[::2], falling[1::2]
    assert len(by_line) == len(MEMORIES_S)
    assert max(by_line) < -3.0
    assert max(map(abs, [*still, *by_mode])) < 0.01


def test_a_new_vibration_has_no_trend_yet():
    following = Trends()
    for i in range(5):
        (trends,) = following.follow([line(500.0, 0.5 + 0.05 * i)])
    assert not any(trends)


def test_what_a_measure_tells_is_seen_in_what_is_told():
    """A measure that nothing else knows of finds all that grows; one of chance finds no more than is allowed."""
    rng = np.random.default_rng(5)
    kind = np.repeat([NOISE, NEAR, GROWTH, CALM], [20_000, 2000, 2000, 2000])
    age_s = np.where(kind == GROWTH, rng.uniform(0.0, AGES_S[-1], len(kind)), np.inf)
    known = np.zeros((len(kind), len(MEASURES)))
    chance = rng.normal(size=(len(kind), 1))

    def found(further):
        x = np.column_stack([known, further])
        return np.array(told((x, kind), x, kind, age_s))

    assert found(chance + 10.0 * (kind == GROWTH)[:, np.newaxis]) == pytest.approx(100.0)
    by_chance = found(chance).mean(axis=1)
    assert by_chance == pytest.approx([100.0 * share for *_, share in FALSE], abs=2.0)
