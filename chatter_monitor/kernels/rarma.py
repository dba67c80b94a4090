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

from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.polynomial import all_roots, is_minimum_phase, multiply_out

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

# Indices into RarmaState.level (float64)
INNOVATION_VARIANCE = 0
POWER = 1
SCATTER = 2  # weighted mean of squared standardised innovations: 1 where the weights are right
LAST_SAMPLE = 3
WINDOW = 4  # sum of lambda^k over the samples adapted to
WINDOW_SQUARED = 5  # sum of lambda^2k
USUAL_VARIANCE = 6  # innovation variance averaged over the memory
# Indices into RarmaState.counts (int64)
ADAPTED = 0  # samples adapted to, since the start
REPEATS = 1  # how long the signal has not changed
REFILL = 2  # samples to wait after a gap until the regressors mean something again
FORGETTING_STOPPED = 3  # 1 while the covariance is at its bound
MISSING = 4  # non-finite samples met, since the start
CONTRACTIONS = 5  # times C had to be contracted, since the start


class RarmaState(NamedTuple):
    """Everything the recursion remembers; n = p + q.

    ``theta[n]`` = [c, a]; row j of ``u[n, n]`` holds column j of U (unit upper triangular: the first j entries
    count) and ``d[n]`` its D; ``phi`` is the regressor [e(t-1).., -y(t-1)..] and ``psi`` the same filtered by 1/C,
    both of length q + max(p, q) because the filter reaches back q samples; ``gain[n]``, ``scratch[q + 1]`` and
    ``zeros[2, q]`` are work space; ``level`` and ``counts`` hold scalars at the indices above.
    """

    theta: np.ndarray
    u: np.ndarray
    d: np.ndarray
    phi: np.ndarray
    psi: np.ndarray
    gain: np.ndarray
    scratch: np.ndarray
    zeros: np.ndarray
    level: np.ndarray
    counts: np.ndarray


def new_state(p: int, q: int) -> RarmaState:
    """Fresh state of a RARMA(p, q) recursion."""
    n = p + q
    return RarmaState(
        theta=np.zeros(n),
        u=np.zeros((n, n)),
        d=np.full(n, PRIOR_VARIANCE),
        phi=np.zeros(q + max(p, q)),
        psi=np.zeros(q + max(p, q)),
        gain=np.zeros(n),
        scratch=np.zeros(q + 1),
        zeros=np.zeros((2, q), dtype=np.complex128),
        level=np.zeros(7),
        counts=np.zeros(6, dtype=np.int64),
    )


@njit(forceinline=True, **OPTIONS)
def udu_update(n, u, d, psi, gain, noise, forgetting):
    """Bierman's measurement update of P = U D U' for the regressor `psi`, followed by forgetting.

    On return ``gain`` holds P psi (before the update); the result is ``noise + psi' P psi``, so that the Kalman gain is
    their quotient. Then P <- (P - gain gain' / result) / forgetting.
    """
    total = noise
    inverse = 1.0 / noise
    growth = 1.0 / forgetting
    for j in range(n):
        f = psi[j]
        for i in range(j):
            f += u[j, i] * psi[i]
        v = d[j] * f
        before = total
        step = -f * inverse
        total += f * v
        inverse = 1.0 / total
        d[j] *= before * inverse * growth
        gain[j] = v
        for i in range(j):
            u_ij = u[j, i]
            u[j, i] = u_ij + gain[i] * step
            gain[i] += u_ij * v
    return total


@njit(forceinline=True, **OPTIONS)
def inner(q, n, x, y):
    """Inner product in two sums that the processor can form at the same time."""
    of_c = 0.0
    of_a = 0.0
    for i in range(q):
        of_c += x[i] * y[i]
    for i in range(q, n):
        of_a += x[i] * y[i]
    return of_c + of_a


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
def forget_regressors(state, forgetting):
    """After missing samples: the past is unknown, so empty the regressors and wait until they mean something again."""
    state.phi[:] = 0.0
    state.psi[:] = 0.0
    state.counts[REFILL] = int(REFILL_SHARE / (1.0 - forgetting))
    state.counts[REPEATS] = 0


@njit(**OPTIONS)
def distrust(n, d, factor):
    """Multiply the covariance, but nothing beyond the prior."""
    for j in range(n):
        d[j] = max(d[j], min(d[j] * factor, PRIOR_VARIANCE))


@njit(**OPTIONS)
def mean_variance(n, u, d):
    """Trace of U D U' divided by n."""
    trace = 0.0
    for j in range(n):
        column = 1.0
        for i in range(j):
            column += u[j, i] * u[j, i]
        trace += d[j] * column
    return trace / n


@njit(forceinline=True, **OPTIONS)
def step(p, q, sample, state, forgetting):
    """Take one sample into the model.

    Parameters
    ----------
    p, q : int
        Orders; known constants after inlining, which is what makes the loops unroll.
    sample : float
        y(t). Non-finite counts as missing.
    state : RarmaState
        Changed in place.
    forgetting : float
        lambda = 1 - 1 / (memory in samples).

    Returns
    -------
    bool
        Whether the model adapted; False for frozen.
    """
    theta, u, d, phi, psi, gain, scratch, zeros, level, counts = state
    n = p + q
    if not abs(sample) < LARGEST_SAMPLE:
        counts[MISSING] += 1
        forget_regressors(state, forgetting)
        return False

    counts[REPEATS] = counts[REPEATS] + 1 if sample == level[LAST_SAMPLE] else 0
    level[LAST_SAMPLE] = sample
    speed = VARIANCE_SPEED * (1.0 - forgetting)
    power = level[POWER] + speed * (sample * sample - level[POWER])
    level[POWER] = power

    error = sample - inner(q, n, theta, phi)
    residual = error

    informative = counts[REPEATS] < REPEATS_TO_FREEZE and counts[REFILL] == 0 and power > 0.0
    if informative:
        variance = max(level[INNOVATION_VARIANCE], PREDICTABLE_SHARE * power)
        if counts[ADAPTED] == 0:
            variance = sample * sample + power
        noise = max(variance, error * error / (OUTLIER_SD * OUTLIER_SD))
        remembered = 1.0 if counts[FORGETTING_STOPPED] else forgetting
        start = forgetting * noise
        total = udu_update(n, u, d, psi, gain, start, remembered)
        rate = error / total
        residual = error - rate * inner(q, n, gain, phi)
        for i in range(n):
            theta[i] += gain[i] * rate
        if not is_minimum_phase(q, theta, scratch, forgetting):
            counts[CONTRACTIONS] += 1
            contract(q, theta, zeros, CONTRACTION * forgetting)
            residual = sample - inner(q, n, theta, phi)

        explained = min(error * rate * start, OUTLIER_SD * OUTLIER_SD * variance)
        variance += speed * (explained - variance)
        level[INNOVATION_VARIANCE] = variance
        if counts[ADAPTED] < SAMPLES_PER_COEFFICIENT * n:
            level[USUAL_VARIANCE] = variance
        if variance > SURPRISE * level[USUAL_VARIANCE]:
            distrust(n, d, variance / level[USUAL_VARIANCE])
            level[USUAL_VARIANCE] = variance
        level[USUAL_VARIANCE] += (1.0 - forgetting) * (variance - level[USUAL_VARIANCE])
        level[WINDOW] = remembered * level[WINDOW] + 1.0
        level[WINDOW_SQUARED] = remembered * remembered * level[WINDOW_SQUARED] + 1.0
        level[SCATTER] += (explained / noise - level[SCATTER]) / level[WINDOW]
        counts[ADAPTED] += 1
        if counts[ADAPTED] % BOUND_INTERVAL == 0:
            counts[FORGETTING_STOPPED] = mean_variance(n, u, d) > PRIOR_VARIANCE
    elif counts[REFILL] > 0:
        counts[REFILL] -= 1

    # eq. (22): psi is phi filtered by 1/C, with a posteriori residuals
    sample_filtered = sample
    residual_filtered = residual
    for i in range(q):
        sample_filtered += theta[i] * psi[q + i]
        residual_filtered -= theta[i] * psi[i]
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
