"""Whether each rotation repeats the one before, louder and out of step: chatter with many waves in a rotation.

Each rotation cuts into the waves that the one before has left, and the vibration answers them with a delay in phase.
The roots of the delay equation lie about one rotation's frequency apart (Insperger and Stepan, Semi-Discretization for
Time-Delay Systems, 2011), nearer to each other than lines can be told, and none of them takes most of the power.

Forced lines are such a comb, too. But they are at multiples of the rotation: after a rotation all of it is as it was,
the waves and their envelope. Of chatter the envelope comes back, and the waves below it have moved on. So where the
envelope of the correlation with what was a rotation before is largest, it is at a crest for a forced comb only.

A rotation of one to two frames, 600 to 1200 rpm, is heard in frames, a slower one of two to four in pairs of frames at
half of the rate.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.correlation import coefficient
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.repeats import Repeats, got_fainter, new_repeats, repeating_share

# A rotation repeats the one before: so large a correlation, at a lag that differs by so little from frame to frame.
REPEATING, SAME_LAG = 0.6, 0.03
# It has grown when it has been louder in so many frames in a row, and the amplitude 1.6 times what it was (natural
# logarithm); what has grown is followed until it is half of that.
IN_A_ROW, GROWN, NO_MORE = 4, 0.5, 0.25
# What gets louder by so much in a frame has jumped, as when a tool enters. A smaller jump is seen for a rotation, too:
# what regenerates gets louder in the next ones as well, by so much in all.
JUMP, BEYOND_A_JUMP = 0.4, 0.25
# Out of step is a mean cosine of the phase below that of 60 degrees.
OUT_OF_STEP = 0.5
# A phase is one of waves: half a wave from where they repeat, on one side or the other, they are the opposite, by so
# much of that at least. Blows that repeat have next to nothing there, or a ripple on what repeats more slowly.
OPPOSITE = 0.5
# Within a rotation it repeats by so much less, at lags from so many frames on to so near a whole rotation: a mode that
# noise drives repeats the more the nearer, and teeth repeat more often.
IN_BETWEEN, NEAREST, NEXT = 0.6, 0.36, 0.9
# Waves on either side of the largest correlation that its envelope is taken over, and that it is looked for in.
WAVES = 2.0

# Indices of what is known: the lag in frames, frames in a row, growth of the logarithm of the amplitude, its largest
# step and sum of the cosines in them, and whether it has been found to repeat less within a rotation.
LAG, FRAMES, GROWTH, STEP, COSINES, ALONE = range(6)


class Slower(NamedTuple):
    """What is heard of rotations that take longer.

    Attributes
    ----------
    frame : ndarray of float64, shape (n,)
        Two frames of as many samples, one after the other, at half of their rate.
    filled : ndarray of int64, shape (1,)
        How many of its samples are those of the frame before.
    repeats : Repeats
        What has been heard, in such frames.
    rotations : ndarray of float64, shape (6,)
        What is known of them.
    growth : ndarray of float64, shape (1,)
        Of the last of them.
    """

    frame: np.ndarray
    filled: np.ndarray
    repeats: Repeats
    rotations: np.ndarray
    growth: np.ndarray


def new_rotations() -> np.ndarray:
    """Nothing has been heard."""
    return np.zeros(6)


def new_slower(frame: int) -> Slower:
    """Nothing has been heard in frames of so many samples."""
    return Slower(np.zeros(frame), np.zeros(1, np.int64), new_repeats(frame), new_rotations(), np.zeros(1))


@njit(**OPTIONS)
def another_frame(
    frame: np.ndarray, repeats: Repeats, rotations: np.ndarray, slower: Slower
) -> tuple[float, bool, float]:
    """Take in a frame; return `repeating_share`, whether it `got_fainter`, and the `growth` of what is out of step."""
    share = repeating_share(frame, repeats)
    fainter = got_fainter(repeats)
    return share, fainter, max(growth(rotations, repeats), slower_growth(frame, slower))


@njit(**OPTIONS)
def slower_growth(frame, slower):
    """Take in a frame, shape (n,); return the `growth` of what comes back after two to four, as of the last pair."""
    half = slower.frame.shape[0] // 2
    begin = slower.filled[0]
    for t in range(half):
        slower.frame[begin + t] = 0.5 * (frame[2 * t] + frame[2 * t + 1])
    slower.filled[0] = half - begin
    if begin == half:
        repeating_share(slower.frame, slower.repeats)
        slower.growth[0] = growth(slower.rotations, slower.repeats)
    return slower.growth[0]


@njit(**OPTIONS)
def growth(rotations: np.ndarray, repeats: Repeats) -> float:
    """Follow another frame; return by how much what repeats out of step has grown.

    Parameters
    ----------
    rotations : ndarray of float64, shape (6,)
        Changed in place.
    repeats : Repeats
        What has been heard, this frame included.

    Returns
    -------
    float
        Natural logarithm of the amplitude, from `NO_MORE` on, or 0.
    """
    if repeats.now[0] < REPEATING:
        rotations[:] = 0.0
        return 0.0
    lag = repeats.lag[0]
    if abs(lag - rotations[LAG]) > SAME_LAG * lag:
        rotations[:] = 0.0
    step = repeats.louder[0] / lag
    had_grown = rotations[GROWTH] >= GROWN and rotations[ALONE] == 1.0
    rotations[LAG] = lag
    rotations[FRAMES] += 1.0
    rotations[GROWTH] += step
    rotations[STEP] = max(rotations[STEP], step)
    if step > JUMP or (rotations[GROWTH] < NO_MORE if had_grown else step <= 0.0):
        rotations[1:] = 0.0
        return 0.0
    rotations[COSINES] += cosine(repeats.correlation)
    if rotations[FRAMES] < IN_A_ROW or rotations[GROWTH] < NO_MORE:
        return 0.0
    if rotations[COSINES] >= OUT_OF_STEP * rotations[FRAMES]:
        return 0.0
    beyond = rotations[GROWTH] - lag * rotations[STEP]
    if rotations[ALONE] == 0.0 and beyond >= BEYOND_A_JUMP and _between(repeats) <= IN_BETWEEN * repeats.now[0]:
        rotations[ALONE] = 1.0
    return rotations[GROWTH] if rotations[ALONE] == 1.0 else 0.0


@njit(**OPTIONS)
def cosine(correlation: np.ndarray) -> float:
    """Cosine of the phase of a correlation where its envelope is largest; 1 where that is not found, or no waves are.

    Parameters
    ----------
    correlation : ndarray of float64, shape (lags,)
        A narrow-band signal's, from lag to lag.
    """
    crest = np.argmax(correlation)
    before, after = _next_crest(correlation, crest, -1), _next_crest(correlation, crest, 1)
    begin, end = max(before, 0), min(after, correlation.shape[0] - 1)  # beside the first and the last there is no crest
    if _lowest(correlation, begin, end) > -OPPOSITE * correlation[crest]:
        return 1.0
    omega = 4.0 * math.pi / max(after - before, 1)
    reach = round(WAVES * 2.0 * math.pi / omega)
    last = correlation.shape[0] - 1 - reach
    begin, end = max(crest - reach, reach), min(crest + reach, last)
    largest = 0.0
    where = begin
    for at in range(begin, end + 1):
        envelope = abs(_around(correlation, at, omega, reach))
        if envelope > largest:
            largest, where = envelope, at
    if where <= begin or where >= end:
        return 1.0
    left = abs(_around(correlation, where - 1, omega, reach))
    right = abs(_around(correlation, where + 1, omega, reach))
    here = _around(correlation, where, omega, reach)
    aside = 0.5 * (left - right) / (left - 2.0 * largest + right)  # crest of the parabola through the three
    return math.cos(math.atan2(here.imag, here.real) + omega * aside)


@njit(**OPTIONS)
def _next_crest(values, crest, step):
    """The next maximum beside one."""
    i = crest + step
    while 0 < i < values.shape[0] - 1 and values[i] <= values[i - step]:
        i += step
    while 0 < i < values.shape[0] - 1 and values[i + step] > values[i]:
        i += step
    return i


@njit(**OPTIONS)
def _lowest(values, begin, end):
    """The least from one to another."""
    lowest = math.inf
    for i in range(begin, end + 1):
        lowest = min(lowest, values[i])
    return lowest


@njit(**OPTIONS)
def _around(values, at, omega, reach):
    """Complex amplitude of the wave at a place, under a Hann window; no cosine is taken anew for each value."""
    along = math.pi / (reach + 1)
    wave, turn = _turned(omega * reach), _turned(-omega)
    hann, next_one = _turned(-along * reach), _turned(along)
    total = complex(0.0, 0.0)
    for m in range(-reach, reach + 1):
        total += (0.5 + 0.5 * hann.real) * values[at + m] * wave
        wave *= turn
        hann *= next_one
    return total


@njit(**OPTIONS)
def _turned(angle):
    """One, turned by an angle."""
    return complex(math.cos(angle), math.sin(angle))


@njit(**OPTIONS)
def _between(repeats):
    """The largest correlation within a rotation."""
    samples = repeats.samples
    size = repeats.correlation.shape[0] - 1
    end = samples.shape[0]
    largest = 0.0
    for lag in range(round(NEAREST * size), round(NEXT * repeats.lag[0] * size)):
        largest = max(largest, abs(coefficient(samples[end - size :], samples[end - size - lag : end - lag])))
    return largest
