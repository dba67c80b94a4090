"""Fourier transforms of several short stretches of a signal at once, one in each lane.

So few points take a library as long to be asked for as to transform. Two halves of a real signal make a complex one of
half its length; that goes through Stockham's passes, four parts at a time, after which nothing has to be put in order
(Van Loan, Computational Frameworks for the Fast Fourier Transform, 1992, sections 1.7 and 2.4).
"""

import numpy as np
from numba import njit

from chatter_monitor.kernels.lanes import fma
from chatter_monitor.kernels.options import OPTIONS


def new_turns(points: int) -> np.ndarray:
    """Powers of exp(-2 pi i / points), shape (points,)."""
    turns: np.ndarray = np.exp(-2j * np.pi * np.arange(points) / points)
    return turns


@njit(**OPTIONS)
def real_transform(re, im, work_re, work_im, turns):
    """Transform real signals in place.

    Parameters
    ----------
    re, im : ndarray of lanes, shape (points / 2 + 1,)
        Samples with an even index, and those with an odd one; the last place is free. Overwritten with the transforms.
    work_re, work_im : ndarray of lanes, shape (points / 2 + 1,)
        Work space.
    turns : ndarray of complex128, shape (points,)
        Powers of exp(-2 pi i / points); points are a power of two.
    """
    half = turns.shape[0] // 2
    if transform(re, im, work_re, work_im, half, turns):
        for k in range(half):
            re[k], im[k] = work_re[k], work_im[k]
    _part(re, im, half, turns)


@njit(**OPTIONS)
def transform(re, im, work_re, work_im, points, turns):
    """Transform complex signals of so many points; the result is in the work space if that is what is returned.

    ``turns`` may be powers of a root for more points. Otherwise as `real_transform`.
    """
    left, beside = points, 1  # points of a transform that is left to do, and how many of these lie beside each other
    there = False  # where the numbers are
    while left > 1:
        parts = 4 if left >= 4 else 2
        if there:
            _pass(work_re, work_im, re, im, left, beside, parts, turns)
        else:
            _pass(re, im, work_re, work_im, left, beside, parts, turns)
        there = not there
        left //= parts
        beside *= parts
    return there


@njit(**OPTIONS)
def _pass(re, im, out_re, out_im, left, beside, parts, turns):
    """One pass: transforms of so many points become four times as many of a fourth, or twice as many of a half."""
    step = turns.shape[0] // left
    apart = beside * (left // parts)
    for p in range(left // parts):
        w1, w2, w3 = turns[step * p], turns[2 * step * p], turns[3 * step * p]
        for i in range(beside * p, beside * (p + 1)):
            o = i + (parts - 1) * beside * p
            if parts == 2:
                out_re[o], out_im[o] = re[i] + re[i + apart], im[i] + im[i + apart]
                out_re[o + beside], out_im[o + beside] = re[i] - re[i + apart], im[i] - im[i + apart]
                continue
            sum_re, sum_im = re[i] + re[i + 2 * apart], im[i] + im[i + 2 * apart]
            off_re, off_im = re[i] - re[i + 2 * apart], im[i] - im[i + 2 * apart]
            odd_re, odd_im = re[i + apart] + re[i + 3 * apart], im[i + apart] + im[i + 3 * apart]
            aside_re, aside_im = im[i + apart] - im[i + 3 * apart], re[i + 3 * apart] - re[i + apart]
            out_re[o], out_im[o] = sum_re + odd_re, sum_im + odd_im
            o += beside
            out_re[o], out_im[o] = _turned(off_re + aside_re, off_im + aside_im, w1)
            o += beside
            out_re[o], out_im[o] = _turned(sum_re - odd_re, sum_im - odd_im, w2)
            o += beside
            out_re[o], out_im[o] = _turned(off_re - aside_re, off_im - aside_im, w3)


@njit(inline="always", **OPTIONS)
def _turned(re, im, turn):
    """Product with a number."""
    return fma(-im, turn.imag, re * turn.real), fma(re, turn.imag, im * turn.real)


@njit(**OPTIONS)
def _part(re, im, half, turns):
    """Take apart what even and odd samples have given together."""
    re[half], im[half] = re[0], im[0]
    for k in range(half // 2 + 1):
        m = half - k
        even_re, even_im = 0.5 * (re[k] + re[m]), 0.5 * (im[k] - im[m])
        odd_re, odd_im = 0.5 * (im[k] + im[m]), 0.5 * (re[m] - re[k])
        turned_re, turned_im = _turned(odd_re, odd_im, turns[k])
        re[k], im[k] = even_re + turned_re, even_im + turned_im
        re[m], im[m] = even_re - turned_re, turned_im - even_im
