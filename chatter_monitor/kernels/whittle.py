"""Spectrum of one mode with a regenerative delay, and the likelihood of a periodogram under it.

    x'' + 2 zeta w x' + w^2 x + kappa w^2 [x - x(t - tau)] = W

With r = omega / w its dynamic stiffness over w^2 is

    D = 1 - r^2 + 2 i zeta r + kappa [1 - exp(-i omega tau)],

and what a sensor delivers has the spectrum S = gain (omega / omega_0)^slope / abs(D)^2 + floor: the slope is 0, 2 or 4
for displacement, velocity and acceleration and takes up the colour of the force, the floor is the sensor's noise.

A spindle wanders while the periodogram is averaged, and tau with it: then 1 / abs(D)^2 is the mean of three, with
delays of tau and of sqrt(3) spreads to either side (Gauss-Hermite: exact up to the fifth power). It is a mean of
spectra and no loss of coherence, because a mode forgets sooner than a spindle changes its speed.

Bins are looked at in tiles, with a row for each quantity at a fixed place of one array, and sums may be formed in any
order: that is what lets the compiler use vector instructions.
"""

import cmath
import math

from numba import njit

from chatter_monitor.kernels.lanes import as_lanes, fma
from chatter_monitor.kernels.options import SUMS

# Indices into the parameters
LOG_GAIN, SLOPE, LOG_OMEGA, LOG_ZETA, KAPPA, LOG_TAU, LOG_SPREAD, LOG_FLOOR = range(8)
PARAMETERS = 8

# Delays that the spectrum is averaged over: how many spreads from the mean, and their weights.
DELAYS = 3
_OFFSETS, _WEIGHTS = (0.0, math.sqrt(3.0), -math.sqrt(3.0)), (2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0)

# Power response of the Hann window at distances of 0, 1/2, 1 and 3/2 bins; beyond that 0.03 % are left. The mean of a
# periodogram is the spectrum convolved with it, which samples at half bins represent as long as the signal forgets
# within the window (Sykulski et al., The debiased Whittle likelihood, Biometrika 106, 2019).
_RESPONSE = (0.25, 0.18012655, 0.0625, 0.00720506)
_ALL = _RESPONSE[0] + 2.0 * (_RESPONSE[1] + _RESPONSE[2] + _RESPONSE[3])
HERE, HALF_BIN, ONE_BIN, BIN_AND_HALF = (part / _ALL for part in _RESPONSE)

TILE = 64  # bins
REACH = 3  # half bins on either side that the window sees
ROOM = TILE + 8  # places of a row: the window reaches three beyond a tile; whole vectors
# Rows of the work space: how far the wave of each delay turns from bin to bin; logarithm of the frequency, then the
# signal and its derivatives by the parameters, at the bins from one before the tile on, and again half a bin before
# each; the periodogram, 1 for the bins in use; S, its factor in the likelihood, how far the periodogram exceeds it;
# its logarithmic derivatives by the parameters; sums of products of those rows, of every eighth bin by itself.
TURN_REAL, TURN_IMAG, TURNS = 0, ROOM, 2 * ROOM
AT = DELAYS * TURNS
BETWEEN = AT + PARAMETERS * ROOM
SIGNAL = ROOM  # from the logarithm of the frequency on
PERIODOGRAM, COUNTS, SPECTRUM, FACTOR, EXCESS, SLOPES = (BETWEEN + (PARAMETERS + i) * ROOM for i in range(6))
PRODUCTS = SLOPES + PARAMETERS * ROOM
LANES = 8
WORK = PRODUCTS + PARAMETERS * (PARAMETERS + 3) // 2 * LANES
TOGETHER = 8  # factors whose product is far from underflow


@njit(inline="always", **SUMS)
def _exponential(x):
    """exp(x) by the series for x / 64: relative 1e-12 up to 5, which the compiler can do for several x at once."""
    y = x / 64.0
    series = 1 / 6 + y * (1 / 24 + y * (1 / 120 + y * (1 / 720 + y * (1 / 5040 + y * (1 / 40320)))))
    power = 1.0 + y * (1.0 + y * (0.5 + y * series))
    for _ in range(6):
        power *= power
    return power


@njit(inline="always", **SUMS)
def _copy(values, count, work, row):
    """Copy the first values into a row."""
    for t in range(count):
        work[row + t] = values[t]


@njit(inline="always", **SUMS)
def _respond(theta, omega, bin_width, delays, work, rows):
    """Fill rows with the signal and its derivatives at places a bin apart, the first at the angular frequency omega."""
    gain, slope = math.exp(theta[LOG_GAIN]), theta[SLOPE]
    inverse_w = math.exp(-theta[LOG_OMEGA])  # of 1 / w the compiler makes a division in each place again
    zeta, kappa = math.exp(theta[LOG_ZETA]), theta[KAPPA]
    for delay in range(delays):
        tau, off, share = _delay(theta, delays, delay)
        turns, first = delay * TURNS, delay == 0
        real, imag = math.cos(omega * tau), -math.sin(omega * tau)
        for t in range(ROOM):
            turned = omega + t * bin_width
            cosine = real * work[turns + TURN_REAL + t] - imag * work[turns + TURN_IMAG + t]
            sine = real * work[turns + TURN_IMAG + t] + imag * work[turns + TURN_REAL + t]
            r = turned * inverse_w
            damper = 2.0 * zeta * r
            in_phase = 1.0 - r * r + kappa * (1.0 - cosine)
            quadrature = damper - kappa * sine
            compliance = 1.0 / (in_phase * in_phase + quadrature * quadrature)
            log_frequency = work[rows + t]
            signal = share * gain * _exponential(slope * log_frequency) * compliance
            # d signal = -2 signal Re(dD / D)
            x = -2.0 * signal * compliance * in_phase
            y = -2.0 * signal * compliance * quadrature
            by_tau = kappa * turned * (y * cosine - x * sine)
            _put(work, rows + SIGNAL + LOG_GAIN * ROOM + t, signal, first)
            _put(work, rows + SIGNAL + SLOPE * ROOM + t, signal * log_frequency, first)
            _put(work, rows + SIGNAL + LOG_OMEGA * ROOM + t, x * 2.0 * r * r - y * damper, first)
            _put(work, rows + SIGNAL + LOG_ZETA * ROOM + t, y * damper, first)
            _put(work, rows + SIGNAL + KAPPA * ROOM + t, x * (1.0 - cosine) - y * sine, first)
            _put(work, rows + SIGNAL + LOG_TAU * ROOM + t, by_tau * tau, first)
            _put(work, rows + SIGNAL + LOG_SPREAD * ROOM + t, by_tau * off, first)


@njit(inline="always", **SUMS)
def _delay(theta, delays, delay):
    """One of so many delays, how far it is off the mean, and its weight."""
    tau = math.exp(theta[LOG_TAU])
    if delays == 1:
        return tau, 0.0, 1.0
    off = _OFFSETS[delay] * math.exp(theta[LOG_SPREAD]) * tau
    return tau + off, off, _WEIGHTS[delay]


@njit(inline="always", **SUMS)
def _put(work, place, value, first):
    """Put the first value in a place, or add another."""
    work[place] = value if first else work[place] + value


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
    theta : ndarray of float64, shape (8,)
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
    score : ndarray of float64, shape (8,)
        Filled with the negative gradient.
    information : ndarray of float64, shape (8, 8)
        Filled with the expected Hessian.
    """
    floor = math.exp(theta[LOG_FLOOR])
    for delay in range(delays):
        turn = cmath.exp(complex(0.0, -bin_width * _delay(theta, delays, delay)[0]))
        wave = complex(1.0, 0.0)
        for t in range(delay * TURNS, delay * TURNS + ROOM):
            work[TURN_REAL + t], work[TURN_IMAG + t] = wave.real, wave.imag
            wave *= turn
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
        _respond(theta, before, bin_width, delays, work, AT)
        _respond(theta, before - 0.5 * bin_width, bin_width, delays, work, BETWEEN)
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
    logarithms = 0.0
    for t in range(TILE // TOGETHER):
        product = 1.0
        for i in range(TOGETHER):
            product *= work[FACTOR + i * (TILE // TOGETHER) + t]
        logarithms += math.log(product)
    return ratios + logarithms
