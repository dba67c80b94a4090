"""What some seconds of whitened errors say: of forces that are missing, and of a change since before.

Blocks of half a second are reduced to matrices of products and to powers in bands, and kept as running sums, so that a
window of any length costs the same. Of some blocks there are the signatures of a few forces only, the scouts; a window
with such a block tells of these.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from chatter_monitor.kernels import live_windows as kernel

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

BANDS = 24
FINE_BANDS = 120  # in which a shape shows
FEWEST_BLOCKS = 2  # that tell of a shape: the powers of one are too few to be nearly Gaussian
RIDGE = 1e-9
# Of a running sum: what is left of less than that when two are subtracted is rounding.
_LOST = 1e-8


class Blocks:
    """The newest blocks.

    Parameters
    ----------
    most : int
        How many are kept, at least.
    tried, scouts : int
        How many forces there are, and how many of them, the first, are tried in every block.
    linear : int
        How many of the signatures stand for the linear machine; they come first.
    samples : int
        In a block.
    shapes : ndarray of float64, shape (s, FINE_BANDS)
        Of changes of the logarithm of the spectrum that are looked for, orthogonal to one of the level; unit length.

    Attributes
    ----------
    firsts : list of int
        First sample of each.
    """

    def __init__(self, most: int, tried: int, scouts: int, linear: int, samples: int, shapes: Matrix) -> None:
        self._most, self._linear, self._shapes = most, linear, shapes
        self._ordinates = samples // 2
        self._edges, self._fine_edges = (
            np.linspace(0, samples // 2, bands + 1).astype(np.int64) for bands in (BANDS, FINE_BANDS)
        )
        self._widths, self._fine_widths = np.diff(self._edges), np.diff(self._fine_edges)
        kept = 2 * most + 1
        # Of errors, 1, signatures of the linear machine, and of forces: scouts, and all where all were tried.
        self._of_scouts, self._of_all = (
            np.zeros((kept, size, size)) for size in (2 + linear + scouts, 2 + linear + tried)
        )
        self._whole: list[bool] = []
        self._power = np.zeros((kept, 2, BANDS))  # and its square
        self._fine_power = np.zeros((kept, FINE_BANDS))
        self.firsts: list[int] = []

    def __len__(self) -> int:
        return len(self.firsts)

    def append(self, first: int, rows: Matrix) -> None:
        """Append whitened errors and signatures of a block.

        They count over the variance of the errors in the block: what is louder says no more.

        Parameters
        ----------
        first : int
            Its first sample.
        rows : ndarray of float64, shape (samples, 1 + linear + tried) or (samples, 1 + linear + scouts)
        """
        errors = rows[:, 0].copy()
        variance = float(errors @ errors) / errors.size
        if not 0.0 < variance < np.inf:
            return
        if len(self) == 2 * self._most:
            for sums in (self._of_scouts, self._of_all, self._power, self._fine_power):
                sums[: self._most + 1] = sums[self._most :] - sums[self._most]
            del self.firsts[: self._most], self._whole[: self._most]
        at = len(self)
        amplitudes = np.fft.rfft(errors)[1:]
        periodogram = (amplitudes.real**2 + amplitudes.imag**2) / (errors.size * variance)
        power, fine = (
            np.add.reduceat(periodogram, edges[:-1]) / widths
            for edges, widths in ((self._edges, self._widths), (self._fine_edges, self._fine_widths))
        )
        products = _with_offset(rows) / variance
        few, whole = self._of_scouts.shape[1], products.shape == self._of_all.shape[1:]
        self._of_scouts[at + 1] = self._of_scouts[at] + products[:few, :few]
        self._of_all[at + 1] = self._of_all[at] + (products if whole else 0.0)
        self._power[at + 1] = self._power[at] + np.stack([power, power**2])
        self._fine_power[at + 1] = self._fine_power[at] + fine
        self.firsts.append(first)
        self._whole.append(whole)

    def fill(self, first: int, rows: Matrix) -> None:
        """Put in what all forces say of a block that had only scouts; nothing, if there is no such block."""
        if first not in self.firsts:
            return
        at = self.firsts.index(first)
        if not self._whole[at]:
            errors = rows[:, 0]
            self._of_all[at + 1 : len(self) + 1] += _with_offset(rows) * (errors.size / (errors @ errors))
            self._whole[at] = True

    def whole(self, size: int) -> bool:
        """Whether all forces were tried in all of the newest blocks, so many."""
        return all(self._whole[-size:])

    def newest(self, sizes: Sequence[int]) -> list[Rest]:
        """What an offset and the linear machine leave of errors and other signatures, over the newest blocks.

        Parameters
        ----------
        sizes : sequence of int
            How many are the newest, for each window.

        Returns
        -------
        list of Rest
            Of all forces for each window that is `whole`, of scouts for the others.
        """
        whole = [size for size in sizes if self.whole(size)]
        rests = self._rests(self._of_all, whole) | self._rests(self._of_scouts, [s for s in sizes if s not in whole])
        return [rests[size] for size in sizes]

    def _rests(self, sums: Matrix, sizes: Sequence[int]) -> dict[int, Rest]:
        always = 1 + self._linear
        totals = np.empty((len(sizes), *sums.shape[1:]))
        if sizes:
            kernel.newest(sums, len(self), np.array(sizes, dtype=np.int64), _LOST, RIDGE, always, totals)
        rests = (Rest(total[0, always + 1 :], total[always + 1 :, always + 1 :]) for total in totals)
        return dict(zip(sizes, rests, strict=True))

    def changed_p(self, sizes: Sequence[int]) -> Vector:
        """How often chance makes the newest blocks differ as much from those before them.

        In the coefficients of the linear machine; in the spectrum of the errors without its level; or in that spectrum
        by one of the shapes, which takes much less of a change than all bands together do.

        Parameters
        ----------
        sizes : sequence of int
            How many are the newest, for each window.
        """
        retuned, coloured, spreads = np.empty((3, len(sizes)))
        size = np.array(sizes, dtype=np.int64)
        ordinates = self._ordinates / BANDS
        kernel.changed(
            self._of_scouts, self._power, len(self), size, 2, self._linear, ordinates, retuned, coloured, spreads
        )
        p = [
            chdtrc(self._linear, np.maximum(retuned, 0.0)),
            chdtrc(BANDS - 1, coloured),
            max(len(self._shapes), 1) * chdtrc(1, self._shaped(size) / spreads),
        ]
        return np.asarray(np.minimum(1.0, len(p) * np.min(p, axis=0)))

    def _shaped(self, size: NDArray[np.int64]) -> Vector:
        """Chi-squared of the shape that the newest blocks have most of next to those before; one degree of freedom."""
        if not len(self._shapes):
            return np.zeros(size.size)
        at = len(self) - size
        before = self._fine_power[at]
        new, old = (self._fine_power[len(self)] - before) / size[:, None], before / at[:, None]
        # Wilson and Hilferty (1931): the cube root of a mean of few ordinates is nearly Gaussian.
        change = 3.0 * np.cbrt(new / old)
        most = np.max(np.abs(change @ self._shapes.T), axis=1)
        chi_squared = most**2 * self._ordinates / FINE_BANDS / (1.0 / at + 1.0 / size)
        return np.asarray(np.where(size < FEWEST_BLOCKS, 0.0, chi_squared))


def _with_offset(rows: Matrix) -> Matrix:
    """Products of columns, and of 1 after the first of them: what a constant force or a drift adds to the errors."""
    products, sums, samples = rows.T @ rows, np.ones(len(rows)) @ rows, len(rows)
    total = np.empty((len(sums) + 1, len(sums) + 1))
    total[0, 0], total[0, 2:] = products[0, 0], products[0, 1:]
    total[2:, 0], total[2:, 2:] = products[1:, 0], products[1:, 1:]
    total[1, 1], total[0, 1], total[1, 0], total[1, 2:], total[2:, 1] = samples, sums[0], sums[0], sums[1:], sums[1:]
    return total


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

    @cached_property
    def gains(self) -> Vector:
        """Of each column by itself, nats."""
        return np.asarray(0.5 * self._errors**2 / self._columns.diagonal())

    def regress(self, chosen: Sequence[int]) -> tuple[float, list[float]]:
        """Gain of one column or two together, nats, and their coefficients."""
        i, j = chosen[0], chosen[-1]
        x, a = float(self._errors[i]), float(self._columns[i, i])
        if i == j:
            return 0.5 * x * x / a, [x / a]
        y, b, c = float(self._errors[j]), float(self._columns[i, j]), float(self._columns[j, j])
        determinant = a * c - b * b
        u, v = (c * x - b * y) / determinant, (a * y - b * x) / determinant
        return 0.5 * (u * x + v * y), [u, v]

    def bounded(self, columns: Sequence[int], lower: Sequence[float], price: float) -> tuple[float, list[int]]:
        """Best gain less a price for each column, and by which columns; none has a coefficient below its bound."""
        best: tuple[float, list[int]] = (-math.inf, [])
        for chosen in ([0], [1], [0, 1]) if len(columns) == 2 else ([0],):
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
        columns += np.diag(np.maximum(RIDGE * size - np.diag(columns), 0.0))
        return Rest(self._errors - projection.T @ self._errors[at], columns)
