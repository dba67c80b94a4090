"""How much of a signal repeats what it was a little before: teeth, a slot, a rotation, whatever their speed.

Whatever turns comes back after a rotation, and after several. Of noise, and of a mode that noise drives, little is left
after 50 ms. So the correlation of the latest samples with those 50 to 100 ms before, at the lag at which it is
largest, is about the share of the power that is periodic. No speed has to be known for it, no lines have to be
resolved, and it is heard after some tenths of a second instead of the seconds that a comb takes.

It does not mind how loud either of the two is. So it tells a cut that has got lighter from a tool that has left: most
of what is heard then was heard before, and louder. A pump that goes on was as loud before as it is now.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.options import OPTIONS

# Samples whose mean is taken as one: there are a quarter as many products then, and half of the band is enough.
THINNED = 2
# The longest lag in frames, that of a rotation at 600 rpm; the shortest is half of it, so that a multiple of every
# period is between them.
LONGEST = 2
# Weight of a frame in the average of the correlations. One that is so many times as powerful as those before weighs by
# its power: a tool that enters is not heard out of the air before it.
AVERAGING, LOUDER = 0.25, 2.0
# Frames that a change of loudness is looked for in; in each of them so much repeats, and in one so many times fainter.
CHANGING, MOST, FAINTER = 4, 0.5, 1.4


class Repeats(NamedTuple):
    """What has been heard.

    Attributes
    ----------
    samples : ndarray of float64, shape ((LONGEST + 1) n / THINNED,)
        The latest, thinned, oldest first; n is that of a frame.
    correlation, norms : ndarray of float64, shape (n / THINNED + 1,)
        Average of the correlation at each lag, the longest first, and of the powers that it is over.
    products : ndarray of float64, shape (n / THINNED + 1,)
        Work space.
    now : ndarray of float64, shape (CHANGING,)
        The largest correlation of each of the latest frames, the newest first.
    times : ndarray of float64, shape (CHANGING,)
        How many times as loud as in the frame was before what repeats in it.
    lag, louder : ndarray of float64, shape (1,)
        Lag in frames at which the newest frame repeats most; natural logarithm of how many times as loud it is as then.
    """

    samples: np.ndarray
    correlation: np.ndarray
    norms: np.ndarray
    products: np.ndarray
    now: np.ndarray
    times: np.ndarray
    lag: np.ndarray
    louder: np.ndarray


def new_repeats(frame: int) -> Repeats:
    """Nothing has been heard."""
    size = frame // THINNED
    return Repeats(
        samples=np.zeros((LONGEST + 1) * size),
        correlation=np.zeros(size + 1),
        norms=np.zeros(size + 1),
        products=np.zeros(size + 1),
        now=np.zeros(CHANGING),
        times=np.zeros(CHANGING),
        lag=np.zeros(1),
        louder=np.zeros(1),
    )


@njit(**OPTIONS)
def repeating_share(frame, repeats):
    """Take in a frame, shape (n,); return the share of the power that repeats, 0 to 1.

    For a sample that is missing, which is not finite, the one before stands in.
    """
    samples, correlation, norms, products = repeats.samples, repeats.correlation, repeats.norms, repeats.products
    size = correlation.shape[0] - 1
    begin = samples.shape[0] - size
    for t in range(begin):
        samples[t] = samples[t + size]
    for t in range(size):
        total = 0.0
        for i in range(THINNED):
            total += frame[THINNED * t + i]
        samples[begin + t] = total / THINNED if abs(total) < math.inf else samples[begin + t - 1]
    for i in range(CHANGING - 1, 0, -1):
        repeats.now[i] = repeats.now[i - 1]
        repeats.times[i] = repeats.times[i - 1]
    repeats.now[0] = repeats.times[0] = repeats.lag[0] = repeats.louder[0] = 0.0
    power = _products(samples, size, products)
    total = 0.0
    square = 0.0
    for t in range(size):
        total += samples[t]
        square += samples[t] * samples[t]
    share = most = past = 0.0
    where = 0
    for i in range(size + 1):
        before = square - total * total / size
        norm = math.sqrt(max(power * before, 0.0))
        now = products[i] / norm if norm > 0.0 else 0.0
        if now > most:
            most, where, past = now, i, before
        norms[i] += AVERAGING * (norm - norms[i])
        weight = AVERAGING * norm / norms[i] if norm > LOUDER * norms[i] else AVERAGING
        correlation[i] += weight * (now - correlation[i])
        share = max(share, correlation[i])
        total += samples[i + size] - samples[i]
        square += samples[i + size] * samples[i + size] - samples[i] * samples[i]
    if most > 0.0:
        repeats.now[0], repeats.times[0] = most, products[where] / power
        repeats.lag[0], repeats.louder[0] = LONGEST - where / size, 0.5 * math.log(power / past)
    return min(share, 1.0)


@njit(**OPTIONS)
def _products(samples, size, products):
    """Sums of products of the newest samples with those before, at each lag; returns the power of the newest."""
    products[:] = 0.0
    newest = samples[samples.shape[0] - size :]
    mean = np.mean(newest)
    power = 0.0
    for t in range(0, size, 4):
        a, b, c, d = (
            _away(newest, t, mean),
            _away(newest, t + 1, mean),
            _away(newest, t + 2, mean),
            _away(newest, t + 3, mean),
        )
        power += a * a + b * b + c * c + d * d
        past = samples[t:]
        # The inner loop goes over the lags, so that several are done at a time; their sums are fetched and put back
        # once for four samples.
        for i in range(size + 1):
            products[i] += a * past[i] + b * past[i + 1] + c * past[i + 2] + d * past[i + 3]
    return power


@njit(**OPTIONS)
def _away(values, t, mean):
    """How far a value is from the mean; those beyond the end are not."""
    return values[t] - mean if t < values.shape[0] else 0.0


@njit(**OPTIONS)
def got_fainter(repeats):
    """Whether most of what is heard is what was heard before, and that has got fainter."""
    least, times = repeats.now[0], repeats.times[0]
    for i in range(1, CHANGING):
        least = min(least, repeats.now[i])
        times = max(times, repeats.times[i])
    return least >= MOST and times >= FAINTER
