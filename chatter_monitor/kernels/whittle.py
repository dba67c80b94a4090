"""Whittle's likelihood of a periodogram under a `regenerative_spectrum`.

Bins are looked at in tiles, with a row for each quantity at a fixed place of one array, and sums may be formed in any
order: that is what lets the compiler use vector instructions.
"""

import math

from numba import njit

from chatter_monitor.kernels.lanes import as_lanes, fma
from chatter_monitor.kernels.options import SUMS
from chatter_monitor.kernels.regenerative_spectrum import (
    DELAYS,
    KAPPA,
    LOG_FLOOR,
    LOG_GAIN,
    LOG_OMEGA,
    LOG_SPREAD,
    LOG_TAU,
    LOG_ZETA,
    MODULATION,
    PARAMETERS,
    ROOM,
    SIGNAL,
    SLOPE,
    TURNS,
    respond,
    turn,
)

# Power response of the Hann window at distances of 0, 1/2, 1 and 3/2 bins; beyond that 0.03 % are left. The mean of a
# periodogram is the spectrum convolved with it, which samples at half bins represent as long as the signal forgets
# within the window (Sykulski et al., The debiased Whittle likelihood, Biometrika 106, 2019).
_RESPONSE = (0.25, 0.18012655, 0.0625, 0.00720506)
_ALL = _RESPONSE[0] + 2.0 * (_RESPONSE[1] + _RESPONSE[2] + _RESPONSE[3])
HERE, HALF_BIN, ONE_BIN, BIN_AND_HALF = (part / _ALL for part in _RESPONSE)

REACH = 3  # half bins on either side that the window sees
TILE = ROOM - 8  # bins: the window reaches three beyond a tile
# Rows of the work space after those of `turn`: what `respond` fills, at the bins from one before the tile on, and again
# half a bin before each; the periodogram, 1 for the bins in use; S, its factor in the likelihood, how far the
# periodogram exceeds it; its logarithmic derivatives by the parameters; sums of products of those rows, of every eighth
# bin by itself.
AT = DELAYS * TURNS
BETWEEN = AT + PARAMETERS * ROOM
PERIODOGRAM, COUNTS, SPECTRUM, FACTOR, EXCESS, SLOPES = (BETWEEN + (PARAMETERS + i) * ROOM for i in range(6))
PRODUCTS = SLOPES + PARAMETERS * ROOM
LANES = 8
WORK = PRODUCTS + PARAMETERS * (PARAMETERS + 3) // 2 * LANES
TOGETHER = 8  # factors whose product is far from underflow


@njit(inline="always", **SUMS)
def _copy(values, count, work, row):
    """Copy the first values into a row."""
    for t in range(count):
        work[row + t] = values[t]


@njit(inline="always", **SUMS)
def _seen(work, row, t):
    """What the window sees of a row at a bin of the tile."""
    return (
        HERE * work[AT + SIGNAL + row + t + 1]
        + HALF_BIN * (work[BETWEEN + SIGNAL + row + t + 1] + work[BETWEEN + SIGNAL + row + t + 2])
        + ONE_BIN * (work[AT + SIGNAL + row + t] + work[AT + SIGNAL + row + t + 2])
        + BIN_AND_HALF * (work[BETWEEN + SIGNAL + row + t] + work[BETWEEN + SIGNAL + row + t + 3])
    )


@njit(forceinline=True, **SUMS)
def whittle(theta, first, bin_width, delays, log_frequency, periodogram, used, work, spectrum, score, information):
    """Whittle's likelihood of a periodogram under the model: the sum of log S + I / S over the bins, to be made small.

    Parameters
    ----------
    theta : ndarray of float64, shape (9,)
        Parameters in the order above.
    first, bin_width : float
        Angular frequency of the first bin and distance of the bins, in rad/s.
    delays : int
        1 for a delay without a spread, or `DELAYS`.
    log_frequency : ndarray of float64, shape (2, n + 3)
        log(omega / omega_0): at the bins from one before the first on, and half a bin before each of these.
    periodogram : ndarray of float64, shape (n,)
        Of Hann windows; its unit is that of the gain.
    used : ndarray of bool, shape (n,)
        Bins to take into account.
    work : ndarray of float64, shape (WORK,)
        Work space.
    spectrum : ndarray of float64, shape (n,)
        Filled with S, the window's effect included.
    score : ndarray of float64, shape (9,)
        Filled with the negative gradient.
    information : ndarray of float64, shape (9, 9)
        Filled with the expected Hessian.
    """
    floor = math.exp(theta[LOG_FLOOR])
    turn(theta, bin_width, delays, work)
    work[PRODUCTS:] = 0.0
    total = 0.0
    for begin in range(0, periodogram.shape[0], TILE):
        bins = min(TILE, periodogram.shape[0] - begin)
        _copy(log_frequency[0, begin:], bins + REACH, work, AT)
        _copy(log_frequency[1, begin:], bins + REACH, work, BETWEEN)
        _copy(periodogram[begin:], bins, work, PERIODOGRAM)
        _copy(used[begin:], bins, work, COUNTS)
        for t in range(bins, TILE):
            work[COUNTS + t] = 0.0
        before = first + (begin - 1.0) * bin_width
        respond(theta, before, bin_width, delays, work, AT)
        respond(theta, before - 0.5 * bin_width, bin_width, delays, work, BETWEEN)
        total += _compare(floor, work)
        here = spectrum[begin:]
        for t in range(bins):
            here[t] = work[SPECTRUM + t]
        _multiply(work)
    row = PRODUCTS
    for i in range(PARAMETERS):
        score[i] = _sum(work, row)
        row += LANES
        for j in range(i + 1):
            information[i, j] = information[j, i] = _sum(work, row)
            row += LANES
    return total


@njit(forceinline=True, **SUMS)
def _multiply(work):
    """Add the products of a tile: of each derivative with the excess, and with those before and itself."""
    rows = as_lanes(work, LANES)
    place = PRODUCTS // LANES
    for i in range(PARAMETERS):
        slope = (SLOPES + i * ROOM) // LANES
        for j in range(-1, i + 1):  # the excess lies before the derivatives
            other = (SLOPES + j * ROOM) // LANES
            products = rows[place]
            for t in range(TILE // LANES):
                products = fma(rows[slope + t], rows[other + t], products)
            rows[place] = products
            place += 1


@njit(forceinline=True, **SUMS)
def _sum(work, row):
    """Sum of a row of lanes."""
    total = 0.0
    for t in range(LANES):
        total += work[row + t]
    return total


@njit(inline="always", **SUMS)
def _compare(floor, work):
    """Fill the rows that compare S with the periodogram; returns the tile's part of the likelihood."""
    ratios = 0.0
    for t in range(TILE):
        counts = work[COUNTS + t]
        signal = _seen(work, LOG_GAIN * ROOM, t)
        whole = signal + floor
        work[SPECTRUM + t] = whole
        work[FACTOR + t] = counts * (whole - 1.0) + 1.0
        inverse = counts / whole
        ratio = work[PERIODOGRAM + t] * inverse
        ratios += ratio
        work[EXCESS + t] = ratio - 1.0
        work[SLOPES + LOG_GAIN * ROOM + t] = signal * inverse
        work[SLOPES + LOG_FLOOR * ROOM + t] = floor * inverse
        work[SLOPES + SLOPE * ROOM + t] = _seen(work, SLOPE * ROOM, t) * inverse
        work[SLOPES + LOG_OMEGA * ROOM + t] = _seen(work, LOG_OMEGA * ROOM, t) * inverse
        work[SLOPES + LOG_ZETA * ROOM + t] = _seen(work, LOG_ZETA * ROOM, t) * inverse
        work[SLOPES + KAPPA * ROOM + t] = _seen(work, KAPPA * ROOM, t) * inverse
        work[SLOPES + LOG_TAU * ROOM + t] = _seen(work, LOG_TAU * ROOM, t) * inverse
        work[SLOPES + LOG_SPREAD * ROOM + t] = _seen(work, LOG_SPREAD * ROOM, t) * inverse
        work[SLOPES + MODULATION * ROOM + t] = _seen(work, MODULATION * ROOM, t) * inverse
    logarithms = 0.0
    for t in range(TILE // TOGETHER):
        product = 1.0
        for i in range(TOGETHER):
            product *= work[FACTOR + i * (TILE // TOGETHER) + t]
        logarithms += math.log(product)
    return ratios + logarithms
