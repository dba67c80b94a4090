"""Halving the rate and taking away the offset, against convolution and formulas."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import freqz

from chatter_monitor.kernels import conditioning

NOISE = np.random.default_rng(1).standard_normal(3001)


def halve(samples, state=None):
    out = np.full(len(samples) // 2 + 1, np.nan)
    return out[: conditioning.halve(samples, state or conditioning.new_half_band(), out)]


def high_pass(samples, corner, state=None):
    out = np.full(len(samples), -1.0)
    conditioning.high_pass(samples, corner, np.zeros(2) if state is None else state, out)
    return out


@pytest.mark.parametrize("n", [0, 1, 2, 63, 3001])
def test_halving_is_convolution_and_every_second_sample(n):
    """Output k is the convolution with the taps at input 2 k, silence before the first sample."""
    expected = np.convolve(NOISE[:n], conditioning.half_band())[:n:2] if n else []
    np.testing.assert_allclose(halve(NOISE[:n]), expected, atol=1e-14)


@settings(max_examples=30, derandomize=True, deadline=None)
@given(st.lists(st.integers(0, 400), min_size=1, max_size=10))
def test_halving_and_high_pass_do_not_feel_the_cuts(sizes):
    """In pieces of any size, empty ones included, both give the bits that they give at once."""
    whole = NOISE[: sum(sizes)]
    half_band, memory = conditioning.new_half_band(), np.zeros(2)
    pieces = np.split(whole, np.cumsum(sizes))
    halved = np.concatenate([halve(piece, half_band) for piece in pieces])
    passed = np.concatenate([high_pass(piece, 0.01, memory) for piece in pieces])
    assert halved.tobytes() == halve(whole).tobytes()
    assert passed.tobytes() == high_pass(whole, 0.01).tobytes()


def test_the_delay_is_31_inputs():
    """A click at input 2 k - 31 has its peak, half its height, at output k, and the response is symmetric about it."""
    click = np.zeros(200)
    click[2 * 40 - conditioning.HALF_BAND_DELAY] = 1.0
    out = halve(click)
    assert np.argmax(abs(out)) == 40
    assert out[40] == 0.5
    assert np.count_nonzero(out) == 1  # every other tap of a half-band filter is zero

    click = np.zeros(200)
    click[2 * 40 - conditioning.HALF_BAND_DELAY - 1] = 1.0
    out = halve(click)[24:56]
    np.testing.assert_allclose(out, out[::-1], atol=1e-15)
    assert conditioning.HALF_BAND_DELAY == 31


def test_the_band_is_full_to_its_edge():
    """Flat within 0.01 dB up to 0.42 of the new rate, -6 dB at half of it, 78 dB down from 0.6 on."""
    frequency, response = freqz(conditioning.half_band(), worN=4096, fs=2.0)  # the new rate is 1
    level_db = 20 * np.log10(np.maximum(abs(response), 1e-12))
    assert abs(level_db[frequency <= 0.42]).max() < 0.01
    assert np.interp(0.5, frequency, level_db) == pytest.approx(-6.02, abs=0.02)
    assert level_db[frequency >= 0.6].max() < -78


@pytest.mark.parametrize("corner", [2 * np.pi * 20 / 12_800, 0.3])
def test_high_pass_has_the_response_of_a_first_order_filter(corner):
    """Its response at every frequency is s / (s + corner) with s = 2 j tan(w / 2), the bilinear transform."""
    click = np.zeros(1 << 14)
    click[0] = 1.0
    response = np.fft.rfft(high_pass(click, corner))
    s = 2 * np.tan(np.linspace(0, np.pi, len(response))[:-1] / 2) * 1j
    np.testing.assert_allclose(response[:-1], s / (s + corner), atol=1e-9)


def test_high_pass_with_corner_zero_takes_away_the_start_only():
    """Without a corner the signal passes; only its level before the first sample, zero, is remembered."""
    np.testing.assert_allclose(high_pass(NOISE, 0.0), NOISE, atol=1e-12)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_high_pass_lets_what_is_no_number_through_and_forgets_it(bad):
    """A sample that is no number stays what it is, and those after it are as if it had not been there."""
    riddled = np.insert(NOISE, 100, [bad, bad])
    out = high_pass(riddled, 0.1)
    np.testing.assert_array_equal(out[100:102], [bad, bad])
    np.testing.assert_array_equal(np.delete(out, [100, 101]), high_pass(NOISE, 0.1))
