"""The working day of the benchmark: as long as asked for, the same again, made of stable cuts, cheap."""

from __future__ import annotations

import time

import numpy as np
import pytest

from benchmarks.verdict.cut import RATE_HZ
from benchmarks.verdict.monitor import Passage, watch
from benchmarks.verdict.shift import FADE_S, SLOWLY_S, _is_stable, library, shift
from tests.test_benchmark_verdict_scoring import made_up

SECONDS = 200.0


@pytest.fixture(scope="module")
def cuts():
    """Two cuts whose sound is noise; what they are made of does not matter here."""
    rng = np.random.default_rng(0)
    return [made_up(name, rng.standard_normal(12 * round(RATE_HZ))) for name in ("one", "two")]


def test_day_is_as_long_as_asked_for_and_the_same_again(cuts):
    """The samples add up to the sample, and the same seed gives the same day, another seed another."""
    day, again, other = (np.concatenate([p.samples for p in shift(cuts, SECONDS, seed)]) for seed in (1, 1, 2))
    assert day.size == round(SECONDS * RATE_HZ)
    assert np.array_equal(day, again)
    assert not np.array_equal(day[:1000], other[:1000])
    assert np.isfinite(day).all()


def test_tools_of_a_day_may_enter_slowly(cuts):
    """After a twentieth of a second each is half as loud as later, at most; the day is the same otherwise."""
    quick, slow = (list(shift(cuts, SECONDS, 1, fade_s)) for fade_s in (FADE_S, SLOWLY_S))
    for one, other in zip(quick, slow, strict=True):
        assert one.doing == other.doing
        assert one.doing.startswith("cut") or np.array_equal(one.samples, other.samples)
    passes = [p.samples for p in slow if p.doing.startswith("cut")][:-1]  # the last may be cut off
    begins, later = slice(0, round(0.05 * RATE_HZ)), slice(round(0.7 * RATE_HZ), round(1.2 * RATE_HZ))
    assert len(passes) > 3
    assert all(np.std(samples[begins]) < 0.5 * np.std(samples[later]) for samples in passes)


@pytest.mark.parametrize("first", [3, 4])
def test_a_library_begins_where_it_is_told(first):
    """A day may be made of cuts that no day before was made of."""
    (cut,) = library(1, None, first=first)
    assert int(cut.name.split("-")[1]) == first


def test_room_is_heard_between_passes_and_no_pass_is_a_copy(cuts):
    """Gaps hold noise but no cut, and two passes of one cut have no stretch in common."""
    day = list(shift(cuts, SECONDS, 1))
    passes = [p.samples for p in day if p.doing.startswith("cut")]
    gaps = [p.samples for p in day if p.doing == "pause"]
    assert 0 < max(np.std(g) for g in gaps) < min(np.std(p) for p in passes)
    firsts = {p[5000:5010].tobytes() for p in passes}
    assert len(firsts) == len(passes)


def test_cuts_that_chatter_stay_outside():
    """A cut with an unstable interval is not taken into the library."""
    assert not _is_stable(made_up())


def test_generating_is_fast(cuts):
    """Ten minutes of the day take less than a second of processor: 600 times real time."""
    began = time.process_time()
    for _ in shift(cuts, 600.0, 3):
        pass
    assert 600.0 / (time.process_time() - began) > 600.0


def test_monitor_hears_every_passage_under_its_name():
    """States come with what was being done, one for each interval of 50 ms that is complete, to the end."""
    noise = np.random.default_rng(1).standard_normal(3 * round(RATE_HZ))
    passages = [Passage(noise[: round(RATE_HZ)], "pause", (1200.0, 3)), Passage(noise[round(RATE_HZ) :], "cut", None)]
    said = list(watch(passages, announce=True))
    assert [s.doing for s in said] == ["pause", "cut"]
    assert sum(len(s.states) for s in said) >= 59
    assert said[-1].until_s == 3.0
