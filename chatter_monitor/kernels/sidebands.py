"""How well a vibration with evenly spaced sidebands explains lines of a spectrum, and how well a comb does.

A vibration that excites itself in a machine that turns has two frequencies, its own and that of the teeth, and lines at
sums and differences of their multiples: it is quasi-periodic. What is forced has one.

Both explanations are counted alike: for each line -ln(chance to lie so near to one of their places), less what the
choice of these lines among all is worth, and less the lines that the explanation was made from. Two frequencies have
lines at small multiples of both; of a low frequency that nearly divides them these are a few large multiples out of
hundreds, and nothing tells why these. So of the places of either explanation the choice of those that have a line is
weighed as well, unless a comb is one that a machine may have.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.options import OPTIONS

# Multiples of the vibration's frequency that have sidebands; beside those there are multiples of the spacing itself.
OVERTONES = 2
# How far from any multiple of the spacing the vibration has to be, and that from any of the vibration: in tolerances,
# and relatively, for a speed that wanders blurs high multiples, which then have crests beside them.
CLEAR, CLEAR_SHARE = 3.0, 0.006
# Most teeth of a spindle. What a chip is thick varies from tooth to tooth, so that the rotation is heard between them.
MOST_TEETH = 6
# A comb has a spacing among its multiples when that is so near to one, as a part of the comb's own.
SAME = 0.02
# Two lines make an explanation; with less than so many nothing is explained.
FEWEST = 4
# A spacing that comes from two lines is so exact, in their tolerances; then it is fitted to all.
ROUGHLY = 2.0


class Beside(NamedTuple):
    """Sidebands that a comb is held against: their spacing, and how scattered they are (`scattered_sidebands`).

    And how many teeth a rotation has, where the spacing is known to be theirs; 1 where that is not known.
    """

    spacing: float
    scattered: float
    teeth: int


@njit(**OPTIONS)
def best_sidebands(frequencies, tolerances, carriers, low, high, teeth, parts, factorials, best):
    """The vibration with the spacing of its sidebands that explain lines best.

    Parameters
    ----------
    frequencies, tolerances : ndarray of float64, shape (lines,)
        Where lines are, and how exactly that is known.
    carriers : int
        The vibration is one of the first so many.
    low, high : float
        Range of the spacing.
    teeth : int
        Of the spindle whose rotation the range is about, as in `kernels.comb.surprise`.
    parts : int
        The distance of a line from the vibration is up to so many times the spacing.
    factorials : ndarray of float64, shape (>= lines,)
        Logarithms of the factorials of the numbers from 0 on.
    best : ndarray of float64, shape (3,)
        The result: frequency of the vibration and spacing, fitted to the lines, and the logarithm of how many were
        tried.

    Returns
    -------
    float
        Log odds against chance, over all that were tried; two lines are explained for certain.
    """
    evidence = 0.0
    tried = 0
    for c in range(carriers):
        for i in range(frequencies.shape[0]):
            distance = abs(frequencies[i] - frequencies[c])
            first = max(1, math.ceil(distance / high))
            for part in range(first, min(int(distance / low), first + parts - 1) + 1):
                hits, carrier, spacing = _fitted(frequencies, tolerances, frequencies[c], distance / part)
                if not is_clear(carrier, spacing, tolerances[c]):
                    continue
                tried += 1
                if hits < FEWEST:
                    continue
                gain = _gain(frequencies, tolerances, c, carrier, spacing, teeth, factorials)
                if gain > evidence:
                    evidence = gain
                    best[0], best[1] = carrier, spacing
    best[2] = math.log(max(tried, 1))
    return evidence - best[2]


@njit(**OPTIONS)
def best_comb(frequencies, tolerances, without, low, high, teeth, beside, factorials):
    """Log odds against chance, over all that were tried, of the best comb of all lines but one (``without``).

    Where the teeth are not known the rotation may be heard between them. A comb that is none of a machine with the
    spacing of the sidebands ``beside`` has to tell, as they do, why it has lines at some of its places and not at
    others. Other parameters as in `best_sidebands`.
    """
    evidence = 0.0
    tried = 0
    most = MOST_TEETH if teeth == 1 else 1
    for i in range(frequencies.shape[0]):
        if i == without:
            continue
        for multiple in range(max(1, math.ceil(frequencies[i] / high)), int(frequencies[i] / low) + 1):
            tried += most
            hits, spacing = _fitted_comb(frequencies, tolerances, without, frequencies[i] / multiple)
            if hits < FEWEST - 1:  # one line makes a comb
                continue
            of_machine = _turns_with(spacing, beside)
            for parts in range(1, most + 1):
                gain = _gain_of_comb(frequencies, tolerances, without, spacing, teeth, parts, factorials)
                if not of_machine and gain + beside.scattered > evidence:
                    gain += beside.scattered - _scattered_comb(frequencies, tolerances, without, spacing, parts)
                evidence = max(evidence, gain)
    return evidence - math.log(tried) if tried > 0 else 0.0


@njit(**OPTIONS)
def comb_of(frequencies, tolerances, without, beside, teeth, factorials):
    """Log odds against chance of the comb of the spacing ``beside`` alone, or of teeth so far apart and their rotation.

    Other parameters as in `best_comb`.
    """
    evidence = 0.0
    for parts in range(1, max(MOST_TEETH, beside.teeth) + 1):
        if not _may_have(parts, beside.teeth):
            continue
        told = teeth if parts == 1 else 1
        _, rotation = _fitted_comb(frequencies, tolerances, without, beside.spacing / parts)
        evidence = max(evidence, _gain_of_comb(frequencies, tolerances, without, rotation, told, parts, factorials))
    return evidence


@njit(**OPTIONS)
def _turns_with(spacing, beside):
    """Whether a comb of this spacing is that of a rotation whose teeth are so far apart, or of these alone."""
    teeth = np.rint(beside.spacing / spacing)
    return _may_have(teeth, beside.teeth) and abs(beside.spacing / spacing - teeth) < SAME


@njit(**OPTIONS)
def _may_have(parts, teeth):
    """Whether a rotation may have so many parts: one, as many as it has teeth, or up to `MOST_TEETH` if that is 1."""
    return parts == 1 or parts == teeth or (teeth == 1 and 1 <= parts <= MOST_TEETH)


@njit(**OPTIONS)
def _fitted_comb(frequencies, tolerances, without, spacing):
    """How many lines are roughly at multiples, and the spacing by least squares over them."""
    hits = 0
    information = score = 0.0
    for j in range(frequencies.shape[0]):
        order = np.rint(frequencies[j] / spacing)
        if j != without and order >= 1.0 and abs(frequencies[j] - order * spacing) <= ROUGHLY * tolerances[j]:
            weight = tolerances[j] ** -2.0
            information += weight * order * order
            score += weight * order * frequencies[j]
            hits += 1
    return hits, score / information if hits > 0 else spacing


@njit(**OPTIONS)
def _gain_of_comb(frequencies, tolerances, without, spacing, teeth, parts, factorials):
    """Log odds of a comb; lines at every so many multiples (``parts``: the teeth) and others are told apart."""
    total = rarest = 0.0
    hits = whole = 0
    n = frequencies.shape[0]
    for j in range(n):
        order = np.rint(frequencies[j] / spacing)
        if j != without and order >= 1.0 and abs(frequencies[j] - order * spacing) <= tolerances[j]:
            at_teeth = order % parts == 0.0
            places = 1 if at_teeth else parts - 1
            surprise = _surprise(2.0 * places * tolerances[j], parts * spacing, order, teeth)
            total += surprise
            rarest = max(rarest, surprise)
            hits += 1
            whole += at_teeth
    return total - rarest - _choices(n - 1, hits - 1, factorials) - _choices(hits, whole, factorials)


@njit(**OPTIONS)
def _scattered_comb(frequencies, tolerances, without, spacing, parts):
    """Logarithm of the ways to choose the multiples that have a line among all where there are some.

    There are lines in three ranges, where modes are: what is between these, in the widest two gaps, does not count.
    """
    hits = whole = 0
    highest = widest = second = 0.0
    lowest = order = _next_multiple(frequencies, tolerances, without, spacing, 0.0)
    while order < math.inf:
        hits += 1
        whole += order % parts == 0.0
        highest = order
        order = _next_multiple(frequencies, tolerances, without, spacing, order)
        if order < math.inf:
            gap = order - highest - 1.0
            widest, second = max(widest, gap), max(second, min(widest, gap))
    return _ways(highest - lowest + 1.0 - widest - second, hits, parts, whole) if hits > 0 else 0.0


@njit(**OPTIONS)
def _next_multiple(frequencies, tolerances, without, spacing, order):
    """The lowest multiple beyond one that has a line; infinity if there is none."""
    lowest = math.inf
    for i in range(frequencies.shape[0]):
        multiple = np.rint(frequencies[i] / spacing)
        if i != without and multiple > order and abs(frequencies[i] - multiple * spacing) <= tolerances[i]:
            lowest = min(lowest, multiple)
    return lowest


@njit(**OPTIONS)
def scattered_sidebands(frequencies, tolerances, carrier, spacing, teeth):
    """The same of the sidebands of a vibration, its overtone's, and the forced lines, each where they are.

    The spacing is that of a rotation with so many teeth, or with any number of them if that is 1.
    """
    total = 0.0
    for overtone in range(OVERTONES + 1):
        fewest = math.inf
        for parts in range(1, max(MOST_TEETH, teeth) + 1):
            if _may_have(parts, teeth):
                fewest = min(fewest, _scattered_around(frequencies, tolerances, carrier, spacing, overtone, parts))
        total += fewest
    return total


@njit(**OPTIONS)
def _scattered_around(frequencies, tolerances, carrier, spacing, overtone, parts):
    """The same of those around one multiple of the vibration's frequency."""
    hits = whole = 0
    lowest, highest = math.inf, -math.inf
    for i in range(frequencies.shape[0]):
        around, multiple = _place(frequencies[i], tolerances[i], carrier, spacing, 1.0 / spacing)
        if around == overtone:
            hits += 1
            whole += multiple % parts == 0.0
            lowest, highest = min(lowest, multiple), max(highest, multiple)
    return _ways(highest - lowest + 1.0, hits, parts, whole) if hits > 0 else 0.0


@njit(**OPTIONS)
def _ways(places, hits, parts, whole):
    """Logarithm of the ways to choose among places, those of teeth (every so many, ``parts``) and others apart."""
    of_teeth = max(places / parts, 1.0 * whole)
    others = max(places - of_teeth, 1.0 * (hits - whole))
    return _log_choices(of_teeth, whole) + _log_choices(others, hits - whole)


@njit(**OPTIONS)
def _log_choices(n, k):
    """The same as `_choices` of any number, whole or not."""
    return math.lgamma(n + 1.0) - math.lgamma(k + 1.0) - math.lgamma(n - k + 1.0)


@njit(**OPTIONS)
def is_clear(carrier, spacing, tolerance):
    """Whether neither is a multiple of the other, nor the line one of a half or third of a spacing: teeth not alike."""
    if _away(carrier, spacing / 2.0) <= ROUGHLY * tolerance or _away(carrier, spacing / 3.0) <= ROUGHLY * tolerance:
        return False
    least = CLEAR * tolerance
    return min(_away(carrier, spacing), _away(spacing, carrier)) > least + CLEAR_SHARE * max(carrier, spacing)


@njit(**OPTIONS)
def _away(hertz, spacing):
    """Distance from the nearest multiple."""
    return abs(hertz - np.rint(hertz / spacing) * spacing)


@njit(**OPTIONS)
def _place(hertz, tolerance, carrier, spacing, inverse):
    """Of which multiples of the vibration's frequency and of the spacing (1 / ``inverse``) a line is; -1 for none."""
    for overtone in range(OVERTONES + 1):
        away = hertz - overtone * carrier
        multiple = np.rint(away * inverse)
        if abs(away - multiple * spacing) <= tolerance and (overtone > 0 or multiple >= 1.0):
            return overtone, multiple
    return -1, 0.0


@njit(**OPTIONS)
def _fitted(frequencies, tolerances, carrier, spacing):
    """How many lines are roughly where these two have them, and both by least squares over those."""
    hits = 0
    inverse = 1.0 / spacing
    aa = ab = bb = ay = by = 0.0
    for i in range(frequencies.shape[0]):
        overtone, multiple = _place(frequencies[i], ROUGHLY * tolerances[i], carrier, spacing, inverse)
        if overtone >= 0:
            hits += 1
            weight = tolerances[i] ** -2.0
            aa += weight * overtone * overtone
            ab += weight * overtone * multiple
            bb += weight * multiple * multiple
            ay += weight * overtone * frequencies[i]
            by += weight * multiple * frequencies[i]
    determinant = aa * bb - ab * ab
    if not determinant > 1e-9 * aa * bb:
        return hits, carrier, spacing
    return hits, (bb * ay - ab * by) / determinant, (aa * by - ab * ay) / determinant


@njit(**OPTIONS)
def _gain(frequencies, tolerances, vibration, carrier, spacing, teeth, factorials):
    """Log odds of a vibration with sidebands; multiples of the spacing go with them, as a forced comb does."""
    total = rarest = 0.0
    hits = forced = 0
    inverse = 1.0 / spacing
    for i in range(frequencies.shape[0]):
        overtone, multiple = _place(frequencies[i], tolerances[i], carrier, spacing, inverse)
        if i == vibration or overtone < 0:
            continue
        places = OVERTONES if overtone > 0 else 1
        surprise = _surprise(2.0 * places * tolerances[i], spacing, multiple, teeth)
        total += surprise
        rarest = max(rarest, surprise)
        hits += 1
        forced += overtone == 0
    n = frequencies.shape[0]
    return total - rarest - _choices(n - 2, hits - 1, factorials) - _choices(hits, forced, factorials)


@njit(**OPTIONS)
def _surprise(width, spacing, multiple, teeth):
    """-ln(chance) that a line is so near to one of these places: places of the teeth are rarer."""
    return max(0.0, -math.log(width / (spacing * (teeth if multiple % teeth == 0.0 else 1))))


@njit(**OPTIONS)
def _choices(n, k, factorials):
    """Logarithm of the number of ways to choose k of n."""
    k = min(max(k, 0), n)
    return factorials[n] - factorials[k] - factorials[n - k]
