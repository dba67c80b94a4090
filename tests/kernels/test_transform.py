"""Transforms of several stretches against a library's."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit
from scipy import fft

from chatter_monitor.kernels.lanes import as_lanes
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.transform import real_transform

LANES = 4


@njit(**{**OPTIONS, "cache": False})
def transform(stretches, turns):
    re, im = as_lanes(stretches[0], LANES), as_lanes(stretches[1], LANES)
    real_transform(re, im, as_lanes(stretches[2], LANES), as_lanes(stretches[3], LANES), turns)


@pytest.mark.parametrize("points", [4, 8, 16, 32, 256, 512, 2048])
def test_each_lane_is_a_transform(points):
    """For even and odd powers of two, each lane has the transform of its own samples, the highest bin included."""
    samples = np.random.default_rng(points).standard_normal((points, LANES))
    stretches = np.full((4, points // 2 + 1, LANES), np.nan)
    stretches[:2, : points // 2] = samples[::2], samples[1::2]
    transform(stretches, np.exp(-2j * np.pi * np.arange(points) / points))
    np.testing.assert_allclose(stretches[0] + 1j * stretches[1], fft.rfft(samples, axis=0), rtol=0, atol=1e-13 * points)
