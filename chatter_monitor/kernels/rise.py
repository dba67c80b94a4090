"""By how much a line is more than it was: earlier in this cut, in the cuts before, in the air between."""

import math

from numba import njit

from chatter_monitor.kernels.median import median_of_many
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.rings import before

# Frames of the air before a cut, and of cuts before it, that are enough to know what was in them.
HEARD = 10
# Frames that are fainter by so much (logarithm of the power, 25 dB) are silence.
SILENCE = 5.8


@njit(**OPTIONS)
def compared(levels, cutting, crests, head, frames, columns):
    """Columns of the last frames that a line is compared with, the newest first; returns how many there are.

    Frames in which nothing was cut, or in which there was next to silence, do not count: what begins has not risen from
    them. Where something that turns was heard it was no silence, however much louder it is now. There are none while
    nothing is cut.

    Parameters
    ----------
    levels : ndarray, shape (size,)
        Ring: mean logarithm of the power in each frame.
    cutting : ndarray of bool, shape (size,)
        Whether the tool was in the cut.
    crests : ndarray, shape (size,)
        Ring: infinite where something turned that could be heard.
    head : int
        Column after the newest, counted from the start without wrapping.
    frames : int
        How far to look back.
    columns : ndarray of int64, shape (>= frames,)
        The result.
    """
    size = levels.shape[0]
    column = head % size
    newest = before(column, size)
    if not cutting[newest]:
        return 0
    silence = levels[newest] - SILENCE
    count = 0
    for _ in range(min(frames, head, size)):  # without a branch
        column = before(column, size)
        columns[count] = column
        heard = levels[column] > silence or crests[column] == math.inf
        count += cutting[column] and heard
    return count


@njit(**OPTIONS)
def power_rise(powers, columns, here, b, scratch):
    """By how much a bin has risen: half of its power's logarithm, less its median over the last frames.

    What has grown has risen above what it was since the tool entered, and above what it was in the cuts before.

    Parameters
    ----------
    powers : ndarray, shape (bins, size)
        Ring of logarithms of the power, a column for each frame.
    columns : ndarray of int64, shape (n,)
        Of the frames that count (`compared`).
    here : int
        How many of them are since the tool entered.
    b : int
        The bin.
    scratch : ndarray, shape (>= n,)
        Work space.
    """
    return _rise(powers, powers, False, columns, here, b, scratch)


@njit(**OPTIONS)
def line_rise(reliefs, powers, columns, here, b, scratch):
    """The same of a prominence (`prominence.stand_out`), of which there is a ring: growth that is not shared.

    Where the bin was on the slope of another line, what stood out there was that one's.
    """
    peak = columns.shape[0] > 0 and not _is_slope(powers, b, columns[0])
    return _rise(reliefs, powers, peak, columns, here, b, scratch)


@njit(**OPTIONS)
def _rise(heights, powers, peak, columns, here, b, scratch):
    """Rise of a bin; if it is to count as a peak by now, what it had on a slope is not its own."""
    if columns.shape[0] == 0:
        return 0.0
    usual = _usual(heights, powers, peak, columns, b, scratch)
    if here < columns.shape[0]:
        usual = max(usual, _usual(heights, powers, peak, columns[:here], b, scratch))
    return 0.5 * (height(heights, b, columns[0]) - usual)


@njit(**OPTIONS)
def _usual(heights, powers, peak, columns, b, scratch):
    """Median height of a bin over some frames."""
    for i in range(columns.shape[0]):
        scratch[i] = height(heights, b, columns[i])
        if peak and _is_slope(powers, b, columns[i]):
            scratch[i] = min(scratch[i], 0.0)
    return median_of_many(scratch[: columns.shape[0]])


@njit(**OPTIONS)
def _is_slope(powers, b, column):
    """Whether neither a bin nor one of the next is a maximum in a frame."""
    for at in range(b - 1, b + 2):
        below = powers[at - 1, column] if at > 0 else -math.inf
        above = powers[at + 1, column] if at + 1 < powers.shape[0] else -math.inf
        if powers[at, column] >= max(below, above):
            return False
    return True


@njit(inline="always", **OPTIONS)
def height(heights, b, column):
    """Height of a bin in a frame: what stands out one bin aside is the same line."""
    return max(heights[b - 1, column], heights[b, column], heights[b + 1, column])


@njit(**OPTIONS)
def arrival(heights, cutting, since, head, frames, b, scratch):
    """Half the prominence of a bin less its median in all that was heard before the tool entered, cut or air.

    What was in the cuts among that has not come now, however little of it was left in the air. Zero where too little
    has been heard. Parameters as of `rise`.
    """
    columns = heights.shape[1]
    newest = before(head % columns, columns)
    known = min(frames, head, columns)
    usual = -math.inf
    for cuts_only in (False, True):
        count = 0
        column = (head - int(min(since, known))) % columns
        for _ in range(int(min(since, known)), known):
            column = before(column, columns)
            if cutting[column] or not cuts_only:
                scratch[count] = height(heights, b, column)
                count += 1
        if count >= HEARD:
            usual = max(usual, median_of_many(scratch[:count]))
    return 0.5 * (height(heights, b, newest) - usual) if usual > -math.inf else 0.0


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
                scratch[count] = height(heights, b, column)
                count += 1
        if count < HEARD:
            return 0.0
        usual = max(usual, median_of_many(scratch[:count]))
    return 0.5 * (height(heights, b, newest) - usual)
