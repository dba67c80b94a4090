"""Lines of a short-time spectrum: where they are, how they stand out, and how their complex amplitude behaves.

The ring ``spectra[hops, bins]`` holds the latest transforms, ``spectra[head - 1]`` the newest, and ``valid[hops]``
whether a transform saw samples at all. The amplitudes of one line over the hops are a narrow-band signal at baseband:
of a mode that noise drives, their correlation decays as exp(-zeta omega t) and their modulus is Rayleigh distributed;
of a limit cycle or a tone, neither (MATHS section 3).
"""

import math

import numpy as np
from numba import njit

from chatter_monitor.kernels.options import OPTIONS

# Half width of a line in bins: the main lobe of the Hann window, transformed with 1.6 times its length.
LOBE = 3
# Bins on either side, beyond the lobe, that tell the level around a line.
AROUND = 12
# Hops between the amplitudes whose correlation is looked at: from no common samples to a fifth of a second.
LAGS = (2, 4, 8, 16)
# Added to powers before their logarithm is taken.
TINY = 1e-300
# Hops over which growth is fitted.
GROWTH_HOPS = 12

# Indices into what `describe` writes
SHARE = 0
VARIATION = 1
GROWTH = 2
GROWTH_SD = 3
COHERENCE = 4  # and one for each further lag
MEASURES = COHERENCE + len(LAGS)


@njit(**OPTIONS)
def recent_power(spectra, valid, head, hops, power):
    """Mean power of each bin over the newest valid hops; returns how many there were."""
    size, bins = spectra.shape
    power[:] = 0.0
    found = 0
    for back in range(1, hops + 1):
        row = (head - back) % size
        if not valid[row]:
            continue
        found += 1
        for b in range(bins):
            power[b] += spectra[row, b].real ** 2 + spectra[row, b].imag ** 2
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
def line_power(power, b):
    """Power within the lobe around a bin."""
    total = 0.0
    for i in range(max(0, b - LOBE), min(power.shape[0], b + LOBE + 1)):
        total += power[i]
    return total


@njit(**OPTIONS)
def median(values):
    """Median (upper one of two); sorts the values."""
    for i in range(1, values.shape[0]):
        value = values[i]
        j = i
        while j > 0 and values[j - 1] > value:
            values[j] = values[j - 1]
            j -= 1
        values[j] = value
    return values[values.shape[0] // 2]


@njit(**OPTIONS)
def describe(spectra, valid, head, power, lowest, b, scratch, out):
    """Measures of the line at bin ``b``, at the indices above.

    Parameters
    ----------
    spectra : ndarray of complex128, shape (hops, bins)
        Ring of transforms, phases referred to a common time.
    valid : ndarray of bool, shape (hops,)
        Which of them hold samples.
    head : int
        Row after the newest.
    power : ndarray, shape (bins,)
        Recent power of each bin (`recent_power`).
    lowest : int
        First bin that counts as vibration.
    b : int
        The line.
    scratch : ndarray, shape (hops,)
        Work space.
    out : ndarray, shape (MEASURES,)
        Share of the power; coefficient of variation of the modulus over half of the
        ring; growth of its logarithm in a hop with standard deviation; correlation at each of `LAGS`.
    """
    size = spectra.shape[0]
    total = 0.0
    for i in range(lowest, power.shape[0]):
        total += power[i]
    out[:] = 0.0
    if not total > 0.0:
        return
    own = line_power(power, b)
    out[SHARE] = min(own / total, 1.0)

    modulus = scratch  # oldest first
    count = 0
    for back in range(size, 0, -1):
        row = (head - back) % size
        if valid[row]:
            modulus[count] = abs(spectra[row, b])
            count += 1
    if count < GROWTH_HOPS:
        return
    mean, spread = _moments(modulus[max(0, count - size // 2) : count])
    if mean > 0.0:
        out[VARIATION] = spread / mean
    _growth(modulus[count - GROWTH_HOPS : count], out)
    for i in range(len(LAGS)):
        out[COHERENCE + i] = _coherence(spectra, valid, head, b, LAGS[i])


@njit(**OPTIONS)
def rise(reliefs, head, frames, b, scratch):
    """Half the prominence of a bin, less its median over the last frames: growth that the surroundings do not share.

    Parameters
    ----------
    reliefs : ndarray, shape (rows, bins)
        Ring of prominences (`stand_out`), one row a frame.
    head : int
        Row after the newest, counted from the start without wrapping.
    frames : int
        How far to look back.
    b : int
        The bin; what stands out one bin aside is the same line.
    scratch : ndarray, shape (rows,)
        Work space.
    """
    rows = reliefs.shape[0]
    count = min(frames, head, rows)
    newest = 0.0
    for back in range(1, count + 1):
        row = (head - back) % rows
        height = max(reliefs[row, b - 1], reliefs[row, b], reliefs[row, b + 1])
        if back == 1:
            newest = height
        scratch[back - 1] = height
    return 0.5 * (newest - median(scratch[:count])) if count > 1 else 0.0


@njit(**OPTIONS)
def _moments(values):
    """Mean and standard deviation."""
    n = values.shape[0]
    mean = 0.0
    for i in range(n):
        mean += values[i] / n
    variance = 0.0
    for i in range(n):
        variance += (values[i] - mean) ** 2 / n
    return mean, math.sqrt(variance)


@njit(**OPTIONS)
def _growth(modulus, out):
    """Straight line through the logarithm of the modulus: slope per hop and its standard deviation."""
    n = modulus.shape[0]
    middle = 0.5 * (n - 1)
    mean = 0.0
    for i in range(n):
        mean += math.log(modulus[i] + TINY) / n
    slope = 0.0
    spread = 0.0
    for i in range(n):
        slope += (i - middle) * (math.log(modulus[i] + TINY) - mean)
        spread += (i - middle) ** 2
    slope /= spread
    scatter = 0.0
    for i in range(n):
        scatter += (math.log(modulus[i] + TINY) - mean - slope * (i - middle)) ** 2
    out[GROWTH] = slope
    out[GROWTH_SD] = math.sqrt(scatter / (n - 2) / spread)


@njit(**OPTIONS)
def _coherence(spectra, valid, head, b, lag):
    """Modulus of the correlation between amplitudes a lag apart."""
    size = spectra.shape[0]
    product = complex(0.0, 0.0)
    early = 0.0
    late = 0.0
    for back in range(1, size + 1 - lag):
        now = (head - back) % size
        then = (head - back - lag) % size
        if valid[now] and valid[then]:
            product += spectra[now, b] * np.conj(spectra[then, b])
            late += abs(spectra[now, b]) ** 2
            early += abs(spectra[then, b]) ** 2
    norm = math.sqrt(early * late)
    return abs(product) / norm if norm > 0.0 else 0.0
