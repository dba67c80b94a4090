"""Autoregressive whitening of prediction errors, and what of it is taken from which samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, signal

ORDER = 40


def autocovariance(errors: NDArray[np.float64], used: NDArray[np.bool_], order: int) -> NDArray[np.float64]:
    """Autocovariance of errors at lags 0 to `order`, products counted where their later factor is used."""
    later = np.where(used, errors, 0.0)
    count = max(int(np.count_nonzero(used)), 1)
    return np.array([later[lag:] @ errors[: errors.size - lag] for lag in range(order + 1)]) / count


def whitener(errors: NDArray[np.float64], used: NDArray[np.bool_], order: int = ORDER) -> NDArray[np.float64]:
    """Prediction error filter of an autoregression (Yule-Walker equations).

    Parameters
    ----------
    errors : ndarray of float64, shape (n,)
    used : ndarray of bool, shape (n,)
        Samples that the filter is fitted to.
    order : int

    Returns
    -------
    ndarray of float64, shape (order + 1,)
        Begins with 1.
    """
    r = autocovariance(errors, used, order)
    if r[0] <= 0.0:
        return np.concatenate([[1.0], np.zeros(order)])
    r[0] *= 1.0 + 1e-10
    return np.concatenate([[1.0], -linalg.solve_toeplitz(r[:-1], r[1:])])


def whitened(column: NDArray[np.float64], taps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pass a column through a prediction error filter."""
    return np.asarray(signal.oaconvolve(column, taps)[: column.size])


def trusted(missing: NDArray[np.bool_], memory: int) -> NDArray[np.bool_]:
    """Samples whose prediction rests on `memory` samples before it that are all there."""
    gone = np.concatenate([np.ones(memory, dtype=np.int64), missing.astype(np.int64)])
    total = np.concatenate([[0], np.cumsum(gone)])
    return np.asarray(total[memory + 1 :] - total[: -memory - 1] == 0)
