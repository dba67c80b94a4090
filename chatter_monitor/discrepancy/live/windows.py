"""What some seconds of whitened errors say: of forces that are missing, and of a change since before.

Blocks of half a second are reduced to matrices of products and to powers in bands, and kept as running sums, so that a
window of any length costs the same.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from chatter_monitor.discrepancy.evidence import Evidence

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

BANDS = 24
_RIDGE = 1e-9
# Of a running sum: what is left of less than that when two are subtracted is rounding.
_LOST = 1e-8


class Blocks:
    """The newest blocks.

    Parameters
    ----------
    most : int
        How many are kept, at least.
    columns : int
        Errors and signatures.
    samples : int
        In a block.

    Attributes
    ----------
    firsts : list of int
        First sample of each.
    """

    def __init__(self, most: int, columns: int, samples: int) -> None:
        self._most = most
        self._ordinates = samples // 2 / BANDS
        self._edges = np.linspace(0, samples // 2, BANDS + 1).astype(np.int64)
        self._products = np.zeros((2 * most + 1, columns, columns))
        self._power = np.zeros((2 * most + 1, 2, BANDS))  # and its square
        self.firsts: list[int] = []

    def __len__(self) -> int:
        return len(self.firsts)

    def append(self, first: int, rows: Matrix) -> None:
        """Append whitened errors (column 0) and signatures of a block, shape (samples, columns).

        They count over the variance of the errors in the block: what is louder says no more.
        """
        errors = rows[:, 0]
        variance = float(errors @ errors) / errors.size
        if not 0.0 < variance < np.inf:
            return
        if len(self) == 2 * self._most:
            for sums in (self._products, self._power):
                sums[: self._most + 1] = sums[self._most :] - sums[self._most]
            del self.firsts[: self._most]
        at = len(self)
        periodogram = np.abs(np.fft.rfft(errors)[1:]) ** 2 / (errors.size * variance)
        power = np.add.reduceat(periodogram, self._edges[:-1]) / np.diff(self._edges)
        self._products[at + 1] = self._products[at] + rows.T @ rows / variance
        self._power[at + 1] = self._power[at] + np.stack([power, power**2])
        self.firsts.append(first)

    def newest(self, size: int) -> Matrix:
        """Products summed over the newest blocks; row and column 0 are the errors.

        A signature that was large once and is next to nothing now is zero: that of a constant force, to a sensor of the
        acceleration, is little more than how the filter began.
        """
        total = np.asarray(self._products[len(self)] - self._products[len(self) - size])
        lost = np.diag(total) <= _LOST * np.diag(self._products[len(self)])
        total[lost], total[:, lost] = 0.0, 0.0
        return total

    def changed_p(self, size: int, modes: int) -> float:
        """How often chance makes the newest blocks differ as much from those before them.

        In the coefficients of the first columns after the errors, or in the spectrum of the errors, its level apart.

        Parameters
        ----------
        size : int
            How many are the newest.
        modes : int
            How many columns.
        """
        at, end = len(self) - size, len(self)
        here = slice(1, modes + 1), slice(0, modes + 1)
        before, after = self._products[at][here], (self._products[end] - self._products[at])[here]
        inverse = [np.linalg.inv(each[:, 1:]) for each in (before, after)]
        change = inverse[1] @ after[:, 0] - inverse[0] @ before[:, 0]
        retuned = float(change @ np.linalg.solve(inverse[0] + inverse[1], change))
        (mean, square), new = self._power[at] / at, (self._power[end, 0] - self._power[at, 0]) / size
        ratio = np.log(new / mean)
        ratio -= ratio.mean()
        # Errors with heavy tails have powers that vary more than those of Gaussian ones.
        spread = float(np.mean(square / mean**2 - 1.0)) * self._ordinates * at / (at - 1)
        coloured = float(ratio @ ratio) * self._ordinates / (max(spread, 1.0) * (1.0 / at + 1.0 / size))
        return min(1.0, 2.0 * min(float(chdtrc(modes, retuned)), float(chdtrc(BANDS - 1, coloured))))


def partial_gains(total: Matrix, nuisance: Sequence[int], columns: Sequence[int]) -> Vector:
    """Gain of each column by itself beside the nuisance, nats.

    Parameters
    ----------
    total : ndarray of float64, shape (1 + c, 1 + c)
        Products; row 0 is that of the errors.
    nuisance, columns : sequence of int
        Rows of them.
    """
    a, b = np.array(nuisance), np.array(columns)
    normal = total[a[:, None], a]
    normal = normal + _RIDGE * np.diag(np.diag(normal)) + 1e-300 * np.eye(len(a))
    inner = total[a[:, None], b]
    projection = np.linalg.solve(normal, np.column_stack([total[a, 0], inner]))
    score = total[b, 0] - inner.T @ projection[:, 0]
    weight = np.maximum(total[b, b] - np.sum(inner * projection[:, 1:], axis=0), _RIDGE * total[b, b] + 1e-300)
    return np.asarray(0.5 * score**2 / weight)


class Accumulated(Evidence):
    """Evidence of products that are there already, as one block."""

    def __init__(self, total: Matrix, nuisance: Sequence[int]) -> None:
        self.products = total[None]
        self.nuisance = list(nuisance)
