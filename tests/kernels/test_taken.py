"""What was taken out of a frame, against the plain definitions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chatter_monitor.kernels.taken import share_taken, strongest


@pytest.mark.parametrize("room", [1, 8, 64])
def test_the_strongest_harmonics_come_first(room):
    """Those that are subtracted at all, by their root mean square, the lower order first of two alike."""
    rng = np.random.default_rng(1)
    real, imag = rng.integers(-3, 4, (2, 40)).astype(float)
    gate = rng.choice([0.0, 0.5, 1.0], 40)
    orders, rms = np.empty(room, np.int64), np.empty(room)
    found = strongest(real, imag, gate, orders, rms)
    all_rms = gate * np.hypot(real, imag) / math.sqrt(2.0)
    expected = [i for i in np.argsort(-all_rms, kind="stable") if gate[i] > 0.0][:room]
    assert found == len(expected)
    assert len(set(all_rms[expected])) < len(expected) or room == 1
    assert orders[:found].tolist() == [i + 1 for i in expected]
    np.testing.assert_allclose(rms[:found], all_rms[expected], rtol=1e-14)


def test_the_share_is_of_the_variance():
    """Offsets and samples that are missing do not count."""
    rng = np.random.default_rng(2)
    after = rng.standard_normal(1000)
    before = after + 2.0 * np.sin(0.3 * np.arange(1000))
    expected = 1.0 - after.var() / before.var()
    gap = np.insert(before, 500, np.nan), np.insert(after, 500, np.nan)
    assert share_taken(before + 5.0, after - 7.0) == pytest.approx((expected, np.var(before)))
    assert share_taken(*gap)[0] == pytest.approx(expected)
    assert share_taken(np.full(3, np.nan), np.full(3, np.nan)) == (0.0, 0.0)
