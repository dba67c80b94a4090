"""Poles of A(z) as quadratic factors that are followed from sample to sample (paper, eq. (23)).

A(z) of even degree p is the product of p/2 factors z^2 + b z + c, one per mode. A mode keeps its factor ("slot"): each
is warm-started from the previous sample and polished by Bairstow's Newton steps. Only when these do not converge, or
two slots fall onto the same factor, all roots are found afresh and handed to the nearest slots. Slots are filled in
order of frequency: at the first sample with poles, and once more when the first memory is full and they mean something.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.polynomial import all_roots

NEWTON_STEPS = 6
# A Newton step smaller than this leaves an error of about its square, far below the coefficients' own noise.
CONVERGED = 1e-5
# The factors' sum must reproduce a1 to this accuracy, else two slots hold the same factor.
CONSISTENT = 1e-6


class PoleState(NamedTuple):
    """Factors ``[b, c]`` of every mode slot, ``factors[m, 2]``, and work space for finding them afresh."""

    factors: np.ndarray
    found: np.ndarray
    roots: np.ndarray
    taken: np.ndarray
    known: np.ndarray


def new_state(p: int) -> PoleState:
    """Fresh state for a polynomial of even degree p: no factor known yet."""
    modes = p // 2
    return PoleState(
        factors=np.zeros((modes, 2)),
        found=np.zeros((modes, 2)),
        roots=np.zeros(p, dtype=np.complex128),
        taken=np.zeros(p, dtype=np.bool_),
        known=np.zeros(1, dtype=np.bool_),
    )


@njit(forceinline=True, **OPTIONS)
def bairstow_step(p, a, b, c):
    """Newton step (db, dc) that takes z^2 + b z + c towards a factor of z^p + a[0] z^(p-1) + ... + a[p-1]."""
    # h: coefficients of the quotient by synthetic division, g: those of a second division
    h1, h2 = 1.0, 0.0  # h[i-1], h[i-2]
    g0, g1, g2 = 1.0, 0.0, 0.0  # g[i-1], g[i-2], g[i-3]
    for i in range(p - 1):
        h = a[i] - b * h1 - c * h2
        h1, h2 = h, h1
        g = h - b * g0 - c * g1
        g0, g1, g2 = g, g0, g1
    remainder = h1
    last = a[p - 1] - b * h1 - c * h2
    # after the loop g0, g1, g2 = g[p-1], g[p-2], g[p-3]
    inverse = 1.0 / (g1 * g1 - g2 * g0)
    return (remainder * g1 - last * g2) * inverse, (last * g1 - remainder * g0) * inverse


@njit(forceinline=True, **OPTIONS)
def polish(p, a, factors):
    """Newton-polish all factors; returns whether they converged to p/2 different ones."""
    total = 0.0
    for m in range(p // 2):
        b = factors[m, 0]
        c = factors[m, 1]
        converged = False
        for _ in range(NEWTON_STEPS):
            db, dc = bairstow_step(p, a, b, c)
            b += db
            c += dc
            if abs(db) + abs(dc) < CONVERGED:
                converged = True
                break
        if not converged:
            return False
        factors[m, 0] = b
        factors[m, 1] = c
        total += b
    return abs(total - a[0]) < CONSISTENT


@njit(**OPTIONS)
def pair_roots(p, roots, taken, found):
    """Join conjugate roots, and neighbouring real ones, to quadratic factors, most oscillatory first."""
    taken[:] = False
    for m in range(p // 2):
        first = -1
        for i in range(p):
            if not taken[i] and (first < 0 or abs(roots[i].imag) > abs(roots[first].imag)):
                first = i
        taken[first] = True
        partner = -1
        target = roots[first].conjugate()
        for i in range(p):
            if not taken[i] and (partner < 0 or abs(roots[i] - target) < abs(roots[partner] - target)):
                partner = i
        taken[partner] = True
        found[m, 0] = -(roots[first] + roots[partner]).real
        found[m, 1] = (roots[first] * roots[partner]).real


@njit(**OPTIONS)
def angle_order(b, c):
    """Number that grows with the angle of the factor's poles; real pairs come last."""
    return -b / (2.0 * math.sqrt(c)) if 4.0 * c > b * b else -2.0


@njit(**OPTIONS)
def find_afresh(p, a, state):
    """Find all factors from nothing and hand them to the slots: by frequency the first time, then to the nearest."""
    factors, found, roots, taken, known = state
    modes = p // 2
    all_roots(p, a, roots)
    pair_roots(p, roots, taken, found)
    if not known[0]:
        known[0] = True
        for m in range(modes):  # lowest frequency into slot 0: cosine of the angle falls with frequency
            best = m
            for k in range(m + 1, modes):
                if angle_order(found[k, 0], found[k, 1]) > angle_order(found[best, 0], found[best, 1]):
                    best = k
            for i in range(2):
                factors[m, i] = found[best, i]
                found[best, i] = found[m, i]
        return
    # greedy: the closest pair of slot and factor first
    taken[:] = False
    assigned = taken[modes:]
    for _ in range(modes):
        nearest = np.inf
        slot = -1
        source = -1
        for m in range(modes):
            if assigned[m]:
                continue
            for k in range(modes):
                distance = abs(factors[m, 0] - found[k, 0]) + abs(factors[m, 1] - found[k, 1])
                if not taken[k] and distance < nearest:
                    nearest = distance
                    slot = m
                    source = k
        assigned[slot] = True
        taken[source] = True
        factors[slot, 0] = found[source, 0]
        factors[slot, 1] = found[source, 1]


@njit(forceinline=True, **OPTIONS)
def forget_slots(state):
    """Fill the slots anew, in order of frequency, at the next sample."""
    state.known[0] = False


@njit(forceinline=True, **OPTIONS)
def follow(p, a, state):
    """Bring the factors of every slot up to date with the coefficients ``a[p]``."""
    if not state.known[0] or not polish(p, a, state.factors):
        find_afresh(p, a, state)
