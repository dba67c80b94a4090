"""Recursive prediction error method for RARMA(p, q), one sample at a time (paper, eq. (18), (21), (22)).

``A(q) y = C(q) e`` with A(z) = 1 + a1 z^-1 + ... and C(z) = 1 + c1 z^-1 + .... The parameter vector is
``theta = [c1..cq, a1..ap]``: C first, because the trailing block of a U D U' factorisation is itself a U D U'
factorisation, and it is the covariance of A that the poles need at every sample.

The covariance P of eq. (22), P = R^-1 (1 - lambda), is carried as U D U' (Bierman): it stays positive definite for
hundreds of millions of updates and with regressors as ill-conditioned as a pure tone. It is dimensionless: each
sample is weighted by the inverse of the running innovation variance, so that the gain of the microphone drops out, a
change of level is forgotten as fast as any other change, and one impact does not outweigh a hundred milliseconds of
cutting. Then cov(theta) = scatter P sum(lambda^2k) / sum(lambda^k), which settles at scatter P / (1 + lambda).
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numba.extending import register_jitable

from chatter_monitor.kernels.lanes import bits, floor, fma, larger, part, select, smaller, spread
from chatter_monitor.kernels.options import EXACT, OPTIONS
from chatter_monitor.kernels.polynomial import all_roots, is_minimum_phase, multiply_out
from chatter_monitor.kernels.udu import distrust, mean_variance, udu_update

# Innovations beyond this many standard deviations count as outliers: their weight falls with their square.
OUTLIER_SD = 3.0
# Prior variance of each coefficient, and the bound on the mean variance: the tracker is never less certain than at
# its start, which stops the covariance from winding up when nothing excites it.
PRIOR_VARIANCE = 100.0
# The innovation variance never reads less than this share of the signal's power (-120 dB): what is predicted better
# than that is arithmetic, not measurement.
PREDICTABLE_SHARE = 1e-12
# A signal that has not changed for so many samples carries no information: silence, a stuck channel.
REPEATS_TO_FREEZE = 32
# Samples per coefficient before anything is reported: fewer equations than four per unknown say nothing.
SAMPLES_PER_COEFFICIENT = 4
# The innovation variance and the power are tracked this many times faster than the parameters.
VARIANCE_SPEED = 8.0
# When the innovation variance exceeds its average over the memory by this factor, the machine is no longer what was
# learned: the past is trusted less in proportion. Far outside the scatter of the variance itself (12 %).
SURPRISE = 4.0
# Zeros of C are contracted to this share of the memory's radius, so that the next sample does not push them out again.
CONTRACTION = 0.999
# After a gap the regressors are wrong until the filter 1/C has forgotten it; waiting this share of the memory is cheap.
REFILL_SHARE = 0.25
# Larger samples overflow when squared and filtered; no sensor means them.
LARGEST_SAMPLE = 1e100
# How often the bound on the covariance is checked, in samples.
BOUND_INTERVAL = 64

# Indices into RarmaState.level: what was learned beside the coefficients
INNOVATION_VARIANCE = 0
SCATTER = 1  # weighted mean of squared standardised innovations: 1 where the weights are right
WINDOW = 2  # sum of lambda^k over the samples adapted to
WINDOW_SQUARED = 3  # sum of lambda^2k
USUAL_VARIANCE = 4  # innovation variance averaged over the memory
ADAPTED = 5  # samples adapted to, since the start
UNCHECKED = 6  # samples adapted to since the bound on the covariance was checked
FORGETTING_STOPPED = 7  # 1 while the covariance is at its bound
CONTRACTIONS = 8  # times C had to be contracted, since the start
LEVELS = 9
# Indices into RarmaState.heard: what the signal is like
POWER = 0
LAST_SAMPLE = 1
REPEATS = 2  # how long the signal has not changed
REFILL = 3  # samples to wait after a gap until the regressors mean something again
MISSING = 4  # non-finite samples met, since the start
HEARD = 5


class RarmaState(NamedTuple):
    """Everything the recursion remembers, rows of lanes or of numbers; n = p + q.

    ``theta[n]`` = [c, a]; ``u`` holds U, unit upper triangular, column after column without the diagonal, and ``d[n]``
    its D; ``phi`` is the regressor [e(t-1).., -y(t-1)..] and ``psi`` the same filtered by 1/C, both of length
    q + max(p, q) because the filter reaches back q samples; ``level`` and ``heard`` are read at the indices above.
    """

    theta: np.ndarray
    d: np.ndarray
    u: np.ndarray
    level: np.ndarray
    heard: np.ndarray
    phi: np.ndarray
    psi: np.ndarray


class Work(NamedTuple):
    """Work space: rows of lanes, and of one lane the coefficients of C and its zeros."""

    gain: np.ndarray
    scratch: np.ndarray
    learned: np.ndarray
    c: np.ndarray
    zeros: np.ndarray


@register_jitable(forceinline=True, **EXACT)
def learned_rows(p, q):
    """How many rows, the first ones of the state, are left alone by a sample that teaches nothing."""
    n = p + q
    return 2 * n + n * (n - 1) // 2 + LEVELS


@register_jitable(forceinline=True, **EXACT)
def rows(p, q):
    """How many rows the state has."""
    return learned_rows(p, q) + HEARD + 2 * (q + max(p, q))


@register_jitable(forceinline=True, **EXACT)
def parts(p, q, memory):
    """State in an array of so many rows."""
    n, learned, regressors = p + q, learned_rows(p, q), q + max(p, q)
    heard = learned + HEARD
    return RarmaState(
        theta=part(memory, 0, n),
        d=part(memory, n, 2 * n),
        u=part(memory, 2 * n, learned - LEVELS),
        level=part(memory, learned - LEVELS, learned),
        heard=part(memory, learned, heard),
        phi=part(memory, heard, heard + regressors),
        psi=part(memory, heard + regressors, heard + 2 * regressors),
    )


def begin(p: int, q: int, memory: np.ndarray) -> None:
    """Make zeros a fresh state."""
    parts(p, q, memory).d[:] = PRIOR_VARIANCE


@njit(forceinline=True, **EXACT)
def less_inner(start, begin, end, x, y):
    """`start` less the inner product of these elements."""
    for i in range(begin, end):
        start = fma(-x[i], y[i], start)
    return start


@njit(forceinline=True, **EXACT)
def predict_error(p, q, start, x, phi):
    """`start` less x' phi, in two sums that the processor can form at the same time."""
    return less_inner(start, q, p + q, x, phi) + less_inner(spread(0.0, start), 0, q, x, phi)


@njit(**OPTIONS)
def contract(q, c, zeros, radius):
    """Pull those zeros of C that lie outside the circle of `radius` radially onto it, and leave the others alone.

    A common shrinking of all zeros would be simpler, but each time one zero touches the circle it would also pull the
    others inwards, and with them those that keep a sharp line apart from the noise around it.
    """
    roots = zeros[0]
    all_roots(q, c, roots)
    for i in range(q):
        modulus = abs(roots[i])
        if not modulus < radius:
            roots[i] *= radius / modulus
    multiply_out(q, roots, zeros[1], c)


@njit(**OPTIONS)
def _contract_in(outside, q, numbers, work):
    """`contract` for those lanes, bits of an integer, of the array behind the lanes; the last row is the forgetting."""
    for lane in range(numbers.shape[1]):
        if outside >> lane & 1:
            for i in range(q):
                work.c[i] = numbers[i, lane]
            contract(q, work.c, work.zeros, CONTRACTION * numbers[-1, lane])
            for i in range(q):
                numbers[i, lane] = work.c[i]


@njit(forceinline=True, **EXACT)
def forget_regressors(missing, state, forgetting):
    """Where samples are missing, the past is unknown: empty the regressors and wait until they mean something again."""
    for i in range(state.phi.shape[0]):
        state.phi[i] = select(missing, 0.0, state.phi[i])
        state.psi[i] = select(missing, 0.0, state.psi[i])
    heard = state.heard
    heard[REFILL] = select(missing, floor(REFILL_SHARE / (1.0 - forgetting)), heard[REFILL])
    heard[MISSING] = select(missing, heard[MISSING] + 1.0, heard[MISSING])


@njit(forceinline=True, **EXACT)
def learn(p, q, sample, error, power, wanted, state, work, numbers, forgetting):
    """Adapt to a sample; the result is the residual. What is not wanted is done as well, but for its dear parts."""
    theta, d, u, level, _heard, phi, psi = state
    n = p + q
    speed = VARIANCE_SPEED * (1.0 - forgetting)
    variance = larger(level[INNOVATION_VARIANCE], PREDICTABLE_SHARE * power)
    variance = select(level[ADAPTED] == 0.0, fma(sample, sample, power), variance)
    noise = larger(variance, error * error * (1.0 / (OUTLIER_SD * OUTLIER_SD)))
    stopped = level[FORGETTING_STOPPED] > 0.0
    remembered = select(stopped, 1.0, forgetting)
    start = forgetting * noise
    total = udu_update(n, u, d, psi, work.gain, start, select(stopped, 1.0, 1.0 / forgetting))
    rate = error / total
    residual = fma(rate, predict_error(p, q, spread(0.0, error), work.gain, phi), error)
    for i in range(n):
        theta[i] = fma(work.gain[i], rate, theta[i])
    minimum_phase = is_minimum_phase(q, theta, work.scratch, 1.0 / forgetting)
    outside = bits(wanted & ~minimum_phase)
    if outside:
        level[CONTRACTIONS] = select(minimum_phase, level[CONTRACTIONS], level[CONTRACTIONS] + 1.0)
        _contract_in(outside, q, numbers, work)
        residual = select(minimum_phase, residual, predict_error(p, q, sample, theta, phi))

    explained = smaller(error * rate * start, OUTLIER_SD * OUTLIER_SD * variance)
    variance = fma(speed, explained - variance, variance)
    level[INNOVATION_VARIANCE] = variance
    usual = select(level[ADAPTED] < SAMPLES_PER_COEFFICIENT * n, variance, level[USUAL_VARIANCE])
    surprised = variance > SURPRISE * usual
    if bits(surprised):
        distrust(n, d, PRIOR_VARIANCE, select(surprised, variance / usual, 1.0))
        usual = select(surprised, variance, usual)
    level[USUAL_VARIANCE] = fma(1.0 - forgetting, variance - usual, usual)
    level[WINDOW] = fma(remembered, level[WINDOW], 1.0)
    level[WINDOW_SQUARED] = fma(remembered * remembered, level[WINDOW_SQUARED], 1.0)
    level[SCATTER] = level[SCATTER] + (explained / noise - level[SCATTER]) / level[WINDOW]
    level[ADAPTED] = level[ADAPTED] + 1.0
    level[UNCHECKED] = level[UNCHECKED] + 1.0
    due = level[UNCHECKED] > BOUND_INTERVAL - 1.0
    if bits(due):
        bounded = select(mean_variance(n, u, d) > PRIOR_VARIANCE, 1.0, spread(0.0, sample))
        level[FORGETTING_STOPPED] = select(due, bounded, level[FORGETTING_STOPPED])
        level[UNCHECKED] = select(due, 0.0, level[UNCHECKED])
    return residual


@njit(forceinline=True, **EXACT)
def step(p, q, sample, state, memory, work, numbers, forgetting):
    """Take one sample into the model.

    Parameters
    ----------
    p, q : int
        Orders; known constants after inlining, which is what makes the loops unroll.
    sample : lanes
        y(t). Non-finite counts as missing.
    state, memory : RarmaState, array of lanes
        The same, changed in place.
    work : Work
        Work space.
    numbers : ndarray of float64, shape (rows, lanes)
        What the lanes of the memory are views of; the last row is the forgetting.
    forgetting : lanes
        lambda = 1 - 1 / (memory in samples).

    Returns
    -------
    mask
        Where the model adapted; elsewhere it is frozen.
    """
    theta, phi, psi, heard = state.theta, state.phi, state.psi, state.heard
    present = abs(sample) < LARGEST_SAMPLE
    if bits(~present):
        forget_regressors(~present, state, forgetting)
        sample = select(present, sample, 0.0)
    repeats = select(present & (sample == heard[LAST_SAMPLE]), heard[REPEATS] + 1.0, 0.0)
    heard[REPEATS] = repeats
    heard[LAST_SAMPLE] = select(present, sample, heard[LAST_SAMPLE])
    speed = VARIANCE_SPEED * (1.0 - forgetting)
    power = fma(speed, fma(sample, sample, -heard[POWER]), heard[POWER])
    power = select(present, power, heard[POWER])
    heard[POWER] = power

    error = predict_error(p, q, sample, theta, phi)
    residual = error
    refilled = heard[REFILL] == 0.0
    informative = present & refilled & (repeats < REPEATS_TO_FREEZE) & (power > 0.0)
    heard[REFILL] = select(present & ~refilled, heard[REFILL] - 1.0, heard[REFILL])
    if bits(informative):
        some = bits(~informative)
        kept = work.learned.shape[0] if some else 0
        for i in range(kept):
            work.learned[i] = memory[i]
        residual = learn(p, q, sample, error, power, informative, state, work, numbers, forgetting)
        for i in range(kept):
            memory[i] = select(informative, memory[i], work.learned[i])
        residual = select(informative, residual, error)

    # eq. (22): psi is phi filtered by 1/C, with a posteriori residuals
    sample_filtered = sample
    residual_filtered = residual
    for i in range(q):
        sample_filtered = fma(theta[i], psi[q + i], sample_filtered)
        residual_filtered = fma(-theta[i], psi[i], residual_filtered)
    for i in range(q - 1, 0, -1):
        phi[i] = phi[i - 1]
        psi[i] = psi[i - 1]
    for i in range(q + max(p, q) - 1, q, -1):
        phi[i] = phi[i - 1]
        psi[i] = psi[i - 1]
    if q > 0:
        phi[0] = residual
        psi[0] = residual_filtered
    phi[q] = -sample
    psi[q] = -sample_filtered
    return informative
