"""How much of a signal comes back after whole rotations of a spindle whose speed is known.

All that forces a cut is the same after a rotation; what it leaves of the signal is noise, and what the machine does of
itself. So of the power P of a frame, whose correlation with what was some rotations before is r, about r P is forced,
and (1 - r) P is not. That does not wait for a comb to be found or averaged, minds no line that is near an order, and
a load that jumps is over after a rotation. `kernels.repeats` asks for no speed, and takes the lag at which most
repeats: of bursts a tooth apart, or of a lightly damped mode that noise drives, some lag always fits.
"""

import math

import numpy as np
from numba import njit

from chatter_monitor.kernels.correlation import coefficient
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.polynomial import cubic

# The longest lag in frames, that of a rotation at 300 rpm; the shortest is one frame, so that no sample is compared
# with itself, and noise has been forgotten.
LONGEST = 4
# How far a rotation may be from the speed that is known, relatively.
AROUND = 0.003
# Places between two samples in which the crest of the correlation is looked for.
BETWEEN = 8


def new_past(frame: int) -> np.ndarray:
    """Nothing has been heard."""
    return np.zeros((LONGEST + 1) * frame)


@njit(**OPTIONS)
def recurring_share(frame: np.ndarray, past: np.ndarray, rotation: float) -> float:
    """Take in a frame; return its correlation with what was a whole number of rotations before, at least a frame.

    Parameters
    ----------
    frame : ndarray of float64, shape (n,)
        For a sample that is missing, which is not finite, the one before stands in.
    past : ndarray of float64, shape ((LONGEST + 1) n,)
        The latest samples, oldest first; changed in place.
    rotation : float
        Length of one in samples; 0 if it is not known.

    Returns
    -------
    float
        0 to 1; NaN if the rotation is not known or too long.
    """
    size, end = frame.shape[0], past.shape[0]
    for t in range(end - size):
        past[t] = past[t + size]
    for t in range(size):
        past[end - size + t] = frame[t] if abs(frame[t]) < math.inf else past[end - size + t - 1]
    if rotation <= 0.0:
        return math.nan
    lag = max(1.0, math.ceil(size / rotation)) * rotation
    shortest, longest = (1.0 - AROUND) * lag, (1.0 + AROUND) * lag
    if longest + 2.0 > end - size:
        return math.nan
    at = int(shortest)
    a, b, c = _alike(past, size, at - 1), _alike(past, size, at), _alike(past, size, at + 1)
    largest = 0.0
    while at <= longest:
        d = _alike(past, size, at + 2)
        for i in range(BETWEEN):
            x = i / BETWEEN
            if shortest <= at + x <= longest:
                largest = max(largest, cubic(a, b, c, d, x))
        a, b, c = b, c, d
        at += 1
    return min(largest, 1.0)


@njit(**OPTIONS)
def _alike(past, size, lag):
    """Correlation of the latest samples with those so many before."""
    end = past.shape[0]
    return coefficient(past[end - size :], past[end - size - lag : end - lag])
