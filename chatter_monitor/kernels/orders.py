"""Spindle-synchronous part of a signal: one revolution of it as a table over the angle, subtracted sample by sample.

Three paces. Every sample is predicted from the table at the angle where the spindle will be. Every tile of 5 ms the
angle and the speed are corrected by what the prediction left over (Kalman filter), and what is left over then is folded
onto the revolution. Once in 50 ms, or in a revolution if that is longer, the Fourier coefficients of the fold move the
amplitudes of the harmonics; only harmonics that are steady enter the next table. Tiles lie on a fixed grid, and a
tile is predicted before its first sample: no delay, and no cut of the stream into blocks can change anything.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.options import OPTIONS

TILE = 64  # samples
POINTS = 1024  # of the table; four on the shortest period that can be among the harmonics
MOST_ORDERS = POINTS // 4

# Power of a harmonic's average over the variance of that average: exponentially distributed with mean 1 where there is
# only noise. Below FAINT nothing is subtracted, above CLEAR all of it, and the harmonic helps to follow the angle.
FAINT = 8.0
CLEAR = 14.0

# A harmonic tells the angle of the spindle only while its own phase is known to well within a turn.
LARGEST_PHASE_SD = 0.5

# How fast the filter learns how noisy its measurements are, and how unsteady the speed is, per tile.
ADAPTATION = 0.03
LARGEST_SURPRISE = 9.0  # squared innovations count as this many times their variance at most
LARGEST_NOISE = 100.0

TWO_PI = 2.0 * math.pi

# Indices of `OrderState.angle`: at the middle of the tile (rad, rad per sample) with covariance; variance per sample of
# the speed's random walk with its limits; noise of the measured angle over what the harmonics' scatter promises; the
# last innovation over its standard deviation; radians turned since the amplitudes moved.
PHASE, SPEED, PHASE_VAR, COVARIANCE, SPEED_VAR, DRIFT, LEAST_DRIFT, MOST_DRIFT, NOISE, INNOVATION, TURNED = range(11)

# Indices of `OrderState.counts`: samples of the tile that have come; samples folded; times that amplitudes have moved.
POSITION, FOLDED, LEARNED = range(3)

# Rows of `OrderState.tables`: the signal; the same with each harmonic over the variance of the noise around it.
SIGNAL, WEIGHTED = range(2)

# Rows of `OrderState.tile`: samples; their prediction; slope of the weighted table; that times the slope of the signal.
SAMPLES, PREDICTION, SLOPE, INFORMATION = range(4)


class OrderState(NamedTuple):
    """The harmonic series; entry h - 1 of each column of ``shape (orders,)`` is order h.

    Attributes
    ----------
    real, imag : ndarray of float64, shape (orders,)
        Complex amplitudes: harmonic h is Re(amplitude exp(j h angle)).
    variance : ndarray of float64, shape (orders,)
        Mean squared distance of the amplitude in one fold from the average.
    gate : ndarray of float64, shape (orders,)
        Share of the amplitude that is subtracted, 0 to 1.
    tables : ndarray of float64, shape (2, POINTS + 3)
        Over one revolution, from one point before angle zero to two points after the end.
    fold : ndarray of float64, shape (POINTS,)
        Sums of the residual over the angle.
    spectra : ndarray of complex128, shape (2, POINTS / 2 + 1)
        From which the tables are to be made.
    tile : ndarray of float64, shape (4, TILE)
        The current tile.
    angle : ndarray of float64, shape (11,)
        The Kalman filter.
    counts : ndarray of int64, shape (3,)
    """

    real: np.ndarray
    imag: np.ndarray
    variance: np.ndarray
    gate: np.ndarray
    tables: np.ndarray
    fold: np.ndarray
    spectra: np.ndarray
    tile: np.ndarray
    angle: np.ndarray
    counts: np.ndarray


def new_state(orders: int, speed: float, speed_sd: float, drift: tuple[float, float]) -> OrderState:
    """Series without amplitudes.

    Parameters
    ----------
    orders : int
        Highest order, at most `MOST_ORDERS`.
    speed, speed_sd : float
        Radians per sample.
    drift : (float, float)
        Least and largest variance per sample of the speed's random walk, (rad per sample)^2.
    """
    real, imag, variance, gate = np.zeros((4, orders))
    angle = np.zeros(11)
    angle[[SPEED, SPEED_VAR, LEAST_DRIFT, MOST_DRIFT, NOISE]] = speed, speed_sd**2, *drift, 1.0
    angle[DRIFT] = math.sqrt(drift[0] * drift[1])
    return OrderState(
        real, imag, variance, gate,
        np.zeros((2, POINTS + 3)), np.zeros(POINTS), np.zeros((2, POINTS // 2 + 1), dtype=np.complex128),
        np.zeros((4, TILE)), angle, np.zeros(3, dtype=np.int64),
    )  # fmt: skip


@njit(**OPTIONS)
def _place(angle):
    """Index of the table's point before an angle, and the fraction of the way to the next."""
    turn = angle / TWO_PI
    place = (turn - math.floor(turn)) * POINTS
    index = min(int(place), POINTS - 1)
    return index, place - index


@njit(**OPTIONS)
def _between(table, index, x):
    """Cubic through the four points around (Lagrange)."""
    a, b, c, d = table[index], table[index + 1], table[index + 2], table[index + 3]
    return b + x * (c - a / 3.0 - b / 2.0 - d / 6.0 + x * ((a + c) / 2.0 - b + x * ((b - c) / 2.0 + (d - a) / 6.0)))


@njit(**OPTIONS)
def _slope(table, index, x):
    """Slope of that cubic per radian."""
    a, b, c, d = table[index], table[index + 1], table[index + 2], table[index + 3]
    per_point = c - a / 3.0 - b / 2.0 - d / 6.0 + x * (a + c - 2.0 * b + x * ((b - c) * 1.5 + (d - a) * 0.5))
    return per_point * (POINTS / TWO_PI)


@njit(**OPTIONS)
def _predict(state):
    """Look ahead over the tile that begins."""
    tile = state.tile
    signal, weighted = state.tables[SIGNAL], state.tables[WEIGHTED]
    speed = state.angle[SPEED]
    angle = state.angle[PHASE] - 0.5 * (TILE - 1) * speed
    for t in range(TILE):
        index, x = _place(angle)
        tile[PREDICTION, t] = _between(signal, index, x)
        tile[SLOPE, t] = _slope(weighted, index, x)
        tile[INFORMATION, t] = tile[SLOPE, t] * _slope(signal, index, x)
        angle += speed


@njit(**OPTIONS)
def _correct(state):
    """Kalman update of angle and speed by the tile: the residual along the slope of the weighted signal."""
    angle, tile = state.angle, state.tile
    score = 0.0
    information = 0.0
    for t in range(TILE):
        residual = tile[SAMPLES, t] - tile[PREDICTION, t]
        if abs(residual) < np.inf:
            score += residual * tile[SLOPE, t]
            information += tile[INFORMATION, t]
    if not information > 0.0:
        return
    innovation = score / information
    spread = angle[PHASE_VAR] + angle[NOISE] / information
    gain = angle[PHASE_VAR] / spread
    speed_gain = angle[COVARIANCE] / spread
    angle[PHASE] += gain * innovation
    angle[SPEED] += speed_gain * innovation
    angle[SPEED_VAR] -= speed_gain * angle[COVARIANCE]
    angle[COVARIANCE] *= 1.0 - gain
    angle[PHASE_VAR] *= 1.0 - gain
    # Innovations of the right size are as large as promised, and each knows nothing of the last. What follows on from
    # the last is a speed that the filter is too slow for, or, with the other sign, noise that it is too quick for.
    relative = innovation / math.sqrt(spread)
    limited = math.copysign(min(abs(relative), math.sqrt(LARGEST_SURPRISE)), relative)
    angle[NOISE] *= math.exp(ADAPTATION * (limited * limited - 1.0))
    angle[NOISE] = min(max(angle[NOISE], 1.0), LARGEST_NOISE)
    angle[DRIFT] *= math.exp(ADAPTATION * limited * angle[INNOVATION])
    angle[DRIFT] = min(max(angle[DRIFT], angle[LEAST_DRIFT]), angle[MOST_DRIFT])
    angle[INNOVATION] = limited


@njit(**OPTIONS)
def _fold(state):
    """Add what is left of the tile, at the corrected angles, to the fold."""
    tile, fold, signal = state.tile, state.fold, state.tables[SIGNAL]
    speed = state.angle[SPEED]
    angle = state.angle[PHASE] - 0.5 * (TILE - 1) * speed
    for t in range(TILE):
        sample = tile[SAMPLES, t]
        if abs(sample) < np.inf:
            index, x = _place(angle)
            residual = sample - _between(signal, index, x)
            fold[index] += (1.0 - x) * residual
            fold[index + 1 if index + 1 < POINTS else 0] += x * residual
            state.counts[FOLDED] += 1
        angle += speed
    state.angle[TURNED] += TILE * speed


@njit(**OPTIONS)
def _advance(angle):
    """Turn to the middle of the next tile; the speed is a random walk."""
    n, drift = TILE, angle[DRIFT]
    angle[PHASE] = (angle[PHASE] + angle[SPEED] * n) % TWO_PI
    angle[PHASE_VAR] += n * (2.0 * angle[COVARIANCE] + n * angle[SPEED_VAR]) + drift * n * n * n / 3.0
    angle[COVARIANCE] += n * angle[SPEED_VAR] + drift * n * n / 2.0
    angle[SPEED_VAR] += drift * n


@njit(**OPTIONS)
def subtract(samples, state, out):
    """Take the synchronous part out of samples and learn from them.

    Parameters
    ----------
    samples, out : ndarray of float64, shape (n,)
        The signal, not finite where samples are missing; what remains of it.
    state : OrderState
        Changed in place.
    """
    counts, tile = state.counts, state.tile
    for t in range(samples.shape[0]):
        if counts[POSITION] == 0:
            _predict(state)
        tile[SAMPLES, counts[POSITION]] = samples[t]
        out[t] = samples[t] - tile[PREDICTION, counts[POSITION]]
        counts[POSITION] += 1
        if counts[POSITION] == TILE:
            _correct(state)
            _fold(state)
            _advance(state.angle)
            counts[POSITION] = 0


@njit(**OPTIONS)
def learn(coefficients, state, lowest, memory):
    """Move the amplitudes by what was folded, decide what is steady, and lay down the spectra of the next tables.

    Parameters
    ----------
    coefficients : ndarray of complex128, shape (POINTS / 2 + 1,)
        Discrete Fourier transform of the fold.
    state : OrderState
        Changed in place; the fold is emptied. The tables are the caller's to renew.
    lowest : int
        Lowest order that is followed.
    memory : float
        Samples over which amplitudes are averaged.

    Returns
    -------
    int
        Harmonics that are clear.
    """
    counts, spectra, angle = state.counts, state.spectra, state.angle
    folded = counts[FOLDED]
    counts[LEARNED] += 1
    rate = min(1.0, max(1.0 / counts[LEARNED], folded / memory))
    window = 2.0 / rate - 1.0  # folds that an exponential average amounts to
    clear = 0
    for i in range(lowest - 1, state.real.shape[0]):
        order = i + 1
        part = math.pi * order / POINTS
        scale = 2.0 / folded * (part / math.sin(part)) ** 2  # sharing between two points blunts high orders
        real = scale * coefficients[order].real - (1.0 - state.gate[i]) * state.real[i]
        imag = scale * coefficients[order].imag - (1.0 - state.gate[i]) * state.imag[i]
        state.variance[i] += rate * (real * real + imag * imag - state.variance[i])
        state.real[i] += rate * real
        state.imag[i] += rate * imag
        signal = window * (state.real[i] * state.real[i] + state.imag[i] * state.imag[i])
        state.gate[i] = min(max((signal / state.variance[i] - FAINT) / (CLEAR - FAINT), 0.0), 1.0)
        spectra[SIGNAL, order] = complex(state.real[i], state.imag[i]) * (state.gate[i] * 0.5 * POINTS)
        spectra[WEIGHTED, order] = 0.0
        if state.gate[i] == 1.0:
            clear += 1
            if clear == 1 or order * order * angle[PHASE_VAR] < LARGEST_PHASE_SD * LARGEST_PHASE_SD:
                # variance of an amplitude over so many samples, times a quarter of them, is that of one sample
                spectra[WEIGHTED, order] = spectra[SIGNAL, order] * 4.0 / (state.variance[i] * folded)
    state.fold[:] = 0.0
    counts[FOLDED] = 0
    angle[TURNED] = 0.0
    return clear


@njit(**OPTIONS)
def renew(tables, state):
    """Put tables of shape (2, POINTS) in place of the old ones."""
    for row in range(2):
        for i in range(POINTS + 3):
            state.tables[row, i] = tables[row, (i - 1) % POINTS]
