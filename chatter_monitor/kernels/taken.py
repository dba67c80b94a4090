"""What was taken out of a frame with the synchronous part: its share of the power, and its strongest harmonics."""

import math

import numpy as np
from numba import njit

from chatter_monitor.kernels.options import OPTIONS


@njit(**OPTIONS)
def share_taken(before, after):
    """Share of the variance that went with the synchronous part, and the variance before.

    Samples that are not finite do not count.
    """
    count = 0
    mean_before = 0.0
    mean_after = 0.0
    for t in range(before.shape[0]):
        if abs(before[t]) < np.inf:
            count += 1
            mean_before += before[t]
            mean_after += after[t]
    if count == 0:
        return 0.0, 0.0
    mean_before /= count
    mean_after /= count
    power = 0.0
    left = 0.0
    for t in range(before.shape[0]):
        if abs(before[t]) < np.inf:
            power += (before[t] - mean_before) ** 2
            left += (after[t] - mean_after) ** 2
    return max(0.0, 1.0 - left / power) if power > 0.0 else 0.0, power / count


@njit(**OPTIONS)
def strongest(real, imag, gate, orders, rms):
    """Harmonics of which most is subtracted, strongest first.

    Parameters
    ----------
    real, imag, gate : ndarray of float64, shape (n,)
        As in `orders.OrderState`.
    orders, rms : ndarray of int64 and of float64, shape (m,)
        The result, for so many at most: order and root mean square of what is subtracted.

    Returns
    -------
    int
        How many there are.
    """
    count = 0
    for i in range(gate.shape[0]):
        if gate[i] == 0.0:
            continue
        here = gate[i] * math.hypot(real[i], imag[i]) / math.sqrt(2.0)
        place = count
        while place > 0 and rms[place - 1] < here:
            place -= 1
        if place == rms.shape[0]:
            continue
        count = min(count + 1, rms.shape[0])
        for k in range(count - 1, place, -1):
            orders[k], rms[k] = orders[k - 1], rms[k - 1]
        orders[place], rms[place] = i + 1, here
    return count
