"""A cut is the same where what forces it is the same, however loud; and what is beyond that is new."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.tracking.long_spectrum import BIN_HZ, LongSpectrum
from chatter_monitor.verdict.same_cut import BAND, BEYOND, SameCut

RATE_HZ, FRAME = 12_800.0, 640
SECONDS = 4.0
PASSING_HZ = 87.3
CHATTER_HZ = 731.0


def noise(seed, seconds=SECONDS):
    """White, of unit deviation."""
    return np.random.default_rng(seed).standard_normal(round(seconds * RATE_HZ / FRAME) * FRAME)


def tone(hertz, seconds=SECONDS):
    """One of unit amplitude."""
    return np.cos(2 * np.pi * hertz * np.arange(round(seconds * RATE_HZ / FRAME) * FRAME) / RATE_HZ)


def teeth(passing_hz=PASSING_HZ, seconds=SECONDS, amplitudes=(1.0, 0.6, 0.8, 0.4)):
    """Multiples of the passing of teeth."""
    return sum(a * tone(order * passing_hz, seconds) for order, a in enumerate(amplitudes, 1))


def spectra(signal):
    """All of a signal."""
    long = LongSpectrum(RATE_HZ, FRAME)
    heard = (long.hear(frame) for frame in signal.reshape(-1, FRAME))
    return [spectrum for spectrum in heard if spectrum is not None]


AIR = np.max(spectra(0.01 * noise(1)), axis=0)


@pytest.fixture(scope="module")
def before():
    """A cut of teeth and noise."""
    return SameCut(spectra(teeth() + 0.3 * noise(2)), AIR)


def gains(before, signal):
    """By how much each spectrum of a signal is forced more."""
    return [before.gain(spectrum) for spectrum in spectra(signal)]


@pytest.mark.parametrize("louder", [1.0, 3.0, 30.0])
def test_a_deeper_cut_is_the_same_and_nothing_in_it_is_new(before, louder):
    """All of it is louder alike."""
    signal = louder * (teeth() + 0.3 * noise(3))
    assert gains(before, signal) == pytest.approx([louder**2] * len(spectra(signal)), rel=0.2)
    assert max(before.new(spectrum, louder**2).share for spectrum in spectra(signal)) < 0.01


def test_a_lighter_cut_is_the_same_and_is_not_held_against_less(before):
    """What was as loud before is not new where the teeth are fainter now."""
    assert gains(before, 0.3 * (teeth() + 0.3 * noise(3))) == [1.0] * len(spectra(noise(3)))


@pytest.mark.parametrize(
    ("off", "same"), [(1.0, True), (1.002, True), (1.006, True), (0.98, False), (1.05, False), (1.3, False)]
)
def test_another_speed_is_another_cut(before, off, same):
    """One that wanders is not."""
    told = gains(before, teeth(off * PASSING_HZ) + 0.3 * noise(4))
    assert all((gain is not None) == same for gain in told)


@pytest.mark.parametrize("off", [0.994, 0.998, 1.003, 1.006])
def test_how_much_louder_a_cut_is_is_heard_where_its_lines_are_now(before, off):
    """A spindle that wanders takes them along; beside them there is less, however loud they are."""
    for spectrum in spectra(6.0 * (teeth(off * PASSING_HZ) + 0.3 * noise(4))):
        gain = before.gain(spectrum)
        assert gain == pytest.approx(36.0, rel=0.4)
        assert before.new(spectrum, gain).share < 0.01


@pytest.mark.parametrize(
    "signal",
    [
        0.3 * noise(5),
        teeth(amplitudes=(0.1, 2.0, 0.1, 2.0)) + 0.3 * noise(5),  # in other relations
        tone(PASSING_HZ) + 0.3 * noise(5),  # one line of the four
    ],
)
def test_what_is_not_there_or_in_other_relations_is_not_the_same(before, signal):
    """Whatever else is."""
    assert set(gains(before, signal)) == {None}


def test_what_is_loud_around_a_line_is_not_the_line():
    """Low lines of a slow spindle are near each other: the skirts of a strong one of another cut are all of them."""
    slow = sum(tone(11.3 * order) for order in (1, 2, 4, 5))
    before = SameCut(spectra(slow + 0.03 * noise(2)), AIR)
    assert None not in gains(before, 2.0 * slow + 0.06 * noise(3))
    hertz = BIN_HZ * np.arange(AIR.size)
    skirts = 1e4 * np.exp(-(((hertz - 35.0) / 20.0) ** 2)) + 1.0
    assert before.gain(skirts) is None


@pytest.mark.parametrize(
    ("signal", "gone"),
    [
        (teeth() + 0.3 * noise(21), False),
        (0.6 * teeth(1.002 * PASSING_HZ) + 0.3 * noise(21), False),
        (teeth() + 80.0 * noise(21), False),  # drowned
        (80.0 * noise(21), False),  # for all that can be told
        (teeth(1.07 * PASSING_HZ) + 0.3 * noise(21) + 4.0 * tone(CHATTER_HZ), True),
        (0.3 * noise(21), True),
    ],
)
def test_a_line_is_gone_where_there_is_less_than_there_was(before, signal, gone):
    """Under what is loud it may go on."""
    assert {before.gone(spectrum) for spectrum in spectra(signal)} == {gone}


def test_of_what_has_no_lines_all_are_gone():
    """Nothing is known to force it."""
    assert SameCut(spectra(noise(2)), AIR).gone(AIR)


@pytest.mark.parametrize("hertz", [CHATTER_HZ, 2 * PASSING_HZ + 20.0, 2001.0])
@pytest.mark.parametrize("amplitude", [3.0, 20.0])
def test_a_line_that_was_not_there_is_new(before, hertz, amplitude):
    """Also beside a line of the teeth."""
    signal = teeth() + 0.3 * noise(6) + amplitude * tone(hertz)
    for spectrum in spectra(signal):
        gain = before.gain(spectrum)
        assert gain == pytest.approx(1.0, abs=0.3)
        new = before.new(spectrum, gain)
        power = (amplitude**2 / 2) / (amplitude**2 / 2 + np.var(teeth()) + 0.3**2 * 0.8)
        assert new.share == pytest.approx(power, abs=0.15)
        assert abs(new.hertz - hertz) <= 0.5 * BAND * BIN_HZ + BIN_HZ


def test_a_slower_tracker_has_fewer_bins(before):
    """Of a rate of 6 kHz there are less than half; what is told of them is the same."""
    few = 1177
    air, cut = AIR[:few], [spectrum[:few] for spectrum in spectra(teeth() + 0.3 * noise(2))]
    for spectrum in spectra(2.0 * (teeth() + 0.3 * noise(17)) + 10.0 * tone(CHATTER_HZ)):
        gain = SameCut(cut, air).gain(spectrum[:few])
        assert gain == pytest.approx(4.0, rel=0.3)
        of_few, of_all = SameCut(cut, air).new(spectrum[:few], gain), before.new(spectrum, gain)
        assert (of_few.share, of_few.hertz) == pytest.approx((of_all.share, of_all.hertz), abs=0.05)


@pytest.mark.parametrize("few", [1, 2, 3, 9, 63])
def test_hardly_any_bins_are_no_error(few):
    """Nobody hears chatter at such a rate, but the monitor runs."""
    cut = [spectrum[:few] for spectrum in spectra(teeth() + 0.3 * noise(2))]
    assert SameCut(cut, AIR[:few]).gain(cut[0]) is None
    assert SameCut(cut, AIR[:few]).new(cut[0], 1.0).share == 0.0


def test_offset_and_drift_are_not_new(before):
    """They are no vibration."""
    for spectrum in spectra(teeth() + 0.3 * noise(15) + 1000.0 + 20.0 * tone(3.0)):
        assert before.new(spectrum, 1.0).share < 0.01


def test_what_is_louder_than_it_was_counts_beyond_its_surroundings(before):
    """A mode that noise drives in a deeper cut is no more than the cut is deeper."""
    signal = 5.0 * (teeth() + 0.3 * noise(7)) + 0.9 * BEYOND * tone(CHATTER_HZ)
    shallow = SameCut(spectra(teeth() + 0.3 * noise(2) + 0.4 * tone(CHATTER_HZ)), AIR)
    for spectrum in spectra(signal):
        assert before.new(spectrum, 25.0).share > 0.1
        assert shallow.new(spectrum, 25.0).share < 0.01


def test_what_is_in_the_air_tells_nothing_and_is_not_new():
    """A pump beside each cut is none of the cut, and one that is switched on in the air has not come with the tool."""
    pump = teeth(61.0)
    cut, air = spectra(pump + 0.3 * noise(8)), spectra(pump + 0.01 * noise(9))
    assert set(gains(SameCut(cut, np.max(air, axis=0)), pump + 0.3 * noise(10))) == {None}
    humming = np.max(spectra(5.0 * tone(CHATTER_HZ) + 0.01 * noise(11)), axis=0)
    before = SameCut(spectra(teeth() + 0.3 * noise(2)), humming)
    for spectrum in spectra(teeth() + 0.3 * noise(12) + 5.0 * tone(CHATTER_HZ)):
        assert before.gain(spectrum) == pytest.approx(1.0, abs=0.3)
        assert before.new(spectrum, 1.0).share < 0.01


@pytest.mark.parametrize(
    ("of_passing", "same"),
    [(1, True), (1 / 2, True), (1.003, True), (None, False), (1.3, False), (1 / 9, False)],
)
def test_where_no_air_was_heard_what_is_on_orders_is_of_the_cut(of_passing, same):
    """If that is not as likely by chance, as on the many orders of a slow spindle."""
    cut, now = (spectra(teeth() + 2.0 * teeth(61.3) + 0.3 * noise(seed)) for seed in (18, 19))
    before = SameCut(cut, None, of_passing and of_passing * PASSING_HZ)
    louder = spectra(3.0 * teeth() + 2.0 * teeth(61.3) + 0.9 * noise(20))
    for spectrum, then, of_both in zip(now, louder, cut, strict=True):
        assert (before.gain(spectrum) is not None) is same
        assert before.gain(then) == (pytest.approx(9.0, rel=0.3) if same else None)
        assert SameCut([of_both] * 3, None, 4 * PASSING_HZ).gain(spectrum) is None  # one line of them


def test_what_comes_and_goes_is_no_line_of_a_cut():
    """A mode of 0.4 % damping that noise drives is as narrow as one, and the same in another cut."""
    pole = np.exp(2 * np.pi * 500.0 / RATE_HZ * (-0.004 + 1j))
    ring = np.zeros(round(8.0 * RATE_HZ))
    for t, force in enumerate(np.random.default_rng(13).standard_normal(ring.size)):
        ring[t] = 2 * pole.real * ring[t - 1] - abs(pole) ** 2 * ring[t - 2] + force
    ring = ring[: ring.size // FRAME * FRAME] / np.std(ring)
    two = ring + np.roll(ring, 5000) * tone(200.0, ring.size / RATE_HZ)[: ring.size]
    heard = spectra(two)
    half = len(heard) // 2
    assert {SameCut(heard[:half], AIR).gain(spectrum) for spectrum in heard[half:]} == {None}


def test_when_the_tool_leaves_what_is_left_is_not_new(before):
    """It is little beside what there was."""
    for spectrum in spectra(0.2 * tone(CHATTER_HZ) + 0.001 * noise(14)):
        assert before.new(spectrum, 1.0).share < 0.05
