"""Combs among lines: harmonic, supported by several lines, and no self-excited vibration with its family."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.tracking.comb import (
    ENOUGH,
    STRONGEST,
    Comb,
    Led,
    Lines,
    Spectrum,
    Target,
    find_any_comb,
    find_comb,
    find_told_comb,
    is_locked,
    speaks_against,
    speaks_for,
)
from tests.signals import RATE_HZ

ANY = Target(5.0, 250.0)
MEASURED = 91.6 * np.array([4, 8, 12, 11, 1, 7, 9, 13])


def lines(*frequencies, tolerance_hz=0.4):
    frequency = np.concatenate([np.atleast_1d(f) for f in frequencies]).astype(float)
    return Lines(frequency, np.full(len(frequency), tolerance_hz))


def test_a_comb_among_other_lines_is_found():
    """Eight harmonics of 91.6 Hz among four other lines give 91.6 Hz, not its half nor its double."""
    comb = find_comb(lines(MEASURED, [739.6, 1505.7, 1611.4, 281.1]), ANY)
    assert comb.fundamental_hz == pytest.approx(91.6, abs=0.1)
    assert comb.evidence > ENOUGH


@pytest.mark.parametrize(
    "others",
    [
        [1071.4],  # a lone tone
        [1071.4, 2142.8, 3214.2],  # with its overtones
        [1071.4, 2142.8, 3214.2, 214.28],  # and a line that divides them by chance
        1071.4 + 215.3 * np.arange(-4, 5),  # with sidebands, evenly spaced but offset
        np.concatenate([1071.4 + 215.3 * np.arange(-3, 4), 2142.8 + 215.3 * np.arange(-2, 3)]),
    ],
)
def test_a_self_excited_vibration_makes_no_comb(others):
    """Neither alone, nor with its overtones, nor with sidebands around them."""
    assert find_comb(lines(others), ANY) is None


def test_tooth_harmonics_beside_a_family_of_sidebands_are_found():
    """Where forced lines stand beside a vibration with sidebands, the comb is that of the forced lines."""
    forced, family = 215.3 * np.array([1, 2, 3, 4, 6, 7]), 1031.0 + 215.3 * np.array([-2, -1, 0, 1, 2, 3])
    assert find_comb(lines(forced, family), ANY).fundamental_hz == pytest.approx(215.3, abs=0.2)


def test_a_divisor_of_the_mains_and_of_a_vibration_is_no_comb():
    """59.9 Hz and 259.4 Hz with its overtones are near multiples of 20 Hz; a spindle's lines are found all the same."""
    hum, vibration = 59.9 * np.arange(1, 9), 259.4 * np.arange(1, 5)
    assert find_comb(lines(hum, vibration), ANY).fundamental_hz == pytest.approx(19.96, abs=0.01)
    assert find_any_comb(lines(hum, vibration), ANY).fundamental_hz == pytest.approx(59.9, abs=0.02)
    assert find_any_comb(lines(hum[:4], MEASURED), ANY).fundamental_hz == pytest.approx(91.6, abs=0.02)


def test_a_told_spindle_is_heard_beside_the_mains():
    """Two lines of its teeth among eight of the mains; one that turns as fast as these hum is all theirs."""
    hum, told = 60.0 * np.arange(1, 9), Target(0.965 * 26.95, 1.035 * 26.95, 6)
    heard = lines(hum, [163.9, 491.8, 1012.3])
    assert find_comb(heard, told) is None
    assert find_told_comb(heard, told).fundamental_hz == pytest.approx(27.32, abs=0.02)
    assert find_told_comb(lines(hum), Target(0.965 * 59.0, 1.035 * 59.0, 4)).fundamental_hz == pytest.approx(60.0)


@pytest.mark.parametrize(
    ("others", "teeth", "found"),
    [
        ([99.6, 199.2], 6, True),  # the passing of teeth and its double
        ([99.6], 6, False),  # one line may be anybody's
        ([99.6, 199.2], 5, False),  # such lines may be anybody's, too
        ([547.8, 1095.6, 1643.4], 6, False),  # a vibration near an order, with overtones
    ],
)
def test_two_lines_are_enough_at_the_teeth_of_a_told_spindle(others, teeth, found):
    """A spindle of 16.6 Hz that is told 2.7 % too slow is found by two lines of its teeth, and by no others."""
    told_hz = 16.14
    comb = find_comb(lines(others), Target(0.965 * told_hz, 1.035 * told_hz, teeth))
    assert (comb is not None) is found
    if comb is not None:
        assert comb.fundamental_hz == pytest.approx(16.6, abs=0.02)


def test_random_lines_make_no_comb():
    """Of 500 sets of lines at random, at most 3 make one: chance is to have one in a thousand."""
    rng = np.random.default_rng(5)
    sets = (lines(rng.uniform(20, 4000, STRONGEST), tolerance_hz=0.6) for _ in range(500))
    assert sum(find_comb(each, ANY) is not None for each in sets) <= 3


@pytest.mark.parametrize(
    ("orders", "teeth", "stands"),
    [
        ([1, 2, 3], None, True),
        ([1, 2], None, False),  # two lines are no comb
        ([2, 3, 4], None, True),  # any two of them still have their own fundamental in the range
        ([5, 10, 15], None, False),  # all multiples of 500 Hz
        ([5, 10, 15, 1], None, False),  # but for one
        ([5, 10, 15, 1, 2], None, True),
        ([4, 8, 12], 4, True),  # tooth passing harmonics
        ([4, 8, 12], 8, True),
        ([33, 66, 99], 4, False),  # a vibration near order 33 with overtones
        ([33, 66, 99, 4], 4, False),
        ([6, 12], 6, True),  # two lines of the teeth of a told spindle
        ([12], 6, True),  # and one
        ([12, 24], 6, False),  # a vibration at a multiple, with an overtone
        ([12, 18], 6, True),
        ([30], 6, False),  # which is anybody's at a higher multiple
        ([6, 19], 6, False),
        ([5, 7], 6, False),
        ([], 6, False),
        ([1, 2], 1, False),  # with one tooth any line of the machine is at a multiple
        ([1, 2, 3], 1, True),
    ],
)
def test_what_stands(orders, teeth, stands):
    """Orders make a comb only if, without any one of them, their common divisor is a spindle's or its teeth's."""
    assert Target(5.0, 250.0, teeth).stands(np.array(sorted(orders), np.int64), 100.0) is stands


def test_lines_are_where_they_are():
    """Tones are found to a tenth of a bin in noise, strongest first, and none below the lowest frequency."""
    rng = np.random.default_rng(3)
    t = np.arange(32_640) / RATE_HZ
    tones = {731.37: 1.0, 12.0: 5.0, 2000.11: 0.5, 150.0: 0.25}
    samples = sum(a * np.cos(2 * np.pi * f * t + f) for f, a in tones.items()) + rng.standard_normal(len(t))
    spectrum = Spectrum(len(t), RATE_HZ, 20.0)
    spectrum.transform(samples)
    found = spectrum.lines()
    np.testing.assert_allclose(found.frequency_hz, [731.37, 2000.11, 150.0], atol=0.04)
    assert np.all(found.tolerance_hz > 0.1)


def test_noise_has_no_lines():
    """White and coloured noise of 20 windows has at most one line in all."""
    rng = np.random.default_rng(4)
    spectrum, found = Spectrum(32_640, RATE_HZ, 20.0), 0
    for _ in range(20):
        spectrum.transform(np.convolve(rng.standard_normal(32_700), [1, 0.9, 0.5], "valid")[:32_640])
        found += len(spectrum.lines().frequency_hz)
    assert found <= 1


@pytest.mark.parametrize(
    ("heard", "against"),
    [
        (MEASURED, True),
        (MEASURED / 2.0, False),  # teeth of the spindle that was told: it turns as told
        ([MEASURED, 46.0 * 1.01 * np.array([1, 3, 5, 7])], False),  # another machine's, beside the spindle's
        (59.98 * np.array([1, 2, 3, 4, 5, 6]), False),  # the mains
        (59.98 * np.array([2, 4, 6, 8, 10, 12]), False),
        (29.99 * np.array([2, 3, 4, 6, 8, 10]), False),
        (59.8 * np.array([1, 2, 3, 4, 5, 6]), True),  # too far from the mains to be theirs
    ],
)
def test_what_speaks_against_a_speed_that_was_told(heard, against):
    """A comb that is not that spindle's, where that is not heard."""
    told = Target(0.965 * 45.9 / 2.0, 1.035 * 45.9 / 2.0, 2)
    if isinstance(heard, list):  # told is what is heard beside it
        told = Target(0.965 * 46.0, 1.035 * 46.0, 1)
        heard = np.concatenate(heard)
    found = lines(heard)
    rival, comb = find_comb(found, ANY), find_comb(found, told)
    assert speaks_against(rival, comb, found, told) is against


def test_what_speaks_for_a_speed_that_was_doubted():
    """Evidence that would be enough if it had not been told, and more than for another speed, or beside that."""
    told = Target(45.0, 47.0, 2)
    few, many, other = (Comb(hertz, 0.01, e) for hertz, e in ((46.0, ENOUGH - 1), (46.0, 20.0), (31.0, 25.0)))
    alone = lines(31.0 * np.arange(1, 7))
    assert not speaks_for(few, None, alone, told)
    assert speaks_for(many, None, alone, told)
    assert not speaks_for(many, other, alone, told)
    assert speaks_for(many, other, lines(31.0 * np.arange(1, 7), 46.0 * np.arange(1, 7)), told)
    assert speaks_for(many, Comb(92.0, 0.01, 25.0), alone, told)  # its teeth


@pytest.mark.parametrize(
    ("rotations", "locked"),
    [
        (1 / 2, True),  # every other rotation alike: a flip
        (4 / 3, True),  # a third of four teeth
        (1 / 8, True),
        (5 / 2 * 1.002, True),  # the speed has moved a little
        (1 / 2 * 1.006, False),
        (1.0, False),
        (4.0, False),  # teeth
        (1 / 9, False),
    ],
)
def test_what_comes_back_after_some_rotations_only_has_locked(rotations, locked):
    assert is_locked(31.7 * rotations, 31.7) is locked


def test_the_mains_lock_to_nothing():
    assert not is_locked(50.0, 100.0)
    assert is_locked(52.0, 104.0)


def test_lines_hidden_by_one_that_wanders_are_seen_in_step_with_it():
    """Other multiples of a spindle are as broad as they are high and 36 dB fainter: no comb, until in step."""
    samples = 32_640
    t = np.arange(samples) / RATE_HZ
    angle = 2 * np.pi * np.cumsum(97.4 * (1 + 0.003 * np.sin(2 * np.pi * 0.6 * t))) / RATE_HZ
    heard = np.cos(3 * angle) + 0.015 * sum(np.cos(n * angle + n) for n in (2, 10, 11, 13, 16))
    heard += 0.02 * np.random.default_rng(3).standard_normal(samples)
    spectrum = Spectrum(samples, RATE_HZ, 20.0)
    spectrum.transform(heard)
    leader_hz = spectrum.lines().frequency_hz[0]
    assert find_comb(spectrum.lines(), ANY) is None
    assert find_comb(spectrum.faint_lines(), ANY) is None
    led = spectrum.lines_in_step(leader_hz, heard[:1000], heard[1000:])
    assert led.leader_hz == pytest.approx(3 * 97.4, rel=1e-3)
    assert led.leader_hz * led.start == pytest.approx(3 * 97.4 * (1 + 0.003 * np.sin(2 * np.pi * 0.075)), rel=1e-3)
    comb = find_comb(led.evidence(), ANY)
    assert comb.fundamental_hz == pytest.approx(led.leader_hz / 3, rel=1e-4)
    assert led.admits(comb.fundamental_hz)


def test_overtones_of_the_strongest_line_are_in_step_and_no_evidence():
    led = Led(lines([211.0, 633.0, 422.0, 844.0, 53.0, 159.0]), 211.0, 1.0)
    assert led.evidence().frequency_hz.tolist() == [211.0, 53.0, 159.0]
    assert Led(lines([]), 211.0, 1.0).evidence().frequency_hz.tolist() == []


@pytest.mark.parametrize(
    ("fundamental_hz", "admitted"),
    [(91.6, True), (91.6 * 4 / 8, True), (91.6 * 4 / 9, False), (61.3, True)],
)
def test_the_leader_is_a_low_multiple_or_beside_the_comb(fundamental_hz, admitted):
    """The fourth or the eighth, but not the ninth; what is no multiple may be a vibration beside what turns."""
    assert Led(lines([366.4, 300.0, 201.0]), 366.3, 1.0).admits(fundamental_hz) is admitted
