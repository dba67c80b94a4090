"""Evidence for forces that a model lacks: regression of its whitened prediction errors on signatures.

All columns (errors, signatures) are whitened by the same filter and weighted by the local size of the errors, then
reduced to one matrix of products per block of the recording. Every question after that, coefficients, gains,
combinations, held-out tests, is linear algebra on sums of these small matrices.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, stats
from scipy.linalg import lapack

from chatter_monitor.discrepancy.side_by_side import each

Vector = NDArray[np.float64]
_TINY = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Regressed:
    """Coefficients of some columns beside the nuisance columns, fitted to some blocks.

    Attributes
    ----------
    coefficients, sd : ndarray of float64, shape (k,)
    gain : float
        Logarithm of the likelihood ratio over the nuisance columns alone, nats, on the blocks fitted.
    all_coefficients : ndarray of float64
        Those of the nuisance columns as well, nuisance first.
    """

    coefficients: Vector
    sd: Vector
    gain: float
    all_coefficients: Vector


class Evidence:
    """Products of columns by blocks.

    Parameters
    ----------
    errors : ndarray of float64, shape (n,)
        Whitened prediction errors.
    columns : c times ndarray of float64, shape (n,)
        Whitened signatures.
    weight : ndarray of float64, shape (n,)
        Reciprocal of the standard deviation of the errors; 0 for samples not to be used.
    nuisance : sequence of int
        Columns that are always fitted.
    block : int
        Samples in a block.
    """

    def __init__(
        self,
        errors: Vector,
        columns: Sequence[Vector] | NDArray[np.float64],
        weight: Vector,
        nuisance: Sequence[int],
        block: int,
    ) -> None:
        self.nuisance = list(nuisance)
        self._sums: dict[bytes, NDArray[np.float64]] = {}  # of the products, by blocks
        count = max(1, errors.size // block)
        self.block = block
        rows = [errors, *columns]
        edges = [*(b * block for b in range(count)), errors.size]
        self.products = np.empty((count, len(rows), len(rows)))
        self.samples = np.array([np.count_nonzero(weight[a:z]) for a, z in pairwise(edges)], dtype=np.float64)

        def products(b: int) -> None:
            part = slice(edges[b], edges[b + 1])
            weighted = np.empty((len(rows), edges[b + 1] - edges[b]))
            for row, into in zip(rows, weighted, strict=True):
                np.multiply(row[part], weight[part], out=into)
            self.products[b] = weighted @ weighted.T

        each(products, range(count))

    def only(self, blocks: NDArray[np.bool_]) -> Evidence:
        """The evidence of some blocks."""
        part = copy.copy(self)
        part.products, part.samples, part._sums = self.products[blocks], self.samples[blocks], {}
        part.__dict__.pop("everything", None)
        return part

    def join(self, column: Vector, errors: Vector, columns: NDArray[np.float64], weight: Vector) -> int:
        """Add a column to those that are given again; return its number."""
        products = np.empty((self.blocks, columns.shape[0] + 2))
        for b in range(self.blocks):
            part = slice(b * self.block, (b + 1) * self.block if b < self.blocks - 1 else errors.size)
            row = column[part] * weight[part] ** 2
            products[b] = [errors[part] @ row, *(columns[:, part] @ row), column[part] @ row]
        row, corner = products[:, :-1], products[:, -1:]
        self._sums = {}
        self.products = np.block([[self.products, row[:, :, None]], [row[:, None, :], corner[:, None]]])
        return int(self.products.shape[1]) - 2

    def expect(self, column: int, value: float, sd: float) -> None:
        """Count what is known of a coefficient beforehand, a normal variable, as one sample more."""
        sample = np.zeros(self.products.shape[1])
        sample[[0, column + 1]] = value / sd, 1.0 / sd
        self.products[0] += np.outer(sample, sample)
        self._sums = {}

    @property
    def blocks(self) -> int:
        """How many."""
        return int(self.products.shape[0])

    @cached_property
    def everything(self) -> NDArray[np.bool_]:
        """All blocks."""
        return np.ones(self.blocks, dtype=bool)

    def over(self, blocks: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Products summed over blocks; row and column 0 are the errors."""
        which = blocks.tobytes()
        if which not in self._sums:
            self._sums[which] = self.products[blocks].sum(axis=0)
        return self._sums[which]

    def regress(self, columns: Sequence[int], blocks: NDArray[np.bool_] | None = None) -> Regressed:
        """Fit some columns beside the nuisance."""
        total = self.over(self.everything if blocks is None else blocks)
        return _regress(total, self.nuisance, list(columns))

    def bounded(
        self, columns: Sequence[int], lower: Sequence[float], price: float, blocks: NDArray[np.bool_] | None = None
    ) -> tuple[list[int], Regressed]:
        """Fit with coefficients not below their bounds (0 or none); which columns are left, and their fit.

        Columns at their bound are left out, with one or two of them that is the solution of the bounded problem; and
        those that do not gain their price in nats.
        """
        total = self.over(self.everything if blocks is None else blocks)
        best: tuple[list[int], Regressed] = ([], replace(_regress(total, self.nuisance, []), gain=-math.inf))
        for mask in range(1, 1 << len(columns)):
            chosen = [c for i, c in enumerate(columns) if mask >> i & 1]
            floor = [low for i, low in enumerate(lower) if mask >> i & 1]
            fit = _regress(total, self.nuisance, chosen)
            allowed = all(c >= low for c, low in zip(fit.coefficients, floor, strict=True))
            if allowed and fit.gain - price * len(chosen) > best[1].gain - price * len(best[0]):
                best = (chosen, fit)
        return best

    def gain_on(self, fit: Regressed, columns: Sequence[int], base: Regressed, blocks: NDArray[np.bool_]) -> float:
        """Log-likelihood ratio, on blocks that were not fitted, of two fits with their coefficients as they are."""
        return self.rest(base, [], blocks) - self.rest(fit, columns, blocks)

    def rest(self, fit: Regressed, columns: Sequence[int], blocks: NDArray[np.bool_]) -> float:
        """Half the sum of squares that a fit leaves of some blocks."""
        return _rest(self.over(blocks), fit.all_coefficients, [*self.nuisance, *columns])

    def p_value(self, columns: Sequence[int], blocks: NDArray[np.bool_]) -> float:
        """How often chance lets these columns explain as much of these blocks."""
        gain = _regress(self.over(blocks), self.nuisance, list(columns)).gain
        return float(stats.chi2.sf(2.0 * max(gain, 0.0), len(columns)))


def _regress(total: NDArray[np.float64], nuisance: list[int], columns: list[int]) -> Regressed:
    """Least squares by a Cholesky factor U'U of the products, whose leading block is that of the nuisance alone."""
    index = np.array([-1, *nuisance, *columns]) + 1
    products = total[index[:, None], index]
    normal, right = products[1:, 1:], products[1:, 0]
    k = len(nuisance)
    size = np.sqrt(np.maximum(normal.diagonal(), 1e-300))
    scaled = normal / (size[:, None] * size)
    scaled.flat[:: size.size + 1] += _TINY
    factor, failed = lapack.dpotrf(scaled)
    if failed:
        msg = f"products of columns are not positive definite: the {failed}th leading minor"
        raise linalg.LinAlgError(msg)
    inverse, _ = lapack.dtrtri(factor)
    coordinates = (right / size) @ inverse
    solution = inverse @ coordinates / size
    gain = 0.5 * float(coordinates[k:] @ coordinates[k:])
    sd = np.sqrt(np.sum(inverse[k:] ** 2, axis=1)) / size[k:]
    return Regressed(solution[k:], sd, gain, solution)


def _rest(total: NDArray[np.float64], coefficients: Vector, columns: Sequence[int]) -> float:
    """Half the sum of squares that is left."""
    index = [i + 1 for i in columns]
    right = total[index, 0]
    square = coefficients @ total[np.ix_(index, index)] @ coefficients
    return 0.5 * float(total[0, 0] - 2.0 * coefficients @ right + square)
