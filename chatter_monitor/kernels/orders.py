"""Spindle-synchronous part of a signal: one revolution of it as a table over the angle, subtracted sample by sample.

Three paces. Every sample is predicted from the table at the angle where the spindle will be. Every tile of 5 ms the
angle and the speed are corrected by what the prediction left over (Kalman filter), and what is left over then is folded
onto the revolution. Once in 50 ms, or in a revolution if that is longer, the Fourier coefficients of the fold move the
amplitudes of the harmonics; only harmonics that are steady enter the next table. Tiles lie on a fixed grid, and a
tile is predicted before its first sample: no delay, and no cut of the stream into blocks can change anything.
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.lanes import as_lanes
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.polynomial import cubic
from chatter_monitor.kernels.transform import new_turns, real_transform, transform

TILE = 64  # samples
MOST_ORDERS = 256

# Power of a harmonic's average over the variance of that average: exponentially distributed with mean 1 where there is
# only noise. Below FAINT nothing is subtracted, above CLEAR all of it, and the harmonic helps to follow the angle.
FAINT = 8.0
CLEAR = 14.0

# A harmonic tells the angle of the spindle only while its own phase is known to well within a turn.
LARGEST_PHASE_SD = 0.5

# Harmonics have jumped together when they have become so much louder, besides, as a part of what they were (amplitude),
# that is so much of how they have changed, and there are so many: chatter that has locked to the teeth has a few.
JUMP, ALIKE, TOGETHER = 0.7, 0.7, 4

# How fast the filter learns how noisy its measurements are, and how unsteady the speed is, per tile.
ADAPTATION = 0.03
LARGEST_SURPRISE = 9.0  # squared innovations count as this many times their variance at most
LARGEST_NOISE = 100.0

TWO_PI = 2.0 * math.pi

# Indices of `OrderState.angle`: at the middle of the tile (rad, rad per sample) with covariance; variance per sample of
# the speed's random walk with its limits; noise of the measured angle over what the harmonics' scatter promises; the
# last innovation over its standard deviation; radians turned since the amplitudes moved; offset of the residual; sums
# of squares of the signal and of its prediction since the amplitudes moved.
(
    PHASE, SPEED, PHASE_VAR, COVARIANCE, SPEED_VAR,
    DRIFT, LEAST_DRIFT, MOST_DRIFT, NOISE, INNOVATION, TURNED, OFFSET,
    HEARD, PREDICTED,
) = range(14)  # fmt: skip

# Indices of `OrderState.counts`: samples of the tile that have come; samples folded; times that amplitudes have moved;
# an order that is left in the signal, 0 for none.
POSITION, FOLDED, LEARNED, LEFT = range(4)

# Rows of `OrderState.tables`: the signal; the same with each harmonic over the variance of the noise around it.
SIGNAL, WEIGHTED = range(2)

# Rows of `OrderState.tile`: samples, less the offset; their prediction; slope of the weighted table; that times the
# slope of the signal.
SAMPLES, PREDICTION, SLOPE, INFORMATION = range(4)


class OrderState(NamedTuple):
    """The harmonic series; entry h - 1 of each column of ``shape (orders,)`` is order h.

    A revolution has a power of two of points, at least four on the shortest period.

    Attributes
    ----------
    real, imag : ndarray of float64, shape (orders,)
        Complex amplitudes: harmonic h is Re(amplitude exp(j h angle)).
    variance : ndarray of float64, shape (orders,)
        Mean squared distance of the amplitude in one fold from the average.
    gate : ndarray of float64, shape (orders,)
        Share of the amplitude that is subtracted, 0 to 1.
    tables : ndarray of float64, shape (2, points + 3)
        Over one revolution, from one point before angle zero to two points after the end.
    fold : ndarray of float64, shape (points,)
        Sums of the residual over the angle.
    coefficients : ndarray of complex128, shape (orders + 1,)
        Fourier coefficients of the fold.
    spectra : ndarray of complex128, shape (2, orders + 1)
        Fourier coefficients from which the tables are made.
    turns : ndarray of complex128, shape (points,)
        Powers of exp(-2 pi i / points).
    work : ndarray of float64, shape (4, points)
        Work space of the transforms.
    tile : ndarray of float64, shape (4, TILE)
        The current tile.
    angle : ndarray of float64, shape (14,)
        The Kalman filter.
    counts : ndarray of int64, shape (4,)
    """

    real: np.ndarray
    imag: np.ndarray
    variance: np.ndarray
    gate: np.ndarray
    tables: np.ndarray
    fold: np.ndarray
    coefficients: np.ndarray
    spectra: np.ndarray
    turns: np.ndarray
    work: np.ndarray
    tile: np.ndarray
    angle: np.ndarray
    counts: np.ndarray


@cache
def _turns(points: int) -> np.ndarray:
    """Shared by all series of so many points."""
    turns = new_turns(points)
    turns.flags.writeable = False
    return turns


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
    points = 4 << (orders - 1).bit_length()
    real, imag, variance, gate = np.zeros((4, orders))
    angle = np.zeros(14)
    angle[[SPEED, SPEED_VAR, LEAST_DRIFT, MOST_DRIFT, NOISE]] = speed, speed_sd**2, *drift, 1.0
    angle[DRIFT] = math.sqrt(drift[0] * drift[1])
    return OrderState(
        real, imag, variance, gate,
        np.zeros((2, points + 3)), np.zeros(points),
        np.zeros(orders + 1, dtype=np.complex128), np.zeros((2, orders + 1), dtype=np.complex128),
        _turns(points), np.zeros((4, points)),
        np.zeros((4, TILE)), angle, np.zeros(4, dtype=np.int64),
    )  # fmt: skip


@njit(**OPTIONS)
def _between(table, index, x):
    """Cubic through the four points around, a fraction x of the way from one to the next."""
    return cubic(table[index], table[index + 1], table[index + 2], table[index + 3], x)


@njit(**OPTIONS)
def _start(angle, points):
    """Place in the table, 0 to points, at the tile's first sample, and places per sample."""
    step = angle[SPEED] * points / TWO_PI
    place = (angle[PHASE] * points / TWO_PI - 0.5 * (TILE - 1) * step) % points
    return place if place < points else 0.0, step


@njit(**OPTIONS)
def _predict(state):
    """Look ahead over the tile that begins."""
    tile = state.tile
    signal, weighted = state.tables[SIGNAL], state.tables[WEIGHTED]
    points = state.fold.shape[0]
    per_radian = points / TWO_PI
    place, step = _start(state.angle, points)
    for t in range(TILE):
        index = int(place)
        tile[PREDICTION, t] = _between(signal, index, place - index)
        slope = (weighted[index + 2] - weighted[index + 1]) * per_radian
        tile[SLOPE, t] = slope
        tile[INFORMATION, t] = slope * (signal[index + 2] - signal[index + 1]) * per_radian
        place += step
        if place >= points:
            place -= points


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
    points = fold.shape[0]
    place, step = _start(state.angle, points)
    for t in range(TILE):
        sample = tile[SAMPLES, t]
        if abs(sample) < np.inf:
            state.angle[HEARD] += sample * sample
            state.angle[PREDICTED] += tile[PREDICTION, t] * tile[PREDICTION, t]
            index = int(place)
            x = place - index
            residual = sample - _between(signal, index, x)
            fold[index] += (1.0 - x) * residual
            fold[index + 1 if index + 1 < points else 0] += x * residual
            state.counts[FOLDED] += 1
        place += step
        if place >= points:
            place -= points
    state.angle[TURNED] += TILE * state.angle[SPEED]


@njit(**OPTIONS)
def _advance(angle):
    """Turn to the middle of the next tile; the speed is a random walk."""
    n, drift = TILE, angle[DRIFT]
    angle[PHASE] = (angle[PHASE] + angle[SPEED] * n) % TWO_PI
    angle[PHASE_VAR] += n * (2.0 * angle[COVARIANCE] + n * angle[SPEED_VAR]) + drift * n * n * n / 3.0
    angle[COVARIANCE] += n * angle[SPEED_VAR] + drift * n * n / 2.0
    angle[SPEED_VAR] += drift * n


@njit(**OPTIONS)
def subtract(samples, state, corner, out):
    """Take the synchronous part out of samples and learn from them.

    Parameters
    ----------
    samples, out : ndarray of float64, shape (n,)
        The signal, not finite where samples are missing; what remains of it.
    state : OrderState
        Changed in place.
    corner : float
        What changes slower than this, in radians per sample, is offset: nothing is learned from it.
    """
    counts, tile, angle = state.counts, state.tile, state.angle
    begin = 0
    while begin < samples.shape[0]:
        first = counts[POSITION]
        if first == 0:
            _predict(state)
        size = min(TILE - first, samples.shape[0] - begin)
        offset = angle[OFFSET]
        for i in range(size):
            sample = samples[begin + i]
            residual = sample - tile[PREDICTION, first + i]
            out[begin + i] = residual
            if abs(residual) < np.inf:
                offset += corner * (residual - offset)
            tile[SAMPLES, first + i] = sample - offset
        angle[OFFSET] = offset
        begin += size
        counts[POSITION] += size
        if counts[POSITION] == TILE:
            _correct(state)
            _fold(state)
            _advance(state.angle)
            counts[POSITION] = 0


@njit(**OPTIONS)
def learn(state, lowest, memory):
    """Move the amplitudes by what was folded, decide what is steady, and lay down the next tables.

    Parameters
    ----------
    state : OrderState
        Changed in place; the fold is emptied.
    lowest : int
        Lowest order that is followed.
    memory : float
        Samples over which amplitudes are averaged.
    """
    _transform_fold(state)
    _move(state, lowest, memory)
    _renew(state)


@njit(**OPTIONS)
def _transform_fold(state):
    """Fourier coefficients of the fold: of its points with an even number, and those with an odd one, at once."""
    fold, work = state.fold, state.work
    for k in range(fold.shape[0] // 2):
        work[0, k], work[1, k] = fold[2 * k], fold[2 * k + 1]
    re, im = as_lanes(work[0], 1), as_lanes(work[1], 1)
    real_transform(re, im, as_lanes(work[2], 1), as_lanes(work[3], 1), state.turns)
    for order in range(state.coefficients.shape[0]):
        state.coefficients[order] = complex(work[0, order], work[1, order])


@njit(**OPTIONS)
def _move(state, lowest, memory):
    """Move the amplitudes, and fill in the spectra of the next tables."""
    counts, coefficients, spectra, angle = state.counts, state.coefficients, state.spectra, state.angle
    folded, points = counts[FOLDED], state.fold.shape[0]
    counts[LEARNED] += 1
    rate = min(1.0, max(1.0 / counts[LEARNED], folded / memory))
    window = 2.0 / rate - 1.0  # folds that an exponential average amounts to
    # No part of a signal is louder than the signal. When the tool has left, what was taken out would go on being
    # subtracted from the air for a memory, and be heard there.
    too_loud = angle[PREDICTED] > angle[HEARD]
    still_there = math.sqrt(angle[HEARD] / angle[PREDICTED]) if too_loud else 1.0
    turn = 0.0
    weight = 0.0
    louder = certain = changed = 0.0
    clear = 0
    for i in range(lowest - 1, state.real.shape[0]):
        order = i + 1
        part = math.pi * order / points
        scale = 2.0 / folded * (part / math.sin(part)) ** 2  # sharing between two points blunts high orders
        # from the average to the amplitude in this fold
        coefficients[order] = scale * coefficients[order] - (1.0 - state.gate[i]) * complex(
            state.real[i], state.imag[i]
        )
        if state.gate[i] == 1.0:
            torque = coefficients[order].imag * state.real[i] - coefficients[order].real * state.imag[i]
            power = state.real[i] * state.real[i] + state.imag[i] * state.imag[i]
            turn += order * torque / state.variance[i]
            weight += order * order * power / state.variance[i]
            along = coefficients[order].real * state.real[i] + coefficients[order].imag * state.imag[i]
            told = power / (power + state.variance[i])  # as far as a fold tells it
            clear += 1
            certain += told
            louder += told * along / power
            changed += told * (along * along + torque * torque) / (power * power)
    if weight > 0.0:
        turn /= weight
    together = clear >= TOGETHER and louder * louder > ALIKE * certain * changed
    if together and louder > JUMP * certain:
        louder /= certain
        _jump(coefficients, state, louder)
        turn /= 1.0 + louder
    clear = 0
    for i in range(lowest - 1, state.real.shape[0]):
        order = i + 1
        # What all harmonics turn by together is the angle's business; let them turn, and the angle would never learn.
        real = coefficients[order].real + order * turn * state.imag[i]
        imag = coefficients[order].imag - order * turn * state.real[i]
        state.variance[i] += rate * (real * real + imag * imag - state.variance[i])
        state.real[i] = still_there * (state.real[i] + rate * real)
        state.imag[i] = still_there * (state.imag[i] + rate * imag)
        signal = window * (state.real[i] * state.real[i] + state.imag[i] * state.imag[i])
        state.gate[i] = min(max((signal / state.variance[i] - FAINT) / (CLEAR - FAINT), 0.0), 1.0)
        if order == counts[LEFT]:
            state.gate[i] = 0.0
        spectra[SIGNAL, order] = complex(state.real[i], state.imag[i]) * (state.gate[i] * 0.5 * points)
        spectra[WEIGHTED, order] = 0.0
        if state.gate[i] == 1.0:
            clear += 1
            if clear == 1 or order * order * angle[PHASE_VAR] < LARGEST_PHASE_SD * LARGEST_PHASE_SD:
                # variance of an amplitude over so many samples, times a quarter of them, is that of one sample
                spectra[WEIGHTED, order] = spectra[SIGNAL, order] * 4.0 / (state.variance[i] * folded)
    state.fold[:] = 0.0
    counts[FOLDED] = 0
    angle[TURNED] = angle[HEARD] = angle[PREDICTED] = 0.0


@njit(**OPTIONS)
def _jump(coefficients, state, louder):
    """Make all harmonics louder by a part of what they are: a load does that from one moment to the next.

    To follow it one by one they would need a memory, in which most of what turns is left in the signal. What excites
    itself makes a few of them louder, and not the others.
    """
    for i in range(state.real.shape[0]):
        coefficients[i + 1] -= louder * complex(state.real[i], state.imag[i])
        state.real[i] *= 1.0 + louder
        state.imag[i] *= 1.0 + louder
        state.variance[i] *= (1.0 + louder) * (1.0 + louder)


@njit(**OPTIONS)
def _renew(state):
    """Make both tables from their spectra: real and imaginary part of one complex transform.

    That goes backwards, which it does forwards with real and imaginary parts exchanged. Both parts have to be about as
    large, or the smaller one would be lost in the rounding of the other; and nothing has to stay nothing.
    """
    spectra, tables, work = state.spectra, state.tables, state.work
    points = state.fold.shape[0]
    signal_size, weighted_size = _size(spectra[SIGNAL]), _size(spectra[WEIGHTED])
    scale = 2.0 ** round(math.log2(signal_size / weighted_size)) if 0.0 < weighted_size < math.inf else 0.0
    unscale = 1.0 / scale if scale > 0.0 else 0.0
    work[:2] = 0.0
    for order in range(1, spectra.shape[1]):
        signal, weighted = spectra[SIGNAL, order] / points, spectra[WEIGHTED, order] * (scale / points)
        work[0, order], work[1, order] = signal.imag + weighted.real, signal.real - weighted.imag
        work[0, points - order], work[1, points - order] = weighted.real - signal.imag, signal.real + weighted.imag
    re, im = as_lanes(work[0], 1), as_lanes(work[1], 1)
    there = transform(re, im, as_lanes(work[2], 1), as_lanes(work[3], 1), points, state.turns)
    for row, part, share in ((SIGNAL, 3 if there else 1, 1.0), (WEIGHTED, 2 if there else 0, unscale)):
        tables[row, 0] = work[part, points - 1] * share
        for i in range(points):
            tables[row, 1 + i] = work[part, i] * share
        for i in range(2):
            tables[row, 1 + points + i] = work[part, i] * share


@njit(**OPTIONS)
def _size(spectrum):
    """Size of the largest number of a spectrum, to a factor of the square root of two."""
    size = 0.0
    for order in range(spectrum.shape[0]):
        size = max(size, abs(spectrum[order].real) + abs(spectrum[order].imag))
    return size
