"""How lines stand out of a spectrum, against naive twins."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.kernels import prominence
from tests import naive
from tests.kernels.rings import BINS, LOWEST, ring


def stand_out(power):
    result = np.full(BINS, np.nan)
    prominence.stand_out(power, LOWEST, np.zeros(BINS + 1), result)
    return result


@pytest.mark.parametrize("missing", [(), (79,), (76, 78)])
def test_recent_power_is_the_mean_of_the_valid_hops(missing):
    """Power of each bin is the mean over those of the newest four hops that hold samples."""
    ordered, valid, transforms = ring(1, missing)
    power = np.zeros(BINS)
    assert prominence.recent_power(*transforms, 4, power) == 4 - len(missing)
    np.testing.assert_allclose(power, (abs(ordered[-4:][valid[-4:]]) ** 2).mean(axis=0))


def test_no_power_without_samples():
    """Four hops without samples have no power, and say so."""
    power = np.ones(BINS)
    assert prominence.recent_power(*ring(1, (76, 77, 78, 79))[2], 4, power) == 0
    assert not power.any()


def test_prominence_is_that_of_the_twin():
    """Every bin, those at both ends of the band included, stands out as the plain definition says."""
    power = np.random.default_rng(2).exponential(size=BINS)
    power[30] *= 1000
    np.testing.assert_allclose(stand_out(power), naive.prominence(power, LOWEST), atol=1e-12)


def test_prominence_does_not_depend_on_the_gain():
    """A louder signal has the same prominence."""
    power = np.random.default_rng(3).exponential(size=BINS)
    np.testing.assert_allclose(stand_out(1e9 * power), stand_out(power), atol=1e-9)


def test_most_prominent_are_maxima_a_lobe_apart():
    """Peaks come in order of their height; what is within the lobe of a higher one, or no maximum, is none."""
    heights = np.zeros(BINS)
    heights[[10, 12, 30, 31, 50]] = 5.0, 4.0, 9.0, 8.5, 1.0
    peaks = np.zeros(5, np.int64)
    count = prominence.most_prominent(heights, LOWEST, peaks)
    assert peaks[: min(count, 3)].tolist() == [30, 10, 50]


@pytest.mark.parametrize("b", [2, 33, 63])
def test_the_share_is_that_of_the_lobe(b):
    """What is within three bins counts as the line's, at the ends of the band, too; in silence nothing does."""
    power = np.random.default_rng(5).exponential(size=BINS)
    total = float(power[LOWEST:].sum())
    lobe = power[max(b - 3, 0) : b + 4].sum()
    assert prominence.share(power, total, b) == pytest.approx(min(lobe / total, 1.0))
    assert prominence.share(power, 0.5 * lobe, b) == 1.0
    assert prominence.share(np.zeros(BINS), 0.0, b) == 0.0
