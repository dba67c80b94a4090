"""Power of a long real signal at each frequency: parts of it side by side in lanes, and then joined.

The signal makes a complex one of half its length; of that each lane has every eighth number. Their transforms go
through Stockham's passes like short ones (`kernels.transform`), and eight of their numbers at a time make eight of the
whole (Van Loan, Computational Frameworks for the Fast Fourier Transform, 1992, section 3.3). What numbers are
multiplied by comes from tables; of the last step it is powers of one of them.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.lanes import as_lanes, fma
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.transform import new_turns, transform

LEAST_POINTS = 512
LANES = 8
VECTOR_BYTES = 64
# Numbers between rows of work space: rows a power of two apart would have the same few places in the cache.
BETWEEN = 72
EIGHTH = math.sqrt(0.5)  # real part, and negative imaginary one, of an eighth of a turn


class Tables(NamedTuple):
    """Powers of exp(-2 pi i / points): for the parts all of them, for the whole the first half of them.

    Attributes
    ----------
    parts : ndarray of complex128, shape (points / 16,)
    re, im : ndarray of float64, shape (points / 2,)
    """

    parts: np.ndarray
    re: np.ndarray
    im: np.ndarray


def new_tables(points: int) -> Tables:
    """Tables for a signal of so many points, a power of two from `LEAST_POINTS` on."""
    whole = new_turns(points)[: points // 2]
    return Tables(new_turns(points // 16), whole.real.copy(), whole.imag.copy())


def new_work(points: int) -> np.ndarray:
    """Work space for a signal of so many points, shape (5, more than half of that): whole vectors of memory."""
    row = points // 2 + BETWEEN
    memory = np.empty(5 * row + LANES)
    begin = -memory.ctypes.data % VECTOR_BYTES // memory.itemsize
    return memory[begin : begin + 5 * row].reshape(5, row)


@njit(**OPTIONS)
def power_spectrum(signal, tables, work, power):
    """Fill in the power of a signal, shape (points,), at its frequencies but the highest, shape (points / 2,).

    ``tables`` and ``work`` are those for so many points.
    """
    half = power.shape[0]
    re, im, other_re, other_im, tile = work[0], work[1], work[2], work[3], work[4]
    for k in range(half):
        re[k], im[k] = signal[2 * k], signal[2 * k + 1]
    here = as_lanes(re, LANES), as_lanes(im, LANES)
    there = as_lanes(other_re, LANES), as_lanes(other_im, LANES)
    if transform(*here, *there, half // LANES, tables.parts):
        _join(other_re, other_im, tables, as_lanes(tile, LANES), tile, *here)
        _take_apart(re, im, tables, power)
    else:
        _join(re, im, tables, as_lanes(tile, LANES), tile, *there)
        _take_apart(other_re, other_im, tables, power)


@njit(**OPTIONS)
def _join(re, im, tables, rows, tile, whole_re, whole_im):
    """Transform of the whole from those of its parts: ``rows`` are the lanes of the ``tile``, work space."""
    length = tables.parts.shape[0]
    apart = length // LANES
    for begin in range(0, length, LANES):
        for t in range(LANES):
            for part in range(LANES):
                tile[part * LANES + t] = re[(begin + t) * LANES + part]
                tile[(LANES + part) * LANES + t] = im[(begin + t) * LANES + part]
            tile[2 * LANES * LANES + t] = tables.re[2 * (begin + t)]
            tile[(2 * LANES + 1) * LANES + t] = tables.im[2 * (begin + t)]
        r1, i1 = rows[2 * LANES], rows[2 * LANES + 1]
        r2, i2 = _product(r1, i1, r1, i1)
        r3, i3 = _product(r2, i2, r1, i1)
        r4, i4 = _product(r2, i2, r2, i2)
        r5, i5 = _product(r4, i4, r1, i1)
        r6, i6 = _product(r3, i3, r3, i3)
        r7, i7 = _product(r4, i4, r3, i3)
        a0, a1, a2, a3, b0, b1, b2, b3 = _of_four(
            rows[0], rows[LANES],
            *_product(rows[2], rows[LANES + 2], r2, i2),
            *_product(rows[4], rows[LANES + 4], r4, i4),
            *_product(rows[6], rows[LANES + 6], r6, i6),
        )  # fmt: skip
        c0, c1, c2, c3, d0, d1, d2, d3 = _of_four(
            *_product(rows[1], rows[LANES + 1], r1, i1),
            *_product(rows[3], rows[LANES + 3], r3, i3),
            *_product(rows[5], rows[LANES + 5], r5, i5),
            *_product(rows[7], rows[LANES + 7], r7, i7),
        )  # fmt: skip
        c1, d1 = EIGHTH * (c1 + d1), EIGHTH * (d1 - c1)
        c2, d2 = d2, -c2
        c3, d3 = EIGHTH * (d3 - c3), -EIGHTH * (c3 + d3)
        k = begin // LANES
        whole_re[k], whole_im[k] = a0 + c0, b0 + d0
        whole_re[k + apart], whole_im[k + apart] = a1 + c1, b1 + d1
        whole_re[k + 2 * apart], whole_im[k + 2 * apart] = a2 + c2, b2 + d2
        whole_re[k + 3 * apart], whole_im[k + 3 * apart] = a3 + c3, b3 + d3
        whole_re[k + 4 * apart], whole_im[k + 4 * apart] = a0 - c0, b0 - d0
        whole_re[k + 5 * apart], whole_im[k + 5 * apart] = a1 - c1, b1 - d1
        whole_re[k + 6 * apart], whole_im[k + 6 * apart] = a2 - c2, b2 - d2
        whole_re[k + 7 * apart], whole_im[k + 7 * apart] = a3 - c3, b3 - d3


@njit(forceinline=True, **OPTIONS)
def _product(a_re, a_im, b_re, b_im):
    """Product of complex numbers."""
    return fma(-a_im, b_im, a_re * b_re), fma(a_re, b_im, a_im * b_re)


@njit(forceinline=True, **OPTIONS)
def _of_four(a_re, a_im, b_re, b_im, c_re, c_im, d_re, d_im):
    """Transform of four numbers: the real parts, then the imaginary ones."""
    sum_re, sum_im, off_re, off_im = a_re + c_re, a_im + c_im, a_re - c_re, a_im - c_im
    odd_re, odd_im, aside_re, aside_im = b_re + d_re, b_im + d_im, b_im - d_im, d_re - b_re
    return (
        *(sum_re + odd_re, off_re + aside_re, sum_re - odd_re, off_re - aside_re),
        *(sum_im + odd_im, off_im + aside_im, sum_im - odd_im, off_im - aside_im),
    )


@njit(**OPTIONS)
def _take_apart(re, im, tables, power):
    """Power of a real signal from the transform of its even and odd samples together."""
    half = power.shape[0]
    power[0] = (re[0] + im[0]) ** 2
    for b in range(1, half):
        m = np.uint64(half - b)  # which is not counted from the end, and the compiler knows it
        even_re, even_im = re[b] + re[m], im[b] - im[m]
        odd_re, odd_im = im[b] + im[m], re[m] - re[b]
        x = even_re + odd_re * tables.re[b] - odd_im * tables.im[b]
        y = even_im + odd_re * tables.im[b] + odd_im * tables.re[b]
        power[b] = 0.25 * (x * x + y * y)
