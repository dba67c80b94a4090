"""The power that each mode carries, against signals for which it is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from chatter_monitor.kernels.share import modal_shares
from tests.signals import factor


def shares(factors, c=()):
    p = 2 * len(factors)
    a = np.array([1.0])
    for each in factors:
        a = np.convolve(a, each)
    theta = np.concatenate([c, a[1:]])
    result = np.full(len(factors), -1.0)
    pairs = np.array([each[1:] for each in factors])
    modal_shares(p, len(c), theta, pairs, np.zeros(p, dtype=np.complex128), result)
    return result


def variance(a):
    """Variance of 1/A e for white e of variance 1, by summing the squared impulse response."""
    click = np.zeros(1 << 17)
    click[0] = 1.0
    return float(np.sum(lfilter([1.0], a, click) ** 2))


def numerator_of_sum(parts):
    """C, monic, of the ARMA process that is the sum of independent processes g / A e, given (g, A) each."""
    order = 2 * (len(parts) - 1)
    covariance = np.zeros(2 * order + 1)
    for i, (gain, _) in enumerate(parts):
        others = np.array([1.0])
        for k, (_, a) in enumerate(parts):
            if k != i:
                others = np.convolve(others, a)
        covariance += gain**2 * np.convolve(others, others[::-1])
    zeros = np.roots(covariance)
    return np.poly(zeros[abs(zeros) < 1]).real[1:]


@pytest.mark.parametrize(
    "modes",
    [
        [(400, 0.03, 1.0), (2000, 0.02, 1.0)],
        [(400, 0.03, 1.0), (2000, 0.02, 30.0)],
        [(300, 0.01, 0.01), (330, 0.05, 1.0)],  # neighbours
        [(150, 0.02, 1.0), (1067, 0.001, 0.3), (4000, 0.1, 20.0)],
    ],
)
def test_independent_modes_get_their_own_variance(modes):
    """For a sum of independent modes the shares are exactly their parts of the variance, also where they overlap."""
    parts = [(gain, factor(f, zeta)) for f, zeta, gain in modes]
    power = np.array([gain**2 * variance(a) for gain, a in parts])
    found = shares([a for _, a in parts], numerator_of_sum(parts))
    np.testing.assert_allclose(found, power / power.sum(), rtol=1e-4, atol=1e-7)


def test_separated_modes_get_the_power_of_their_band():
    """For any C, the share of a mode that stands alone is the integral of the spectrum over its part of the band."""
    a = [factor(400, 0.03), factor(3000, 0.01)]
    c = np.array([-1.1, 0.55, -0.125])
    angle = (np.arange(1 << 18) + 0.5) * np.pi / (1 << 18)
    z = np.exp(-1j * angle)
    spectrum = abs(np.polyval([*c[::-1], 1.0], z) / np.polyval(np.convolve(*a)[::-1], z)) ** 2
    low = spectrum[angle < 2 * np.pi * 1200 / 12_800].sum() / spectrum.sum()
    np.testing.assert_allclose(shares(a, c), [low, 1 - low], atol=0.02)


@pytest.mark.parametrize("damping_ratio", [0.0, -1e-6, -0.01])
def test_a_growing_mode_carries_the_power(damping_ratio):
    """A pole on or outside the unit circle, which has no stationary power, counts as the strongest."""
    found = shares([factor(400, 0.03), factor(900, damping_ratio)], [0.1, 0.2, 0.1])
    assert found[1] > 0.95
    assert found.sum() == pytest.approx(1.0)


def test_real_poles_count_as_well():
    """A factor with two real poles has the share of its two first-order parts."""
    real = np.convolve([1, -0.9], [1, 0.5])
    parts = [(1.0, factor(3000, 0.02)), (2.0, real)]
    power = np.array([gain**2 * variance(a) for gain, a in parts])
    np.testing.assert_allclose(shares([a for _, a in parts], numerator_of_sum(parts)), power / power.sum(), rtol=1e-6)


@pytest.mark.parametrize("pair", [[1.0, 0.0, 0.0], [1.0, np.nan, np.nan]])
def test_nothing_known_is_no_share(pair):
    """Where nothing can be said, no mode has a share."""
    np.testing.assert_array_equal(shares([pair, pair], [0.0, 0.0, 0.0]), [0.0, 0.0])
