"""Sidebands among lines: of a vibration with a frequency of its own, and of nothing that turns."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.tracking.comb import Lines, Spectrum, Target
from chatter_monitor.tracking.follower import CombFollower
from chatter_monitor.tracking.sidebands import Sidebands, find_sidebands, may_be_sidebands
from tests.signals import RATE_HZ

SLOWEST_HZ = 5.0
CARRIER_HZ, TEETH_HZ = 898.5, 165.6
SIDEBANDS = TEETH_HZ * np.array([-1, 1, -2, 2, 3])
FORCED = TEETH_HZ * np.array([1, 2, 3, 4, 6, 7])


def lines(*frequencies, seed=1):
    """Lines where they are, but for a part of their tolerance."""
    hertz = np.concatenate([np.atleast_1d(f) for f in frequencies]).astype(float)
    off = 0.27 + 3e-4 * hertz
    return Lines(hertz + 0.4 * off * np.random.default_rng(seed).uniform(-1.0, 1.0, len(hertz)), off)


@pytest.mark.parametrize("seed", range(3))
def test_a_vibration_with_sidebands_is_found(seed):
    """With its overtone or with forced lines beside it, among others, called by the strongest of its lines."""
    for strongest in (0.0, TEETH_HZ):
        carrier = CARRIER_HZ + strongest
        found = find_sidebands(
            lines(carrier, CARRIER_HZ + SIDEBANDS, 2 * CARRIER_HZ, FORCED, 733.1, 1505.7, seed=seed), SLOWEST_HZ
        )
        assert found.carrier_hz == pytest.approx(carrier, abs=0.3)
        assert found.spacing_hz == pytest.approx(TEETH_HZ, abs=0.1)


@pytest.mark.parametrize("told", [None, Target(26.6, 28.6, 6)])
def test_a_hum_has_no_say(told):
    """Though each of its lines is louder, and there are more of them; a vibration may be at a high multiple of it."""
    hum = 50.0 * np.array([1, 2, 3, 5, 7, 9, 4, 6, 8, 10, 11, 12])
    some = lines(hum, CARRIER_HZ, CARRIER_HZ + SIDEBANDS, FORCED, 900.0)
    found = find_sidebands(some, SLOWEST_HZ, told)
    assert (found.carrier_hz, found.spacing_hz) == (
        pytest.approx(CARRIER_HZ, abs=0.3),
        pytest.approx(TEETH_HZ, abs=0.1),
    )
    assert find_sidebands(lines(hum, FORCED, CARRIER_HZ), SLOWEST_HZ, told) is None


def beats(vibration_hz, teeth_hz):
    """Lines of a vibration beside teeth of nearly its frequency, strongest first."""
    own, teeth = (1, 0, 1, 1, 2, 0, -1, 2, 2, 3, -2, 2, 3), (0, 1, 1, 2, 0, 3, 2, -1, 1, 0, 3, 2, -1)
    return vibration_hz * np.array(own) + teeth_hz * np.array(teeth)


@pytest.mark.parametrize("stronger", [0, 1])
def test_of_two_frequencies_that_beat_the_stronger_is_the_vibration(stronger):
    """Each has the other between its lines; some low frequency nearly divides both and is no machine's for that."""
    some = beats(405.0, 340.5)
    some[[0, stronger]] = some[[stronger, 0]]
    found = find_sidebands(lines(some), SLOWEST_HZ)
    assert (found.carrier_hz, found.spacing_hz) == (pytest.approx(some[0], abs=0.3), pytest.approx(some[1], abs=0.3))
    told = find_sidebands(lines(some), SLOWEST_HZ, Target(66.0, 70.0, 5))
    assert (told.carrier_hz, told.spacing_hz) == (pytest.approx(405.0, abs=0.3), pytest.approx(340.5, abs=0.3))


def test_where_more_lines_speak_for_the_weaker_it_may_be_either():
    """Strong teeth of an unknown speed, six of their multiples, and chatter with five sidebands (a milling cut)."""
    teeth_hz, chatter_hz = 388.2, 1401.2
    vibration, teeth = (0, 0, 1, 1, 1, 0, 1, 0, 0, 0, 1), (1, 2, 0, -1, 1, 3, 3, 6, 4, 5, 2)
    some = lines(chatter_hz * np.array(vibration) + teeth_hz * np.array(teeth))
    found = find_sidebands(some, SLOWEST_HZ)
    assert (found.carrier_hz, found.spacing_hz) == pytest.approx((teeth_hz, chatter_hz), abs=0.3)
    assert found.either
    told = find_sidebands(some, SLOWEST_HZ, Target(63.0, 66.0, 6))
    assert (told.carrier_hz, told.either) == (pytest.approx(chatter_hz, abs=0.3), False)


def test_teeth_beside_two_tones_are_no_vibration():
    """One tone is by chance where a sideband of the other is; those of the teeth would be of nothing that is heard."""
    hertz = np.array([204.09, 751.11, 341.92, 408.17, 612.83, 1021.79])
    some = Lines(hertz, 0.56 + 3e-4 * hertz)
    for found in (find_sidebands(some, SLOWEST_HZ), find_sidebands(some, SLOWEST_HZ, Target(66.0, 70.0, 5))):
        assert found is None or found.order(204.2) is None


@pytest.mark.parametrize(
    "others",
    [
        FORCED,
        27.6 * np.array([6, 12, 18, 24, 30, 1, 2, 5, 7]),  # teeth that are not alike
        27.6 * np.array([33, 6, 12, 18, 24, 39, 27, 45, 21]),  # and are loud at a resonance, between the teeth
        np.append(FORCED, CARRIER_HZ),  # a tone beside
        np.append(FORCED, CARRIER_HZ * np.arange(1, 4)),  # with overtones
        np.append(FORCED, 50.0 * np.array([1, 3, 5, 7, 9])),  # hum
        np.append(5.5 * TEETH_HZ + SIDEBANDS, FORCED),  # every second tooth: half of its passing is as periodic
    ],
)
def test_what_turns_has_none(others):
    """Neither a comb, nor one with a tone or another comb beside it, whichever of the lines is the strongest."""
    for first in range(len(others)):
        some = np.roll(others, -first)
        assert find_sidebands(lines(some, seed=first), SLOWEST_HZ) is None
        assert find_sidebands(lines(some, seed=first), SLOWEST_HZ, Target(26.6, 28.6, 6)) is None


@pytest.mark.parametrize(
    ("carrier_hz", "comb_hz", "may_be"),
    [
        (165.6 * 17 / 9, 165.6 / 9, True),  # nearly a fraction of the spacing: all are multiples of a ninth of that
        (165.6 * 17 / 9, 165.6, False),  # the forced lines are a comb, and leave the vibration
        (165.6 * 5, 165.6, False),  # nothing is beside the forced lines
    ],
)
def test_a_comb_that_takes_a_vibration_along_may_be_its_sidebands(carrier_hz, comb_hz, may_be):
    """Where a vibration is on the comb, and it with sidebands explains as much."""
    sidebands = 165.6 * np.array([-1, 1, -2, 2])
    some = lines(carrier_hz, carrier_hz + sidebands, 2 * carrier_hz, 2 * carrier_hz - 165.6, 165.6 * np.array([2, 3]))
    assert may_be_sidebands(some, comb_hz, SLOWEST_HZ) is may_be


def test_where_the_speed_is_told_fewer_lines_are_enough():
    """Four sidebands alone, where the distance of the teeth is known: else another distance may be as likely."""
    some = lines(CARRIER_HZ, CARRIER_HZ + SIDEBANDS[:4])
    assert find_sidebands(some, SLOWEST_HZ) is None
    assert find_sidebands(some, SLOWEST_HZ, Target(26.6, 28.6, 6)).carrier_hz == pytest.approx(CARRIER_HZ, abs=0.3)
    assert find_sidebands(some, SLOWEST_HZ, Target(22.6, 24.6, 6)) is None


def test_a_told_spindle_has_the_teeth_that_were_told():
    """A vibration a sixth of their passing beside three teeth: a spindle of six may have such lines."""
    some = lines(1347.5, 1347.5 + 105.0 * np.array([-1, 1, 2, -2]), 105.0 * np.array([1, 3, 2, 4, 5, 6, 12]))
    found = find_sidebands(some, SLOWEST_HZ, Target(34.0, 36.0, 3))
    assert found.carrier_hz == pytest.approx(1347.5, abs=0.5)
    assert find_sidebands(some, SLOWEST_HZ, Target(17.0, 18.0, 6)) is None


def test_random_lines_have_none():
    """Of 500 sets of lines at random not one: chance is to have one in a million."""
    rng = np.random.default_rng(5)
    for _ in range(500):
        some = lines(rng.uniform(20.0, 4000.0, 24))
        assert find_sidebands(some, SLOWEST_HZ) is None
        assert find_sidebands(some, SLOWEST_HZ, Target(26.6, 28.6, 6)) is None


def test_faint_lines_beside_a_strong_one_are_heard():
    """Sidebands 36 dB below their line and 25 Hz from it are among the lines, and not what a window makes of it."""
    t = np.arange(round(2.55 * RATE_HZ)) / RATE_HZ
    around = 1.0 + 0.03 * np.cos(2.0 * np.pi * 25.0 * t)
    signal = around * np.cos(2.0 * np.pi * 611.0 * t) + 1e-3 * np.random.default_rng(2).standard_normal(len(t))
    spectrum = Spectrum(len(t), RATE_HZ, 20.0)
    spectrum.transform(signal)
    assert sorted(spectrum.faint_lines().frequency_hz) == pytest.approx([586.0, 611.0, 636.0], abs=0.1)
    assert spectrum.lines().frequency_hz == pytest.approx([611.0], abs=0.1)


def test_of_a_family_are_the_vibration_its_overtone_and_their_sidebands():
    """Not what is forced, nor what is beside."""
    found = Sidebands(CARRIER_HZ, 0.5, TEETH_HZ, 40.0)
    assert found.of(lines(CARRIER_HZ, CARRIER_HZ + SIDEBANDS, 2 * CARRIER_HZ - TEETH_HZ)).all()
    ways = [found._replace(either=either) for either in (False, True)]
    apart = [way.apart_hz(hertz, 12.0) for way in ways for hertz in (900.0, 500.0, 160.0)]
    assert apart == [TEETH_HZ, None, None, TEETH_HZ, None, CARRIER_HZ]
    assert not found.of(lines(FORCED, CARRIER_HZ + 3.0)).any()
    told = [found.order(CARRIER_HZ / order + off) for order, off in ((1, 0.0), (60, 0.0), (60, 0.007), (60, 0.01))]
    assert told == [1, 60, 60, None]


@pytest.mark.parametrize(
    ("known", "carrier", "stays"), [(False, 33, False), (False, 33.4, True), (True, 33, True), (False, None, True)]
)
def test_a_comb_of_no_told_speed_that_has_the_vibration_is_given_up(known, carrier, stays):
    """Where sidebands tell that what looks like one of its multiples turns with nothing; else it goes on."""
    frame, rotation_hz = 640, 27.6
    anything = Target(5.0, 250.0)
    target = Target(27.0, 28.0, 1) if known else anything
    follower = CombFollower(target, anything, frame, RATE_HZ, window_s=2.55, memory_s=1.0, lowest_hz=20.0, lost_s=1.5)
    angle = 2.0 * np.pi * rotation_hz * np.arange(70 * frame) / RATE_HZ
    frames = sum(np.cos(order * angle + order) for order in (1, 2, 3, 5, 8)).reshape(70, frame)
    rest = np.empty(frame)
    for samples in frames:
        follower.subtract(samples, rest)
        follower.end_frame(samples)
    assert follower.harmonics is not None
    found = None if carrier is None else Sidebands(carrier * rotation_hz, 0.5, 165.6, 40.0)
    follower.end_frame(frames[-1], sidebands=found)
    assert (follower.harmonics is not None) is stays


@pytest.mark.parametrize(("sidebands", "found"), [(None, True), (Sidebands(10 * 60.0, 0.5, 3 * 60.0, 20.0), False)])
def test_lines_of_a_vibration_whose_sidebands_are_known_make_no_comb(sidebands, found):
    """However often it is looked for; the lines of this one are multiples of a tenth of its frequency."""
    frame, anything = 640, Target(5.0, 250.0)
    follower = CombFollower(anything, anything, frame, RATE_HZ, window_s=2.55, memory_s=1.0, lowest_hz=20.0, lost_s=1.5)
    angle = 2.0 * np.pi * 60.0 * np.arange(140 * frame) / RATE_HZ
    frames = sum(np.cos(order * angle + order) for order in (4, 7, 10, 13, 16)).reshape(-1, frame)
    told = [follower.end_frame(samples, sidebands=sidebands) for samples in frames]
    assert any(told) is found
