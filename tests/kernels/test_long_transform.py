"""Power of long signals against a library's transform."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import fft

from chatter_monitor.kernels.long_transform import LEAST_POINTS, new_tables, new_work, power_spectrum


@pytest.mark.parametrize("points", [LEAST_POINTS, 1024, 2048, 32768])
def test_the_power_is_that_of_a_transform(points):
    """For even and odd powers of two, whatever was in the work space; the highest frequency is left out."""
    signal = 3.0 + np.random.default_rng(points).standard_normal(points)
    work, power = new_work(points), np.full(points // 2, np.nan)
    work[:] = np.nan
    power_spectrum(signal, new_tables(points), work, power)
    expected = np.abs(fft.rfft(signal)[:-1]) ** 2
    np.testing.assert_allclose(power, expected, rtol=1e-9, atol=1e-14 * points * expected.max())
