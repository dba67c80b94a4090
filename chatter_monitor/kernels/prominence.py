"""How the lines of a spectrum stand out of what is around them."""

import math

from numba import njit

from chatter_monitor.kernels.options import OPTIONS

# Half width of a line in bins: the main lobe of the Hann window, transformed with 1.6 times its length.
LOBE = 3
# Bins on either side, beyond the lobe, that tell the level around a line.
AROUND = 12
# Added to powers before their logarithm is taken.
TINY = 1e-300


@njit(**OPTIONS)
def recent_power(spectra, valid, head, hops, power):
    """Mean power of each bin over the newest valid hops; returns how many there were."""
    bins, size = spectra.shape
    power[:] = 0.0
    found = 0
    for back in range(1, hops + 1):
        column = (head - back) % size
        if not valid[column]:
            continue
        found += 1
        for b in range(bins):
            power[b] += spectra[b, column].real ** 2 + spectra[b, column].imag ** 2
    if found > 0:
        for b in range(bins):
            power[b] /= found
    return found


@njit(**OPTIONS)
def stand_out(power, lowest, sums, prominence):
    """How far each bin stands out (natural logarithm of the power) of the mean around it, its own lobe left out.

    ``sums`` is work space of one more than the bins. Means of logarithms do not mind a neighbouring line.
    """
    bins = power.shape[0]
    sums[0] = 0.0
    for b in range(bins):
        sums[b + 1] = sums[b] + math.log(power[b] + TINY)
    prominence[:] = 0.0
    for b in range(lowest, bins):
        left = max(lowest, b - LOBE - AROUND)
        right = min(bins, b + LOBE + AROUND + 1)
        inner_left = max(left, b - LOBE)
        inner_right = min(right, b + LOBE + 1)
        around = sums[right] - sums[inner_right] + sums[inner_left] - sums[left]
        count = right - inner_right + inner_left - left
        prominence[b] = sums[b + 1] - sums[b] - around / count


@njit(**OPTIONS)
def most_prominent(prominence, lowest, peaks):
    """Bins of the most prominent local maxima at least a lobe apart, in order; returns how many were found."""
    count = 0
    for _ in range(peaks.shape[0]):
        best = -1
        for b in range(max(lowest, 1), prominence.shape[0] - 1):
            if not (prominence[b] >= prominence[b - 1] and prominence[b] > prominence[b + 1]):
                continue
            if best >= 0 and prominence[b] <= prominence[best]:
                continue
            apart = True
            for i in range(count):
                apart = apart and abs(peaks[i] - b) > LOBE
            if apart:
                best = b
        if best < 0:
            break
        peaks[count] = best
        count += 1
    return count


@njit(**OPTIONS)
def share(power, total, b):
    """Share of the power that is within the lobe around a bin; zero of nothing."""
    within = 0.0
    for i in range(max(0, b - LOBE), min(power.shape[0], b + LOBE + 1)):
        within += power[i]
    return min(within / total, 1.0) if total > 0.0 else 0.0


@njit(**OPTIONS)
def crest(power, b):
    """How far the crest of the parabola through the logarithms of a maximum and its neighbours is from it, in bins."""
    before, here, after = math.log(power[b - 1] + TINY), math.log(power[b] + TINY), math.log(power[b + 1] + TINY)
    bend = before - 2.0 * here + after
    return min(max(0.5 * (before - after) / bend, -0.5), 0.5) if bend < 0.0 else 0.0
