"""Sums over the newest blocks of a running signal: what windows of different lengths say, in one pass each."""

import numpy as np
from numba import njit

from chatter_monitor.kernels.options import OPTIONS


@njit(**OPTIONS)
def take_out(products, count):
    """Take columns 1 to `count` out of column 0 and of those behind them, by elimination."""
    size = products.shape[0]
    for pivot in range(1, count + 1):
        for i in range(size):
            if i == 0 or i > pivot:
                factor = products[i, pivot] / products[pivot, pivot]
                for j in range(size):
                    products[i, j] -= factor * products[pivot, j]


@njit(cache=True, nogil=True)
def newest(sums, end, sizes, lost, ridge, always, out):
    """Products of the newest blocks with some columns taken out of the others.

    A column that was large once and is next to nothing now is zero: what is left when two sums are subtracted is
    rounding.

    Parameters
    ----------
    sums : ndarray of float64, shape (b, c, c)
        Products of columns, summed over all blocks up to each.
    end : int
        The newest block.
    sizes : ndarray of int64, shape (w,)
        How many blocks are in each window.
    lost : float
        Share of a column's sum that is rounding.
    ridge : float
        Share of a column's own product that is added to it.
    always : int
        Columns 1 to `always` are taken out.
    out : ndarray of float64, shape (w, c, c)
        Filled; rows and columns of what was taken out are of no use.
    """
    columns = out.shape[1]
    for window in range(sizes.size):
        total, before = out[window], sums[end - sizes[window]]
        for i in range(columns):
            for j in range(columns):
                total[i, j] = sums[end, i, j] - before[i, j]
        for i in range(columns):
            if total[i, i] <= lost * sums[end, i, i]:
                for j in range(columns):
                    total[i, j] = total[j, i] = 0.0
            total[i, i] += ridge * total[i, i] + 1e-300
        take_out(total, always)


@njit(**OPTIONS)
def explained(total, earlier, first, count, work):
    """Sum of squares of the errors that some columns explain, in what has come since an earlier sum."""
    for i in range(count + 1):
        row = i + first - 1 if i else 0
        for j in range(count + 1):
            column = j + first - 1 if j else 0
            work[i, j] = total[row, column] - earlier[row, column]
    whole = work[0, 0]
    take_out(work, count)
    return whole - work[0, 0]


@njit(cache=True, nogil=True, error_model="numpy")
def changed(sums, powers, end, sizes, first, count, ordinates, retuned, coloured, spreads):
    """By how much the newest blocks differ from all those before them.

    Parameters
    ----------
    sums : ndarray of float64, shape (b, c, c)
        Products of errors and columns, summed over all blocks up to each; none come first.
    powers : ndarray of float64, shape (b, 2, bands)
        Powers of the errors in bands, and their squares, summed likewise.
    end : int
        The newest block.
    sizes : ndarray of int64, shape (w,)
        How many blocks are new.
    first, count : int
        Columns whose coefficients may have changed.
    ordinates : float
        Of the periodogram in each band of a block.
    retuned, coloured : ndarray of float64, shape (w,)
        Filled: chi-squared of a change of the coefficients, of `count` degrees of freedom; and of a change of the
        spectrum without its level, of bands - 1.
    spreads : ndarray of float64, shape (w,)
        Filled: variance of the powers over that of Gaussian errors, at least 1.
    """
    bands = powers.shape[2]
    ratio, work = np.empty(bands), np.empty((count + 1, count + 1))
    whole = explained(sums[end], sums[0], first, count, work)
    for window in range(sizes.size):
        size = sizes[window]
        at = end - size
        # Coefficients of their own for either part explain more than common ones do.
        apart = explained(sums[at], sums[0], first, count, work) + explained(sums[end], sums[at], first, count, work)
        retuned[window] = apart - whole
        mean_ratio = spread = square = 0.0
        for band in range(bands):
            mean = powers[at, 0, band] / at
            spread += (powers[at, 1, band] / at / (mean * mean) - 1.0) / bands
            ratio[band] = np.log((powers[end, 0, band] - powers[at, 0, band]) / size / mean)
            mean_ratio += ratio[band] / bands
        for band in range(bands):
            square += (ratio[band] - mean_ratio) ** 2
        # Errors with heavy tails have powers that vary more than those of Gaussian ones.
        spreads[window] = max(spread * ordinates * at / (at - 1), 1.0)
        coloured[window] = square * ordinates / (spreads[window] * (1.0 / at + 1.0 / size))
