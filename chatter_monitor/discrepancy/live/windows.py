"""What some seconds of whitened errors say: of forces that are missing, and of a change since before.

Blocks of half a second are reduced to matrices of products and to powers in bands, and kept as running sums, so that a
window of any length costs the same.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

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

    def newest(self, sizes: Sequence[int]) -> Matrix:
        """Products summed over the newest blocks, shape (len(sizes), columns, columns); the errors come first.

        A signature that was large once and is next to nothing now is zero: that of a constant force, to a sensor of the
        acceleration, is little more than how the filter began.
        """
        everything = self._products[len(self)]
        total = everything - self._products[len(self) - np.array(sizes)]
        kept = np.diagonal(total, axis1=1, axis2=2) > _LOST * np.diag(everything)
        return np.asarray(total * kept[:, :, None] * kept[:, None, :])

    def changed_p(self, sizes: Sequence[int], modes: int) -> Vector:
        """How often chance makes the newest blocks differ as much from those before them.

        In the coefficients of the first columns after the errors, or in the spectrum of the errors, its level apart.

        Parameters
        ----------
        sizes : sequence of int
            How many are the newest, for each window.
        modes : int
            How many columns.
        """
        size, end = np.array(sizes), len(self)
        at = end - size
        before = self._products[at, 1 : modes + 1, : modes + 1]
        after = self._products[end, 1 : modes + 1, : modes + 1] - before
        inverse = np.linalg.inv(np.stack([before, after])[..., 1:])
        change = np.einsum("wij,wj->wi", inverse[1], after[..., 0]) - np.einsum("wij,wj->wi", inverse[0], before[..., 0])
        retuned = np.sum(change * np.linalg.solve(inverse.sum(axis=0), change[..., None])[..., 0], axis=-1)
        mean, square = np.moveaxis(self._power[at] / at[:, None, None], 1, 0)
        new = (self._power[end, 0] - self._power[at, 0]) / size[:, None]
        ratio = np.log(new / mean)
        ratio -= ratio.mean(axis=1, keepdims=True)
        # Errors with heavy tails have powers that vary more than those of Gaussian ones.
        spread = np.mean(square / mean**2 - 1.0, axis=1) * self._ordinates * at / (at - 1)
        coloured = np.sum(ratio * ratio, axis=1) * self._ordinates / (np.maximum(spread, 1.0) * (1.0 / at + 1.0 / size))
        return np.minimum(1.0, 2.0 * np.minimum(chdtrc(modes, retuned), chdtrc(BANDS - 1, coloured)))


class Rest:
    """What some columns leave of errors and of other columns: a regression with them always in.

    Parameters
    ----------
    errors : ndarray of float64, shape (c,)
        Products of the errors with the columns.
    columns : ndarray of float64, shape (c, c)
        Products of the columns.
    """

    def __init__(self, errors: Vector, columns: Matrix) -> None:
        self._errors, self._columns = errors, columns

    @property
    def gains(self) -> Vector:
        """Of each column by itself, nats."""
        return np.asarray(0.5 * self._errors**2 / np.diag(self._columns))

    def regress(self, chosen: Sequence[int]) -> tuple[float, Vector]:
        """Gain of some columns together, nats, and their coefficients."""
        at = np.array(chosen)
        coefficients = np.linalg.solve(self._columns[at[:, None], at], self._errors[at])
        return 0.5 * float(coefficients @ self._errors[at]), coefficients

    def bounded(self, columns: Sequence[int], lower: Sequence[float], price: float) -> tuple[float, list[int]]:
        """Best gain less a price for each column, with no coefficient below its bound (0 or none), and by which columns."""
        best: tuple[float, list[int]] = (-np.inf, [])
        for mask in range(1, 1 << len(columns)):
            chosen = [i for i in range(len(columns)) if mask >> i & 1]
            gain, coefficients = self.regress([columns[i] for i in chosen])
            allowed = all(c >= lower[i] for c, i in zip(coefficients, chosen, strict=True))
            if allowed and gain - price * len(chosen) > best[0]:
                best = gain - price * len(chosen), [columns[i] for i in chosen]
        return best

    def beside(self, given: Sequence[int]) -> Rest:
        """With more columns always in."""
        at = np.array(given)
        projection = np.linalg.solve(self._columns[at[:, None], at], self._columns[at])
        columns = self._columns - self._columns[:, at] @ projection
        size = np.diag(self._columns)
        columns += np.diag(np.maximum(_RIDGE * size - np.diag(columns), 0.0))
        return Rest(self._errors - projection.T @ self._errors[at], columns)


def rests(totals: Matrix, nuisance: int) -> list[Rest]:
    """What the first columns leave of the others, for each of some windows.

    Parameters
    ----------
    totals : ndarray of float64, shape (w, 1 + c, 1 + c)
        Products; the errors come first, then the nuisance.
    nuisance : int
        How many columns.
    """
    eye = np.eye(totals.shape[1])
    size = np.diagonal(totals, axis1=1, axis2=2)
    totals = totals + (_RIDGE * size + 1e-300)[:, :, None] * eye
    always, others = slice(1, nuisance + 1), np.r_[0, nuisance + 1 : totals.shape[1]]
    inner = totals[:, always][:, :, others]
    left = totals[:, others[:, None], others] - np.swapaxes(inner, 1, 2) @ np.linalg.solve(totals[:, always, always], inner)
    return [Rest(each[0, 1:], each[1:, 1:]) for each in left]
