"""Lines of a spectrum, and how well multiples of a frequency, or a vibration with its sidebands, explain them."""

import math

import numpy as np
from numba import njit

from chatter_monitor.kernels.median import median
from chatter_monitor.kernels.options import EXACT, OPTIONS

FLOOR_BINS = 128
# Bins on either side of a line in which the noise beside it is heard: nearer than the sidebands of another line.
BESIDE = 16
GROUP = 8  # bins that are looked at together, before each by itself
# What a self-excited vibration brings along: multiples of its frequency, and sidebands on either side of each.
OVERTONES = 3
SIDEBANDS = 4
FORCED = 8  # and multiples of the sidebands' spacing
PARTS = 3  # the distance of two sidebands is up to so many times their spacing


@njit(**EXACT)
def power_of(amplitudes, power):
    """Fill in the power of complex amplitudes."""
    for b in range(power.shape[0]):
        power[b] = amplitudes[b].real * amplitudes[b].real + amplitudes[b].imag * amplitudes[b].imag


@njit(**OPTIONS)
def crests(power, line_to_noise, lowest, scratch, peaks):
    """Local maxima of a spectrum that stand out of the noise around them.

    Parameters
    ----------
    power : ndarray of float64, shape (n,)
        A multiple of `FLOOR_BINS`. The noise of so many is the median of every second one (neighbours know little that
        is new) of an exponential distribution.
    line_to_noise : float
        Least ratio of a maximum to the noise.
    lowest : int
        First bin that counts.
    scratch : ndarray of float64, shape (FLOOR_BINS / 2,)
        Work space.
    peaks : ndarray of int64, shape (n,)
        The result: their bins.

    Returns
    -------
    int
        How many there are.
    """
    count = 0
    middle = FLOOR_BINS // 4
    for begin in range(0, power.shape[0], FLOOR_BINS):
        highest = 0.0
        for b in range(begin, begin + FLOOR_BINS):
            highest = max(highest, power[b])
        enough = highest * math.log(2.0) / line_to_noise
        loud = 0
        for i in range(FLOOR_BINS // 2):
            loud += power[begin + 2 * i] > enough
        if loud > middle:  # so is the median, and nothing stands out: no need to find it
            continue
        for i in range(FLOOR_BINS // 2):
            scratch[i] = power[begin + 2 * i]
        upper = median(scratch)
        lower = scratch[0]
        for i in range(1, middle):
            lower = max(lower, scratch[i])
        threshold = line_to_noise * (0.5 * (lower + upper) / math.log(2.0))
        for b in range(max(begin, lowest, 1), min(begin + FLOOR_BINS, power.shape[0] - 1)):
            if power[b] > threshold and _is_crest(power, b):
                peaks[count] = b
                count += 1
    return count


@njit(**OPTIONS)
def crests_beside(power, line_to_noise, lowest, least, peaks):
    """As `crests`, beside stronger lines, too: the noise is the median of the `BESIDE` bins on either side.

    What has less power than ``least`` does not count.
    """
    count = 0
    first, last = max(lowest, 1), power.shape[0] - 1
    for begin in range(first, last, GROUP):
        end = min(begin + GROUP, last)
        highest = 0.0
        for b in range(begin, end):
            highest = power[b] if power[b] > highest else highest
        if highest < least or _loud_beside_all(power, begin, highest * math.log(2.0) / line_to_noise):
            continue
        for b in range(begin, end):
            if power[b] >= least and _is_crest(power, b):
                # no more than half of them are louder, so the median is not
                enough = power[b] * math.log(2.0) / line_to_noise
                low, high = max(b - BESIDE, 0), min(b + BESIDE, last)
                loud = 0
                for i in range(low, high + 1):
                    loud += power[i] > enough
                if 2 * loud <= high - low:
                    peaks[count] = b
                    count += 1
    return count


@njit(**OPTIONS)
def _loud_beside_all(power, begin, enough):
    """Whether more than half of the bins beside any bin of a group are louder than is enough for its loudest one.

    Those that are beside all of them tell, as nearly always: then none of the group stands out.
    """
    if begin < BESIDE or begin + GROUP + BESIDE > power.shape[0]:
        return False
    beside = power[begin + GROUP - 1 - BESIDE :]
    loud = 0
    for i in range(2 * BESIDE + 2 - GROUP):
        loud += beside[i] > enough
    return loud > BESIDE


@njit(**OPTIONS)
def _is_crest(power, b):
    """Whether a bin is a local maximum; of equal ones the first is."""
    return power[b] > power[b - 1] and power[b] >= power[b + 1]


@njit(**OPTIONS)
def apart(frequencies, least, kept):
    """Put the indices of the first lines that are at least so far (``least``, Hz) from all before into ``kept``.

    Returns how many were found; ``kept`` has room for as many as are wanted.
    """
    count = 0
    for i in range(frequencies.shape[0]):
        if count == kept.shape[0]:
            break
        alone = True
        for k in range(count):
            alone = alone and abs(frequencies[i] - frequencies[kept[k]]) > least[i]
        if alone:
            kept[count] = i
            count += 1
    return count


@njit(**OPTIONS)
def common_without_one(orders, common):
    """Greatest common divisor of all orders but one, for each of them, shape (n,) both; of one order that itself."""
    if orders.shape[0] == 1:
        common[0] = orders[0]
        return
    behind = 0
    for i in range(orders.shape[0] - 1, -1, -1):
        common[i] = behind
        behind = math.gcd(behind, orders[i])
    before = 0
    for i in range(orders.shape[0]):
        common[i] = math.gcd(before, common[i])
        before = math.gcd(before, orders[i])


@njit(**OPTIONS)
def surprise(frequencies, tolerances, low, high, teeth, candidates, gains, hits):
    """Log odds against chance that lines lie on the multiples of each frequency that makes one of them a multiple.

    Parameters
    ----------
    frequencies, tolerances : ndarray of float64, shape (lines,)
        Where lines are, and how exactly that is known.
    low, high : float
        Range of the candidates.
    teeth : int
        Of the spindle: its lines are at multiples of their passing first of all. A line at one of those is so many
        times less likely to be there by chance. 1 where it is unknown.
    candidates, gains : ndarray of float64, shape (room,)
        Each candidate, and the sum over its lines of -ln(chance that a line is so close to a multiple), less that of
        the rarest of them, because the candidate was made from one.
    hits : ndarray of int64, shape (room,)
        Lines on the multiples of each candidate.

    Returns
    -------
    int
        Number of candidates.
    """
    made = 0
    for i in range(frequencies.shape[0]):
        for multiple in range(max(1, math.ceil(frequencies[i] / high)), int(frequencies[i] / low) + 1):
            candidate = frequencies[i] / multiple
            total = 0.0
            rarest = 0.0
            count = 0
            for j in range(frequencies.shape[0]):
                order = math.floor(frequencies[j] / candidate + 0.5)
                if order >= 1.0 and abs(frequencies[j] - order * candidate) <= tolerances[j]:
                    count += 1
                    spacing = candidate * (teeth if order % teeth == 0.0 else 1)
                    chance = 2.0 * tolerances[j] / spacing
                    if chance < 1.0:
                        total -= math.log(chance)
                        rarest = max(rarest, -math.log(chance))
            candidates[made] = candidate
            gains[made] = total - rarest
            hits[made] = count
            made += 1
            if made == candidates.shape[0]:
                return made
    return made


@njit(**OPTIONS)
def best_family(frequencies, tolerances, surprises, choices, best):
    """Lines that a self-excited vibration explains best: its overtones, sidebands around them, forced lines beside.

    The sidebands' spacing is that of two lines, or a part of it; a vibration that is a multiple of the spacing is not
    self-excited for all that can be seen.

    Parameters
    ----------
    frequencies, tolerances : ndarray of float64, shape (lines,)
        As in `surprise`.
    surprises : ndarray of float64, shape (lines,)
        -ln(chance) that the line is on one of the family's places.
    choices : ndarray of float64, shape (lines,)
        Logarithm of the number of ways to choose so many more lines than two.
    best : ndarray of bool, shape (2, lines)
        The result: which lines the best vibration brings along; the second row is work space.

    Returns
    -------
    float
        Log odds against chance of the best, counted as for a comb. Two lines are on it for certain.
    """
    n = frequencies.shape[0]
    best[:] = False
    widest = 0.0
    for i in range(n):
        widest = max(widest, tolerances[i])
    evidence = -math.inf
    tried = 0
    for second in range(n):
        for first in range(n):
            carrier = frequencies[first]
            for part in range(1, PARTS + 1):
                spacing = abs(frequencies[second] - carrier) / part
                if not spacing > 10.0 * widest:
                    continue
                if not abs(carrier - np.rint(carrier / spacing) * spacing) > 2.0 * tolerances[first]:
                    continue
                tried += 1
                gain = _gain_of_family(carrier, spacing, frequencies, tolerances, surprises, choices, best[1])
                if gain > evidence:
                    evidence = gain
                    for i in range(n):
                        best[0, i] = best[1, i]
    return evidence - math.log(tried) if tried > 0 else evidence


@njit(**OPTIONS)
def _gain_of_family(carrier, spacing, frequencies, tolerances, surprises, choices, brought):
    """Log odds of one vibration with these sidebands; ``brought`` is filled with the lines that are not forced."""
    total = 0.0
    rarest = 0.0
    next_rarest = 0.0
    members = 0
    hits = 0
    for i in range(frequencies.shape[0]):
        member = False
        for overtone in range(1, OVERTONES + 1):
            away = frequencies[i] - overtone * carrier
            sideband = np.rint(away / spacing)
            member = member or (abs(sideband) <= SIDEBANDS and abs(away - sideband * spacing) <= 2.0 * tolerances[i])
        # forced lines at the spacing itself go well with it
        multiple = np.rint(frequencies[i] / spacing)
        forced = 1 <= multiple <= FORCED and abs(frequencies[i] - multiple * spacing) <= 2.0 * tolerances[i]
        brought[i] = member and not forced
        members += member
        if member or forced:
            hits += 1
            total += surprises[i]
            next_rarest = max(next_rarest, min(surprises[i], rarest))
            rarest = max(rarest, surprises[i])
    return total - rarest - next_rarest - choices[max(hits - 2, 0)] if members >= 3 else -math.inf
