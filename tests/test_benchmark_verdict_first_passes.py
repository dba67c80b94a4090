"""First passes of the benchmark: a pause, the pass and air in one room, the same again, told or not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.verdict.cut import RATE_HZ
from benchmarks.verdict.first_passes import AFTER_S, PAUSE_S, first_pass, runs
from benchmarks.verdict.shift import FADE_S, SLOWLY_S
from tests.test_benchmark_verdict_scoring import made_up


@pytest.fixture(scope="module")
def cut():
    """A cut whose sound is noise."""
    return made_up("one", np.random.default_rng(0).standard_normal(12 * round(RATE_HZ)))


def test_a_first_pass_is_heard_between_a_pause_and_air(cut):
    """Of the lengths that are said, in the same room, with the speed in the pause."""
    (pause, passage, air), _ = first_pass(cut, np.random.default_rng(1))
    assert PAUSE_S[0] <= pause.samples.size / RATE_HZ <= PAUSE_S[1]
    assert AFTER_S[0] <= air.samples.size / RATE_HZ <= AFTER_S[1]
    assert np.std(pause.samples) == pytest.approx(np.std(air.samples), rel=0.05)
    assert np.std(passage.samples) > np.std(pause.samples)
    assert pause.announced == (cut.nominal_rpm, cut.teeth)
    assert passage.announced is air.announced is None
    again, _ = first_pass(cut, np.random.default_rng(1))
    assert all(np.array_equal(a.samples, b.samples) for a, b in zip((pause, passage, air), again, strict=True))


def test_a_tool_may_enter_slowly(cut):
    """After a twentieth of a second, half as deep as it will be at most, and later the same as one that is quick."""
    quick, slow = (first_pass(cut, np.random.default_rng(1), fade_s)[0][1].samples for fade_s in (FADE_S, SLOWLY_S))
    begins, later = slice(0, round(0.05 * RATE_HZ)), slice(round(0.7 * RATE_HZ), round(1.0 * RATE_HZ))
    assert np.std(slow[begins]) < 0.5 / math.sqrt(3.0) * np.std(slow[later])
    assert np.array_equal(slow[later], quick[later])


def test_a_fifth_of_the_rooms_has_a_pump(cut):
    """Four standard deviations either way."""
    pumps = [first_pass(cut, np.random.default_rng(seed))[1] for seed in range(100)]
    assert 4 <= sum(pumps) <= 36


def test_each_room_is_heard_with_the_speed_and_without(cut):
    """A verdict for each interval of all that is heard."""
    heard = list(runs([cut], 2, seed=1))
    assert [run.told for run in heard] == [True, False, True, False]
    assert len(heard[0].states) == len(heard[1].states)
    assert len(heard[0].states) * 0.05 >= PAUSE_S[0] + AFTER_S[0]
    assert heard[0].alarms == 0
