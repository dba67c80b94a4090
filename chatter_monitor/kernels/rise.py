"""By how much a line is more than it was: earlier in this cut, in the cuts before, in the air between."""

import math

from numba import njit

from chatter_monitor.kernels.median import median
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.rings import before

# Frames of the air before a cut, and of cuts before it, that are enough to know what was in them.
HEARD = 10
# Frames that are fainter by so much (logarithm of the power, 25 dB) are silence.
SILENCE = 5.8


@njit(**OPTIONS)
def rise(heights, levels, cutting, since, head, frames, b, scratch):
    """Half the height of a bin, less its median over the last frames: growth, of prominences that which is not shared.

    Frames in which nothing was cut, or in which there was next to silence, do not count: what begins has not risen from
    them. What has grown has risen above what it was since the tool entered, and above what it was in the cuts before.

    Parameters
    ----------
    heights : ndarray, shape (bins, columns)
        Ring of prominences (`prominence.stand_out`) or of logarithms of the power, a column for each frame.
    levels : ndarray, shape (columns,)
        Mean logarithm of the power in each of these frames.
    cutting : ndarray of bool, shape (columns,)
        Whether the tool was in the cut.
    since : float
        Frames since nothing was cut.
    head : int
        Column after the newest, counted from the start without wrapping.
    frames : int
        How far to look back.
    b : int
        The bin; what stands out one bin aside is the same line.
    scratch : ndarray, shape (>= columns,)
        Work space.
    """
    columns = heights.shape[1]
    column = head % columns
    newest = before(column, columns)
    if not cutting[newest]:
        return 0.0
    silence = levels[newest] - SILENCE
    count = here = 0
    for back in range(min(frames, head, columns)):
        column = before(column, columns)
        if cutting[column] and levels[column] > silence:
            scratch[count] = max(heights[b - 1, column], heights[b, column], heights[b + 1, column])
            count += 1
            here += back < since
    height = scratch[0]
    usual = median(scratch[:here])
    if here < count:
        usual = max(usual, median(scratch[:count]))
    return 0.5 * (height - usual)


@njit(**OPTIONS)
def news(heights, cutting, since, head, frames, b, scratch):
    """Half the prominence of a bin less what it was before this cut: its median in cuts before, and in the last air.

    Zero while the tool is not in the cut, and where not enough of both has been heard. Parameters as of `rise`.
    """
    columns = heights.shape[1]
    newest = before(head % columns, columns)
    known = min(frames, head, columns)
    if not cutting[newest] or since >= known:
        return 0.0
    usual = -math.inf
    for cut in (False, True):
        count = 0
        column = (head - int(since)) % columns
        for _ in range(int(since), known):
            column = before(column, columns)
            if cutting[column] == cut and (cut or count < HEARD):
                scratch[count] = max(heights[b - 1, column], heights[b, column], heights[b + 1, column])
                count += 1
        if count < HEARD:
            return 0.0
        usual = max(usual, median(scratch[:count]))
    height = max(heights[b - 1, newest], heights[b, newest], heights[b + 1, newest])
    return 0.5 * (height - usual)
