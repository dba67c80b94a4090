"""Poles of A(z) as quadratic factors that are followed from sample to sample (paper, eq. (23)).

A(z) of even degree p is the product of p/2 factors z^2 + b z + c, one per mode. A mode keeps its factor ("slot"): each
is warm-started from a sample before and polished by Bairstow's Newton steps. Only when these do not converge, or
slots have changed places, all roots are found afresh and handed to the nearest slots. Slots are filled in
order of frequency: at the first sample with poles, and once more when the first memory is full and they mean something.

Poles teach the recursion nothing, so they can wait for the coefficients of several samples. The samples of a recursion
are divided into stretches, and all of one start from where the stretch before ended: they do not wait for each other
and go side by side in lanes. Stretches lie on the grid of the recursion's samples, so that blocks change nothing
(docs/decisions/0064-poles-of-a-stretch.md).
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numba.extending import register_jitable

from chatter_monitor.kernels.lanes import as_lanes, bits, fma, part, select, spread
from chatter_monitor.kernels.odp import TILE
from chatter_monitor.kernels.options import EXACT, OPTIONS
from chatter_monitor.kernels.polynomial import all_roots

NEWTON_STEPS = 6
# A Newton step smaller than this leaves an error of about its square, far below the coefficients' own noise.
CONVERGED = 1e-5
# What is asked of a sample: nothing; factors near the last ones; factors from nothing.
NOTHING, NEAR, AFRESH = range(3)


class PoleState(NamedTuple):
    """Rows of lanes or numbers.

    ``factors[2 m]`` and the next are b and c of mode m; ``origin`` is the same where the stretch began, NaN where that
    is no guide; ``known[0]`` tells whether there are any, ``passed[0]`` how many samples of the stretch have come.
    """

    factors: np.ndarray
    origin: np.ndarray
    known: np.ndarray
    passed: np.ndarray


class Stretch(NamedTuple):
    """Samples that go side by side, one in each lane or number of a row: room for a whole stretch of some recursions.

    ``coefficients[p]`` rows of A; ``rest[p]`` rows of what is left of them to factor; ``start[p]`` rows of the factors
    to start from; ``asked`` one row.
    """

    coefficients: np.ndarray
    rest: np.ndarray
    start: np.ndarray
    asked: np.ndarray


class Search(NamedTuple):
    """Work space for one lane's factors: ``coefficients[p]``, ``factors[modes, 2]`` and more."""

    coefficients: np.ndarray
    rest: np.ndarray
    factors: np.ndarray
    found: np.ndarray
    roots: np.ndarray
    taken: np.ndarray


@register_jitable(forceinline=True, **EXACT)
def rows(p):
    """How many rows the state has."""
    return 2 * p + 2


@register_jitable(forceinline=True, **EXACT)
def parts(p, memory):
    """State in an array of so many rows."""
    return PoleState(
        factors=part(memory, 0, p),
        origin=part(memory, p, 2 * p),
        known=part(memory, 2 * p, 2 * p + 1),
        passed=part(memory, 2 * p + 1, 2 * p + 2),
    )


def begin(p: int, memory: np.ndarray) -> None:
    """Make zeros a fresh state."""
    parts(p, memory).origin[:] = math.nan


def new_stretch(p: int) -> Stretch:
    """Allocate it."""
    coefficients, rest, start = np.zeros((3, p * TILE))
    return Stretch(coefficients, rest, start, np.zeros(TILE))


def new_search(p: int) -> Search:
    """Allocate it."""
    modes = p // 2
    return Search(
        coefficients=np.zeros(p),
        rest=np.zeros(p),
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
def polish(p, a, rest, start, factors, wanted):
    """Newton-polish one factor, divide it out, and so on; returns where that converged with each in its slot."""
    polished = wanted
    for i in range(p):
        rest[i] = a[i]
    for m in range(p // 2 - 1):
        degree = p - 2 * m
        b, c = start[2 * m], start[2 * m + 1]
        moving = wanted
        for _ in range(NEWTON_STEPS):
            db, dc = bairstow_step(degree, rest, b, c)
            b, c = select(moving, b + db, b), select(moving, c + dc, c)
            moving = moving & ~(abs(db) + abs(dc) < CONVERGED)
            if not bits(moving):
                break
        polished = polished & ~moving
        factors[2 * m], factors[2 * m + 1] = b, c
        h1, h2 = spread(1.0, b), spread(0.0, b)
        for i in range(degree - 2):
            h1, h2 = fma(-b, h1, fma(-c, h2, rest[i])), h1
            rest[i] = h1
    factors[p - 2], factors[p - 1] = rest[0], rest[1]
    for m in range(p // 2):
        for k in range(m):
            stayed = _distance(factors, m, start, m) + _distance(factors, k, start, k)
            crossed = _distance(factors, m, start, k) + _distance(factors, k, start, m)
            polished = polished & ~(crossed < stayed)
    return polished


@njit(forceinline=True, **EXACT)
def _distance(x, m, y, k):
    """How far factor m of x is from factor k of y."""
    return abs(x[2 * m] - y[2 * k]) + abs(x[2 * m + 1] - y[2 * k + 1])


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
    a, _rest, factors, found, roots, taken = search
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


@njit(**EXACT)
def _near_or_afresh(p, known, search):
    """Factors from those of the sample before, if Newton's steps lead to any, else from nothing."""
    if known:
        near, found = search.factors.reshape(p), search.found.reshape(p)
        a, start, factors = as_lanes(search.coefficients, 1), as_lanes(near, 1), as_lanes(found, 1)
        if bits(polish(p, a, as_lanes(search.rest, 1), start, factors, start[0] == start[0])):
            for i in range(p):
                near[i] = found[i]
            return
    find_afresh(p, known, search)


@njit(**EXACT)
def _one_by_one(p, lane, size, polished, numbers, coefficients, asked, factors, search):
    """Go through the samples of one lane's stretch, where not all have come out well; arguments as of `follow`.

    ``coefficients``, ``asked`` and ``factors`` are the numbers behind the rows, ``polished`` bits of an integer.
    """
    lanes, places = numbers.shape[1], asked.shape[0]
    state = parts(p, numbers)
    misled = False
    for t in range(size):
        place = t * lanes + lane
        if asked[place] == AFRESH:  # what is left of the stretch has no guide
            misled = True
            state.known[0, lane] = 0.0
            state.origin[:, lane] = math.nan
        if asked[place] != NOTHING and (misled or not polished >> place & 1):
            for i in range(p):
                search.coefficients[i] = coefficients[i * places + place]
                search.factors[i // 2, i % 2] = state.factors[i, lane]
            _near_or_afresh(p, state.known[0, lane] != 0.0, search)
            state.known[0, lane] = 1.0
            for i in range(p):
                state.factors[i, lane] = search.factors[i // 2, i % 2]
        elif asked[place] != NOTHING:
            for i in range(p):
                state.factors[i, lane] = factors[i * places + place]
        for i in range(p):
            factors[i * places + place] = state.factors[i, lane]


@njit(forceinline=True, **EXACT)
def follow(p, lanes, size, state, numbers, stretch, factors, search):
    """Find the factors of so many samples of each recursion, which lie in one stretch of it.

    Parameters
    ----------
    p, lanes : int
        Degree of A; how many recursions go side by side: constants.
    size : int
        Samples.
    state, numbers : PoleState, ndarray of float64, shape (rows, lanes)
        The same, changed in place.
    stretch : Stretch
        A place for each sample of the first one's lanes, then of the second one's, and so on, `TILE` places in all.
        Nothing is asked of samples that have not come.
    factors : ndarray of float64, shape (p TILE,)
        The result, rows as in a `PoleState`; where nothing was asked what the last sample had.
    search : Search
        Work space.
    """
    tall = TILE // lanes
    start, found = as_lanes(stretch.start, lanes), as_lanes(factors, lanes)
    for i in range(p):
        for t in range(tall):
            start[i * tall + t] = state.origin[i]
    near = as_lanes(stretch.asked, TILE)[0] == NEAR
    polished = bits(
        polish(
            p,
            as_lanes(stretch.coefficients, TILE),
            as_lanes(stretch.rest, TILE),
            as_lanes(stretch.start, TILE),
            as_lanes(factors, TILE),
            near,
        )
    )
    if polished == (1 << (size * lanes)) - 1:
        for i in range(p):
            state.factors[i] = found[i * tall + size - 1]
    else:
        for lane in range(lanes):
            _one_by_one(p, lane, size, polished, numbers, stretch.coefficients, stretch.asked, factors, search)
    passed = state.passed[0] + size
    over = passed == tall
    state.passed[0] = select(over, 0.0, passed)
    for i in range(p):
        state.origin[i] = select(over & (state.known[0] > 0.0), state.factors[i], state.origin[i])
