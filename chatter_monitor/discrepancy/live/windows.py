"""What some seconds of whitened errors say: of forces that are missing, and of a change since before.

Blocks of half a second are reduced to matrices of products and to powers in bands, and kept as running sums, so that a
window of any length costs the same. Of some blocks there are the signatures of a few forces only, the scouts, and these
in a part of the block; a window with such a block tells of these.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, chdtri

from chatter_monitor.kernels import live_windows as kernel
from chatter_monitor.kernels.binding import bound
from chatter_monitor.kernels.live_signatures import FEW, Summary

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

BANDS = 24
FINE_BANDS = 120  # in which a shape shows
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
    newest : int
        Of the samples of a block, those whose powers are looked at: as many in each block.
    shapes : ndarray of float64, shape (s, FINE_BANDS)
        Of changes of the logarithm of the spectrum that are looked for, orthogonal to one of the level; unit length.

    Attributes
    ----------
    firsts : list of int
        First sample of each.
    """

    def __init__(self, most: int, tried: int, scouts: int, linear: int, newest: int, shapes: Matrix) -> None:
        self._most, self._linear, self._shapes = most, linear, shapes
        self._newest = newest
        self._edges, self._fine_edges = (
            np.linspace(0, newest // 2, bands + 1).astype(np.int64) for bands in (BANDS, FINE_BANDS)
        )
        self._whole: list[bool] = []
        self.firsts: list[int] = []
        kept = 2 * most + 1
        few, every = 2 + linear + scouts, 2 + linear + tried
        self._sums = kernel.Sums(
            np.zeros((kept, few, few)), np.zeros((kept, every, every)), np.zeros((kept, 2, BANDS)),
            np.zeros((kept, FINE_BANDS)),
        )  # fmt: skip
        # What every comparison of a change is told: its columns, and what the powers are made of.
        ordinates = newest // 2
        self._compared = 2, linear, ordinates / BANDS, shapes, ordinates / FINE_BANDS
        summary, spectrum = no_summary(1, newest), np.zeros(newest // 2 + 1, dtype=np.complex128)
        self._append = bound(kernel.append, self._sums, 0, summary, 1, spectrum, self._edges, self._fine_edges)
        self._quiet = bound(kernel.quiet, *self._asked((), (), np.zeros(3), 0.0))

    def __len__(self) -> int:
        return len(self.firsts)

    def append(self, first: int, summary: Summary, used: int) -> bool:
        """Append whitened errors and signatures of a block; whether there was anything in it.

        Parameters
        ----------
        first : int
            Its first sample.
        summary : Summary
            Of it, or of its newest part.
        used : int
            How many columns are of use: 1 + linear + tried, or of the newest part 1 + linear + scouts.
        """
        if len(self) == 2 * self._most:
            for sums in self._sums:
                sums[: self._most + 1] = sums[self._most :] - sums[self._most]
            del self.firsts[: self._most], self._whole[: self._most]
        spectrum = np.fft.rfft(summary.errors[-self._newest :])
        if not self._append(self._sums, len(self), summary, used, spectrum, self._edges, self._fine_edges):
            return False
        self.firsts.append(first)
        self._whole.append(used + 1 == self._sums.of_all.shape[1])
        return True

    def fill(self, first: int, summary: Summary, used: int) -> None:
        """Put in what all forces say of a block that had only scouts; nothing, if there is no such block."""
        if first not in self.firsts:
            return
        at = self.firsts.index(first)
        if not self._whole[at]:
            samples = summary.errors.size
            products = kernel.with_offset(summary, samples, used)
            self._sums.of_all[at + 1 : len(self) + 1] += products * (samples / products[0, 0])
            self._whole[at] = True

    def whole(self, size: int) -> bool:
        """Whether all forces were tried in all of the newest blocks, so many."""
        return all(self._whole[-size:])

    def first_with_scouts(self, size: int) -> int:
        """First sample of the first of the newest blocks, so many, in which not all forces were tried."""
        return self.firsts[self._whole.index(False, len(self) - size)]

    def newest(self, sizes: Sequence[int]) -> list[Rest]:
        """What an offset and the linear machine leave of errors and of all forces, over the newest blocks.

        Parameters
        ----------
        sizes : sequence of int
            How many are the newest, for each window; all of these are `whole`.
        """
        of_all, always = self._sums.of_all, 1 + self._linear
        totals = np.empty((len(sizes), *of_all.shape[1:]))
        if sizes:
            kernel.newest(of_all, len(self), _array(sizes), _LOST, RIDGE, always, totals)
        return [Rest(total[0, always + 1 :], total[always + 1 :, always + 1 :]) for total in totals]

    def most_of_scouts(self, sizes: Sequence[int]) -> Vector:
        """What the scout that explains most by itself does over the newest blocks, nats."""
        gains = np.zeros(len(sizes))
        kernel.most(self._sums.of_scouts, len(self), _array(sizes), _LOST, RIDGE, 1 + self._linear, gains)
        return gains

    def quiet(self, changes: Sequence[int], forces: Sequence[int], little: Vector, nats: float) -> bool:
        """Whether a change and a force show less than this in all of the newest blocks; in one call.

        Parameters
        ----------
        changes, forces : sequence of int
            How many are the newest, for each window.
        little : ndarray of float64, shape (3,)
            Chi-squared of a change, see `little`.
        nats : float
            Of a scout.
        """
        return bool(self._quiet(*self._asked(changes, forces, little, nats)))

    def little(self, p: float) -> Vector:
        """What `quiet` takes for little: where `changed_p` would be about p."""
        each = p / 3.0
        return np.array(
            [chdtri(self._linear, each), chdtri(BANDS - 1, each), chdtri(1, each / max(len(self._shapes), 1))]
        )

    def _asked(self, changes: Sequence[int], forces: Sequence[int], little: Vector, nats: float) -> tuple[object, ...]:
        """What `kernel.quiet` is told."""
        sizes = _array(changes), _array(forces)
        return (self._sums, len(self), *sizes, *self._compared, little, _LOST, RIDGE, nats)

    def changed_p(self, sizes: Sequence[int]) -> Vector:
        """How often chance makes the newest blocks differ as much from those before them.

        In the coefficients of the linear machine; in the spectrum of the errors without its level; or in that spectrum
        by one of the shapes, which takes much less of a change than all bands together do.

        Parameters
        ----------
        sizes : sequence of int
            How many are the newest, for each window.
        """
        retuned, coloured, shaped = np.empty((3, len(sizes)))
        kernel.changed(self._sums, len(self), _array(sizes), *self._compared, retuned, coloured, shaped)
        p = [
            chdtrc(self._linear, np.maximum(retuned, 0.0)),
            chdtrc(BANDS - 1, coloured),
            max(len(self._shapes), 1) * chdtrc(1, shaped),
        ]
        return np.asarray(np.minimum(1.0, len(p) * np.min(p, axis=0)))


def _array(sizes: Sequence[int]) -> NDArray[np.int64]:
    return np.array(sizes, dtype=np.int64)


def no_summary(lanes: int, samples: int) -> Summary:
    """Room for that of so many samples."""
    return Summary(*(np.zeros(size) for size in (FEW * lanes, lanes * lanes, lanes, samples)))


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
