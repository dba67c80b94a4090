"""Where the posterior of the spectrum of one mode with a regenerative delay (`kernels.whittle`) is largest."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.delay_roots import critical_coefficient
from chatter_monitor.kernels.options import OPTIONS, WITHIN
from chatter_monitor.kernels.regenerative_spectrum import (
    KAPPA,
    LOG_GAIN,
    LOG_OMEGA,
    LOG_TAU,
    LOG_ZETA,
    MODULATION,
    PARAMETERS,
)
from chatter_monitor.kernels.whittle import whittle

FIRST_DAMPING = 1e-3
CONVERGED = 0.02  # nats that a step promises: a fifth of a standard deviation, and the step is still taken
LARGEST_STEP = (2.0, 2.0, 0.02, 0.5, 0.1, 0.01, 0.5, 0.3, 2.0)

# Indices of what a climb keeps from piece to piece: the negative log-posterior where it is, Levenberg's damping, and
# how many steps it may still take.
VALUE, DAMPING, STEPS_LEFT = range(3)


class Likelihood(NamedTuple):
    """What the parameters are fitted to: arguments of `whittle` by their names, and what is believed beforehand.

    Attributes
    ----------
    weight : float
        By which the likelihood of the bins counts.
    prior_mean, prior_precision : ndarray of float64, shape (9,)
        Of an independent normal distribution.
    """

    first: float
    bin_width: float
    delays: int
    log_frequency: np.ndarray
    periodogram: np.ndarray
    used: np.ndarray
    work: np.ndarray
    spectrum: np.ndarray
    weight: float
    prior_mean: np.ndarray
    prior_precision: np.ndarray


@njit(**WITHIN)
def posterior(theta, likelihood, score, information):
    """Negative log-posterior, its negative gradient and its expected Hessian, as in `whittle`."""
    value = likelihood.weight * whittle(
        theta, likelihood.first, likelihood.bin_width, likelihood.delays, likelihood.log_frequency,
        likelihood.periodogram, likelihood.used, likelihood.work, likelihood.spectrum, score, information,
    )  # fmt: skip
    for i in range(PARAMETERS):
        away = theta[i] - likelihood.prior_mean[i]
        value += 0.5 * likelihood.prior_precision[i] * away * away
        score[i] = likelihood.weight * score[i] - likelihood.prior_precision[i] * away
        for j in range(PARAMETERS):
            information[i, j] *= likelihood.weight
        information[i, i] += likelihood.prior_precision[i]
    return value


@njit(**WITHIN)
def stabilise(theta):
    """Mirror what lies beyond the limit.

    A root as far to the right of the imaginary axis as it was to the left has the same spectrum. What is stationary has
    none there; growth is for others to see. A modulation half a tooth later has the same spectrum, too.
    """
    critical = critical_coefficient(math.exp(theta[LOG_OMEGA]), math.exp(theta[LOG_ZETA]), math.exp(theta[LOG_TAU]))
    if theta[KAPPA] > critical:
        theta[KAPPA] = max(2.0 * critical - theta[KAPPA], 0.5 * critical)
    theta[MODULATION] = abs(theta[MODULATION])


@njit(**WITHIN)
def begin_climb(theta, likelihood, steps, space, information, progress):
    """Begin a climb of so many steps at most; arguments as of `climb`."""
    progress[VALUE] = posterior(theta, likelihood, space[0], information)
    progress[DAMPING] = FIRST_DAMPING
    progress[STEPS_LEFT] = steps


@njit(**WITHIN)
def climb(theta, likelihood, steps, space, information, progress):
    """Fisher scoring with Levenberg's damping, so many steps of it; returns whether there are more to take.

    Parameters
    ----------
    theta : ndarray of float64, shape (9,)
        Where to start; overwritten with where it ends.
    likelihood : Likelihood
        When the climb is over, its ``spectrum`` is left as by `whittle` for the result.
    steps : int
        At most.
    space : ndarray of float64, shape (22, 9)
        Kept from piece to piece; the first row is the negative gradient.
    information : ndarray of float64, shape (9, 9)
        Expected Hessian, at the result in the end.
    progress : ndarray of float64, shape (3,)
        At the indices above.
    """
    score, ahead, ahead_score, step = space[0], space[1], space[2], space[3]
    ahead_information, damped = space[4 : 4 + PARAMETERS], space[4 + PARAMETERS :]
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
def race(theta, likelihood, mean, steps, space, information, progress):
    """Climb from a start, and return the negative log-posterior where that ends.

    The gain is chosen first: the one with which the mean of the spectrum is ``mean``. Other arguments as of `climb`.
    """
    theta[LOG_GAIN] = 0.0
    posterior(theta, likelihood, space[0], information)
    theta[LOG_GAIN] = math.log(mean / np.mean(likelihood.spectrum))
    begin_climb(theta, likelihood, steps, space, information, progress)
    climb(theta, likelihood, steps, space, information, progress)
    return progress[VALUE]


@njit(**WITHIN)
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
