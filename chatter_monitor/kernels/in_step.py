"""A stretch of a signal read in step with one of its lines: whatever turns along with that line keeps its frequency.

The speed of a spindle wanders, and each of its lines with it, the n-th multiple n times as far, so that they are broad
and hide what is beside them. Where the spindle has turned to is told by the phase of one line that is loud (Bonnardot
et al., 2005; Combet and Gelman, 2007: order tracking without a tachometer). Read at even steps of that phase instead of
time, the others are as narrow as if the speed had been constant, and what does not turn along is blurred.
"""

import math

import numpy as np
from numba import njit

from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.polynomial import cubic

BLOCK = 64  # samples whose sum tells one phase
REAL, IMAGINARY, PLACE, WEIGHT = range(4)


def new_work(samples: int) -> np.ndarray:
    """Work space for a stretch of so many samples."""
    return np.empty((4, samples // BLOCK))


@njit(**OPTIONS)
def read_in_step(samples: np.ndarray, line: float, width: float, work: np.ndarray, out: np.ndarray) -> float:
    """Read a stretch in step with one of its lines.

    Parameters
    ----------
    samples : ndarray of float64, shape (n,)
        The signal.
    line : float
        Frequency of the line, in cycles per sample.
    width : float
        How far around it the line may be, likewise.
    work : ndarray of float64, shape (4, n // BLOCK)
        Of `new_work`.
    out : ndarray of float64, shape (n,)
        The result; zeros at the end, from the middle of the last block on, and for half a block more.

    Returns
    -------
    float
        Mean frequency of the line, which is its frequency in the result; NaN if its phase goes backwards at a time, as
        that of noise does: then there is no result.
    """
    _sum_blocks(samples, line, work)
    blocks = work.shape[1]
    _find_places(line, max(1, round(0.5 / (width * BLOCK))), work)
    place = work[PLACE]
    for b in range(1, blocks):
        if not place[b] > place[b - 1]:
            return math.nan
    count = (blocks - 1) * BLOCK
    step = (place[blocks - 1] - place[0]) / count
    i, last = 0, samples.shape[0] - 3
    for b in range(blocks - 1):
        until = count if b == blocks - 2 else min(math.ceil((place[b + 1] - place[0]) / step), count)
        rate = BLOCK / (place[b + 1] - place[b])
        begin = BLOCK * b + 0.5 * (BLOCK - 1) - (place[b] - place[0]) * rate
        while i < until:
            at = begin + i * step * rate
            t = min(int(at), last)
            out[i] = cubic(samples[t - 1], samples[t], samples[t + 1], samples[t + 2], at - t)
            i += 1
    out[count:] = 0.0
    return float(line * step)


def start_of(work: np.ndarray, samples: int) -> float:
    """Mean frequency of the line that was followed in the first so many samples, as a part of its mean frequency."""
    place = work[PLACE]
    blocks = max(1, min(samples // BLOCK, len(place) - 1))
    return float((place[blocks] - place[0]) / blocks * (len(place) - 1) / (place[-1] - place[0]))


@njit(**OPTIONS)
def _sum_blocks(samples, line, work):
    """Fill in the sum of each block, shifted from the line's frequency to zero."""
    turn = complex(math.cos(2.0 * math.pi * line), -math.sin(2.0 * math.pi * line))
    for b in range(work.shape[1]):
        begin = b * BLOCK
        cycles = line * begin
        angle = 2.0 * math.pi * (cycles - math.floor(cycles))
        phasor, total = complex(math.cos(angle), -math.sin(angle)), complex(0.0, 0.0)
        for t in range(begin, begin + BLOCK):
            total += samples[t] * phasor
            phasor *= turn
        work[REAL, b], work[IMAGINARY, b] = total.real, total.imag


@njit(**OPTIONS)
def _find_places(line, half, work):
    """Fill in where the line is at the middle of each block, in samples at its nominal frequency.

    Blocks are averaged under a Hann window, ``half`` of them on either side.
    """
    half = min(half, work.shape[1] - 1)
    for k in range(half + 1):
        work[WEIGHT, k] = 1.0 + math.cos(math.pi * k / (half + 1))
    before, cycles = complex(0.0, 0.0), 0.0
    for b in range(work.shape[1]):
        re, im = 0.0, 0.0
        for k in range(max(0, b - half), min(work.shape[1], b + half + 1)):
            weight = work[WEIGHT, abs(k - b)]
            re += weight * work[REAL, k]
            im += weight * work[IMAGINARY, k]
        now = complex(re, im)
        if b > 0:
            turned = now * before.conjugate()
            cycles += math.atan2(turned.imag, turned.real) / (2.0 * math.pi)
        before = now
        work[PLACE, b] = b * BLOCK + cycles / line
