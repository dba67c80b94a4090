"""Median by selection: half of the values need not be sorted to find the one in their middle."""

import math

import numpy as np
from numba import njit

from chatter_monitor.kernels.options import OPTIONS, SUMS

# Of loops over values without NaN, which are vector instructions then.
NUMBERS = {**SUMS, "fastmath": SUMS["fastmath"] | {"nnan"}}

# Values that are left to select from, and how often their range is halved at most.
FEW, HALVINGS = 12, 16
HALF = np.float32(0.5)  # which leaves values of either kind what they are


@njit(**OPTIONS)
def median(values):
    """Median (upper one of two) of values without NaN, which are put into another order: the lower half comes first."""
    return _select(values, values.shape[0] // 2)


@njit(**OPTIONS)
def median_of_many(values):
    """`median`, several times faster; of the values only some are left.

    Which of two numbers is larger nobody can predict, and the processor waits for that. So those below the middle of a
    range are counted, without a branch, until there are few left in the half that the median is in.
    """
    n = values.shape[0]
    middle = n // 2
    low, high = _range(values)
    below, between = 0, n
    for _ in range(HALVINGS):
        pivot = HALF * low + HALF * high
        if between <= FEW or not low < pivot < high:
            break
        under = _below(values, pivot)
        if under <= middle:
            between -= under - below
            low, below = pivot, under
        else:
            between = under - below
            high = pivot
    kept = 0
    for t in range(n):
        value = values[t]
        values[kept] = value
        kept += (value >= low) & (value <= high)
    return _select(values[:kept], middle - below)


@njit(**NUMBERS)
def _range(values):
    """The smallest and the largest value."""
    low = high = values[0]
    for t in range(values.shape[0]):
        value = values[t]
        low = value if value < low else low
        high = value if value > high else high
    return low, high


@njit(**NUMBERS)
def _below(values, pivot):
    """How many values are below a pivot: counted as what they are, so that as many go into a vector."""
    one, none = np.float32(1.0), np.float32(0.0)
    under = none
    for t in range(values.shape[0]):
        under += one if values[t] < pivot else none
    return int(under)


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
            found = _copy_numbers(columns[i][:, m], hold[m], values)
            if counts[m, wanted] < rows or found * hold[m] < rows:  # not all of them count
                found = 0
                for t in range(0, rows, hold[m]):  # without a branch: which values count changes without a rule
                    value = columns[i][t, m]
                    values[found] = value
                    found += (status[t, m] == wanted) & (value == value)
            if found > 0:
                medians[m, i] = median_of_many(values[:found])


@njit(**OPTIONS)
def _copy_numbers(column, hold, values):
    """Copy the values that are looked at, in vector instructions; return how many of them are not NaN."""
    numbers = 0
    if hold == 1:  # as the compiler has to know for that
        for t in range(column.shape[0]):
            values[t] = column[t]
            numbers += column[t] == column[t]
    else:
        for i in range((column.shape[0] + hold - 1) // hold):
            values[i] = column[i * hold]
            numbers += values[i] == values[i]
    return numbers
