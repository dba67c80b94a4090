"""Advice on spindle speeds against the stability chart of physics.lobes and the roots of physics.stability."""

import math

import numpy as np
import pytest

from chatter_monitor.errors import InputError
from chatter_monitor.kernels.likely_modes import SINGLE_HOLDS, chances, room, weigh_modes
from chatter_monitor.physics.lobes import recommended_speeds, stability_limit
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Mode, Spindle
from chatter_monitor.physics.stability import rightmost_root
from chatter_monitor.physics.terms import CATALOGUE
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.verdict import advice
from chatter_monitor.verdict.advice import APART, MOST_SPEEDS, WORTH_IT, advise, likely_speeds

TEETH, MODE_HZ = 3, 890.0


def cut(damping_ratio, coefficient, speed_rpm):
    term = AppliedTerm(CATALOGUE["regenerative_delay"], {"coefficient": coefficient})
    return MachiningSystem((Mode(MODE_HZ, damping_ratio),), (term,), spindle=Spindle(speed_rpm, TEETH))


def limit(damping_ratio, speed_rpm):
    """Largest stable coefficient at a speed, from the chart."""
    return float(stability_limit(cut(damping_ratio, 0.01, 5000.0), np.array([speed_rpm]))[0])


def chattering(damping_ratio, waves, over):
    """Speed, depth and frequency of a cut so far beyond its limit, with so many waves of the mode between two teeth."""
    here = 60.0 * MODE_HZ / (TEETH * waves)
    depth = over * limit(damping_ratio, here)
    root = rightmost_root(cut(damping_ratio, depth, here))
    assert not root.stable
    return here, depth, root.frequency_hz


CUTS = [
    (damping_ratio, waves, over)
    for damping_ratio in (0.012, 0.02, 0.035)
    for waves in (1.6, 1.8, 2.4, 2.7, 3.5, 3.8)
    for over in (1.2, 1.6, 2.2)
]


@pytest.mark.parametrize("heard", [True, False])
def test_a_cut_of_one_mode_is_stable_where_it_is_sent(heard):
    """At nine tenths of the first speeds that are advised, by the chart; in step with the chatter at less."""
    stable, in_step, given = 0, 0, 0
    for damping_ratio, waves, over in CUTS:
        here, depth, chatter_hz = chattering(damping_ratio, waves, over)
        rotation_hz = here / 60.0 if heard else None
        speeds = advise(chatter_hz, SpindleSettings(here, TEETH), rotation_hz).speeds
        nearest = min(
            recommended_speeds(chatter_hz, TEETH, 0.5 * here, 2.0 * here).speeds,
            key=lambda speed: abs(math.log(speed.spindle_rpm / here)),
        )
        in_step += limit(damping_ratio, nearest.spindle_rpm) > depth
        if speeds:
            given += 1
            stable += limit(damping_ratio, speeds[0].spindle_rpm) > depth
    assert given >= 0.9 * len(CUTS)
    assert stable >= 0.9 * given
    assert in_step < 0.7 * len(CUTS)


def test_speeds_are_advised_as_they_have_to_be_told():
    """Where a display shows 2 % more than the spindle turns, so do the speeds that are advised."""
    here, _, chatter_hz = chattering(0.02, 2.7, 1.6)
    true = likely_speeds(chatter_hz, SpindleSettings(here, TEETH), here / 60.0)
    shown = likely_speeds(chatter_hz, SpindleSettings(1.02 * here, TEETH), here / 60.0)
    assert [speed.rpm for speed in shown] == pytest.approx([1.02 * speed.rpm for speed in true], rel=0.01)
    assert true[0].rpm != pytest.approx(here, rel=0.05)


def test_the_likeliest_speeds_come_first():
    """At most three within the range, apart from each other; what is said of them is in the text."""
    here, _, chatter_hz = chattering(0.02, 3.5, 1.6)
    spindle = SpindleSettings(here, TEETH, 0.3 * here, 4.0 * here)
    speeds = likely_speeds(chatter_hz, spindle, here / 60.0)
    assert len(speeds) == MOST_SPEEDS
    assert [speed.stable for speed in speeds] == sorted((speed.stable for speed in speeds), reverse=True)
    assert all(0.3 * here <= speed.rpm <= 4.0 * here for speed in speeds)
    rpm = np.sort([speed.rpm for speed in speeds])
    assert np.diff(np.log(rpm)).min() >= APART
    assert 0.5 < speeds[0].stable <= SINGLE_HOLDS
    told = advise(chatter_hz, spindle, here / 60.0)
    assert [speed.spindle_rpm for speed in told.speeds] == [s.rpm for s in speeds if s.stable > WORTH_IT]
    for given, speed in zip(told.speeds, speeds, strict=False):
        assert f"{speed.rpm:.0f} rpm (stable in {speed.in_ten} of 10 such cuts)" in told.text
        assert given.lobe == round(60.0 * chatter_hz / (TEETH * speed.rpm))


def test_only_speeds_within_the_machines_range_are_given():
    """A narrow one leaves those in it."""
    here, _, chatter_hz = chattering(0.02, 2.7, 1.6)
    for speed in advise(chatter_hz, SpindleSettings(here, TEETH, 0.8 * here, 1.2 * here), here / 60.0).speeds:
        assert 0.8 * here <= speed.spindle_rpm <= 1.2 * here
    only = SpindleSettings(here, TEETH, 0.99 * here, 1.01 * here)
    assert likely_speeds(chatter_hz, only, here / 60.0) == []
    assert "there is no other speed" in advise(chatter_hz, only, here / 60.0).text


def test_at_low_speed_less_depth_is_advised():
    """Where dozens of waves fit between two teeth the lobes overlap; the text says how unlikely the best speed is."""
    here, _, chatter_hz = chattering(0.03, 25.7, 1.6)
    told = advise(chatter_hz, SpindleSettings(here, TEETH), here / 60.0)
    assert told.speeds == ()
    assert told.text.startswith("reduce the depth of cut: between ")
    assert "of 10 such cuts" in told.text


def test_what_no_single_mode_explains_is_sent_into_step():
    """With a fifth of a wave left over two directions sway: their modes are near the chatter, either way round."""
    here = 60.0 * MODE_HZ / (TEETH * 2.2)
    for speed in likely_speeds(MODE_HZ, SpindleSettings(here, TEETH), here / 60.0)[:2]:
        waves = 60.0 * MODE_HZ / (TEETH * speed.rpm)
        assert waves == pytest.approx(round(waves), abs=0.1)


def test_of_hundreds_of_waves_the_last_one_tells():
    """A slow spindle that may be made much faster: what it is sent to does not depend on how many waves there were."""
    spindle = SpindleSettings(100.0, 1, 100.0, 60.0 * MODE_HZ)
    slow = likely_speeds(MODE_HZ, spindle, MODE_HZ / 500.7)
    faster = likely_speeds(MODE_HZ, SpindleSettings(60.0 * MODE_HZ / 20.7, 1, 100.0, 60.0 * MODE_HZ), MODE_HZ / 20.7)
    turns = 60.0 * MODE_HZ / 500.7 / 100.0
    assert [speed.stable for speed in slow] == pytest.approx([speed.stable for speed in faster], abs=0.1)
    assert turns * slow[0].rpm == pytest.approx(faster[0].rpm, rel=0.1)


def test_where_no_speed_is_heard_those_around_it_are_looked_at(monkeypatch):
    """Five within 3 % of the one that is told, many in the range where none is; never more than some twenty waves."""
    looked_at = []

    def record(chatter_hz, tau_s, modes):
        looked_at.append(chatter_hz * tau_s)
        weigh_modes(chatter_hz, tau_s, modes)

    monkeypatch.setattr(advice, "weigh_modes", record)
    here = 60.0 * MODE_HZ / (TEETH * 2.7)
    likely_speeds(MODE_HZ, SpindleSettings(here, TEETH), here / 60.0)
    likely_speeds(MODE_HZ, SpindleSettings(here, TEETH))
    likely_speeds(MODE_HZ, SpindleSettings(None, TEETH, 0.5 * here, 2.0 * here))
    likely_speeds(MODE_HZ, SpindleSettings(here, TEETH), MODE_HZ / (TEETH * 312.7))
    heard, told, untold, slow = looked_at
    assert heard == pytest.approx([2.7])
    assert np.sort(told) == pytest.approx(2.7 / np.array([1.03, 1.015, 1.0, 0.985, 0.97]))
    assert len(untold) > 10
    assert (untold.min(), untold.max()) == pytest.approx((1.35, 5.4))
    assert slow == pytest.approx([20.7])


def test_of_speeds_as_likely_the_deepest_is_given():
    """Alone, a peak beside a higher one is none; on a plateau it is the place where the cut may be deepest."""
    speeds = 5000.0 * np.exp(0.01 * np.arange(9))
    score = np.array([0.1, 0.5, 0.4, 0.6, 0.1, 0.1, 0.1, 0.1, 0.3])
    assert advice._tops(speeds, score, []) == [3, 8]
    assert advice._tops(speeds, score, [speeds[3]]) == [8]
    here, _, chatter_hz = chattering(0.02, 1.8, 1.2)
    spindle = SpindleSettings(here, TEETH)
    best = likely_speeds(chatter_hz, spindle, here / 60.0)[0]
    modes, speeds = room(1), best.rpm * np.exp(0.01 * np.arange(-4, 5))
    weigh_modes(chatter_hz, np.array([60.0 / (TEETH * here)]), modes)
    stable, deeper = np.empty((2, len(speeds)))
    chances(modes, 60.0 / (TEETH * speeds), stable, deeper)
    as_likely = np.isclose(stable, best.stable, rtol=1e-9)
    assert as_likely.sum() > 1
    assert deeper[4] == deeper[as_likely].max()


def test_without_any_speed_nothing_is_advised():
    """With neither speed nor range known there is no advice, but a reason; a range alone is enough."""
    assert "neither" in advise(900.0, SpindleSettings()).text
    assert likely_speeds(900.0, SpindleSettings()) == []
    assert advise(900.0, SpindleSettings(None, 3, 3000.0, 12000.0)).speeds


@pytest.mark.parametrize("chatter_hz", [-1.0, 0.0, math.nan, math.inf])
def test_a_frequency_that_is_none_is_refused(chatter_hz):
    """The error says what is allowed."""
    with pytest.raises(InputError, match="no spindle speed can be advised"):
        advise(chatter_hz, SpindleSettings(5000.0, 3))


def test_a_range_upside_down_is_refused():
    """The least speed of the machine is not above its largest."""
    with pytest.raises(ValueError, match="min_rpm must not be above max_rpm"):
        SpindleSettings(min_rpm=5000.0, max_rpm=4000.0)
