"""Signatures of forces against a twin that a reader can check by eye."""

import numpy as np
import pytest

from chatter_monitor.discrepancy.observer import Linear, observer
from chatter_monitor.kernels.signatures import LANES, response_of, signatures, unseen_of
from chatter_monitor.physics.parts import Mode


def naive(o, force, missing, taps):
    """One force: the error recursion of the module's docstring, sample by sample, then the filter as a convolution."""
    n = missing.size
    s, d = np.zeros(n), np.zeros(o.gain.size)
    for k in range(n):
        felt = force[1, k - 1] if k > 0 else 0.0
        s[k] = 0.0 if missing[k] else o.output @ d + o.feed * felt
        # What a sensor that feels the force told of it.
        news = force[0, k] - felt if o.feed and k > 0 else 0.0
        d = d + o.end * news
        if not missing[k]:
            d = d - o.gain * (s[k] + o.output @ o.end * news + o.feed * news)
        d = o.transition @ d + o.begin * force[0, k] + o.end * force[1, k]
    return np.convolve(s, taps)[:n]


@pytest.mark.parametrize("quantity", ["displacement", "pressure"])
def test_many_signatures_are_those_of_each_force(quantity):
    """Side by side, over any number of samples and with gaps, each product of factors has its own signature."""
    rng = np.random.default_rng(1)
    n = 333
    o = observer(Linear((Mode(400.0, 0.02),), quantity, 1e-3), 5600.0)
    left, right = rng.standard_normal((7, 2, n)), rng.standard_normal((3, 2, n))
    missing = (rng.random(n) < 0.05) & (np.arange(n) < 200)
    taps = np.concatenate([[1.0], 0.3 * rng.standard_normal(39)])
    out = np.empty((21, n))
    for first in (0, LANES):
        signatures(response_of(o, taps), unseen_of(o, taps), left, right, first, missing, out[first : first + LANES])
    for i, found in enumerate(out):
        expected = naive(o, left[i // 3] * right[i % 3], missing, taps)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())
