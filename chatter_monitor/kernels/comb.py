"""How well multiples of a frequency explain the lines of a spectrum."""

import math

from numba import njit

from chatter_monitor.kernels.options import OPTIONS


@njit(**OPTIONS)
def surprise(frequencies, tolerances, low, high, candidates, gains, hits):
    """Log odds against chance that lines lie on the multiples of each frequency that makes one of them a multiple.

    Parameters
    ----------
    frequencies, tolerances : ndarray of float64, shape (lines,)
        Where lines are, and how exactly that is known.
    low, high : float
        Range of the candidates.
    candidates, gains : ndarray of float64, shape (room,)
        Each candidate, and the sum over its lines of -ln(chance that a line is so close to a multiple), less that of
        the rarest of them, because the candidate was made from one.
    hits : ndarray of int64, shape (room,)
        Lines on the multiples of each candidate.

    Returns
    -------
    int
        Number of candidates.
    """
    made = 0
    for i in range(frequencies.shape[0]):
        for multiple in range(max(1, math.ceil(frequencies[i] / high)), int(frequencies[i] / low) + 1):
            candidate = frequencies[i] / multiple
            total = 0.0
            rarest = 0.0
            count = 0
            for j in range(frequencies.shape[0]):
                order = math.floor(frequencies[j] / candidate + 0.5)
                if order >= 1.0 and abs(frequencies[j] - order * candidate) <= tolerances[j]:
                    count += 1
                    chance = 2.0 * tolerances[j] / candidate
                    if chance < 1.0:
                        total -= math.log(chance)
                        rarest = max(rarest, -math.log(chance))
            candidates[made] = candidate
            gains[made] = total - rarest
            hits[made] = count
            made += 1
            if made == candidates.shape[0]:
                return made
    return made
