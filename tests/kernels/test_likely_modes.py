"""Modes that may be what chatters, against the roots and the chart of physics."""

import math

import numpy as np
import pytest

from chatter_monitor.kernels.likely_modes import (
    COUPLED_HOLDS,
    FARTHEST,
    KAPPA,
    OMEGA,
    SINGLE,
    SINGLE_HOLDS,
    TOLERANCE,
    TWO_DIRECTIONS,
    WEIGHT,
    ZETA,
    chances,
    room,
    weigh_modes,
)
from chatter_monitor.physics.lobes import stability_limit
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Mode, Spindle
from chatter_monitor.physics.stability import rightmost_root
from chatter_monitor.physics.terms import CATALOGUE

CHATTER_HZ, RPM, TEETH = 640.0, 4800.0, 3  # 2.67 waves between two teeth
TAU_S = 60.0 / (RPM * TEETH)


def cut(mode):
    term = AppliedTerm(CATALOGUE["regenerative_delay"], {"coefficient": mode[KAPPA]})
    structure = Mode(mode[OMEGA] / (2.0 * math.pi), mode[ZETA])
    return MachiningSystem((structure,), (term,), spindle=Spindle(RPM, TEETH))


@pytest.fixture
def modes():
    found = room(1)
    weigh_modes(CHATTER_HZ, np.array([TAU_S]), found)
    return found


def test_a_single_mode_is_as_likely_as_its_chatter_is_near(modes):
    """By the roots of another solver; none is stable, and those far off have no weight at all."""
    single = modes[:SINGLE]
    likely = single[single[:, WEIGHT] > 0.0]
    assert len(likely) > 20
    heaviest = likely[np.argmax(likely[:, WEIGHT])]
    for mode in likely[::7]:
        ratio = math.exp(-0.5 * (off(mode) ** 2 - off(heaviest) ** 2))
        assert mode[WEIGHT] / heaviest[WEIGHT] == pytest.approx(ratio, rel=0.05)
    assert min(off(mode) for mode in single[single[:, WEIGHT] == 0.0][::301]) >= 0.9 * FARTHEST


def off(mode):
    """How far the chatter of a mode is from what is heard, in tolerances."""
    root = rightmost_root(cut(mode))
    assert not root.stable
    return abs(math.log(root.frequency_hz * math.sqrt(1.0 - root.damping_ratio**2) / CHATTER_HZ)) / TOLERANCE


def test_the_weights_are_of_one_kind_or_the_other(modes):
    """Where a single mode explains the chatter it most likely is one; with a little of a wave left over it is none."""
    single = 2.0 * (1.0 - TWO_DIRECTIONS)
    assert modes[:SINGLE, WEIGHT].sum() == pytest.approx(SINGLE_HOLDS * single / (single + TWO_DIRECTIONS))
    assert modes[SINGLE:, WEIGHT].sum() == pytest.approx(COUPLED_HOLDS * TWO_DIRECTIONS / (single + TWO_DIRECTIONS))
    assert (modes[SINGLE:, KAPPA] < 0.0).mean() == 0.5
    assert 0.2 < (modes[SINGLE:, WEIGHT] > 0.0).mean() < 0.9
    for waves in (1.2, 2.2, 5.3):
        weigh_modes(CHATTER_HZ, np.array([waves / CHATTER_HZ]), modes)
        assert modes[:SINGLE, WEIGHT].sum() == 0.0
        assert modes[SINGLE:, WEIGHT].sum() == pytest.approx(COUPLED_HOLDS)


def test_chances_are_the_weight_of_the_modes_that_are_stable(modes):
    """By the chart; where the delay is what it is none is."""
    stable, deeper = np.empty((2, 1))
    chances(modes, np.array([TAU_S]), stable, deeper)
    assert stable[0] == 0.0
    modes[SINGLE:, WEIGHT] = 0.0
    rpm = np.array([RPM, 5300.0, 6100.0, 7400.0])
    stable, deeper = np.empty((2, len(rpm)))
    chances(modes, 60.0 / (rpm * TEETH), stable, deeper)
    likely = modes[modes[:, WEIGHT] > 0.0]
    over = np.array([stability_limit(cut(mode), rpm) / mode[KAPPA] for mode in likely])
    assert stable == pytest.approx(likely[:, WEIGHT] @ (over > 1.0), abs=0.02)
    assert deeper == pytest.approx(likely[:, WEIGHT] @ np.log(np.minimum(over, 5.0)), abs=0.02)
    assert stable[0] == 0.0
    assert stable.max() > 0.2


def test_modes_that_are_deflected_into_the_chip_have_the_lobes_the_other_way_round():
    """A little slower than in step is stable for one kind, a little faster for the other."""
    modes, (stable, deeper) = room(1), np.empty((2, 2))
    weigh_modes(CHATTER_HZ, np.array([2.2 / CHATTER_HZ]), modes)
    tau_s = np.array([1.75, 2.25]) / CHATTER_HZ
    for sign, best in ((1.0, 1), (-1.0, 0)):
        kept = modes[SINGLE:][modes[SINGLE:, KAPPA] * sign > 0.0]
        chances(np.ascontiguousarray(kept), tau_s, stable, deeper)
        assert np.argmax(deeper) == best


def test_several_delays_are_as_many_times_the_single_modes():
    """Those of each are what they are alone, with its part of the weight."""
    delays = TAU_S * np.array([0.97, 1.0])
    both, alone = room(2), room(1)
    weigh_modes(CHATTER_HZ, delays, both)
    weigh_modes(CHATTER_HZ, delays[1:], alone)
    assert both[SINGLE : 2 * SINGLE, :WEIGHT] == pytest.approx(alone[:SINGLE, :WEIGHT])
    assert both[SINGLE : 2 * SINGLE, WEIGHT] == pytest.approx(0.5 * alone[:SINGLE, WEIGHT])
    assert not np.array_equal(both[:SINGLE, WEIGHT], both[SINGLE : 2 * SINGLE, WEIGHT])
