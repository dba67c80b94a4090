"""Spectrum of one mode with a regenerative delay, its likelihood, and where that is largest.

    x'' + 2 zeta w x' + w^2 x + kappa w^2 [x - x(t - tau)] = W

With r = omega / w its dynamic stiffness over w^2 is

    D = 1 - r^2 + 2 i zeta r + kappa [1 - exp(-i omega tau)],

and what a sensor delivers has the spectrum S = gain (omega / omega_0)^slope / abs(D)^2 + floor: the slope is 0, 2 or 4
for displacement, velocity and acceleration and takes up the colour of the force, the floor is the sensor's noise.
"""

import cmath
import math
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.delay_roots import critical_coefficient
from chatter_monitor.kernels.options import OPTIONS

# Indices into the parameters
LOG_GAIN, SLOPE, LOG_OMEGA, LOG_ZETA, KAPPA, LOG_TAU, LOG_FLOOR = range(7)
PARAMETERS = 7

# Power response of the Hann window at distances of 0, 1/2, 1 and 3/2 bins; beyond that 0.03 % are left. The mean of a
# periodogram is the spectrum convolved with it, which samples at half bins represent as long as the signal forgets
# within the window (Sykulski et al., The debiased Whittle likelihood, Biometrika 106, 2019).
HANN_POWER = np.array([0.25, 0.18012655, 0.0625, 0.00720506])
HANN_POWER /= HANN_POWER[0] + 2.0 * HANN_POWER[1:].sum()
REACH = 3  # half bins

FIRST_DAMPING = 1e-3
CONVERGED = 0.02  # nats that a step promises: a fifth of a standard deviation, and the step is still taken
LARGEST_STEP = (2.0, 2.0, 0.02, 0.5, 0.1, 0.01, 2.0)

# Indices of what a climb keeps from piece to piece: the negative log-posterior where it is, Levenberg's damping, and
# how many steps it may still take.
VALUE, DAMPING, STEPS_LEFT = range(3)


@njit(**OPTIONS)
def whittle(theta, first, bin_width, log_frequency, periodogram, used, window, work, score, information):
    """Whittle's likelihood of a periodogram under the model: the sum of log S + I / S over the bins, to be made small.

    Parameters
    ----------
    theta : ndarray of float64, shape (7,)
        Parameters in the order above.
    first, bin_width : float
        Angular frequency of the first bin and distance of the bins, in rad/s.
    log_frequency : ndarray of float64, shape (2 n + 5,)
        log(omega / omega_0) at the half bins from three before the first bin to three behind the last.
    periodogram : ndarray of float64, shape (n,)
        Of Hann windows; its unit is that of the gain.
    used : ndarray of bool, shape (n,)
        Bins to take into account.
    window : ndarray of float64, shape (4,)
        `HANN_POWER`.
    work : ndarray of float64, shape (8, >= 2 n + 5)
        The first n entries of row 0 are left with S, the window's effect included; the rest is work space.
    score : ndarray of float64, shape (7,)
        Filled with the negative gradient.
    information : ndarray of float64, shape (7, 7)
        Filled with the expected Hessian.
    """
    gain = math.exp(theta[LOG_GAIN])
    floor = math.exp(theta[LOG_FLOOR])
    w = math.exp(theta[LOG_OMEGA])
    zeta = math.exp(theta[LOG_ZETA])
    kappa = theta[KAPPA]
    tau = math.exp(theta[LOG_TAU])
    bins = periodogram.shape[0]
    half = 0.5 * bin_width
    start = first - REACH * half
    wave = cmath.exp(complex(0.0, -start * tau))
    turn = cmath.exp(complex(0.0, -half * tau))
    for k in range(2 * bins - 1 + 2 * REACH):
        omega = start + k * half
        r = omega / w
        damper = 2.0 * zeta * r
        in_phase = 1.0 - r * r + kappa * (1.0 - wave.real)
        quadrature = damper - kappa * wave.imag
        compliance = 1.0 / (in_phase * in_phase + quadrature * quadrature)
        signal = gain * math.exp(theta[SLOPE] * log_frequency[k]) * compliance
        # d signal = -2 signal Re(dD / D)
        x = -2.0 * signal * compliance * in_phase
        y = -2.0 * signal * compliance * quadrature
        work[0, k] = signal + floor
        work[1 + LOG_GAIN, k] = signal
        work[1 + SLOPE, k] = signal * log_frequency[k]
        work[1 + LOG_OMEGA, k] = x * 2.0 * r * r - y * damper
        work[1 + LOG_ZETA, k] = y * damper
        work[1 + KAPPA, k] = x * (1.0 - wave.real) - y * wave.imag
        work[1 + LOG_TAU, k] = kappa * omega * tau * (y * wave.real - x * wave.imag)
        wave *= turn
    for i in range(PARAMETERS):
        score[i] = 0.0
        for j in range(PARAMETERS):
            information[i, j] = 0.0
    total = 0.0
    slopes = work[7]
    for n in range(bins):
        k = 2 * n + REACH
        S = window[0] * work[0, k]
        for m in range(1, REACH + 1):
            S += window[m] * (work[0, k - m] + work[0, k + m])
        work[0, n] = S  # that place has been read for the last time
        if not used[n]:
            continue
        inverse = 1.0 / S
        for i in range(LOG_FLOOR):
            slope = window[0] * work[1 + i, k]
            for m in range(1, REACH + 1):
                slope += window[m] * (work[1 + i, k - m] + work[1 + i, k + m])
            slopes[i] = slope * inverse
        slopes[LOG_FLOOR] = floor * inverse
        ratio = periodogram[n] * inverse
        total += math.log(S) + ratio
        for i in range(PARAMETERS):
            score[i] += (ratio - 1.0) * slopes[i]
            for j in range(i + 1):
                information[i, j] += slopes[i] * slopes[j]
    for i in range(PARAMETERS):
        for j in range(i):
            information[j, i] = information[i, j]
    return total


class Likelihood(NamedTuple):
    """What the parameters are fitted to: arguments of `whittle` by their names, and what is believed beforehand.

    Attributes
    ----------
    weight : float
        By which the likelihood of the bins counts.
    prior_mean, prior_precision : ndarray of float64, shape (7,)
        Of an independent normal distribution.
    """

    first: float
    bin_width: float
    log_frequency: np.ndarray
    periodogram: np.ndarray
    used: np.ndarray
    window: np.ndarray
    work: np.ndarray
    weight: float
    prior_mean: np.ndarray
    prior_precision: np.ndarray


@njit(**OPTIONS)
def posterior(theta, likelihood, score, information):
    """Negative log-posterior, its negative gradient and its expected Hessian, as in `whittle`."""
    value = likelihood.weight * whittle(
        theta, likelihood.first, likelihood.bin_width, likelihood.log_frequency, likelihood.periodogram,
        likelihood.used, likelihood.window, likelihood.work, score, information,
    )  # fmt: skip
    for i in range(PARAMETERS):
        away = theta[i] - likelihood.prior_mean[i]
        value += 0.5 * likelihood.prior_precision[i] * away * away
        score[i] = likelihood.weight * score[i] - likelihood.prior_precision[i] * away
        for j in range(PARAMETERS):
            information[i, j] *= likelihood.weight
        information[i, i] += likelihood.prior_precision[i]
    return value


@njit(**OPTIONS)
def stabilise(theta):
    """Mirror what lies beyond the limit.

    A root as far to the right of the imaginary axis as it was to the left has the same spectrum. What is stationary has
    none there; growth is for others to see.
    """
    critical = critical_coefficient(math.exp(theta[LOG_OMEGA]), math.exp(theta[LOG_ZETA]), math.exp(theta[LOG_TAU]))
    if theta[KAPPA] > critical:
        theta[KAPPA] = max(2.0 * critical - theta[KAPPA], 0.5 * critical)


@njit(**OPTIONS)
def begin_climb(theta, likelihood, steps, space, information, progress):
    """Begin a climb of so many steps at most; arguments as of `climb`."""
    progress[VALUE] = posterior(theta, likelihood, space[0], information)
    progress[DAMPING] = FIRST_DAMPING
    progress[STEPS_LEFT] = steps


@njit(**OPTIONS)
def climb(theta, likelihood, steps, space, information, progress):
    """Fisher scoring with Levenberg's damping, so many steps of it; returns whether there are more to take.

    Parameters
    ----------
    theta : ndarray of float64, shape (7,)
        Where to start; overwritten with where it ends.
    likelihood : Likelihood
        When the climb is over, the first row of its ``work`` is left as by `whittle` for the result.
    steps : int
        At most.
    space : ndarray of float64, shape (18, 7)
        Kept from piece to piece; the first row is the negative gradient.
    information : ndarray of float64, shape (7, 7)
        Expected Hessian, at the result in the end.
    progress : ndarray of float64, shape (3,)
        At the indices above.
    """
    score, ahead, ahead_score, step = space[0], space[1], space[2], space[3]
    ahead_information, damped = space[4:11], space[11:18]
    rejected = False
    for _ in range(steps):
        if not progress[STEPS_LEFT] > 0.0:
            break
        progress[STEPS_LEFT] -= 1.0
        for i in range(PARAMETERS):
            step[i] = score[i]
            for j in range(PARAMETERS):
                damped[i, j] = information[i, j]
            damped[i, i] += progress[DAMPING] * (information[i, i] + 1e-12)
        if not solve(damped, step):  # a spectrum that is all line tells nothing of some parameter
            progress[STEPS_LEFT] = 0.0
            break
        longest = 1.0
        for i in range(PARAMETERS):
            longest = max(longest, abs(step[i]) / LARGEST_STEP[i])
        promised = 0.0
        for i in range(PARAMETERS):
            step[i] /= longest
            promised += score[i] * step[i]
            ahead[i] = theta[i] + step[i]
        stabilise(ahead)
        trial = posterior(ahead, likelihood, ahead_score, ahead_information)
        rejected = not trial < progress[VALUE]
        if rejected:
            progress[DAMPING] *= 8.0
        else:
            progress[DAMPING] *= 0.2
            progress[VALUE] = trial
            for i in range(PARAMETERS):
                theta[i], score[i] = ahead[i], ahead_score[i]
                for j in range(PARAMETERS):
                    information[i, j] = ahead_information[i, j]
        if promised < CONVERGED:
            progress[STEPS_LEFT] = 0.0
    more = progress[STEPS_LEFT] > 0.0
    if rejected and not more:  # the spectrum that is left behind shall be that of the result
        posterior(theta, likelihood, ahead_score, ahead_information)
    return more


@njit(**OPTIONS)
def solve(matrix, vector):
    """Solve ``matrix x = vector`` in place of both (elimination, largest pivot first); False where it is singular."""
    n = vector.shape[0]
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        if not abs(matrix[pivot, k]) > 0.0:
            return False
        if pivot != k:
            vector[k], vector[pivot] = vector[pivot], vector[k]
            for j in range(k, n):
                matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
        for i in range(k + 1, n):
            factor = matrix[i, k] / matrix[k, k]
            vector[i] -= factor * vector[k]
            for j in range(k + 1, n):
                matrix[i, j] -= factor * matrix[k, j]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            vector[k] -= matrix[k, j] * vector[j]
        vector[k] /= matrix[k, k]
    return True
