"""How soon an onset can be told at all: against what is known of the likelihood ratio."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.verdict.cut import INTERVAL_S
from benchmarks.verdict.soonest import FALSE, LONGEST_S, as_scored, soonest


def apart(before: float, after: float, instead: float, seconds: float) -> float:
    """How far apart the ratio is on the average, in standard deviations of it where nothing becomes unstable.

    With d the difference of the rates and I the integral of the mean power, its mean is d^2 I where it does, -d^2 I
    where not, with a standard deviation of d sqrt(2 I).
    """
    t = np.linspace(0.0, seconds, 2000)
    one, other = (
        np.trapezoid(np.exp(2.0 * rate * t) / (-2.0 * before) + np.expm1(2.0 * rate * t) / (2.0 * rate), t)
        for rate in (after, instead)
    )
    return float(abs(after - instead) * (one + other) / math.sqrt(2.0 * other))


@pytest.mark.parametrize("after", [-80.0, -60.0])
def test_a_small_change_is_told_when_the_ratio_is_three_deviations_apart(after):
    """Of a stable machine that becomes a little less so: there the ratio is nearly Gaussian, 3.09 for 1 in 1000."""
    assert FALSE == 0.001
    assert apart(-100.0, after, -100.0, soonest(-100.0, after, -100.0)) == pytest.approx(3.09, rel=0.1)


def test_it_takes_longer_the_less_there_is_to_tell():
    """From what is nearly unstable, of what grows slowly."""
    from_stable, from_limit = (soonest(-20.0, 15.0, instead) for instead in (-20.0, 0.0))
    assert 0.0 < from_stable < from_limit < soonest(-20.0, 7.0, 0.0) < LONGEST_S


def test_time_scales_with_the_rates():
    """Rates ten times as high, a tenth of the time, within the steps."""
    slow, fast = soonest(-20.0, 15.0, -10.0), soonest(-200.0, 150.0, -100.0)
    assert fast == pytest.approx(0.1 * slow, rel=0.1)


def test_a_verdict_is_given_at_the_end_of_an_interval():
    assert as_scored(1.01, 0.03) == pytest.approx(0.04)
    assert as_scored(1.01, 0.05) == pytest.approx(0.09)
    assert 0.0 <= as_scored(1.237, 0.02) - 0.02 < INTERVAL_S
