"""Covariance as U D U': positive definite for hundreds of millions of updates, however ill-conditioned (Bierman).

All numbers are lanes. U is unit upper triangular, column after column without the diagonal.
"""

from numba import njit

from chatter_monitor.kernels.lanes import fma, larger, smaller, spread
from chatter_monitor.kernels.options import EXACT


@njit(forceinline=True, **EXACT)
def column(j):
    """Where column j of U begins."""
    return j * (j - 1) // 2


@njit(forceinline=True, **EXACT)
def udu_update(n, u, d, psi, gain, noise, growth):
    """Bierman's measurement update of P = U D U' for the regressor `psi`, followed by growth of P.

    On return ``gain`` holds P psi (before the update); the result is ``noise + psi' P psi``, so that the Kalman gain is
    their quotient. Then P <- (P - gain gain' / result) growth.
    """
    return _of_seven(u, d, psi, gain, noise, growth) if n == 7 else _update(n, u, d, psi, gain, noise, growth)


@njit(forceinline=True, **EXACT)
def _of_seven(u, d, psi, gain, noise, growth):
    """`udu_update` of the paper's seven coefficients.

    A kernel is optimised by itself before it becomes part of another. In one that knows the number all loops are
    unrolled; learned later, it is too late for that.
    """
    return _update(7, u, d, psi, gain, noise, growth)


@njit(forceinline=True, **EXACT)
def _update(n, u, d, psi, gain, noise, growth):
    total = noise
    inverse = 1.0 / noise
    for j in range(n):
        f = psi[j]
        for i in range(j):
            f = fma(u[column(j) + i], psi[i], f)
        v = d[j] * f
        before = total
        step = -f * inverse
        total = fma(f, v, total)
        inverse = 1.0 / total
        d[j] = d[j] * (before * inverse * growth)
        gain[j] = v
        for i in range(j):
            u_ij = u[column(j) + i]
            u[column(j) + i] = fma(gain[i], step, u_ij)
            gain[i] = fma(u_ij, v, gain[i])
    return total


@njit(forceinline=True, **EXACT)
def distrust(n, d, prior, factor):
    """Multiply the covariance, but nothing beyond the prior."""
    for j in range(n):
        d[j] = larger(d[j], smaller(d[j] * factor, prior))


@njit(forceinline=True, **EXACT)
def mean_variance(n, u, d):
    """Trace of U D U' divided by n."""
    trace = spread(0.0, d[0])
    for j in range(n):
        squares = spread(1.0, trace)
        for i in range(j):
            squares = fma(u[column(j) + i], u[column(j) + i], squares)
        trace = fma(d[j], squares, trace)
    return trace / n
