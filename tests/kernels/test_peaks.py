"""Peaks of an averaged periodogram, against plain definitions."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.kernels import peaks as kernel

SIZE = 3000


@pytest.fixture
def spectrum():
    """Averaged noise with a resonance and lines at every multiple of 71.3 bins."""
    rng = np.random.default_rng(7)
    power = rng.gamma(10.0, 0.1, SIZE) * (1.0 + 50.0 / (1.0 + ((np.arange(SIZE) - 900.0) / 30.0) ** 2))
    power[np.rint(71.3 * np.arange(1, SIZE // 72)).astype(int)] *= 20.0
    return power


def test_multiples_that_stand_out_are_marked(spectrum):
    """A multiple is marked, with its lobe, where it is beyond the ratio to the median around it; nothing else is."""
    spectrum[713] = 1.0  # the tenth does not stand out
    expected = np.zeros(SIZE, bool)
    for order in range(1, 60):
        centre = round(71.3 * order)
        around = spectrum[max(centre - kernel.SURROUNDINGS, 0) : centre + kernel.SURROUNDINGS + 1]
        if len(around) == 25 and spectrum[centre - 1 : centre + 2].max() > 5.0 * np.median(around):
            expected[centre - kernel.LINE_BINS : centre + kernel.LINE_BINS + 1] = True
    lines = np.ones(SIZE, bool)
    kernel.mark_multiples(spectrum, 71.3, 5.0, np.empty(25), lines)
    np.testing.assert_array_equal(lines, expected)
    assert not lines[713]
    assert lines[143]


def test_the_strongest_is_where_most_power_is_beside_lines(spectrum):
    """The largest mean over a few percent around, of the bins that are no lines, up to the last that counts."""
    lines = np.zeros(SIZE, bool)
    kernel.mark_multiples(spectrum, 71.3, 5.0, np.empty(25), lines)
    for bins in (SIZE, 800):
        means = []
        for b in range(bins):
            half = max(kernel.LINE_BINS + 1, int(kernel.SMOOTHING * b))
            around = slice(max(b - half, 0), b + half + 1)
            means.append(spectrum[around][~lines[around]].mean())
        work = np.empty(SIZE + 1), np.empty(SIZE + 1, np.int64)
        assert kernel.strongest(spectrum, lines, bins, *work) == np.argmax(means)


@pytest.mark.parametrize(("at", "found"), [(1900, 1900), (1850, -1), (1970, -1), (1050, -1)])
def test_another_peak_stands_out_beside_what_turns(at, found):
    """A narrow hump is found; not within a fifth of the first peak, nor in the skirt of a line of spindle or teeth."""
    power = np.random.default_rng(8).gamma(10.0, 0.1, SIZE)
    power += 300.0 / (1.0 + ((np.arange(SIZE) - 900.0) / 30.0) ** 2)
    power += 40.0 / (1.0 + ((np.arange(SIZE) - at) / 4.0) ** 2)
    work = np.empty(SIZE + 1), np.empty(SIZE + 1, np.int64), np.empty(SIZE + 1)
    lines = np.zeros(SIZE, bool)
    # multiples of 123.4 around are 1851 and 1974.4
    assert abs(kernel.most_prominent(power, lines, 60, 2900, 900.0, 123.4, 370.2, 0.0, 10.0, *work) - found) <= 5
    assert kernel.most_prominent(power, lines, 60, 2900, 900.0, 123.4, 370.2, 0.0, 1e3, *work) == -1
    lines[at - 20 : at + 21] = True
    assert kernel.most_prominent(power, lines, 60, 2900, 900.0, 123.4, 370.2, 0.0, 10.0, *work) == -1


def test_what_turns_reaches_as_far_as_its_speed_is_uncertain():
    """With a speed that may be 3 % off, a hump beside a line may be that line, up to a fifth of a rotation."""
    power = np.random.default_rng(8).gamma(10.0, 0.1, SIZE) + 40.0 / (1.0 + ((np.arange(SIZE) - 632.0) / 2.0) ** 2)
    work = np.empty(SIZE + 1), np.empty(SIZE + 1, np.int64), np.empty(SIZE + 1)
    for off, found in ((0.0, 632), (0.03, -1)):
        best = kernel.most_prominent(power, np.zeros(SIZE, bool), 60, 2900, 2000.0, 123.4, 370.2, off, 10.0, *work)
        assert abs(best - found) <= 3
