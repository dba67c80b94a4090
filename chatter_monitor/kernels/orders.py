"""Spindle-synchronous part of a signal: a harmonic series that is predicted, subtracted, and followed tile by tile.

Within a tile the series turns at constant speed with constant amplitudes, so that the tile's prediction is known before
its first sample: subtracting it costs no delay, and no cut of the stream into blocks can change it. After its last
sample the tile is demodulated, which says how far every harmonic is from its prediction. What all harmonics turn by
together, each by its order, is the spindle's; a Kalman filter follows it. What remains moves the amplitudes.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.options import OPTIONS

# Sums over many harmonics or samples: in any order, which lets them run in vector lanes.
SUMS = {**OPTIONS, "fastmath": {"contract", "nsz", "reassoc"}}

# Power of a harmonic's average over the variance of that average: exponentially distributed with mean 1 where there is
# only noise. Below FAINT nothing is subtracted, above CLEAR all of it, and the harmonic helps to follow the speed.
FAINT = 6.0
CLEAR = 12.0

# A harmonic tells the phase of the spindle only while its own phase is known to well within a turn.
LARGEST_PHASE_SD = 0.5

# Indices of `OrderState.angle`
PHASE, SPEED, PHASE_VAR, COVARIANCE, SPEED_VAR = range(5)


class OrderState(NamedTuple):
    """The harmonic series; row h - 1 of each array is order h.

    Attributes
    ----------
    real, imag : ndarray of float64, shape (orders,)
        Complex amplitudes: harmonic h is Re(amplitude exp(j h angle)).
    variance : ndarray of float64, shape (orders,)
        Mean squared distance of one tile's amplitude from the average.
    gate : ndarray of float64, shape (orders,)
        Share of the amplitude that is subtracted, 0 to 1.
    angle : ndarray of float64, shape (5,)
        Angle of the spindle at the middle of the current tile (rad), its speed (rad per sample), their covariance.
    tiles : ndarray of int64, shape (1,)
        Tiles that the averages hold, at most their memory.
    work : ndarray of float64, shape (5, orders)
        Work space.
    """

    real: np.ndarray
    imag: np.ndarray
    variance: np.ndarray
    gate: np.ndarray
    angle: np.ndarray
    tiles: np.ndarray
    work: np.ndarray


def new_state(orders: int, speed: float, speed_sd: float) -> OrderState:
    """Series without amplitudes; ``speed`` and its standard deviation in radians per sample."""
    angle = np.array([0.0, speed, 0.0, 0.0, speed_sd * speed_sd])
    real, imag, variance, gate = np.zeros((4, orders))
    return OrderState(real, imag, variance, gate, angle, np.zeros(1, dtype=np.int64), np.zeros((5, orders)))


@njit(**SUMS)
def predict(state, out):
    """Fill ``out``, shape (tile,), with the current tile of what is to be subtracted."""
    now, before, step = state.work[0], state.work[1], state.work[2]
    speed = state.angle[SPEED]
    start = state.angle[PHASE] - 0.5 * (out.shape[0] - 1) * speed
    active = 0
    for i in range(state.real.shape[0]):
        if state.gate[i] > 0.0:
            order = i + 1.0
            real = state.gate[i] * state.real[i]
            imag = state.gate[i] * state.imag[i]
            now[active] = real * math.cos(order * start) - imag * math.sin(order * start)
            before[active] = real * math.cos(order * (start - speed)) - imag * math.sin(order * (start - speed))
            step[active] = 2.0 * math.cos(order * speed)
            active += 1
    for t in range(out.shape[0]):
        total = 0.0
        for i in range(active):
            value = now[i]
            total += value
            now[i] = step[i] * value - before[i]
            before[i] = value
        out[t] = total


@njit(**SUMS)
def demodulate(residual, state):
    """Complex amplitudes of all harmonics in a tile, by Goertzel's recursion, to ``work[0]`` and ``work[1]``."""
    one, two, step = state.work[0], state.work[1], state.work[2]
    orders = state.real.shape[0]
    phase = state.angle[PHASE]
    speed = state.angle[SPEED]
    size = residual.shape[0]
    for i in range(orders):
        one[i] = 0.0
        two[i] = 0.0
        step[i] = 2.0 * math.cos((i + 1.0) * speed)
    for t in range(size):
        sample = residual[t]
        for i in range(orders):
            value = sample + step[i] * one[i] - two[i]
            two[i] = one[i]
            one[i] = value
    for i in range(orders):
        order = i + 1.0
        # one - two exp(-j order speed), turned back to the middle of the tile and by the spindle's angle there
        real = one[i] - two[i] * math.cos(order * speed)
        imag = two[i] * math.sin(order * speed)
        turn = order * (0.5 * (size - 1) * speed + phase)
        one[i] = 2.0 / size * (real * math.cos(turn) + imag * math.sin(turn))
        two[i] = 2.0 / size * (imag * math.cos(turn) - real * math.sin(turn))


@njit(**OPTIONS)
def _advance(angle, size, drift):
    """Turn to the middle of the next tile; the speed is a random walk, ``drift`` its variance per sample."""
    angle[PHASE] = (angle[PHASE] + angle[SPEED] * size) % (2.0 * math.pi)
    angle[PHASE_VAR] += size * (2.0 * angle[COVARIANCE] + size * angle[SPEED_VAR]) + drift * size * size * size / 3.0
    angle[COVARIANCE] += size * angle[SPEED_VAR] + drift * size * size / 2.0
    angle[SPEED_VAR] += drift * size


@njit(**OPTIONS)
def _correct(state, lowest):
    """Kalman update of angle and speed by the phases of all clear harmonics together; returns the turn found."""
    angle = state.angle
    total = 0.0
    information = 0.0
    window = 2.0 * state.tiles[0]
    for i in range(lowest - 1, state.real.shape[0]):
        order = i + 1.0
        if order * order * angle[PHASE_VAR] > LARGEST_PHASE_SD * LARGEST_PHASE_SD and information > 0.0:
            break
        real, imag, variance = state.real[i], state.imag[i], state.variance[i]
        if window * (real * real + imag * imag) > CLEAR * variance and variance > 0.0:
            total += order * (state.work[1, i] * real - state.work[0, i] * imag) / variance
            information += order * order * (real * real + imag * imag) / variance
    if information == 0.0:
        return 0.0
    # each of the two components has half of the variance
    noise = 0.5 / information
    innovation = total / information
    spread = angle[PHASE_VAR] + noise
    gain = angle[PHASE_VAR] / spread
    speed_gain = angle[COVARIANCE] / spread
    turn = gain * innovation
    angle[PHASE] += turn
    angle[SPEED] += speed_gain * innovation
    angle[SPEED_VAR] -= speed_gain * angle[COVARIANCE]
    angle[COVARIANCE] *= 1.0 - gain
    angle[PHASE_VAR] *= 1.0 - gain
    return turn


@njit(**OPTIONS)
def _learn(state, lowest, turn, memory):
    """Average the tile's amplitudes, turned with the spindle, and decide what is steady enough to be subtracted."""
    tiles = state.tiles
    tiles[0] = min(tiles[0] + 1, memory)
    rate = 1.0 / tiles[0]
    window = 2.0 * tiles[0] - 1.0  # tiles of an average that forgets exponentially
    clear = 0
    for i in range(lowest - 1, state.real.shape[0]):
        order = i + 1.0
        cos, sin = math.cos(order * turn), math.sin(order * turn)
        real = state.work[0, i] * cos + state.work[1, i] * sin - state.real[i]
        imag = state.work[1, i] * cos - state.work[0, i] * sin - state.imag[i]
        distance = real * real + imag * imag
        state.variance[i] += rate * (distance - state.variance[i])
        state.real[i] += rate * real
        state.imag[i] += rate * imag
        power = window * (state.real[i] * state.real[i] + state.imag[i] * state.imag[i])
        if power > CLEAR * state.variance[i]:
            state.gate[i] = 1.0
            clear += 1
        elif power > FAINT * state.variance[i]:
            state.gate[i] = (power / state.variance[i] - FAINT) / (CLEAR - FAINT)
        else:
            state.gate[i] = 0.0
    return clear


@njit(**OPTIONS)
def follow(residual, state, lowest, memory, drift):
    """Take in a finished tile and turn to the next.

    Parameters
    ----------
    residual : ndarray of float64, shape (tile,)
        The tile's samples less what `predict` said; zero where samples are missing.
    state : OrderState
        Changed in place.
    lowest : int
        Lowest order that is followed.
    memory : int
        Tiles that the averages hold.
    drift : float
        Variance per sample of the speed's random walk, (rad per sample)^2.

    Returns
    -------
    int
        Harmonics that are clear.
    """
    demodulate(residual, state)
    for i in range(state.real.shape[0]):
        state.work[0, i] += state.gate[i] * state.real[i]
        state.work[1, i] += state.gate[i] * state.imag[i]
    turn = _correct(state, lowest)
    clear = _learn(state, lowest, turn, memory)
    _advance(state.angle, residual.shape[0], drift)
    return clear


@njit(**OPTIONS)
def coast(size, state, drift):
    """Turn to the next tile without learning from this one."""
    _advance(state.angle, size, drift)
