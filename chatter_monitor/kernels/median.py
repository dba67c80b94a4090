"""Median by selection: half of the values need not be sorted to find the one in their middle."""

import math

from numba import njit

from chatter_monitor.kernels.options import OPTIONS

# Of so many values or more, a sorted sample tells between which two the median is, and the others are not moved about.
MANY = 128
SAMPLE = 15
LOW, HIGH = 5, 9


@njit(**OPTIONS)
def median(values):
    """Median (upper one of two) of values without NaN, which are put into another order: the lower half comes first."""
    return _select(values, values.shape[0] // 2)


@njit(**OPTIONS)
def median_of_many(values):
    """`median`, faster; of the values only some are left."""
    n = values.shape[0]
    middle = n // 2
    if n >= MANY:
        _sort_sample(values)
        low, high = values[LOW], values[HIGH]
        below, above = 0, 0
        for t in range(n):
            below += values[t] < low
            above += values[t] > high
        if below <= middle < n - above:
            kept = 0
            for t in range(n):  # without a branch, which nobody could predict
                value = values[t]
                values[kept] = value
                kept += (value >= low) & (value <= high)
            return _select(values[:kept], middle - below)
    return _select(values, middle)


@njit(**OPTIONS)
def _sort_sample(values):
    """Bring a sample from all over the values to their beginning, sorted."""
    step = values.shape[0] // SAMPLE
    for i in range(SAMPLE):
        place = i * step + step // 2
        new = values[place]
        values[place] = values[i]
        while i > 0 and values[i - 1] > new:
            values[i] = values[i - 1]
            i -= 1
        values[i] = new


@njit(**OPTIONS)
def _select(values, rank):
    """Value of a rank, counted from 0 (Hoare's selection): nothing above it comes before it, nothing below behind."""
    left, right = 0, values.shape[0] - 1
    while left < right:
        pivot = values[rank]
        i, j = left, right
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        # up to j there is nothing above the pivot, from i on nothing below it
        if j < rank:
            left = i
        if rank < i:
            right = j
    return values[rank]


@njit(**OPTIONS)
def medians_where(columns, status, hold, wanted, values, medians, counts):
    """Median of columns over the rows with a wanted status, and how often there is each status.

    Parameters
    ----------
    columns : tuple of ndarray of float32, shape (n, modes)
        The values; those that are NaN do not count.
    status : ndarray of uint8, shape (n, modes)
        Of each value.
    hold : ndarray of int64, shape (modes,)
        For how many rows a value stands, the first row's to begin with: it is looked at once.
    wanted : int
        Rows with another status are left out.
    values : ndarray of float32, shape (n,)
        Work space.
    medians : ndarray of float64, shape (modes, columns)
        The result; NaN where no more than half of the rows have the wanted status.
    counts : ndarray of int64, shape (modes, kinds of status)
        The result, in rows.
    """
    rows, modes = status.shape
    for m in range(modes):
        counts[m, :] = 0
        for t in range(0, rows, hold[m]):
            counts[m, status[t, m]] += min(hold[m], rows - t)
        for i in range(len(columns)):
            medians[m, i] = math.nan
            if 2 * counts[m, wanted] <= rows:
                continue
            found = 0
            for t in range(0, rows, hold[m]):  # without a branch: which values count changes without a rule
                value = columns[i][t, m]
                values[found] = value
                found += (status[t, m] == wanted) & (value == value)
            if found > 0:
                medians[m, i] = median_of_many(values[:found])
