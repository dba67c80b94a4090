"""Bumps of the force surface against the splines of a library."""

import numpy as np
from scipy.interpolate import BSpline

from chatter_monitor.discrepancy.basis import splines


def test_bumps_are_cubic_splines_that_stay_at_the_ends():
    """Inside they are the B-splines on equal knots, outside they keep their value at the end."""
    count, low, high = 7, -3.2, 3.2
    u = np.linspace(-4.0, 4.0, 202).reshape(2, 101)
    step = (high - low) / (count - 3)
    knots = low + step * np.arange(-3, count + 1)
    inside = np.clip(u.ravel(), low, high - 1e-9)
    expected = BSpline.design_matrix(inside, knots, 3).toarray().T.reshape(count, *u.shape)
    np.testing.assert_allclose(splines(u, count, low, high), expected, atol=1e-8)
