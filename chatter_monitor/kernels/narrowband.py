"""How the complex amplitude of a line behaves from hop to hop: a narrow-band signal at baseband.

Of a mode that noise drives, its correlation decays as exp(-zeta omega t) and its modulus is Rayleigh distributed; of a
limit cycle or a tone, neither (MATHS section 3). A ``line[PARTS, hops]`` has its amplitudes oldest first, zeros where
samples are missing.
"""

import math

from numba import njit

from chatter_monitor.kernels.options import OPTIONS, SUMS
from chatter_monitor.kernels.prominence import TINY
from chatter_monitor.kernels.rings import after, before

# Rows of a line: real and imaginary part, modulus, and 1 where a transform saw samples, 0 where it did not.
RE, IM, MODULUS, HEARD = range(4)
PARTS = 4
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
def put_in_order(amplitudes, valid, head, line):
    """Take a line out of the ring of its transforms, whose phases are referred to a common time.

    Parameters
    ----------
    amplitudes : ndarray of complex128, shape (hops,)
    valid : ndarray of bool, shape (hops,)
        Which of them hold samples.
    head : int
        Column after the newest, with or without wrapping.
    line : ndarray of float64, shape (PARTS, hops)
        The result.
    """
    size = valid.shape[0]
    now = head % size
    for t in range(size):
        heard = 1.0 if valid[now] else 0.0
        re, im = heard * amplitudes[now].real, heard * amplitudes[now].imag
        line[RE, t], line[IM, t], line[HEARD, t] = re, im, heard
        line[MODULUS, t] = math.sqrt(re * re + im * im)  # `abs` is on its guard against numbers without a square
        now = after(now, size)


@njit(**OPTIONS)
def beat(line, turn, otherwise):
    """How far a line is from its bin, in bins, by how its phase advances; ``otherwise`` where that does not tell.

    The crest of a line is pulled aside by what is beside it, at low frequencies by its own mirror image, by some Hz;
    its phase is not. ``turn`` is by how many bins a whole turn from hop to hop would be.
    """
    size = line.shape[1]
    re = im = norm = 0.0
    for t in range(max(size - PHASE_HOPS, 1), size):
        re += line[RE, t] * line[RE, t - 1] + line[IM, t] * line[IM, t - 1]
        im += line[IM, t] * line[RE, t - 1] - line[RE, t] * line[IM, t - 1]
        norm += line[MODULUS, t] * line[MODULUS, t - 1]
    if not math.sqrt(re * re + im * im) > TELLING * norm:
        return otherwise
    return math.atan2(im, re) * turn / (2.0 * math.pi)


@njit(**OPTIONS)
def behaviour(line, scratch):
    """Variation of a line's modulus over half of its hops, its growth in a hop, and its coherence.

    Returns
    -------
    variation, growth, coherence : float
        Coefficient of variation, slope of the logarithm, and largest modulus of the correlation `LAG` to
        `LONGEST_LAG` hops apart; zeros where nothing can be said. ``scratch`` is work space for so many hops.
    """
    size = line.shape[1]
    count = 0
    for t in range(size):  # without a branch
        scratch[count] = line[MODULUS, t]
        count += int(line[HEARD, t])
    if count < GROWTH_HOPS:
        return 0.0, 0.0, 0.0
    coherence = 0.0
    for lag in range(LAG, LONGEST_LAG + 1):
        coherence = max(coherence, _correlation(line, lag))
    return (
        _variation(scratch[max(0, count - size // 2) : count]),
        _growth(scratch[count - GROWTH_HOPS : count]),
        coherence,
    )


@njit(**OPTIONS)
def variation_beside(line, levels, frames, scratch):
    """Coefficient of variation of a line's modulus over half of its hops, measured against the level in each frame.

    A feed or a depth that jumps makes all louder, the noise and what turns; a line that goes with the rest is steady.

    Parameters
    ----------
    line : ndarray of float64, shape (PARTS, hops)
    levels : ndarray, shape (columns,)
        Ring: mean logarithm of the power in each frame.
    frames : int
        Frames so far; the column after the newest of them.
    scratch : ndarray, shape (>= hops / 2 + 1,)
        Work space.
    """
    size, columns = line.shape[1], levels.shape[0]
    column = frames % columns
    gain = 0.0
    count = 0
    for back in range(min(size // 2, FRAME_HOPS * frames)):
        if back % FRAME_HOPS == 0:
            column = before(column, columns)
            gain = math.exp(-0.5 * levels[column])
        t = size - 1 - back
        scratch[count] = gain * line[MODULUS, t]
        count += int(line[HEARD, t])
    return _variation(scratch[:count])


@njit(**SUMS)
def _correlation(line, lag):
    """Modulus of the correlation of a line with itself so many hops apart, where both are known."""
    early_re, early_im, early_modulus, early_heard = line[RE], line[IM], line[MODULUS], line[HEARD]
    late_re, late_im, late_modulus, late_heard = line[RE, lag:], line[IM, lag:], line[MODULUS, lag:], line[HEARD, lag:]
    re = im = early = late = 0.0
    for t in range(late_re.shape[0]):
        re += late_re[t] * early_re[t] + late_im[t] * early_im[t]
        im += late_im[t] * early_re[t] - late_re[t] * early_im[t]
        early += early_modulus[t] * early_modulus[t] * late_heard[t]
        late += late_modulus[t] * late_modulus[t] * early_heard[t]
    norm = math.sqrt(early * late)
    return math.sqrt(re * re + im * im) / norm if norm > 0.0 else 0.0


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


@njit(**SUMS)
def _variation(values):
    """Standard deviation over the mean; 0 where that is none."""
    n = values.shape[0]
    total = 0.0
    for i in range(n):
        total += values[i]
    mean = total / n
    square = 0.0
    for i in range(n):
        square += (values[i] - mean) ** 2
    return math.sqrt(square / n) / mean if total > 0.0 else 0.0
