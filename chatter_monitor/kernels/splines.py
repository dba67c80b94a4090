"""Cubic B-splines on equal knots: of every sample the four that are not zero."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray


@njit(cache=True, nogil=True)
def cubic_splines(u: NDArray[np.float64], low: float, high: float, out: NDArray[np.float64]) -> None:
    """Work out B-splines.

    Parameters
    ----------
    u : ndarray of float64, shape (n,)
        What lies beyond the ends counts as at the ends.
    low, high : float
        First and last knot.
    out : ndarray of float64, shape (count, n)
        The splines, four or more.
    """
    count = out.shape[0]
    last = count - 4  # cell
    step = (high - low) / (count - 3)
    out[:] = 0.0
    for i in range(u.size):
        if u[i] != u[i]:
            out[:, i] = np.nan
            continue
        inside = (min(max(u[i], low), high) - low) / step
        cell = min(int(inside), last)
        t = inside - cell
        r = 1.0 - t
        out[cell, i] = r * r * r / 6.0
        out[cell + 1, i] = (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0
        out[cell + 2, i] = (4.0 - 6.0 * r * r + 3.0 * r * r * r) / 6.0
        out[cell + 3, i] = t * t * t / 6.0
