"""Lines of a short-time spectrum: where they are, how they stand out, and how their complex amplitude behaves.

The ring ``spectra[bins, hops]`` holds the latest transforms, column ``head - 1`` the newest, and ``valid[hops]``
whether a transform saw samples at all. The amplitudes of one line over the hops are a narrow-band signal at baseband:
of a mode that noise drives, their correlation decays as exp(-zeta omega t) and their modulus is Rayleigh distributed;
of a limit cycle or a tone, neither (MATHS section 3). They lie side by side, because that is how they are read.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.engagement import SINCE, engaged, fell, new_air
from chatter_monitor.kernels.median import median
from chatter_monitor.kernels.options import OPTIONS

# Transforms of a frame.
FRAME_HOPS = 4
# Half width of a line in bins: the main lobe of the Hann window, transformed with 1.6 times its length.
LOBE = 3
# Bins on either side, beyond the lobe, that tell the level around a line.
AROUND = 12
# Hops between the amplitudes whose correlation is looked at: from no samples in common on. Two lines within a lobe, or
# one that a rotation modulates, beat: what they lose of it they have again after a beat, down to 13 Hz. What noise
# drives never has.
LAG, LONGEST_LAG = 2, 6
# Added to powers before their logarithm is taken.
TINY = 1e-300
# Hops over which the phase tells the frequency, and the coherence from one to the next that it takes.
PHASE_HOPS, TELLING = 12, 0.5
# Hops over which growth is fitted.
GROWTH_HOPS = 12
# Frames of the air before a cut, and of cuts before it, that are enough to know what was in them.
HEARD = 10
# A line that stands out neither twice nor half as much as before (natural logarithm of the amplitude).
AS_BEFORE = 0.7
# Frames that are fainter by so much (logarithm of the power, 25 dB) are silence.
SILENCE = 5.8

# Indices into what is told of a line, in the order of `tracking.spectrum.Line`: the bin that it is at, interpolated;
# share of the power; how far it stands out; coefficient of variation of its modulus over half of the ring; growth of
# its logarithm in a hop; rise within the time of the ring, and within that of the reliefs, and the latter whatever the
# surroundings did; largest correlation `LAG` to `LONGEST_LAG` hops apart; how much more it stands out than in cuts
# before and the air between.
BIN, SHARE, PROMINENCE, VARIATION, GROWTH, RISE, LONG_RISE, ABSOLUTE_RISE, COHERENCE, NEWS = range(10)
MEASURES = 10

# Indices of `LineState.counts`: hops taken, frames looked at, those of them that the signal has been alike for, and
# those since the whole fell, as long as it has not come back.
TAKEN, FRAMES, ALIKE, FALLEN = range(4)


class LineState(NamedTuple):
    """Rings of transforms and of what stood out.

    Attributes
    ----------
    spectra : ndarray of complex128, shape (bins, hops)
        Phases referred to a common time.
    valid : ndarray of bool, shape (hops,)
        Which of them hold samples.
    turns : ndarray of complex128, shape (points,)
        Powers of the root of unity.
    power : ndarray of float64, shape (bins,)
        Recent power of each bin (`recent_power`).
    reliefs, powers : ndarray of float64, shape (bins, frames)
        Rings of prominences (`stand_out`) and of logarithms of the power, a column for each frame.
    relief : ndarray of float64, shape (bins,)
        The newest prominences.
    levels, totals, crests : ndarray of float64, shape (frames,)
        Mean over the bins of the logarithm of the power in each frame, logarithm of the whole power, and prominence of
        the most prominent line, infinite where something turned.
    cutting : ndarray of bool, shape (frames,)
        Whether the tool was in the cut in each frame.
    air : ndarray of float64, shape (7,)
        What is known of the air (`kernels.engagement`).
    counts : ndarray of int64, shape (4,)
    sums : ndarray of float64, shape (bins + 1,)
    scratch : ndarray of float64, shape (max(hops, frames),)
        Work space like the one before.
    """

    spectra: np.ndarray
    valid: np.ndarray
    turns: np.ndarray
    power: np.ndarray
    reliefs: np.ndarray
    powers: np.ndarray
    relief: np.ndarray
    levels: np.ndarray
    totals: np.ndarray
    crests: np.ndarray
    cutting: np.ndarray
    air: np.ndarray
    counts: np.ndarray
    sums: np.ndarray
    scratch: np.ndarray


def new_state(points: int, hops: int, frames: int) -> LineState:
    """State without samples, for transforms of so many points, and rings of so many hops and frames."""
    bins = points // 2 + 1
    return LineState(
        spectra=np.zeros((bins, hops), np.complex128),
        valid=np.zeros(hops, np.bool_),
        turns=np.exp(-2j * np.pi * np.arange(points) / points),
        power=np.zeros(bins),
        reliefs=np.zeros((bins, frames)),
        powers=np.zeros((bins, frames)),
        relief=np.zeros(bins),
        levels=np.zeros(frames),
        totals=np.zeros(frames),
        crests=np.zeros(frames),
        cutting=np.zeros(frames, np.bool_),
        air=new_air(),
        counts=np.zeros(4, np.int64),
        sums=np.zeros(bins + 1),
        scratch=np.zeros(max(hops, frames)),
    )


@njit(**OPTIONS)
def cut_out(samples, window, first, hop, largest, pieces, valid):
    """Windowed stretches of samples, each a row of ``pieces[:, points]``, ``hop`` samples apart.

    A stretch with samples that are missing or beyond ``largest`` is not valid; it is left as zeros. Returns whether
    there is anything but zeros.
    """
    heard = False
    for i in range(pieces.shape[0]):
        begin = first + i * hop
        whole = True
        for t in range(window.shape[0]):
            whole &= abs(samples[begin + t]) < largest
            heard |= samples[begin + t] != 0.0
            pieces[i, t] = samples[begin + t] * window[t]
        valid[i] = whole
        if not whole:
            pieces[i, :] = 0.0
    return heard


@njit(**OPTIONS)
def follow(transforms, valid, start, hop, lowest, turns, fainter, state, peaks, measures):
    """Take in the transforms of a frame, find its most prominent lines and describe each.

    Parameters
    ----------
    transforms : ndarray of complex128, shape (n, bins)
        Oldest first; those of a shorter frame are fewer than of others.
    valid : ndarray of bool, shape (n,)
        Which of them hold samples.
    start, hop : int
        Index of the first one's first sample, and samples from one to the next.
    lowest : int
        First bin that counts as vibration.
    turns : bool
        Whether something that turns has been taken out.
    fainter : bool
        Whether most of what is heard goes on, fainter.
    state : LineState
        Changed in place.
    peaks : ndarray of int64, shape (lines,)
        Work space, one for each line at most.
    measures : ndarray of float64, shape (lines, MEASURES)
        The result, a row for each line.

    Returns
    -------
    int
        How many lines there are.
    """
    spectra, power, reliefs, relief, counts = state.spectra, state.power, state.reliefs, state.relief, state.counts
    _take(transforms, valid, start, hop, state)
    if recent_power(spectra, state.valid, counts[TAKEN], FRAME_HOPS, power) == 0:
        return 0
    frames = reliefs.shape[1]
    column = counts[FRAMES] % frames
    counts[FRAMES] += 1
    counts[ALIKE] += 1
    stand_out(power, lowest, state.sums, relief)
    bins = power.shape[0]
    state.levels[column] = (state.sums[bins] - state.sums[lowest]) / (bins - lowest)
    total = 0.0
    for b in range(lowest, bins):
        total += power[b]
    state.totals[column] = math.log(total + TINY)
    count = most_prominent(relief, lowest, peaks)
    state.crests[column] = math.inf if turns or count == 0 else relief[peaks[0]]
    state.cutting[column] = engaged(
        state.levels, state.totals, state.crests, fainter, counts[FRAMES], state.air, state.scratch
    )
    for b in range(relief.shape[0]):
        reliefs[b, column] = relief[b]
        state.powers[b, column] = state.sums[b + 1] - state.sums[b]
    counts[FALLEN] = counts[FALLEN] + 1 if fell(state.totals, counts[FRAMES], state.air, state.scratch) else 0
    known = min(frames, counts[ALIKE])
    recent = min(state.valid.shape[0] // FRAME_HOPS, known)
    since = state.air[SINCE]
    for i in range(count):
        b, out = peaks[i], measures[i]
        describe(spectra, state.valid, counts[TAKEN], power, total, b, state.scratch, out)
        out[BIN] = b + beat(spectra[b], state.valid, counts[TAKEN], state.turns.shape[0] / hop, crest(power, b))
        out[PROMINENCE] = relief[b]
        out[RISE] = rise(reliefs, state.levels, state.cutting, since, counts[FRAMES], recent, b, state.scratch)
        out[LONG_RISE] = rise(reliefs, state.levels, state.cutting, since, counts[FRAMES], known, b, state.scratch)
        out[ABSOLUTE_RISE] = rise(
            state.powers, state.levels, state.cutting, since, counts[FRAMES], known, b, state.scratch
        )
        if 0 < counts[FALLEN] < known:  # nothing has risen out of what was louder
            fallen = counts[FALLEN]
            above = rise(reliefs, state.levels, state.cutting, since, counts[FRAMES], fallen, b, state.scratch)
            out[RISE], out[LONG_RISE] = min(out[RISE], above), min(out[LONG_RISE], above)
            above = rise(state.powers, state.levels, state.cutting, since, counts[FRAMES], fallen, b, state.scratch)
            out[ABSOLUTE_RISE] = min(out[ABSOLUTE_RISE], above)
        if abs(out[LONG_RISE]) < AS_BEFORE:  # it may go with the rest
            beside = variation_beside(
                spectra[b], state.valid, counts[TAKEN], state.levels, counts[FRAMES], state.scratch
            )
            out[VARIATION] = min(out[VARIATION], beside)
        out[NEWS] = news(reliefs, state.cutting, since, counts[FRAMES], known, b, state.scratch)
    return count


@njit(**OPTIONS)
def _take(transforms, valid, start, hop, state):
    """Put transforms into the ring, their phases referred to a common time."""
    spectra, turns, counts = state.spectra, state.turns, state.counts
    points = turns.shape[0]
    for i in range(transforms.shape[0]):
        column = counts[TAKEN] % state.valid.shape[0]
        step = (start + i * hop) % points
        turn = 0
        for b in range(transforms.shape[1]):
            spectra[b, column] = transforms[i, b] * turns[turn]
            turn += step
            turn -= points if turn >= points else 0
        state.valid[column] = valid[i]
        counts[TAKEN] += 1


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
def line_power(power, b):
    """Power within the lobe around a bin."""
    total = 0.0
    for i in range(max(0, b - LOBE), min(power.shape[0], b + LOBE + 1)):
        total += power[i]
    return total


@njit(**OPTIONS)
def crest(power, b):
    """How far the crest of the parabola through the logarithms of a maximum and its neighbours is from it, in bins."""
    before, here, after = math.log(power[b - 1] + TINY), math.log(power[b] + TINY), math.log(power[b + 1] + TINY)
    bend = before - 2.0 * here + after
    return min(max(0.5 * (before - after) / bend, -0.5), 0.5) if bend < 0.0 else 0.0


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
        now = _before(now, size)
        then = _before(now, size)
        if valid[now] and valid[then]:
            product += amplitudes[now] * np.conj(amplitudes[then])
            norm += _modulus(amplitudes[now]) * _modulus(amplitudes[then])
    if not abs(product) > TELLING * norm:
        return otherwise
    return math.atan2(product.imag, product.real) * turn / (2.0 * math.pi)


@njit(**OPTIONS)
def describe(spectra, valid, head, power, total, b, scratch, out):
    """Share, variation, growth and coherence of the line at bin ``b``: ``out`` at these indices.

    Parameters
    ----------
    spectra : ndarray of complex128, shape (bins, hops)
        Ring of transforms, phases referred to a common time.
    valid : ndarray of bool, shape (hops,)
        Which of them hold samples.
    head : int
        Column after the newest, with or without wrapping.
    power : ndarray, shape (bins,)
        Recent power of each bin (`recent_power`).
    total : float
        Power of all bins that count as vibration.
    b : int
        The line.
    scratch : ndarray, shape (>= hops,)
        Work space.
    out : ndarray, shape (MEASURES,)
        The result; zeros where nothing can be said.
    """
    size = valid.shape[0]
    out[SHARE : COHERENCE + 1] = 0.0
    if not total > 0.0:
        return
    out[SHARE] = min(line_power(power, b) / total, 1.0)

    amplitudes = spectra[b]
    modulus = scratch  # oldest first
    count = 0
    now = head % size
    for _ in range(size):
        if valid[now]:
            modulus[count] = _modulus(amplitudes[now])
            count += 1
        now = _after(now, size)
    if count < GROWTH_HOPS:
        return
    mean, spread = _moments(modulus[max(0, count - size // 2) : count])
    if mean > 0.0:
        out[VARIATION] = spread / mean
    out[GROWTH] = _growth(modulus[count - GROWTH_HOPS : count])
    out[COHERENCE] = _coherence(amplitudes, valid, head)


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
        now = _before(now, size)
        if back % FRAME_HOPS == 0:
            column = _before(column, columns)
            gain = math.exp(-0.5 * levels[column])
        if valid[now]:
            scratch[count] = gain * _modulus(amplitudes[now])
            count += 1
    mean, spread = _moments(scratch[:count])
    return spread / mean if mean > 0.0 else 0.0


@njit(**OPTIONS)
def rise(heights, levels, cutting, since, head, frames, b, scratch):
    """Half the height of a bin, less its median over the last frames: growth, of prominences that which is not shared.

    Frames in which nothing was cut, or in which there was next to silence, do not count: what begins has not risen from
    them. What has grown has risen above what it was since the tool entered, and above what it was in the cuts before.

    Parameters
    ----------
    heights : ndarray, shape (bins, columns)
        Ring of prominences (`stand_out`) or of logarithms of the power, a column for each frame.
    levels : ndarray, shape (columns,)
        Mean logarithm of the power in each of these frames.
    cutting : ndarray of bool, shape (columns,)
        Whether the tool was in the cut.
    since : float
        Frames since nothing was cut.
    head : int
        Column after the newest, counted from the start without wrapping.
    frames : int
        How far to look back.
    b : int
        The bin; what stands out one bin aside is the same line.
    scratch : ndarray, shape (>= columns,)
        Work space.
    """
    columns = heights.shape[1]
    column = head % columns
    newest = _before(column, columns)
    if not cutting[newest]:
        return 0.0
    silence = levels[newest] - SILENCE
    count = here = 0
    for back in range(min(frames, head, columns)):
        column = _before(column, columns)
        if cutting[column] and levels[column] > silence:
            scratch[count] = max(heights[b - 1, column], heights[b, column], heights[b + 1, column])
            count += 1
            here += back < since
    height = scratch[0]
    usual = median(scratch[:here])
    if here < count:
        usual = max(usual, median(scratch[:count]))
    return 0.5 * (height - usual)


@njit(**OPTIONS)
def news(heights, cutting, since, head, frames, b, scratch):
    """Half the prominence of a bin less what it was before this cut: its median in cuts before, and in the last air.

    Zero while the tool is not in the cut, and where not enough of both has been heard. Parameters as of `rise`.
    """
    columns = heights.shape[1]
    newest = _before(head % columns, columns)
    known = min(frames, head, columns)
    if not cutting[newest] or since >= known:
        return 0.0
    usual = -math.inf
    for cut in (False, True):
        count = 0
        column = (head - int(since)) % columns
        for _ in range(int(since), known):
            column = _before(column, columns)
            if cutting[column] == cut and (cut or count < HEARD):
                scratch[count] = max(heights[b - 1, column], heights[b, column], heights[b + 1, column])
                count += 1
        if count < HEARD:
            return 0.0
        usual = max(usual, median(scratch[:count]))
    height = max(heights[b - 1, newest], heights[b, newest], heights[b + 1, newest])
    return 0.5 * (height - usual)


@njit(**OPTIONS)
def _modulus(amplitude):
    """Modulus of a number whose square is one, too: `abs` is on its guard against those whose square is none."""
    return math.sqrt(amplitude.real * amplitude.real + amplitude.imag * amplitude.imag)


@njit(**OPTIONS)
def _before(column, columns):
    """Column of a ring before another; a division for each would take longer than all that is done with it."""
    return column - 1 if column > 0 else columns - 1


@njit(**OPTIONS)
def _after(column, columns):
    """Column of a ring after another."""
    return column + 1 if column + 1 < columns else 0


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
        now, then = _before(now, size), _before(then, size)
        if valid[now] and valid[then]:
            product += amplitudes[now] * np.conj(amplitudes[then])
            late += amplitudes[now].real ** 2 + amplitudes[now].imag ** 2
            early += amplitudes[then].real ** 2 + amplitudes[then].imag ** 2
    norm = math.sqrt(early * late)
    return abs(product) / norm if norm > 0.0 else 0.0
