"""Peaks of an averaged periodogram: the lines of a spindle, the mode around which most power is, and one beside it."""

import math

import numpy as np
from numba import njit

from chatter_monitor.kernels.median import median
from chatter_monitor.kernels.options import OPTIONS, WITHIN

# A line spreads over so many bins on either side of its own; its surroundings are so many.
LINE_BINS = 2
SURROUNDINGS = 12
# Over what relative width on either side of a frequency the power is averaged.
SMOOTHING = 0.015

# Another peak is so wide to either side, its surroundings so wide, both over its frequency; it is looked for in steps.
PEAK, AROUND, STEP = 0.004, 0.15, 0.002
# One mode with its delay has several peaks, all within so much of it (in the logarithm of the frequency).
OF_ONE_MODE = 0.2
# Nor is another peak within the skirts of a multiple of the spindle's or the teeth's frequency: so far off, over its
# frequency, or so much of their distance.
SKIRT, OFF_SPACING = 0.01, 0.2


@njit(**OPTIONS)
def mark_multiples(spectrum, spacing, excess, scratch, lines):
    """Mark the bins around those multiples of a spacing that stand out of their surroundings.

    Parameters
    ----------
    spectrum : ndarray of float64, shape (n,)
        From 0 Hz on.
    spacing : float
        In bins.
    excess : float
        Least ratio to the median of the surroundings.
    scratch : ndarray of float64, shape (2 SURROUNDINGS + 1,)
        Work space.
    lines : ndarray of bool, shape (n,)
        The result.
    """
    lines[:] = False
    last = spectrum.shape[0] - 1 - SURROUNDINGS
    for order in range(int(np.ceil(SURROUNDINGS / spacing)), int(np.floor(last / spacing)) + 1):
        centre = int(np.rint(order * spacing))
        top = max(spectrum[centre - 1], spectrum[centre], spectrum[centre + 1])
        enough = top / excess
        above = 0
        for i in range(scratch.shape[0]):
            scratch[i] = spectrum[centre - SURROUNDINGS + i]
            above += scratch[i] >= enough
        if above <= SURROUNDINGS and top > excess * median(scratch):  # else the median is above, too
            for b in range(centre - LINE_BINS, centre + LINE_BINS + 1):
                lines[b] = True


@njit(**OPTIONS)
def strongest(spectrum, lines, bins, sums, counts):
    """Bin around which the power is most concentrated, lines apart, to a few percent.

    Parameters
    ----------
    spectrum : ndarray of float64, shape (n,)
    lines : ndarray of bool, shape (n,)
        Bins that do not count.
    bins : int
        So many are looked at, from the first.
    sums, counts : ndarray of float64 and int64, shape (n + 1,)
        Work space.
    """
    n = spectrum.shape[0]
    sums[0], counts[0] = 0.0, 0
    for b in range(n):
        sums[b + 1] = sums[b] + (0.0 if lines[b] else spectrum[b])
        counts[b + 1] = counts[b] + (0 if lines[b] else 1)
    best, most = 0, -1.0
    for b in range(bins):
        half = max(LINE_BINS + 1, int(SMOOTHING * b))
        low, high = max(b - half, 0), min(b + half + 1, n)
        smooth = (sums[high] - sums[low]) / max(counts[high] - counts[low], 1)
        if smooth > most:
            best, most = b, smooth
    return best


@njit(**WITHIN)
def _is_line(place, spacing, off):
    """Whether it may be a multiple of a spacing, or its skirt."""
    nearest = max(1.0, np.rint(place / spacing)) * spacing
    return abs(nearest - place) < PEAK * place + min((SKIRT + off) * place, OFF_SPACING * spacing)


@njit(**OPTIONS)
def most_prominent(spectrum, lines, first, end, peak, rotation, tooth, off, excess, sums, counts, logarithms):
    """Bin of the peak that stands out most, away from another one and from what turns; -1 for none.

    Parameters
    ----------
    spectrum : ndarray of float64, shape (n,)
        Positive from the first bin to the end.
    lines : ndarray of bool, shape (n,)
        Bins that do not count.
    first, end : int
        So many bins are looked at.
    peak, rotation, tooth : float
        Frequencies of the other peak, the spindle and its teeth, in bins.
    off : float
        Relative error that those of the spindle and the teeth may have.
    excess : float
        Least ratio of its mean to the geometric mean of its surroundings.
    sums, counts, logarithms : ndarray of float64, int64 and float64, shape (n + 1,)
        Work space.
    """
    sums[first], counts[first], logarithms[first] = 0.0, 0, 0.0
    for b in range(first, end):
        sums[b + 1] = sums[b] + (0.0 if lines[b] else spectrum[b])
        counts[b + 1] = counts[b] + (0 if lines[b] else 1)
        logarithms[b + 1] = logarithms[b] + math.log(spectrum[b])
    best, most = -1, excess
    centre = (first + 1) / (1.0 - AROUND)
    while centre * (1.0 + AROUND) < end - 1:
        beside = abs(math.log(centre / peak)) > OF_ONE_MODE
        if beside and not (_is_line(centre, rotation, off) or _is_line(centre, tooth, off)):
            low, high = int(np.rint(centre * (1.0 - PEAK))), int(np.rint(centre * (1.0 + PEAK))) + 1
            begin, finish = int(centre * (1.0 - AROUND)), int(centre * (1.0 + AROUND)) + 1
            around = math.exp((logarithms[finish] - logarithms[begin]) / (finish - begin))
            prominence = (sums[high] - sums[low]) / (max(counts[high] - counts[low], 1) * around)
            if prominence > most:
                best, most = int(np.rint(centre)), prominence
        centre *= 1.0 + STEP
    return best
