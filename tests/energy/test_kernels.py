"""The kernels against twins that a reader can check by eye."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.interpolate import CubicSpline

from chatter_monitor.kernels import energy as kernel


def naive_half_cycles(x, v):
    """Crossings by scipy's spline, extremes as the farthest sample of each half cycle."""
    n = np.arange(x.size)
    roots = CubicSpline(n, x).roots(extrapolate=False)
    roots = roots[(roots > 1) & (roots < x.size - 2)]
    velocity = CubicSpline(n, v)(roots)
    fine = np.linspace(0, x.size - 1, 20 * x.size)
    dense = CubicSpline(n, x)(fine)
    extremes = []
    for a, b in itertools.pairwise(roots):
        part = dense[(fine >= a) & (fine <= b)]
        extremes.append(part[np.argmax(np.abs(part))])
    return roots, velocity, np.array(extremes)


def test_half_cycles_match_splines():
    """Crossings and velocities agree with a cubic spline to 1e-3 of a sample and extremes to 3e-4."""
    t = np.arange(2000) / 32.0
    amplitude = 1.0 + 0.5 * np.sin(0.3 * t)
    x = amplitude * np.sin(2 * np.pi * t + 0.4) + 0.05 * np.sin(6 * np.pi * t)
    v = np.gradient(x, t)
    crossing, velocity, extreme = np.empty(x.size), np.empty(x.size), np.empty(x.size)
    count = kernel.half_cycles(x, v, crossing, velocity, extreme)
    roots, expected_velocity, expected_extreme = naive_half_cycles(x, v)
    assert count == expected_extreme.size > 100
    np.testing.assert_allclose(crossing[: count + 1], roots, atol=1e-3)
    np.testing.assert_allclose(velocity[: count + 1], expected_velocity, rtol=1e-3)
    np.testing.assert_allclose(extreme[:count], expected_extreme, rtol=3e-4)


def test_half_cycles_of_a_motion_that_never_crosses():
    """A motion on one side of zero has no half cycle."""
    x = 2.0 + np.sin(np.arange(200) / 5.0)
    scratch = [np.empty(x.size) for _ in range(3)]
    assert kernel.half_cycles(x, np.gradient(x), *scratch) == 0


def naive_covariance(w, v, zone, edges, stride, lags, zones):
    """Eq. (15) before division by the number of segments, term by term."""
    sums = np.zeros((len(edges) - 1, zones, 3, len(lags)))
    counts = np.zeros((len(edges) - 1, zones), dtype=np.int64)
    for b in range(len(edges) - 1):
        for i in range(edges[b], edges[b + 1], stride):
            if zone[i] < 0:
                continue
            counts[b, zone[i]] += 1
            for k, lag in enumerate(lags):
                product = complex(v[i], -w[i]) * complex(v[i + lag], w[i + lag])
                sums[b, zone[i], :, k] += [v[i] * v[i + lag], w[i] * w[i + lag], product.imag]
    return sums, counts


def test_conditional_covariance_matches_its_naive_twin():
    """Sums and counts by block, zone and lag equal those of four plain loops."""
    rng = np.random.default_rng(1)
    w, v = rng.standard_normal((2, 400))
    zone = rng.integers(-1, 3, 400)
    edges = np.array([0, 100, 250, 380])
    lags = np.array([0, 1, 2, 7, 12])
    sums, counts = np.zeros((3, 3, 3, 5)), np.zeros((3, 3), dtype=np.int64)
    kernel.conditional_covariance(w, v, zone, edges, 4, lags, sums, counts)
    expected_sums, expected_counts = naive_covariance(w, v, zone, edges, 4, lags, 3)
    np.testing.assert_array_equal(counts, expected_counts)
    np.testing.assert_allclose(sums, expected_sums, atol=1e-12)
