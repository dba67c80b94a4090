"""What sounded before all became loud within some frames: whether the tool was in a cut already, or a room was heard.

A mode that will chatter sounds in the noise of the cut already, as a hump of its spectrum, above what is on either
side. In a room nothing has sounded yet; its noise has a colour, but a slope is no hump. An idle machine may ring, too,
and a pump or a fan may hum: one steady tone, and no mode beside it, which cutting would have driven.
"""

import math

from numba import njit

from chatter_monitor.kernels.engagement import BEFORE, DECIBEL, FALL, FALLING, STILL
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.prominence import AROUND, LOBE
from chatter_monitor.kernels.rise import height

# A hump is higher than its sides by so much, four standard deviations of a second of noise, and what has grown out of
# it by as much more.
HUMP = 3.0 * DECIBEL


@njit(**OPTIONS)
def what_sounded(reliefs, powers, totals, lowest, head, scratch):
    """What sounded before a frame that is far louder than the ones before.

    Parameters
    ----------
    reliefs, powers : ndarray, shape (bins, frames)
        Rings of prominences and of logarithms of the power; bins count from ``lowest`` on.
    totals : ndarray, shape (frames,)
        Ring: logarithm of the whole power, `engagement.Rings.powers`.
    head : int
        Column after the newest, counted from the start without wrapping.
    scratch : ndarray, shape (>= bins,)
        Work space.

    Returns
    -------
    familiar, mode, quiet : bool
        Whether what stands out most by now grew out of a hump; whether that came and went, as a mode does that noise
        drives; whether there was none, but for a steady tone that is drowned by now, by noise or by a line elsewhere.
    """
    columns, bins = totals.shape[0], reliefs.shape[0]
    newest = (head - 1) % columns
    if head < FALLING + BEFORE or totals[newest] - totals[(head - 1 - FALLING) % columns] < FALL:
        return False, False, False
    before = scratch[lowest:bins]
    before[:] = 0.0
    for back in range(FALLING + 1, FALLING + 1 + BEFORE):
        column = (head - back) % columns
        for b in range(lowest, bins):
            before[b - lowest] += powers[b, column] / BEFORE
    highest = loudest = 0
    for b in range(before.shape[0]):
        highest = b if reliefs[lowest + b, newest] > reliefs[lowest + highest, newest] else highest
        loudest = b if powers[lowest + b, newest] > powers[lowest + loudest, newest] else loudest
    place, grown = _highest_hump(before, highest - LOBE, highest + LOBE + 1)
    familiar = HUMP <= grown <= reliefs[lowest + highest, newest] - HUMP
    mode = familiar and not _is_steady(powers, lowest + place, head - 1 - FALLING)
    tone, stood_out = _highest_hump(before, 0, before.shape[0])
    _, below = _highest_hump(before, 0, tone - LOBE)
    _, above = _highest_hump(before, tone + LOBE + 1, before.shape[0])
    around = powers[lowest + tone, newest] - reliefs[lowest + tone, newest]
    drowned = around > before[tone] or abs(loudest - tone) > 1
    hum = drowned and _is_steady(powers, lowest + tone, head - 1 - FALLING)
    return familiar, mode, max(below, above, -math.inf if hum else stood_out) < HUMP


@njit(**OPTIONS)
def _is_steady(powers, b, end):
    """Whether a bin was as loud in each frame before one, as its standard deviation tells."""
    mean = square = 0.0
    for back in range(1, BEFORE + 1):
        level = height(powers, b, (end - back) % powers.shape[1])
        mean += level / BEFORE
        square += level**2 / BEFORE
    return square - mean**2 < STILL**2


@njit(**OPTIONS)
def _highest_hump(levels, begin, end):
    """Bin of the highest hump of a part of the spectrum, and how far it is above both of its sides."""
    place, highest = 0, -math.inf
    for b in range(max(begin, 0), min(end, levels.shape[0])):
        hump = _hump(levels, b)
        if hump > highest:
            place, highest = b, hump
    return place, highest


@njit(**OPTIONS)
def _hump(levels, b):
    """How far a bin is above both of its sides."""
    below = _mean(levels, b - LOBE - AROUND, b - LOBE)
    above = _mean(levels, b + LOBE + 1, b + LOBE + 1 + AROUND)
    return levels[b] - max(below, above)


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
