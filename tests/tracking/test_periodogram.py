"""The averaged periodogram: forgetting, what it knows, gaps, levels, lines."""

import numpy as np
import pytest

from chatter_monitor.tracking.periodogram import AveragedPeriodogram, spindle_lines, strongest_peak_hz

SEGMENT, HOP, MEMORY = 500, 100, 1000.0


def averaged(signal, **options):
    """Average of a whole signal, a hop at a time, and how many windows went into it."""
    average = AveragedPeriodogram(SEGMENT, HOP, MEMORY, **options)
    windows = sum(average.take(signal[i : i + HOP]) and average.add() for i in range(0, len(signal) - HOP + 1, HOP))
    return average, windows


def test_the_average_is_that_of_forgotten_windows():
    """Every window of unit power counts exp(-age / memory)."""
    signal = np.random.default_rng(1).standard_normal(2000)
    average, windows = averaged(signal)
    hann = np.hanning(SEGMENT + 1)[:-1]
    total, weights = 0.0, 0.0
    ends = range(SEGMENT, 2001, HOP)
    for end in ends:
        power = abs(np.fft.rfft(hann * signal[end - SEGMENT : end])) ** 2
        weight = np.exp((end - 2000) / MEMORY)
        total, weights = total + weight * power / power.sum(), weights + weight
    assert windows == len(ends)
    np.testing.assert_allclose(average.spectrum, total / weights, rtol=1e-9)


def test_blocks_of_any_size_up_to_the_hop_give_the_same_bits():
    """How samples come in pieces changes nothing; a piece beyond the hop is refused."""
    rng = np.random.default_rng(2)
    signal = rng.standard_normal(3000)
    whole, _ = averaged(signal)
    pieces, begin = AveragedPeriodogram(SEGMENT, HOP, MEMORY), 0
    while begin < len(signal):
        size = min(int(rng.integers(1, 60)), pieces.missing_to_hop)
        if pieces.take(signal[begin : begin + size]):
            pieces.add()
        begin += size
    np.testing.assert_array_equal(pieces.spectrum, whole.spectrum)
    with pytest.raises(ValueError, match="101"):
        whole.take(np.zeros(HOP + 1))


def test_it_knows_how_many_independent_windows_it_holds():
    """The mean over m bins of white noise varies by 1 / (m windows), early and late; the scatter allows for 25 %."""
    for hops in (5, 30):
        # the scaling to unit power cancels in a ratio of two halves of the band
        halves = []
        for seed in range(400):
            average, _ = averaged(np.random.default_rng([hops, seed]).standard_normal(hops * HOP))
            halves.append(np.log(average.spectrum[10:120].mean() / average.spectrum[130:240].mean()))
        assert np.var(halves) == pytest.approx(2.0 / (110 * average.windows), rel=0.25)


def test_missing_samples_leave_out_every_window_that_holds_them():
    """After a sample that is no number the next window is taken one whole segment later."""
    signal = np.random.default_rng(3).standard_normal(3000)
    signal[1234] = np.nan
    _, windows = averaged(signal)
    kept = [end for end in range(SEGMENT, 3001, HOP) if not end - SEGMENT <= 1234 < end]
    assert windows == len(kept)
    assert averaged(np.where(np.isnan(signal), 1e200, signal))[1] == len(kept)


def test_another_level_starts_the_average_anew_and_an_offset_hides_none():
    """A level 20 dB higher is another cut, although a large offset stays the same; 5 dB more is the same cut."""
    signal = np.random.default_rng(4).standard_normal(4000)
    louder, more = signal.copy(), signal.copy()
    louder[2000:] *= 10.0
    more[2000:] *= 1.8
    late = averaged(louder + 1000.0, lowest_bin=4)[0]
    assert late.windows < averaged(signal, lowest_bin=4)[0].windows
    assert averaged(more, lowest_bin=4)[0].windows == averaged(signal, lowest_bin=4)[0].windows


def test_silence_adds_nothing():
    """Zeros are no window, and they raise no warning."""
    assert averaged(np.zeros(2000))[1] == 0


def test_lines_at_multiples_of_the_rotation_are_found_and_others_left():
    """Bins around two spindle lines are marked, a tone that is no multiple is not, nor more than 1 % of plain noise."""
    time_s = np.arange(64000) / 12800.0
    noise = np.random.default_rng(5).standard_normal(len(time_s))
    tones = sum(0.5 * np.cos(2 * np.pi * f * time_s) for f in (600.0, 1260.0, 908.0))
    average, plain = AveragedPeriodogram(32000, 6400, 64000.0), AveragedPeriodogram(32000, 6400, 64000.0)
    for begin in range(0, 64000, 6400):
        for periodogram, signal in ((average, noise + tones), (plain, noise)):
            periodogram.take(signal[begin : begin + 6400])
            periodogram.add()
    lines = spindle_lines(average.spectrum, 0.4, 30.0, average.windows)
    assert lines[[1500, 3150]].all()
    assert not lines[2270]
    assert spindle_lines(plain.spectrum, 0.4, 30.0, plain.windows).mean() < 0.01


def test_the_strongest_peak_is_a_mode_and_no_line():
    """Power spread over a resonance counts, a marked line does not."""
    spectrum = 1.0 / ((np.arange(16001) - 2000.0) ** 2 / 60.0**2 + 1.0) + 0.01
    spectrum[5000] = 1000.0
    lines = np.zeros(16001, np.bool_)
    assert strongest_peak_hz(spectrum, lines, 0.4) == pytest.approx(2000.0, rel=0.02)
    lines[5000] = True
    assert strongest_peak_hz(spectrum, lines, 0.4) == pytest.approx(800.0, rel=0.01)


def test_what_lies_before_a_gap_fades_while_it_lasts():
    """A gap of four memories leaves next to nothing of the past in the average."""
    rng, tone = np.random.default_rng(6), np.sin(0.8 * np.arange(1000))
    after = rng.standard_normal(600)
    average, _ = averaged(np.concatenate((tone, np.full(4000, np.nan), after)))
    alone, _ = averaged(after)
    np.testing.assert_allclose(average.spectrum, alone.spectrum, atol=0.03)
    assert alone.windows < average.windows < 1.2 * alone.windows
