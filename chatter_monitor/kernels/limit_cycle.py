"""A vibration that keeps its amplitude though nothing keeps its phase.

Three things make a line. What noise drives has neither: its modulus is that of a complex Gaussian variable, and its
phase drifts. What a force drives has both: the phase is that of the force, however slowly a spindle wanders. A limit
cycle has an amplitude of its own, but no phase: nothing brings that back once noise has pushed it on (Pikovsky,
Rosenblum and Kurths, Synchronization, 2001, chapter 9). Noise that is strong, as where a tool leaves the cut again and
again, makes its line as broad as that of a mode, and as little coherent. So it is told by both together.

The amplitude is that of the whole band, for a line that wanders within it leaves a bin and comes back. Of noise the
power of a band is about a gamma variable, of a shape k that its covariance tells: 1 where one mode fills it, more where
several things do. The mean of its logarithm is then below the logarithm of its mean by log(k) - psi(k), which is the
unit of the dispersion here. The phase advances from one lag to the next by the same as before, if it is a force's, also
where its frequency glides.
"""

import math

import numpy as np
from numba import njit

from chatter_monitor.kernels.narrowband import FRAME_HOPS, LAG
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.prominence import LOBE, TINY

# Indices of what is told: the bin in the middle of the band, its share of the power, the dispersion of its amplitude, 1
# as that of noise, and how well its advance of phase is foretold by the one before, 1 if exactly.
MIDDLE, SHARE, DISPERSION, FORETOLD = range(4)
TOLD = 4
BAND = 2 * LOBE + 1
# A band with less of the power is not looked at, nor any where more of the power repeats: it is not what matters.
LEAST_SHARE, MOST_REPEATING = 0.5, 0.7
# Terms of psi(k) before its expansion for large k is exact to five digits.
SHIFT = 4


@njit(**OPTIONS)
def hear_band(spectra, valid, powers, totals, lowest, repeating, clock, turns, work, told):
    """Tell of the band that had most of the power while the ring was filled.

    Parameters
    ----------
    spectra, valid, turns : ndarray
        Ring of transforms, shape (bins, hops), as in `kernels.lines`.
    powers, totals : ndarray of float64, shape (bins, frames) and (frames,)
        Rings of logarithms of the power of each bin, and of all.
    lowest : int
        First bin that counts.
    repeating : float
        Share of the power that repeats.
    clock : tuple of int
        Hops and frames so far, samples so far, and samples in a hop.
    work : ndarray of float64, shape (2 BAND + 2, max(hops, bins))
        Work space.
    told : ndarray of float64, shape (TOLD,)
        The result; NaN where the ring is not full, or nothing is worth it.
    """
    hops, frames, _, _ = clock
    told[:] = math.nan
    size, columns = spectra.shape[1], powers.shape[1]
    lately = size // FRAME_HOPS
    whole = hops >= size and frames >= lately
    for t in range(size):
        whole &= valid[t]
    if not whole or repeating > MOST_REPEATING:
        return
    middle = _loudest(powers, lowest, frames, lately, work[0])
    total = 0.0
    for back in range(1, lately + 1):
        total += math.exp(totals[(frames - back) % columns])
    power = work[2 * BAND, :size]
    mean = _band(spectra, middle, clock, turns, work, power)
    share = min(mean * lately / total, 1.0) if total > 0.0 else 0.0
    if share < LEAST_SHARE:
        return
    told[MIDDLE], told[SHARE] = middle, share
    told[DISPERSION] = _dispersion(work[:, :size], power, mean)
    told[FORETOLD] = _foretold(work[:, :size], work[2 * BAND :, :size])


@njit(**OPTIONS)
def _loudest(powers, lowest, frames, lately, mean):
    """Middle of the band with most power in so many of the latest frames, by its geometric mean: blows do not count."""
    bins, columns = powers.shape
    for b in range(bins):
        total = 0.0
        for back in range(1, lately + 1):
            total += powers[b, (frames - back) % columns]
        mean[b] = math.exp(total / lately) if b >= lowest else 0.0
    loudest, most = lowest + LOBE, -1.0
    for middle in range(lowest + LOBE, bins - LOBE):
        within = 0.0
        for b in range(middle - LOBE, middle + LOBE + 1):
            within += mean[b]
        if within > most:
            loudest, most = middle, within
    return loudest


@njit(**OPTIONS)
def _band(spectra, middle, clock, turns, work, power):
    """Take a band out of the ring, oldest first; returns its mean power, and leaves that of each hop in ``power``.

    In the ring each bin turns by itself; here all of them turn as the one in the middle, so that a line has one phase.
    """
    hops, _, samples, hop = clock
    size, points = spectra.shape[1], turns.shape[0]
    power[:] = 0.0
    for i in range(BAND):
        aside = i - LOBE
        for t in range(size):
            back = size - t
            ends = samples - (back - 1) * hop
            turn = turns[(-aside * ends) % points]
            value = spectra[middle + aside, (hops - back) % size] * turn
            work[2 * i, t], work[2 * i + 1, t] = value.real, value.imag
            power[t] += value.real**2 + value.imag**2
    return np.mean(power)


@njit(**OPTIONS)
def _dispersion(band, power, mean):
    """How far the logarithm of the power's mean is above the mean of its logarithm, over what that is of noise."""
    size = power.shape[0]
    square = 0.0  # of the covariance
    for i in range(BAND):
        for j in range(i + 1):
            re = im = 0.0
            for t in range(size):
                re += band[2 * i, t] * band[2 * j, t] + band[2 * i + 1, t] * band[2 * j + 1, t]
                im += band[2 * i + 1, t] * band[2 * j, t] - band[2 * i, t] * band[2 * j + 1, t]
            square += (1.0 if i == j else 2.0) * (re * re + im * im) / (size * size)
    logarithm = 0.0
    for t in range(size):
        logarithm += math.log(power[t] + TINY)
    return (math.log(mean + TINY) - logarithm / size) / below_its_mean(mean * mean / square)


@njit(**OPTIONS)
def below_its_mean(shape):
    """By how much the mean logarithm of a gamma variable is below the logarithm of its mean: log(k) - psi(k)."""
    k, terms = shape, 0.0
    for _ in range(SHIFT):
        terms += 1.0 / k
        k += 1.0
    return math.log(shape / k) + terms + 1.0 / (2.0 * k) + 1.0 / (12.0 * k * k)


@njit(**OPTIONS)
def _foretold(band, advance):
    """How alike the advance of the phase within a lag is to that within the lag before: 1 for any steady glide.

    ``advance`` is work space, shape (2, hops).
    """
    size = band.shape[1]
    for t in range(LAG, size):
        advance[0, t], advance[1, t] = _advance(band, t)
    all_re = all_im = norm = 0.0
    for t in range(2 * LAG, size):
        late_re, late_im = advance[0, t], advance[1, t]
        early_re, early_im = advance[0, t - LAG], advance[1, t - LAG]
        all_re += late_re * early_re + late_im * early_im
        all_im += late_im * early_re - late_re * early_im
        norm += math.sqrt((late_re**2 + late_im**2) * (early_re**2 + early_im**2))
    return math.sqrt(all_re**2 + all_im**2) / norm if norm > 0.0 else 0.0


@njit(**OPTIONS)
def _advance(band, t):
    """Product of a band's amplitude with that a lag before, summed over its bins."""
    re = im = 0.0
    for i in range(BAND):
        late_re, late_im = band[2 * i, t], band[2 * i + 1, t]
        early_re, early_im = band[2 * i, t - LAG], band[2 * i + 1, t - LAG]
        re += late_re * early_re + late_im * early_im
        im += late_im * early_re - late_re * early_im
    return re, im
