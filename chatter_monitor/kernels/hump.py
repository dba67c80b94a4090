"""Whether what has become loud within some frames was heard before: then it is no tool that enters.

A mode that will chatter sounds in the noise of the cut already, as a hump of its spectrum, above what is on either
side. In a room nothing has sounded yet; its noise has a colour, but a slope is no hump. An idle machine may ring, too.
"""

import math

from numba import njit

from chatter_monitor.kernels.engagement import BEFORE, DECIBEL, FALL, FALLING
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.prominence import AROUND, LOBE

# A hump is higher than its sides by so much, four standard deviations of a second of noise, and what has grown out of
# it by as much more.
HUMP = 3.0 * DECIBEL


@njit(**OPTIONS)
def grew_out_of_hump(reliefs, powers, totals, lowest, head, scratch):
    """Whether what stands out most, in a frame that is far louder than the ones before, grew out of a hump of those.

    Parameters
    ----------
    reliefs, powers : ndarray, shape (bins, frames)
        Rings of prominences and of logarithms of the power; bins count from ``lowest`` on.
    totals : ndarray, shape (frames,)
        Ring: logarithm of the whole power, `engagement.Rings.powers`.
    head : int
        Column after the newest, counted from the start without wrapping.
    scratch : ndarray, shape (>= 2 (2 LOBE + AROUND) + 1,)
        Work space.
    """
    columns = totals.shape[0]
    newest = (head - 1) % columns
    if head < FALLING + BEFORE or totals[newest] - totals[(head - 1 - FALLING) % columns] < FALL:
        return False
    highest = lowest
    for b in range(lowest, reliefs.shape[0]):
        highest = b if reliefs[b, newest] > reliefs[highest, newest] else highest
    first, last = max(lowest, highest - 2 * LOBE - AROUND), min(reliefs.shape[0], highest + 2 * LOBE + AROUND + 1)
    before = scratch[: last - first]
    before[:] = 0.0
    for back in range(FALLING + 1, FALLING + 1 + BEFORE):
        column = (head - back) % columns
        for b in range(first, last):
            before[b - first] += powers[b, column] / BEFORE
    hump = -math.inf
    for b in range(max(first, highest - LOBE), min(last, highest + LOBE + 1)):
        here = b - first
        below = _mean(before, here - LOBE - AROUND, here - LOBE)
        above = _mean(before, here + LOBE + 1, here + LOBE + 1 + AROUND)
        hump = max(hump, before[here] - max(below, above))
    return HUMP <= hump <= reliefs[highest, newest] - HUMP


@njit(**OPTIONS)
def _mean(values, begin, end):
    """Mean of a part of what there is, infinite where that is too little."""
    begin, end = max(begin, 0), min(end, values.shape[0])
    if end - begin < LOBE:
        return math.inf
    total = 0.0
    for i in range(begin, end):
        total += values[i]
    return total / (end - begin)
