"""What the benchmark says of advice: the limit at the speeds that are given, and of those who are sent to none."""

from __future__ import annotations

import io
import math
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from benchmarks.verdict import milling_remedies, remedies
from benchmarks.verdict.cut import INTERVAL_SAMPLES, Label
from benchmarks.verdict.generator import cut, recipe_of
from benchmarks.verdict.milling import chatters_at, draw, limit
from benchmarks.verdict.remedies import ADVISED, ANY, BEST, IN_STEP, UNTOLD, Remedy, in_step, remedy_of, table_of
from benchmarks.verdict.roots import critical_kappa
from chatter_monitor.records import Advice, Event
from tests.test_benchmark_verdict_scoring import LABELS, made_up


def event(onset_s, end_s, *speeds, remedy="", withdrawn=False):
    about = {"peak_frequency_hz": 640.0, "min_damping_ratio": 0.0, "remedy": remedy, "withdrawn": withdrawn}
    advice = [Advice(rpm, 2) for rpm in speeds]
    return Event(id="e", channel=0, kind="chatter", onset_s=onset_s, end_s=end_s, advice=advice, **about)


@pytest.fixture
def heard(monkeypatch):
    """Let the monitor have said this."""

    def say(*events):
        for module in (remedies, milling_remedies):
            monkeypatch.setattr(module, "events_of", lambda _: list(events))

    return say


@pytest.fixture(scope="module")
def step():
    """A cut that is unstable from one moment to the next."""
    made, recipe = cut("development", 1), recipe_of("development", 1)
    assert made.name == "development-0001-step"
    assert recipe.rpm.values[0] == pytest.approx(made.nominal_rpm, rel=0.04)
    return made, recipe


def test_limits_are_those_of_the_speeds_as_they_are_set(step, heard):
    """The operator's display is off as the speed is that was told; the depth is that of the event."""
    made, recipe = step
    chatters = np.flatnonzero(made.truth.label == Label.SELF_EXCITED)
    onset_s, end_s = made.truth.start_s[chatters[0]], made.truth.start_s[chatters[-1]]
    told, present = made.nominal_rpm, recipe.rpm.values[0]
    heard(event(onset_s, end_s, told, 1.3 * told, remedy="stable in 7 of 10 such cuts or stable in 5 of 10"))
    remedy = remedy_of(made, recipe)
    depth = np.median(made.truth.kappa[chatters[:-1]])
    expected = [
        critical_kappa(recipe.modes, 60.0 / (recipe.teeth * rpm), recipe.engagement.harmonics()) / depth
        for rpm in (present, 1.3 * present)
    ]
    assert remedy.limits[ADVISED] == pytest.approx(expected, rel=1e-3)
    assert remedy.present == pytest.approx(expected[0], rel=1e-3)
    assert remedy.present < 1.0
    assert remedy.limits[BEST][0] == max(remedy.limits[ANY]) >= remedy.limits[ANY][0]
    assert len(remedy.limits[UNTOLD]) <= 3
    assert remedy.said == [7, 5]


def test_only_a_true_alarm_advises(heard):
    """Of long enough; the longest of these."""
    made = made_up("one", np.zeros(LABELS.size * INTERVAL_SAMPLES))
    chatters = np.flatnonzero(LABELS == Label.SELF_EXCITED)
    first, last = (made.truth.start_s[i] for i in (chatters[0], chatters[-1]))
    heard(event(0.5, 0.5 + last - first), event(first, first + 0.4), event(first, last, withdrawn=True))
    assert remedies._chatter(made) is None
    longest = event(first, last)
    heard(event(first, first + 0.5), longest)
    assert remedies._chatter(made) is longest


def test_speeds_in_step_are_whole_waves_and_the_nearest_comes_first():
    """60 f / (N k), between half and twice the present speed."""
    speeds = in_step(640.0, 3, 5000.0)
    assert all(60.0 * 640.0 / (3 * speed.spindle_rpm) == pytest.approx(speed.lobe) for speed in speeds)
    away = [abs(math.log(speed.spindle_rpm / 5000.0)) for speed in speeds]
    assert away == sorted(away)
    assert all(2500.0 <= speed.spindle_rpm <= 10_000.0 for speed in speeds)


def printed(table):
    console = Console(file=io.StringIO(), width=200)
    console.print(table)
    return console.file.getvalue()


def test_the_table_counts_what_is_stable_and_what_gets_worse():
    """The first speed of each, one of its three, and the limit over the present one."""
    one = Remedy(0.5, {ADVISED: [0.4, 1.5], UNTOLD: [], IN_STEP: [0.5], ANY: [0.2, 2.0], BEST: [2.0]}, [6, 5])
    two = Remedy(0.5, {ADVISED: [1.5], UNTOLD: [1.2], IN_STEP: [0.8], ANY: [0.2, 0.4], BEST: [0.4]}, [7])
    rows = {
        line.split("│")[1].strip(): line.split("│")[2:] for line in printed(table_of([one, two])).splitlines()[3:-1]
    }
    read = {name: [cell.strip() for cell in cells[:-1]] for name, cells in rows.items()}
    assert read[ADVISED] == ["2 of 2", "50%", "100%", "50%", "1.90"]
    assert read[UNTOLD] == ["1 of 2", "100%", "100%", "0%", "2.40"]
    assert read[IN_STEP] == ["2 of 2", "0%", "0%", "0%", "1.30"]
    assert read[ANY] == ["2 of 2", "25%", "", "75%", "1.40"]


def test_a_mill_is_stable_where_its_depth_is_below_the_limit():
    """Half a limit does not chatter, two do, at a speed of their own."""
    mill = draw(2)
    elsewhere = 1.2 * mill.rotation_hz
    there = limit(replace(mill, rotation_hz=elsewhere))
    assert not chatters_at(mill, 0.5 * there, elsewhere)
    assert chatters_at(mill, 2.0 * there, elsewhere)


def test_what_is_advised_for_a_mill_is_tried_on_it(heard, monkeypatch):
    """On the same display, which is off a little; speeds are drawn the same again."""
    mill = next(mill for mill in map(draw, range(300, 320)) if mill.chatters)
    heard(event(1.0, 5.0, 900.0), event(7.0, 9.0, 1234.0))
    tried = []
    monkeypatch.setattr(milling_remedies, "passages", lambda *_: [])
    monkeypatch.setattr(milling_remedies, "simulate", lambda _: (np.zeros(1), None))
    monkeypatch.setattr(milling_remedies, "limit", lambda _: 2.0)
    monkeypatch.setattr(milling_remedies, "chatters_at", lambda *a: tried.append(a) or len(tried) == 1)
    remedy = milling_remedies.remedy_of(mill)
    assert tried[0] == (mill, 2.0 * mill.over, pytest.approx(1234.0 / 60.0 * mill.rotation_hz / mill.told_hz))
    assert remedy.advised == [False]
    assert remedy.drawn == [True] * 5
    ratios = [rotation_hz / mill.rotation_hz for *_, rotation_hz in tried[-5:]]
    assert min(ratios) > 0.5
    assert max(ratios) < 2.0
    assert "1 of 1" in printed(milling_remedies.table_of([remedy]))
    heard(event(1.0, 5.0, 900.0))
    assert milling_remedies.remedy_of(mill) is None
