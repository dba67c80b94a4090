"""Roots of small real polynomials z^n + a[0] z^(n-1) + ... + a[n-1], whether they are inside a circle; and a cubic."""

import math

from numba import njit

from chatter_monitor.kernels.lanes import fma, spread
from chatter_monitor.kernels.options import EXACT, OPTIONS, WITHIN

ABERTH_STEPS = 200
ABERTH_CONVERGED = 1e-14


@njit(**WITHIN)
def cubic(a, b, c, d, x):
    """Cubic through four values one apart (Lagrange), a fraction x of the way from the second to the third."""
    return b + x * (c - a / 3.0 - b / 2.0 - d / 6.0 + x * ((a + c) / 2.0 - b + x * ((b - c) / 2.0 + (d - a) / 6.0)))


@njit(forceinline=True, **EXACT)
def is_minimum_phase(n, a, work, inverse_radius):
    """Tell by the Schur-Cohn test whether all zeros of 1 + a[0] z^-1 + ... + a[n-1] z^-n are within a radius.

    Coefficients and radius are lanes, the answer a mask.
    """
    work[0] = spread(1.0, inverse_radius)
    scale = inverse_radius
    for i in range(n):
        work[i + 1] = a[i] * scale
        scale = scale * inverse_radius
    within = abs(work[n]) < work[0]
    for m in range(n, 0, -1):
        first = work[0]
        last = work[m]
        within = within & (abs(last) < first)
        # reverse-and-subtract in place, pairs from both ends, without divisions
        for i in range((m + 1) // 2):
            low = work[i]
            high = work[m - i]
            work[i] = fma(first, low, -(last * high))
            work[m - i] = fma(first, high, -(last * low))
        if m % 2 == 0:
            work[m // 2] = work[m // 2] * (first - last)
    return within


@njit(**OPTIONS)
def all_roots(n, a, roots):
    """All roots of the polynomial by the Ehrlich-Aberth iteration."""
    radius = 0.0
    for i in range(n):
        radius = max(radius, abs(a[i]) ** (1.0 / (i + 1)))
    radius = max(radius, 1e-3)
    for i in range(n):
        angle = 2.0 * math.pi * (i + 0.35) / n  # off the real axis, and off any symmetry
        roots[i] = radius * complex(math.cos(angle), math.sin(angle))
    for _ in range(ABERTH_STEPS):
        largest = 0.0
        for i in range(n):
            z = roots[i]
            value = complex(1.0, 0.0)
            slope = complex(0.0, 0.0)
            for k in range(n):
                slope = slope * z + value
                value = value * z + a[k]
            if value == 0.0:
                continue
            repulsion = complex(0.0, 0.0)
            for k in range(n):
                if k != i and roots[k] != z:
                    repulsion += 1.0 / (z - roots[k])
            denominator = slope - value * repulsion
            if denominator == 0.0:
                denominator = complex(1e-300, 0.0)
            change = value / denominator
            if abs(change) > radius:
                change *= radius / abs(change)
            roots[i] = z - change
            largest = max(largest, abs(change))
        if largest < ABERTH_CONVERGED * radius:
            break


@njit(**OPTIONS)
def multiply_out(n, roots, product, a):
    """Coefficients ``a[n]`` of the polynomial with these roots (real or in conjugate pairs); ``product[n]`` is work."""
    for i in range(n):
        product[i] = -roots[i] * (product[i - 1] if i > 0 else 1.0)
        for k in range(i - 1, -1, -1):
            product[k] -= roots[i] * (product[k - 1] if k > 0 else 1.0)
    for i in range(n):
        a[i] = product[i].real
