"""What the weights of the verdict are learned from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.verdict.cut import RATE_HZ, Cut, Label, Stretch, Truth
from benchmarks.verdict.train import CALM, GROWTH, MEASURES, NEAR, NOISE, examples, fit
from tests.verdict.hearing import interval

HERTZ = 475.0


def a_cut(label, damping_ratio, of_the_limit):
    """One interval of a cut with a vibration at `HERTZ`."""
    one = np.ones(1)
    truth = Truth(
        label=np.array([label], np.int8),
        damping_ratio=damping_ratio * one,
        frequency_hz=HERTZ * one,
        kappa=of_the_limit * one,
        kappa_critical=one,
        synchronous_share=0.0 * one,
        limited=0.0 * one,
        vibration_rms=one,
        unstable=(),
    )
    return Cut(
        name="one",
        family="ramp",
        samples=np.zeros(0),
        rate_hz=RATE_HZ,
        nominal_rpm=3000.0,
        teeth=4,
        speed_times_s=np.zeros(1),
        speed_rpm=np.full(1, 3000.0),
        snr_db=20.0,
        sensor="velocity",
        truth=truth,
    )


@pytest.mark.parametrize(
    ("hertz", "rising", "of_the_limit", "kind"),
    [
        (HERTZ, True, 0.9, NEAR),
        (HERTZ, True, 0.5, NOISE),  # noise drives it as far, now and then
        (HERTZ, False, 0.9, CALM),
        (3.0 * HERTZ, True, 0.9, NOISE),  # another vibration
    ],
)
def test_what_rises_near_the_limit_is_told_apart_from_other_noise(hertz, rising, of_the_limit, kind):
    seen = interval(hertz, rising=rising)
    kinds = [k for _, k in examples(a_cut(Label.OTHER, 0.001, of_the_limit), [seen])]
    assert kinds == [kind]


def test_how_rare_the_ones_near_the_limit_are_does_not_count():
    """Few of noise look like growth: they weigh as much however few, and make growth less likely where they are."""
    rng = np.random.default_rng(3)
    rise = MEASURES.index("own_rise")
    there = np.zeros(len(MEASURES) + 1)
    there[rise], there[-1] = 4.0, 1.0

    def growth_there(near, kind_of_these):
        """Log odds of growth over noise where so many are that look like it, by weights learned from them."""
        kind = np.repeat([NOISE, NEAR, GROWTH, CALM], [10_000, near, 1000, 1000])
        x = np.zeros((len(kind), len(MEASURES)))
        x[:, rise] = rng.normal(size=len(kind)) + np.where((kind == GROWTH) | (kind == NEAR), 4.0, 0.0)
        return fit(x, np.where(kind == NEAR, kind_of_these, kind))[0] @ there

    few, many, as_noise = growth_there(20, NEAR), growth_there(200, NEAR), growth_there(20, NOISE)
    assert few == pytest.approx(many, abs=0.2)
    assert few < as_noise - 0.5


def test_how_long_a_cut_has_been_unstable():
    """From the latest stretch on that has begun."""
    truth = replace(a_cut(Label.OTHER, 0.001, 0.5).truth, unstable=(Stretch(0.1, None), Stretch(0.25, 0.3)))
    truth = replace(truth, label=np.zeros(8, np.int8))
    assert truth.unstable_for_s == pytest.approx([np.inf, np.inf, 0.0, 0.05, 0.1, 0.0, 0.05, 0.1])
