"""One channel's whole recursion: RARMA step and poles sample by sample, their meaning tile by tile."""

import math

import numpy as np
from numba import njit

from chatter_monitor.kernels import odp, poles, rarma
from chatter_monitor.kernels.options import OPTIONS

# What a mode's values stand for; the same numbers as `chatter_monitor.records.ModeStatus`.
OSCILLATORY = 0
REAL_PAIR = 1
HELD = 2
STARTING = 3


@njit(inline="always", **OPTIONS)
def recurse(p, q, samples, recursion, pole_state, tile, forgetting, rate, out):
    """`track`, to be inlined where the orders are known."""
    frequency, damping, frequency_sd, damping_sd, status = out
    u, d, level, counts = recursion.u, recursion.d, recursion.level, recursion.counts
    coefficients = recursion.theta[q:]
    factors = pole_state.factors
    modes = p // 2
    hertz = rate / (2.0 * math.pi)
    memory = int(1.0 / (1.0 - forgetting))
    n = samples.shape[0]
    for begin in range(0, n, odp.TILE):
        size = min(odp.TILE, n - begin)
        for t in range(size):
            adapted = rarma.step(p, q, samples[begin + t], recursion, forgetting)
            if counts[rarma.ADAPTED] < rarma.SAMPLES_PER_COEFFICIENT * (p + q):
                for m in range(modes):
                    status[m, begin + t] = STARTING
                    tile[odp.factor_row(m) + t] = np.nan
                continue
            if adapted:
                if counts[rarma.ADAPTED] == memory:
                    poles.forget_slots(pole_state)
                poles.follow(p, coefficients, pole_state)
            for m in range(modes):
                b = factors[m, 0]
                c = factors[m, 1]
                tile[odp.factor_row(m) + t] = b
                tile[odp.factor_row(m) + odp.TILE + t] = c
                if not b * b < 4.0 * c:
                    status[m, begin + t] = REAL_PAIR
                else:
                    status[m, begin + t] = OSCILLATORY if adapted else HELD
            scale = level[rarma.SCATTER] * level[rarma.WINDOW_SQUARED] / level[rarma.WINDOW]
            for j in range(p):
                column = odp.covariance_row(p, j) + t
                for i in range(j):
                    tile[column + i * odp.TILE] = u[q + j, q + i]
                tile[column + j * odp.TILE] = scale * d[q + j]
        for m in range(modes):
            odp.evaluate(p, m, tile)
            for t in range(size):
                frequency[m, begin + t] = tile[odp.OMEGA + t] * hertz
                damping[m, begin + t] = tile[odp.DAMPING + t]
                frequency_sd[m, begin + t] = tile[odp.OMEGA_SD + t] * hertz
                damping_sd[m, begin + t] = tile[odp.DAMPING_SD + t]


@njit(**OPTIONS)
def _track_4_3(samples, recursion, pole_state, tile, forgetting, rate, out):
    """`track` with the orders of the paper known to the compiler, which makes it several times faster."""
    recurse(4, 3, samples, recursion, pole_state, tile, forgetting, rate, out)


@njit(**OPTIONS)
def _track_any(p, q, samples, recursion, pole_state, tile, forgetting, rate, out):
    """`track` for orders that are known at run time only."""
    recurse(p, q, samples, recursion, pole_state, tile, forgetting, rate, out)


def track(
    p: int,
    q: int,
    samples: np.ndarray,
    recursion: rarma.RarmaState,
    pole_state: poles.PoleState,
    tile: np.ndarray,
    forgetting: float,
    rate: float,
    out: tuple[np.ndarray, ...],
) -> None:
    """Run the recursion over a stretch of samples and fill in the ODPs of every one of them.

    Parameters
    ----------
    p, q : int
        Orders of A (even) and C.
    samples : ndarray of float64, shape (n,)
        The signal; non-finite samples count as missing.
    recursion, pole_state, tile : RarmaState, PoleState, ndarray
        Changed in place; carry the first two over to the next stretch.
    forgetting : float
        lambda = 1 - 1 / (memory in samples).
    rate : float
        Sample rate in Hz.
    out : tuple of ndarray, shape (p / 2, n) each
        frequency (Hz), damping ratio, their standard deviations (float32), status (uint8).
    """
    if (p, q) == (4, 3):
        _track_4_3(samples, recursion, pole_state, tile, forgetting, rate, out)
    else:
        _track_any(p, q, samples, recursion, pole_state, tile, forgetting, rate, out)
