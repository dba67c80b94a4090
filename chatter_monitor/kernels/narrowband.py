"""How the complex amplitude of a line behaves from hop to hop: a narrow-band signal at baseband.

Of a mode that noise drives, its correlation decays as exp(-zeta omega t) and its modulus is Rayleigh distributed; of a
limit cycle or a tone, neither (MATHS section 3). The ring ``amplitudes[hops]`` holds the latest, column ``head - 1``
the newest, and ``valid[hops]`` whether a transform saw samples at all.
"""

import math

import numpy as np
from numba import njit

from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.prominence import TINY
from chatter_monitor.kernels.rings import after, before

# Transforms of a frame.
FRAME_HOPS = 4
# Hops between the amplitudes whose correlation is looked at: from no samples in common on. Two lines within a lobe, or
# one that a rotation modulates, beat: what they lose of it they have again after a beat, down to 13 Hz. What noise
# drives never has.
LAG, LONGEST_LAG = 2, 6
# Hops over which the phase tells the frequency, and the coherence from one to the next that it takes.
PHASE_HOPS, TELLING = 12, 0.5
# Hops over which growth is fitted.
GROWTH_HOPS = 12


@njit(**OPTIONS)
def beat(amplitudes, valid, head, turn, otherwise):
    """How far a line is from its bin, in bins, by how its phase advances; ``otherwise`` where that does not tell.

    The crest of a line is pulled aside by what is beside it, at low frequencies by its own mirror image, by some Hz;
    its phase is not. ``turn`` is by how many bins a whole turn from hop to hop would be.
    """
    size = valid.shape[0]
    product = complex(0.0, 0.0)
    norm = 0.0
    now = head % size
    for _ in range(min(PHASE_HOPS, size - 1)):
        now = before(now, size)
        then = before(now, size)
        if valid[now] and valid[then]:
            product += amplitudes[now] * np.conj(amplitudes[then])
            norm += _modulus(amplitudes[now]) * _modulus(amplitudes[then])
    if not abs(product) > TELLING * norm:
        return otherwise
    return math.atan2(product.imag, product.real) * turn / (2.0 * math.pi)


@njit(**OPTIONS)
def behaviour(amplitudes, valid, head, scratch):
    """Variation of a line's modulus over half of the ring, its growth in a hop, and its coherence.

    Parameters
    ----------
    amplitudes : ndarray of complex128, shape (hops,)
        Ring of the line's transforms, phases referred to a common time.
    valid : ndarray of bool, shape (hops,)
        Which of them hold samples.
    head : int
        Column after the newest, with or without wrapping.
    scratch : ndarray, shape (>= hops,)
        Work space.

    Returns
    -------
    variation, growth, coherence : float
        Coefficient of variation, slope of the logarithm, and largest modulus of the correlation `LAG` to
        `LONGEST_LAG` hops apart; zeros where nothing can be said.
    """
    size = valid.shape[0]
    modulus = scratch  # oldest first
    count = 0
    now = head % size
    for _ in range(size):
        if valid[now]:
            modulus[count] = _modulus(amplitudes[now])
            count += 1
        now = after(now, size)
    if count < GROWTH_HOPS:
        return 0.0, 0.0, 0.0
    mean, spread = _moments(modulus[max(0, count - size // 2) : count])
    variation = spread / mean if mean > 0.0 else 0.0
    return variation, _growth(modulus[count - GROWTH_HOPS : count]), _coherence(amplitudes, valid, head)


@njit(**OPTIONS)
def variation_beside(amplitudes, valid, head, levels, frames, scratch):
    """Coefficient of variation of a line's modulus over half of the ring, measured against the level in each frame.

    A feed or a depth that jumps makes all louder, the noise and what turns; a line that goes with the rest is steady.

    Parameters
    ----------
    amplitudes : ndarray of complex128, shape (hops,)
        Ring of the line's transforms.
    valid : ndarray of bool, shape (hops,)
        Which of them hold samples.
    head : int
        Column after the newest.
    levels : ndarray, shape (columns,)
        Ring: mean logarithm of the power in each frame.
    frames : int
        Frames so far; the column after the newest of them.
    scratch : ndarray, shape (>= hops / 2,)
        Work space.
    """
    size, columns = valid.shape[0], levels.shape[0]
    now, column = head % size, frames % columns
    gain = 0.0
    count = 0
    for back in range(min(size // 2, FRAME_HOPS * frames)):
        now = before(now, size)
        if back % FRAME_HOPS == 0:
            column = before(column, columns)
            gain = math.exp(-0.5 * levels[column])
        if valid[now]:
            scratch[count] = gain * _modulus(amplitudes[now])
            count += 1
    mean, spread = _moments(scratch[:count])
    return spread / mean if mean > 0.0 else 0.0


@njit(**OPTIONS)
def _coherence(amplitudes, valid, head):
    """Largest modulus of the correlation between amplitudes of a line, oldest at ``head``, over the lags."""
    largest = 0.0
    for lag in range(LAG, LONGEST_LAG + 1):
        largest = max(largest, _correlation(amplitudes, valid, head, lag))
    return largest


@njit(**OPTIONS)
def _correlation(amplitudes, valid, head, lag):
    """Modulus of the correlation between the amplitudes of a line so many hops apart."""
    size = amplitudes.shape[0]
    product = complex(0.0, 0.0)
    early = 0.0
    late = 0.0
    now, then = head % size, (head - lag) % size
    for _ in range(size - lag):
        now, then = before(now, size), before(then, size)
        if valid[now] and valid[then]:
            product += amplitudes[now] * np.conj(amplitudes[then])
            late += amplitudes[now].real ** 2 + amplitudes[now].imag ** 2
            early += amplitudes[then].real ** 2 + amplitudes[then].imag ** 2
    norm = math.sqrt(early * late)
    return abs(product) / norm if norm > 0.0 else 0.0


@njit(**OPTIONS)
def _growth(modulus):
    """Slope per hop of the straight line through the logarithm of the modulus (least squares)."""
    n = modulus.shape[0]
    middle = 0.5 * (n - 1)
    slope = 0.0
    spread = 0.0
    for i in range(n):
        slope += (i - middle) * math.log(modulus[i] + TINY)
        spread += (i - middle) ** 2
    return slope / spread


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
def _modulus(amplitude):
    """Modulus of a number whose square is one, too: `abs` is on its guard against those whose square is none."""
    return math.sqrt(amplitude.real * amplitude.real + amplitude.imag * amplitude.imag)
