"""How alike two stretches of a signal are."""

import math

import numpy as np
from numba import njit

from chatter_monitor.kernels.options import SUMS


# Part of each kernel that calls it, as `options.WITHIN` says: a process has the same copy as any other then.
@njit(forceinline=True, **SUMS)
def coefficient(a: np.ndarray, b: np.ndarray) -> float:
    """Coefficient of correlation of two stretches, shape (n,) both; 0 if one of them is constant."""
    size = a.shape[0]
    sum_a = sum_b = square_a = square_b = product = 0.0
    for t in range(size):
        sum_a += a[t]
        sum_b += b[t]
        square_a += a[t] * a[t]
        square_b += b[t] * b[t]
        product += a[t] * b[t]
    norm = math.sqrt(max((square_a - sum_a * sum_a / size) * (square_b - sum_b * sum_b / size), 0.0))
    return (product - sum_a * sum_b / size) / norm if norm > 0.0 else 0.0
