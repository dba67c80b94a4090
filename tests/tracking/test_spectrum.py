"""Lines of signals whose behaviour is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chatter_monitor.tracking.spectrum import WINDOW_S, Line, Spectrum
from tests.signals import RATE_HZ, vibration

INTERVAL = 640


def frames(signal, rate_hz=RATE_HZ, interval=INTERVAL):
    """Lines of each frame of a signal."""
    spectrum = Spectrum(rate_hz, interval)
    return [named(spectrum, signal[first : first + interval]) for first in range(0, len(signal), interval)]


def named(spectrum, signal, **about):
    """Lines of a frame, by name."""
    return [Line._make(row) for row in spectrum.take(signal, **about).tolist()]


def times(seconds, rate_hz=RATE_HZ):
    return np.arange(round(seconds * rate_hz)) / rate_hz


def noise(samples, rms, seed=1):
    return rms * np.random.default_rng(seed).standard_normal(samples)


@pytest.mark.parametrize(("rate_hz", "interval"), [(12_800.0, 640), (11_025.0, 551)])
def test_a_tone_is_one_steady_line(rate_hz, interval):
    """A tone in little noise is found within 2 Hz, carries the power, does not vary, grow or lose coherence."""
    t = times(2.0, rate_hz)
    line = frames(np.sin(2 * np.pi * 1234.5 * t) + noise(len(t), 0.01), rate_hz, interval)[-1][0]
    assert line.frequency_hz == pytest.approx(1234.5, abs=2.0)
    assert line.share > 0.98
    assert line.prominence_db > 30.0
    assert line.variation < 0.01
    assert abs(line.growth_per_s) < 0.1
    assert abs(line.rise) < 0.5
    assert line.coherence > 0.999
    assert line.damping_ratio < 1e-5


@pytest.mark.parametrize(("noise_too", "tone", "least", "most"), [(True, 3.0, 0.0, 0.15), (False, 1.8, 0.2, 0.4)])
def test_a_tone_that_gets_louder_with_the_rest_is_steady(noise_too, tone, least, most):
    """A feed jumps: all is three times as loud at once, and the tone as steady as before; alone it varies."""
    t = times(4.0)
    louder = np.where(t < 3.0, 1.0, tone)
    signal = louder * np.sin(2 * np.pi * 1234.5 * t) + (louder if noise_too else 1.0) * noise(len(t), 0.1)
    variations = [found[0].variation for found in frames(signal)[61:68]]  # from a frame after the jump on
    assert least < max(variations) < most


def test_a_mode_that_noise_drives_loses_coherence_as_its_damping_says():
    """Within 25 ms the coherence falls by exp(-zeta omega t), and the modulus varies as a Rayleigh one does."""
    frequency_hz, damping = 1500.0, 0.0015
    decay = damping * 2 * np.pi * frequency_hz
    seen = [found[0] for found in frames(vibration(round(60 * RATE_HZ), [(frequency_hz, damping)]))[40:]]
    assert np.mean([line.coherence for line in seen]) == pytest.approx(math.exp(-decay * WINDOW_S), abs=0.08)
    assert np.mean([line.variation for line in seen]) == pytest.approx(0.5, abs=0.15)
    assert np.median([line.damping_ratio for line in seen]) == pytest.approx(damping, rel=0.35)
    assert np.median([line.frequency_hz for line in seen]) == pytest.approx(frequency_hz, abs=5.0)


@pytest.mark.parametrize("beat_hz", [13.5, 19.0, 24.0, 38.0])
def test_two_tones_within_a_lobe_are_coherent(beat_hz):
    """What two tones lose of the coherence they have again after a beat; two modes that noise drives have not."""

    def coherences(signal):
        return [max(found, key=lambda line: line.share).coherence for found in frames(signal)[40:]]

    t = times(4.0)
    tones = np.sin(2 * np.pi * 500.0 * t) + np.sin(2 * np.pi * (500.0 + beat_hz) * t)
    assert min(coherences(tones + noise(len(t), 0.05))) > 0.9
    modes = vibration(len(t), [(500.0, 0.01), (500.0 + beat_hz, 0.01)])
    assert np.median(coherences(modes)) < 0.7


@pytest.mark.parametrize("frequency_hz", [62.0, 80.0, 104.4, 112.5, 137.5, 990.3, 4003.1])
def test_the_frequency_of_a_tone_comes_from_its_phase(frequency_hz):
    """At any frequency, low ones too, which lie in their own mirror image, a tone at 20 dB is found within 0.1 Hz."""
    t = times(2.0)
    found = frames(np.sin(2 * np.pi * frequency_hz * t) + noise(len(t), 0.07))[20:]
    assert max(abs(lines[0].frequency_hz - frequency_hz) for lines in found) < 0.1


def test_a_tone_that_comes_with_the_tool_has_not_risen():
    """After a cut, what is there as soon as the tool enters the next one has not risen; what grows then has."""
    t = times(8.0)
    cut = ((t < 2.0) | (t > 4.0)) * 1.0
    tone = np.where(t > 4.0, np.exp(4.0 * np.clip(t - 6.0, 0.0, 0.5)), 0.0) * np.sin(2 * np.pi * 700.0 * t)
    signal = noise(len(t), 1e-3) + cut * noise(len(t), 0.1, seed=2) + tone
    rises = [
        max(line.absolute_rise for line in lines if abs(line.frequency_hz - 700.0) < 5.0)
        for lines in frames(signal)[84:]
    ]
    assert max(rises[: round(1.9 * 20)]) < 0.3
    assert max(rises) > 1.5


@pytest.mark.parametrize(
    ("tone", "least", "most"), [(0.0, 0.0, 0.2), (1.0, 0.2, 0.4), (3.0, 0.7, 0.9), (8.0, 0.95, 1.0)]
)
def test_the_steady_share_of_a_line_tells_a_tone_from_noise(tone, least, most):
    """Of a tone among noise as narrow, about the square of the tone's share of the power is heard as steady."""
    t = times(20.0)
    signal = tone * math.sqrt(2.0) * np.sin(2.0 * np.pi * 505.0 * t) + vibration(len(t), [(500.0, 0.02)])
    seen = [lines[0] for lines in frames(signal)[20:]]
    assert least <= np.mean([line.steady_share / line.share for line in seen]) <= most


@pytest.mark.parametrize("rate_per_s", [20.0, -10.0])
def test_exponential_growth_is_found(rate_per_s):
    """An amplitude exp(g t) reads g within 3 %."""
    t = times(1.0)
    line = frames(np.exp(rate_per_s * t) * np.sin(2 * np.pi * 900 * t))[-1][0]
    assert line.growth_per_s == pytest.approx(rate_per_s, rel=0.03)


def test_a_line_that_appears_rises_and_a_louder_cut_does_not():
    """What grows tenfold out of the noise has risen; when everything grows tenfold, nothing has."""
    t = times(4.0)
    tone, floor = np.sin(2 * np.pi * 900 * t), noise(len(t), 0.3)
    later = t >= 3.5
    alone = frames(np.where(later, 10.0, 1.0) * tone + floor)[-1][0]
    together = frames(np.where(later, 10.0, 1.0) * (tone + floor))[-1][0]
    for rise in (alone.long_rise, alone.rise):
        assert rise == pytest.approx(math.log(10.0), abs=0.7)
    assert abs(together.long_rise) < 0.7


@pytest.mark.parametrize("alike", [True, False])
def test_what_comes_back_into_the_signal_has_not_risen(alike):
    """A tone that had been taken out rises when it is not any more, unless that is told; what grows then has risen."""
    t = times(4.0)
    amplitude = np.where(t < 2.0, 0.0, np.where(t < 3.0, 1.0, 10.0))
    signal = amplitude * np.sin(2 * np.pi * 900 * t) + noise(len(t), 0.03)
    spectrum, seen = Spectrum(RATE_HZ, INTERVAL), []
    for first in range(0, len(t), INTERVAL):
        about = {"alike": alike or first != 40 * INTERVAL, "turns": first < 40 * INTERVAL}
        seen += named(spectrum, signal[first : first + INTERVAL], **about)[:1]
    if alike:
        assert min(min(line.long_rise, line.absolute_rise) for line in seen[44:60]) > 2.0
    else:
        assert max(max(line.rise, line.long_rise, line.absolute_rise) for line in seen[40:60]) < 0.5
        assert seen[70].absolute_rise == pytest.approx(math.log(10.0), abs=0.2)


@pytest.mark.parametrize("turns", [False, True])
def test_the_first_entry_out_of_noise_is_heard_unless_something_turned(turns):
    """A cut begins after a second of white noise: the tool enters, unless a cut was on whose orders are taken out.

    The frame that tells is part of the entry, not of the air before it: it is louder than that.
    """
    t = times(3.0)
    cut = (t > 1.5) * (vibration(len(t), [(900.0, 0.02)]) + noise(len(t), 0.3, seed=2))
    signal = noise(len(t), 0.03) + cut
    spectrum, cutting, entering = Spectrum(RATE_HZ, INTERVAL), [], []
    for first in range(0, len(t), INTERVAL):
        spectrum.take(signal[first : first + INTERVAL], turns=turns)
        cutting.append(spectrum.cutting)
        entering.append(spectrum.entering)
    assert all(cutting[:30])
    assert all(cutting[30:34]) == turns
    assert all(cutting[40:])
    assert [not c for c in cutting] == entering


@pytest.mark.parametrize("hum", [0.3, 3.0])
@pytest.mark.parametrize("enters", [True, False])
def test_a_tool_enters_a_room_in_which_a_pump_hums(enters, hum):
    """The pump goes on as it was, the noise rises: a cut begins. A mode that grows beside it lifts no noise so much."""
    t = times(3.0)
    grown = 3.0 * np.exp(np.minimum(t - 1.7, 0.0) * 60.0) * np.sin(2 * np.pi * 700.0 * t)
    ramp = np.clip((t - 1.5) / 0.1, 0.0, 1.0)
    cut = ramp * (vibration(len(t), [(900.0, 0.02)]) + noise(len(t), 0.3, seed=2)) if enters else grown
    pump = hum * np.sin(2 * np.pi * 2485.0 * t) + noise(len(t), 0.03)
    spectrum, entering = Spectrum(RATE_HZ, INTERVAL), []
    for first in range(0, len(t), INTERVAL):
        spectrum.take((pump + cut)[first : first + INTERVAL])
        entering.append(spectrum.entering)
    assert any(entering[30:34]) == enters
    assert not any(entering[:30] + entering[40:])


@pytest.mark.parametrize(("driven", "enters"), [(0.0, True), (0.05, False)])
def test_a_tool_drowns_a_pump(driven, enters):
    """A tone in noise is a room's; where a mode was driven beside it something was cut, and what leaps is no tool."""
    t = times(3.0)
    before = 0.1 * np.sin(2 * np.pi * 2485.0 * t) + noise(len(t), 0.03) + driven * vibration(len(t), [(900.0, 0.01)])
    loud = vibration(len(t), [(900.0, 0.02)], seed=4) + noise(len(t), 0.3, seed=2)
    spectrum, entering = Spectrum(RATE_HZ, INTERVAL), []
    for first in range(0, len(t), INTERVAL):
        spectrum.take((before + np.where(t > 1.5, 3.0 * loud, 0.0))[first : first + INTERVAL])
        entering.append(spectrum.entering)
    assert any(entering[30:34]) is enters
    assert not any(entering[:30] + entering[40:])


@pytest.mark.parametrize(
    ("hum", "tones", "leaves"), [(0.2, (), True), (0.2, (1640.0,), False), (0.0, (1640.0,), False)]
)
def test_a_tool_leaves_a_room_in_which_a_pump_hums(hum, tones, leaves):
    """The noise of the room is as loud as that of the cut, but what the cut drove is gone; or something new sounds."""
    t = times(4.0)
    cut = np.where(t < 2.0, vibration(len(t), [(900.0, 0.02)]), 0.0)
    left = sum((np.where(t < 2.0, 0.0, 0.2 * np.sin(2 * np.pi * hertz * t)) for hertz in tones), np.zeros(len(t)))
    heard = cut + left + hum * np.sin(2 * np.pi * 2485.0 * t) + noise(len(t), 0.2)
    spectrum, cutting = Spectrum(RATE_HZ, INTERVAL), []
    for first in range(0, len(t), INTERVAL):
        spectrum.take(heard[first : first + INTERVAL], whole=float(np.var(heard[first : first + INTERVAL])))
        cutting.append(spectrum.cutting)
    assert all(cutting[:40])
    assert any(cutting[46:]) is not leaves


@pytest.mark.parametrize(("grown_s", "growing_s", "risen"), [(1.7, 0.04, True), (1.5, 0.0001, False)])
def test_what_grows_after_the_noise_has_come_has_risen(grown_s, growing_s, risen):
    """The noise of a cut comes at once, then a line grows e-fold in 40 ms; what comes with the noise is the tool's."""
    t = times(3.0)
    line = np.exp(np.minimum(t - grown_s, 0.0) / growing_s)
    cut = np.clip((t - 1.5) / 0.01, 0.0, 1.0) * noise(len(t), 3.0, seed=6) + 40.0 * line * np.sin(2 * np.pi * 700.0 * t)
    spectrum = Spectrum(RATE_HZ, INTERVAL)
    for first in range(0, 36 * INTERVAL, INTERVAL):
        lines = named(spectrum, (noise(len(t), 1.0) + cut)[first : first + INTERVAL])
    (found,) = [line for line in lines if line.share > 0.5]
    assert (min(found.long_rise, found.absolute_rise) > 0.8) is risen


@pytest.mark.parametrize("sounded", [True, False])
def test_what_sets_in_at_once_where_a_mode_had_sounded_has_risen(sounded):
    """Chatter of 20 dB within 50 ms, out of the noise of a cut that gets deeper; out of a room it is the tool."""
    t = times(3.0)
    before = (0.2 if sounded else 0.0) * vibration(len(t), [(1000.0, 0.01)], seed=5)
    chatter = np.clip((t - 1.5) / 0.05, 0.0, 1.0) * (15.0 * np.sin(2 * np.pi * 1010.0 * t) + noise(len(t), 3.0, seed=6))
    spectrum, entered = Spectrum(RATE_HZ, INTERVAL), False
    for first in range(0, 40 * INTERVAL, INTERVAL):
        lines = named(spectrum, (before + noise(len(t), 1.0) + chatter)[first : first + INTERVAL])
        entered |= spectrum.entering or not spectrum.cutting
    assert entered is not sounded
    (line,) = [line for line in lines if line.share > 0.5]
    assert (min(line.long_rise, line.absolute_rise) > 0.8) is sounded


@pytest.mark.parametrize("before", ["mode", "tone", "nothing"])
def test_what_grows_out_of_a_mode_is_told_from_a_force_that_gets_louder(before):
    """A mode comes and goes as noise drives it; a force is steady."""
    t = times(3.0)
    tone = np.sin(2 * np.pi * 1010.0 * t)
    sounds = {"mode": vibration(len(t), [(1010.0, 0.01)], seed=5), "tone": np.sqrt(2.0) * tone, "nothing": 0.0 * t}
    signal = 0.3 * sounds[before] + 10.0 * np.clip((t - 1.5) / 0.05, 0.0, 1.0) * tone + noise(len(t), 1.0)
    spectrum, grown = Spectrum(RATE_HZ, INTERVAL), []
    for first in range(0, 40 * INTERVAL, INTERVAL):
        named(spectrum, signal[first : first + INTERVAL])
        grown.append(spectrum.grown)
    assert not any(grown[:30])
    assert any(grown[30:34]) is (before == "mode")


def test_lines_come_most_prominent_first():
    """Of two tones the stronger one is first, and they are told apart."""
    t = times(1.0)
    found = frames(np.sin(2 * np.pi * 700 * t) + 5 * np.sin(2 * np.pi * 2500 * t) + noise(len(t), 0.1))[-1]
    assert [line.frequency_hz for line in found[:2]] == pytest.approx([2500, 700], abs=3.0)
    prominences = [line.prominence_db for line in found]
    assert prominences == sorted(prominences, reverse=True)


def test_missing_samples_have_no_lines_and_leave_no_trace():
    """While samples are missing there is nothing; afterwards a tone is as steady as before, phase and all."""
    t = times(3.0)
    signal = np.sin(2 * np.pi * 900 * t) + noise(len(t), 0.01)
    signal[12_000:14_000] = np.nan
    found = frames(signal)
    assert found[20] == []  # samples 12800 to 13440
    assert all(found[:19])
    after = found[24][0]
    assert after.frequency_hz == pytest.approx(900, abs=2.0)
    assert after.coherence > 0.999
    assert after.variation < 0.02


@pytest.mark.parametrize("samples", [1, 159, 160, 300, 639])
def test_a_short_last_frame(samples):
    """A last frame of any length has the lines of the window that ends with it."""
    t = times(1.0)
    signal = np.sin(2 * np.pi * 900 * t) + noise(len(t), 0.01)
    *_, last = frames(signal[: 15 * INTERVAL + samples])
    assert last[0].frequency_hz == pytest.approx(900, abs=2.0)
    assert last[0].coherence > 0.99


def test_silence_has_no_numbers_that_are_none():
    """Zeros give finite values."""
    for found in frames(np.zeros(12_800)):
        for line in found:
            values = (line.share, line.prominence_db, line.variation, line.growth_per_s, line.rise, line.coherence)
            assert np.isfinite(values).all()


def test_what_comes_to_light_has_not_risen():
    """A cut ends, a pump is switched on, the noise hardly falls: the pump stands out, but rose out of nothing quieter.

    In a room that goes on as it was the same tone has risen.
    """
    t = times(3.0)
    ends, room = 2.0, noise(len(t), 0.02)
    pump = np.where(t > ends, 0.04 * np.sin(2 * np.pi * 116.0 * t), 0.0)
    cut = 0.3 * vibration(len(t), [(700.0, 0.01)], seed=4)
    (found,) = [line for line in frames(np.where(t > ends, 0.0, cut) + pump + room)[50] if line.share > 0.5]
    (risen,) = [line for line in frames(pump + room)[50] if line.share > 0.5]
    assert found.frequency_hz == pytest.approx(116.0, abs=2.0)
    assert max(found.rise, found.long_rise, found.absolute_rise) < 0.1
    assert min(risen.long_rise, risen.absolute_rise) > 1.0


@pytest.mark.parametrize("after", [1.0, 0.1])
def test_what_comes_to_light_as_what_turned_ends_has_not_risen(after):
    """A cut of which only its comb was heard, and that was taken out, ends as a tone begins; or it goes on."""
    t = times(3.0)
    signal = noise(len(t), 0.02) + np.where(t > 2.0, 0.04 * np.sin(2 * np.pi * 116.0 * t), 0.0)
    spectrum = Spectrum(RATE_HZ, INTERVAL)
    for first in range(0, 51 * INTERVAL, INTERVAL):
        whole = 1.0 if t[first] < 2.0 else after
        lines = named(spectrum, signal[first : first + INTERVAL], turns=True, whole=whole, repeating=0.5)
    (line,) = [line for line in lines if line.share > 0.5]
    if after < 1.0:
        assert max(line.rise, line.long_rise, line.absolute_rise) < 0.1
    else:
        assert min(line.long_rise, line.absolute_rise) > 1.0
