"""Sums over the newest blocks of a running signal: what windows of different lengths say, in one pass each."""

from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.options import OPTIONS, SUMS

FEWEST_BLOCKS = 2  # that tell of a shape: the powers of one are too few to be nearly Gaussian


class Sums(NamedTuple):
    """Sums over all blocks up to each; none come first."""

    of_scouts: np.ndarray  # (b, c, c) products of errors, 1, what is linear, and scouts
    of_all: np.ndarray  # (b, d, d) and all forces, of blocks where all were tried
    power: np.ndarray  # (b, 2, bands) powers of the errors in bands, and their squares
    fine_power: np.ndarray  # (b, fine bands)


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


@njit(**OPTIONS)
def summed(sums, end, size, lost, ridge, always, total):
    """Products of the newest blocks, so many, into `total`, with columns 1 to `always` taken out of the others.

    A column that was large once and is next to nothing now is zero: what is left when two sums are subtracted is
    rounding.
    """
    columns, before = total.shape[0], sums[end - size]
    for i in range(columns):
        for j in range(columns):
            total[i, j] = sums[end, i, j] - before[i, j]
    for i in range(columns):
        if total[i, i] <= lost * sums[end, i, i]:
            for j in range(columns):
                total[i, j] = total[j, i] = 0.0
        total[i, i] += ridge * total[i, i] + 1e-300
    take_out(total, always)


@njit(cache=True, nogil=True)
def newest(sums, end, sizes, lost, ridge, always, out):
    """Products of the newest blocks with some columns taken out of the others.

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
    for window in range(sizes.size):
        summed(sums, end, sizes[window], lost, ridge, always, out[window])


@njit(cache=True, nogil=True, error_model="numpy")
def most(sums, end, sizes, lost, ridge, always, gains):
    """The largest gain of any column by itself, nats, over the newest blocks.

    Parameters
    ----------
    sums, end, sizes, lost, ridge, always
        As for `newest`.
    gains : ndarray of float64, shape (w,)
        Filled.
    """
    columns = sums.shape[1]
    total = np.empty((columns, columns))
    for window in range(sizes.size):
        summed(sums, end, sizes[window], lost, ridge, always, total)
        gains[window] = 0.0
        for i in range(always + 1, columns):
            gains[window] = max(gains[window], 0.5 * total[0, i] * total[0, i] / total[i, i])


@njit(**OPTIONS)
def mean_powers(amplitudes, scale, edges, powers):
    """Means of a periodogram in bands, between edges."""
    for band in range(powers.size):
        total = 0.0
        for k in range(edges[band], edges[band + 1]):
            total += amplitudes[k].real * amplitudes[k].real + amplitudes[k].imag * amplitudes[k].imag
        powers[band] = scale * total / (edges[band + 1] - edges[band])


@njit(cache=True, nogil=True, error_model="numpy")
def with_offset(summary, samples, used):
    """Products of the first columns, and of 1 after the first of them: what a constant force or a drift adds to errors.

    Parameters
    ----------
    summary : Summary
    samples : int
        That it sums up.
    used : int
        How many columns are of use.

    Returns
    -------
    ndarray of float64, shape (used + 1, used + 1)
    """
    lanes, total = summary.sums.size, np.empty((used + 1, used + 1))
    total[1, 1] = samples
    for i in range(used):
        row = i + (i > 0)
        total[1, row] = total[row, 1] = summary.sums[i]
        for j in range(used):
            total[row, j + (j > 0)] = summary.products[i * lanes + j]
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def append(sums, at, summary, used, amplitudes, edges, fine_edges):
    """Sums up to a further block; False, and no sums, if there is nothing in it.

    What is in it counts over the variance of its errors: what is louder says no more.

    Parameters
    ----------
    sums : Sums
        Row `at` + 1 is filled.
    at : int
        How many blocks there are.
    summary : Summary
        Of the block.
    used : int
        Columns that are of use, with those of all forces or of scouts.
    amplitudes : ndarray of complex128, shape (n,)
        Spectrum of the newest errors.
    edges, fine_edges : ndarray of int64, shape (bands + 1,)
        Of bands, in samples of the spectrum without the mean.
    """
    n, newest, square = summary.errors.size, 2 * (amplitudes.size - 1), 0.0
    for k in range(n - newest, n):
        square += summary.errors[k] * summary.errors[k]
    products = with_offset(summary, n, used)
    variance = products[0, 0] / n
    if not (0.0 < variance < np.inf and square > 0.0):
        return False
    few = sums.of_scouts.shape[1]
    sums.of_scouts[at + 1] = sums.of_scouts[at] + products[:few, :few] / variance
    sums.of_all[at + 1] = sums.of_all[at]
    if products.shape == sums.of_all.shape[1:]:
        sums.of_all[at + 1] += products / variance
    power, fine = np.empty(sums.power.shape[2]), np.empty(sums.fine_power.shape[1])
    mean_powers(amplitudes[1:], 1.0 / square, edges, power)
    mean_powers(amplitudes[1:], 1.0 / square, fine_edges, fine)
    for band in range(power.size):
        sums.power[at + 1, 0, band] = sums.power[at, 0, band] + power[band]
        sums.power[at + 1, 1, band] = sums.power[at, 1, band] + power[band] * power[band]
    for band in range(fine.size):
        sums.fine_power[at + 1, band] = sums.fine_power[at, band] + fine[band]
    return True


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
def changed(sums, end, sizes, first, count, ordinates, shapes, fine_ordinates, retuned, coloured, shaped):
    """By how much the newest blocks differ from all those before them.

    Parameters
    ----------
    sums : Sums
    end : int
        The newest block.
    sizes : ndarray of int64, shape (w,)
        How many blocks are new.
    first, count : int
        Columns whose coefficients may have changed.
    ordinates, fine_ordinates : float
        Of the periodogram in each band of a block.
    shapes : ndarray of float64, shape (s, fine bands)
        Of changes of the logarithm of the spectrum; unit length.
    retuned, coloured, shaped : ndarray of float64, shape (w,)
        Filled: chi-squared of a change of the coefficients, of `count` degrees of freedom; of a change of the spectrum
        without its level, of bands - 1; and of the shape that there is most of, of one.
    """
    products, powers = sums.of_scouts, sums.power
    bands = powers.shape[2]
    ratio, work, change = np.empty(bands), np.empty((count + 1, count + 1)), np.empty(shapes.shape[1])
    whole = explained(products[end], products[0], first, count, work)
    for window in range(sizes.size):
        size = sizes[window]
        at = end - size
        # Coefficients of their own for either part explain more than common ones do.
        apart = explained(products[at], products[0], first, count, work)
        apart += explained(products[end], products[at], first, count, work)
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
        spread = max(spread * ordinates * at / (at - 1), 1.0)
        surely = 1.0 / (spread * (1.0 / at + 1.0 / size))
        coloured[window] = square * ordinates * surely
        largest = largest_shape(sums.fine_power, end, at, shapes, change) if size >= FEWEST_BLOCKS else 0.0
        shaped[window] = largest * fine_ordinates * surely


@njit(cache=True, nogil=True, error_model="numpy")
def quiet(sums, end, changes, forces, first, count, ordinates, shapes, fine_ordinates, little, lost, ridge, nats):
    """Whether the newest blocks differ by next to nothing from those before, and no scout explains much of them.

    Parameters
    ----------
    sums, end, first, count, ordinates, shapes, fine_ordinates
        As for `changed`.
    changes, forces : ndarray of int64
        Windows in which a change is looked for, and a force.
    little : ndarray of float64, shape (3,)
        What each chi-squared of `changed` stays below.
    lost, ridge
        As for `newest`.
    nats : float
        What the gain of each scout stays below.
    """
    told, gains = np.empty((3, changes.size)), np.empty(forces.size)
    changed(sums, end, changes, first, count, ordinates, shapes, fine_ordinates, told[0], told[1], told[2])
    most(sums.of_scouts, end, forces, lost, ridge, first + count - 1, gains)
    nothing = True
    for window in range(changes.size):
        for kind in range(3):
            nothing &= told[kind, window] < little[kind]
    for window in range(forces.size):
        nothing &= gains[window] <= nats
    return nothing


@njit(**OPTIONS)
def largest_shape(powers, end, at, shapes, change):
    """Square of the shape that there is most of in a change of powers: of the mean after a block from that up to it."""
    for band in range(change.size):
        mean = powers[at, band] / at
        # Wilson and Hilferty (1931): the cube root of a mean of few ordinates is nearly Gaussian.
        change[band] = 3.0 * ((powers[end, band] - powers[at, band]) / (end - at) / mean) ** (1.0 / 3.0)
    largest = 0.0
    for shape in range(shapes.shape[0]):
        largest = max(largest, along(shapes[shape], change) ** 2)
    return largest


@njit(**SUMS)
def along(one, other):
    """Sum of products."""
    total = 0.0
    for i in range(one.size):
        total += one[i] * other[i]
    return total
