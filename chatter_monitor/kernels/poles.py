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
from numba.extending import register_jitable

from chatter_monitor.kernels.lanes import bits, fma, select, spread
from chatter_monitor.kernels.options import EXACT, OPTIONS
from chatter_monitor.kernels.polynomial import all_roots

NEWTON_STEPS = 6
# A Newton step smaller than this leaves an error of about its square, far below the coefficients' own noise.
CONVERGED = 1e-5
# The factors' sum must reproduce a1 to this accuracy, else two slots hold the same factor.
CONSISTENT = 1e-6


class PoleState(NamedTuple):
    """Rows of lanes or numbers: factor ``[b, c]`` of mode m at ``factors[2 m]``, and whether they are ``known[0]``."""

    factors: np.ndarray
    known: np.ndarray


class Search(NamedTuple):
    """Work space for finding one lane's factors afresh: ``coefficients[p]``, ``factors[modes, 2]`` and more."""

    coefficients: np.ndarray
    factors: np.ndarray
    found: np.ndarray
    roots: np.ndarray
    taken: np.ndarray


@register_jitable(forceinline=True, **EXACT)
def rows(p):
    """How many rows the state has."""
    return p + 1


@register_jitable(forceinline=True, **EXACT)
def parts(p, memory):
    """State in `memory`, an array of zeros at first."""
    return PoleState(memory[:p], memory[p : p + 1])


def new_search(p: int) -> Search:
    """Allocate it."""
    modes = p // 2
    return Search(
        coefficients=np.zeros(p),
        factors=np.zeros((modes, 2)),
        found=np.zeros((modes, 2)),
        roots=np.zeros(p, dtype=np.complex128),
        taken=np.zeros(p, dtype=np.bool_),
    )


@njit(forceinline=True, **EXACT)
def bairstow_step(p, a, b, c):
    """Newton step (db, dc) that takes z^2 + b z + c towards a factor of z^p + a[0] z^(p-1) + ... + a[p-1]."""
    # h: coefficients of the quotient by synthetic division, g: those of a second division
    h1, h2 = spread(1.0, b), spread(0.0, b)  # h[i-1], h[i-2]
    g0, g1, g2 = h1, h2, h2  # g[i-1], g[i-2], g[i-3]
    for i in range(p - 1):
        h = fma(-b, h1, fma(-c, h2, a[i]))
        h1, h2 = h, h1
        g = fma(-b, g0, fma(-c, g1, h))
        g0, g1, g2 = g, g0, g1
    remainder = h1
    last = fma(-b, h1, fma(-c, h2, a[p - 1]))
    # after the loop g0, g1, g2 = g[p-1], g[p-2], g[p-3]
    inverse = 1.0 / fma(g1, g1, -(g2 * g0))
    return fma(remainder, g1, -(last * g2)) * inverse, fma(last, g1, -(remainder * g0)) * inverse


@njit(forceinline=True, **EXACT)
def polish(p, a, factors, wanted):
    """Newton-polish all factors in the wanted lanes; returns where they converged to p/2 different ones."""
    moving = wanted
    for _ in range(NEWTON_STEPS):
        left = moving & ~moving
        for m in range(p // 2):
            b = factors[2 * m]
            c = factors[2 * m + 1]
            db, dc = bairstow_step(p, a, b, c)
            factors[2 * m] = select(moving, b + db, b)
            factors[2 * m + 1] = select(moving, c + dc, c)
            left = left | ~(abs(db) + abs(dc) < CONVERGED)
        moving = moving & left
        if not bits(moving):
            break
    excess = -a[0]
    for m in range(p // 2):
        excess = excess + factors[2 * m]
    return wanted & ~moving & (abs(excess) < CONSISTENT)


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
def find_afresh(p, known, search):
    """Find all factors from nothing and hand them to the slots: by frequency unless known, then to the nearest."""
    a, factors, found, roots, taken = search
    modes = p // 2
    all_roots(p, a, roots)
    pair_roots(p, roots, taken, found)
    if not known:
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


@njit(**OPTIONS)
def _find_afresh_in(lane, p, coefficients, factors, known, search):
    """`find_afresh` for one lane of arrays of shape (rows, lanes)."""
    for i in range(p):
        search.coefficients[i] = coefficients[i, lane]
        search.factors[i // 2, i % 2] = factors[i, lane]
    find_afresh(p, known[0, lane] != 0.0, search)
    for i in range(p):
        factors[i, lane] = search.factors[i // 2, i % 2]
    known[0, lane] = 1.0


@njit(forceinline=True, **EXACT)
def follow(p, a, state, wanted, numbers, search):
    """Bring the factors of every slot up to date with the coefficients ``a[p]`` in the wanted lanes.

    ``numbers`` are the arrays behind the lanes of a, factors and known, shape (rows, lanes).
    """
    polished = polish(p, a, state.factors, wanted & (state.known[0] > 0.0))
    lost = bits(wanted & ~polished)
    for lane in range(numbers[0].shape[1] if lost else 0):
        if lost >> lane & 1:
            _find_afresh_in(lane, p, *numbers, search)
