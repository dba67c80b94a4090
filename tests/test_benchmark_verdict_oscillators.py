"""Oscillators that excite themselves: what is simulated, and how it is counted."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.verdict.cut import INTERVAL_S, INTERVAL_SAMPLES, RATE_HZ
from benchmarks.verdict.monitor import Passage, watch
from benchmarks.verdict.oscillators import FAMILIES, LENGTH_S, Oscillator, Score, draw

INTERVALS = 100


def oscillator(damping, frequency_hz=1000.0):
    """An oscillator with a damping for each interval, of which nothing is heard."""
    return Oscillator("step", frequency_hz, 1200.0, 2, np.repeat(damping, INTERVAL_SAMPLES), np.zeros(0))


@pytest.mark.parametrize("number", range(len(FAMILIES)))
def test_what_grows_is_what_has_a_negative_damping(number):
    """At its mode, several times as loud as before; what stays damped stays as loud as its teeth are."""
    made = draw(2000 - 2000 % len(FAMILIES) + number)
    assert made.family == FAMILIES[number]
    assert made.samples.size == made.damping.size == round(LENGTH_S * RATE_HZ)
    chatters, calm = made.labels(round(LENGTH_S / INTERVAL_S))
    assert chatters.any() == (made.family in ("step", "ramp", "bar", "hum", "faint"))
    if chatters.any():
        heard = made.samples.reshape(-1, INTERVAL_SAMPLES)
        before, after = (np.median(np.std(heard[which], axis=1)) for which in (calm, chatters))
        assert after > 1.5 * before
        power = np.abs(np.fft.rfft(heard[chatters], axis=1)).mean(axis=0)
        hertz = np.fft.rfftfreq(INTERVAL_SAMPLES, 1.0 / RATE_HZ)[np.argmax(power)]
        assert hertz == pytest.approx(made.frequency_hz, abs=25.0)


def test_what_is_asked_for():
    """From the fourth interval of an unstable damping on, and as long as it has been positive for half a second."""
    damping = np.full(INTERVALS, 0.02)
    damping[40:60], damping[80:] = -0.01, -0.001
    chatters, calm = oscillator(damping).labels(INTERVALS)
    assert np.flatnonzero(chatters).tolist() == list(range(43, 60))
    assert np.flatnonzero(calm).tolist() == [*range(40), *range(70, 80)]


def test_counts_and_lags():
    """A lag is from the onset to the end of an interval in alarm, over the longer of 50 ms and 30 periods."""
    damping = np.full(INTERVALS, 0.02)
    damping[40:60] = -0.01
    alarm = np.zeros(INTERVALS, bool)
    alarm[[10, 42, 43, 44, 70]] = True
    score = Score()
    score.add(oscillator(damping, frequency_hz=200.0), alarm)
    assert (score.chatter, score.told, score.calm, score.false) == (17, 2, 70, 2)
    assert score.lags == [pytest.approx(3 * INTERVAL_S / 0.15)]
    score.add(oscillator(damping), np.zeros(INTERVALS, bool))
    assert score.lags[1] == math.inf
    assert score.cells == ("34", "5.9 %", "140", "2", "inf, 1")


def test_chatter_that_is_there_within_an_interval_came_with_no_tool():
    """Through the whole monitor: 1.9 kHz, e-fold in 5 ms, out of a cut of which nothing else is heard (seed 81)."""
    made = draw(81)
    heard = watch([Passage(made.samples, "", (made.rpm, made.teeth))], announce=True)
    alarm = np.array([state for remarks in heard for state in remarks.states]) == "self_excited"
    chatters, calm = made.labels(alarm.size)
    assert alarm[chatters].mean() > 0.95
    assert not alarm[calm].any()
