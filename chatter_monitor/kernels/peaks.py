"""Peaks of an averaged periodogram: the lines of a spindle, and the mode around which most power is."""

import numpy as np
from numba import njit

from chatter_monitor.kernels.median import median
from chatter_monitor.kernels.options import OPTIONS

# A line spreads over so many bins on either side of its own; its surroundings are so many.
LINE_BINS = 2
SURROUNDINGS = 12
# Over what relative width on either side of a frequency the power is averaged.
SMOOTHING = 0.015


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
