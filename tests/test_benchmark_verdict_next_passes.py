"""Passes that chatter and come again, or come after calm ones, and what of their chatter is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.verdict import next_passes
from benchmarks.verdict.cut import INTERVAL_SAMPLES, RATE_HZ, Label
from benchmarks.verdict.next_passes import (
    AIR_S,
    CALM,
    GROWN,
    PAUSE_S,
    SETTLING,
    Run,
    again,
    at_once,
    job,
    library,
    runs,
)
from tests.test_benchmark_verdict_scoring import LABELS, made_up


@pytest.fixture(scope="module")
def cut():
    """A cut whose sound is noise, tenfold where it chatters."""
    noise = np.random.default_rng(0).standard_normal(LABELS.size * INTERVAL_SAMPLES)
    return made_up("one", noise * np.repeat(np.where(LABELS == Label.SELF_EXCITED, 10.0, 1.0), INTERVAL_SAMPLES))


def test_a_pass_comes_twice_with_air_between(cut):
    """Whole intervals, as loud and in the same room, with the speed in the pause; the calm part is as loud as a cut."""
    pause, first, between, second, after = job(cut, again(cut), np.random.default_rng(1))
    assert pause.samples.size == PAUSE_S * RATE_HZ
    assert between.samples.size == after.samples.size == AIR_S * RATE_HZ
    assert first.samples.size == second.samples.size == (LABELS.size - SETTLING) * INTERVAL_SAMPLES
    assert all(each.samples.size % INTERVAL_SAMPLES == 0 for each in (pause, first, between, second, after))
    assert np.std(second.samples) == pytest.approx(np.std(first.samples), rel=0.05)
    assert np.std(between.samples) == pytest.approx(np.std(pause.samples), rel=0.05)
    calm = slice(10 * INTERVAL_SAMPLES, 40 * INTERVAL_SAMPLES)
    assert 10**-2.1 < np.std(first.samples[calm]) < 10**-0.6
    assert pause.announced == (cut.nominal_rpm, cut.teeth)
    assert {each.announced for each in (first, between, second, after)} == {None}


def test_what_chatters_at_once_comes_after_its_calm_part_twice(cut):
    """A second after it has turned to chatter, and as loud beside that as it is."""
    pause, calm, _, same, air, chatters, _ = job(cut, at_once(cut), np.random.default_rng(1))
    first = int(np.flatnonzero(LABELS == Label.SELF_EXCITED)[0])
    assert calm.samples.size == same.samples.size <= (first - SETTLING) * INTERVAL_SAMPLES
    assert chatters.samples.size == (LABELS.size - first - GROWN) * INTERVAL_SAMPLES
    assert np.std(chatters.samples) > 5.0 * np.std(calm.samples)
    assert [each.doing for each in (pause, calm, same, air, chatters)] == ["pause", "0", "1", "air", "2"]


@pytest.mark.parametrize("plan", [again, at_once])
def test_there_is_a_verdict_for_each_interval_of_each_pass(cut, plan):
    """With the speed, and without."""
    heard = list(runs([cut], seed=1, plan=plan))
    assert [run.told for run in heard] == [True, False]
    for run in heard:
        assert [len(states) for states in run.passes] == [len(LABELS[intervals]) for intervals in plan(cut)]
        assert [run.self_excited(number) for number in range(len(run.truth))] == [
            np.sum(LABELS[intervals] == Label.SELF_EXCITED) for intervals in plan(cut)
        ]


def test_what_is_told_is_counted_pass_by_pass(cut):
    """What the truth leaves open counts neither way."""
    labels = np.array([Label.OTHER, Label.FORCED, Label.UNSCORED, Label.SELF_EXCITED, Label.SELF_EXCITED])
    calm, alarm = ["forced"] * 5, ["self_excited"] * 5
    passes = [["stable", *alarm[1:]], [*calm[:3], "approaching", "self_excited"], calm[:2]]
    run = Run(cut, True, [labels, labels, labels[:2]], passes)
    assert [run.self_excited(number) for number in (0, 1, 2)] == [2, 2, 0]
    assert [run.told_of(number) for number in (0, 1, 2)] == [2, 1, 0]
    assert [run.false_in(number) for number in (0, 1, 2)] == [1, 0, 0]


def test_the_library_has_cuts_that_turn_to_chatter_after_some_calm(monkeypatch):
    """Not those that never do, or too soon, or with tones of the room; and no more than are asked for."""

    def labelled(name, labels):
        plain = made_up(name)
        return replace(plain, truth=replace(plain.truth, label=np.array(labels, np.int8)))

    late = [Label.OTHER] * (SETTLING + CALM) + [Label.SELF_EXCITED] * 20
    cuts = [
        labelled("step", late),
        labelled("ramp", [Label.OTHER] * len(late)),
        labelled("bar", late[1:]),
        labelled("clipped", [*late[: SETTLING + 5], Label.UNSCORED, *late[SETTLING + 6 :]]),
        labelled("hum", late),
        labelled("speed_ramp", [Label.SELF_EXCITED] * SETTLING + late[SETTLING:]),
        labelled("forced_then_chatter", late),
    ]
    monkeypatch.setattr(next_passes, "cached_cuts", lambda *_: iter(cuts))
    assert [cut.name for cut in library(2, None, "report", 0)] == ["step", "speed_ramp"]
    assert len(library(9, None, "report", 0)) == 3
    assert library(9, None, "report", 0, at_once) == []  # no second is left after the one in which it grows
    cuts[0] = labelled("step", [*late, *[Label.SELF_EXCITED] * GROWN])
    assert [cut.name for cut in library(9, None, "report", 0, at_once)] == ["step"]
