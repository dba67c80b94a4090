"""Lines of a short-time spectrum: where they are, how they stand out, how they behave, what they were before.

The ring ``spectra[bins, hops]`` holds the latest transforms, column ``head - 1`` the newest, and ``valid[hops]``
whether a transform saw samples at all. The amplitudes of a line lie side by side, because that is how they are read.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.binding import bound
from chatter_monitor.kernels.engagement import (
    SINCE,
    Rings,
    Signs,
    are_several,
    engaged,
    fell,
    has_leapt,
    is_pump,
    louder_beside_pump,
    new_air,
)
from chatter_monitor.kernels.hump import what_sounded
from chatter_monitor.kernels.lanes import as_lanes
from chatter_monitor.kernels.limit_cycle import BAND, TOLD, hear_band
from chatter_monitor.kernels.narrowband import FRAME_HOPS, PARTS, beat, behaviour, put_in_order, variation_beside
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.prominence import TINY, crest, most_prominent, recent_power, share, stand_out
from chatter_monitor.kernels.rarma import LARGEST_SAMPLE
from chatter_monitor.kernels.rise import arrival, compared, line_rise, news, power_rise
from chatter_monitor.kernels.transform import new_turns, real_transform

# A line that stands out neither twice nor half as much as before (natural logarithm of the amplitude).
AS_BEFORE = 0.7
# Indices into what is told of a line, in the order of `tracking.spectrum.Line`: the bin that it is at, interpolated;
# share of the power; how far it stands out; coefficient of variation of its modulus over half of the ring; growth of
# its logarithm in a hop; rise within the time of the ring, and within that of the reliefs, and the latter whatever the
# surroundings did; coherence; how much more it stands out than in cuts before and the air between, and than in all
# that was heard before the tool entered.
BIN, SHARE, PROMINENCE, VARIATION, GROWTH, RISE, LONG_RISE, ABSOLUTE_RISE, COHERENCE, NEWS, ARRIVAL = range(11)
MEASURES = 11

# Indices of `LineState.counts`: samples and hops taken, frames looked at, those of them that the signal has been alike
# for, and those since the whole fell, as long as it has not come back; whether what stands out most in the newest has
# grown out of a mode.
SAMPLES, TAKEN, FRAMES, ALIKE, FALLEN, GROWN = range(6)


class LineState(NamedTuple):
    """Rings of transforms and of what stood out.

    Attributes
    ----------
    samples : ndarray of float64, shape (window + interval,)
        The newest, in the order of time; NaN where they are missing.
    window : ndarray of float64, shape (window,)
        By which each stretch is multiplied before it is transformed.
    stretches : ndarray of float64, shape (4, points / 2 + 1, FRAME_HOPS)
        Work space for the stretches of a frame and their transforms, a lane each (`kernels.transform`).
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
    levels, totals, wholes, crests, repeating : ndarray of float64, shape (frames,)
        Mean over the bins of the logarithm of the power in each frame, logarithm of the whole power, and of that with
        what turns, prominence of the most prominent line, infinite where something turned, and share of the power
        that repeats.
    cutting : ndarray of bool, shape (frames,)
        Whether the tool was in the cut in each frame.
    air : ndarray of float64, shape (14,)
        What is known of the air (`kernels.engagement`).
    counts : ndarray of int64, shape (6,)
    sums : ndarray of float64, shape (bins + 1,)
    line : ndarray of float64, shape (PARTS, hops)
        A line by itself (`kernels.narrowband`).
    columns : ndarray of int64, shape (frames,)
        Frames that it is compared with (`kernels.rise`).
    cycle : ndarray of float64, shape (TOLD,)
        Whether a vibration keeps its amplitude and not its phase (`kernels.limit_cycle`).
    band : ndarray of float64, shape (2 BAND + 2, max(hops, bins))
    scratch : ndarray of float64, shape (max(hops, frames),)
        Work space, as the ones before.
    """

    samples: np.ndarray
    window: np.ndarray
    stretches: np.ndarray
    spectra: np.ndarray
    valid: np.ndarray
    turns: np.ndarray
    power: np.ndarray
    reliefs: np.ndarray
    powers: np.ndarray
    relief: np.ndarray
    levels: np.ndarray
    totals: np.ndarray
    wholes: np.ndarray
    crests: np.ndarray
    repeating: np.ndarray
    cutting: np.ndarray
    air: np.ndarray
    counts: np.ndarray
    sums: np.ndarray
    line: np.ndarray
    columns: np.ndarray
    cycle: np.ndarray
    band: np.ndarray
    scratch: np.ndarray


def new_state(window: np.ndarray, interval: int, hops: int, frames: int) -> LineState:
    """State without samples, for stretches under this window, whole frames of so many samples, and rings so long."""
    points = 1 << math.ceil(math.log2(1.5 * len(window)))
    bins = points // 2 + 1
    return LineState(
        samples=np.full(len(window) + interval, np.nan),
        window=window,
        stretches=np.zeros((4, bins, FRAME_HOPS)),
        spectra=np.zeros((bins, hops), np.complex128),
        valid=np.zeros(hops, np.bool_),
        turns=new_turns(points),
        power=np.zeros(bins),
        reliefs=np.zeros((bins, frames)),
        powers=np.zeros((bins, frames)),
        relief=np.zeros(bins),
        levels=np.zeros(frames),
        totals=np.zeros(frames),
        wholes=np.zeros(frames),
        crests=np.zeros(frames),
        repeating=np.zeros(frames),
        cutting=np.zeros(frames, np.bool_),
        air=new_air(),
        counts=np.zeros(6, np.int64),
        sums=np.zeros(bins + 1),
        line=np.zeros((PARTS, hops)),
        columns=np.zeros(frames, np.int64),
        cycle=np.full(TOLD, np.nan),
        band=np.zeros((2 * BAND + 2, max(hops, bins))),
        scratch=np.zeros(max(hops, frames)),
    )


def finding(
    hop: int, lowest: int, state: LineState, peaks: np.ndarray, measures: np.ndarray
) -> Callable[[np.ndarray, bool, bool, float, float, bool], int]:
    """How the lines of a frame are found.

    Parameters
    ----------
    hop : int
        Samples from one stretch that is transformed to the next.
    lowest : int
        First bin that counts as vibration.
    state : LineState
        To be changed in place.
    peaks : ndarray of int64, shape (lines,)
        Work space, one for each line at most.
    measures : ndarray of float64, shape (lines, MEASURES)
        To be left with the result, a row for each line.

    Returns
    -------
    callable
        Of the frame's samples, contiguous float64, shape (n,), NaN where they are missing; of whether the signal is
        alike to what it was, whether something that turns has been taken out of it, the power with that, which share
        of this repeats, and whether it has got fainter though the tool has not left. Returns how many lines there are.
    """
    machine_code = bound(_find, state.window, False, False, 0.0, 0.0, False, hop, lowest, state, peaks, measures)
    return lambda signal, alike, turns, whole, repeating, fainter: machine_code(
        signal, alike, turns, whole, repeating, fainter, hop, lowest, state, peaks, measures
    )


@njit(**OPTIONS)
def _find(signal, alike, turns, whole, repeating, fainter, hop, lowest, state, peaks, measures):
    if not alike:
        state.counts[ALIKE] = 0
    _take(signal, hop, state)
    return _follow(hop, lowest, turns, whole, repeating, fainter, state, peaks, measures)


@njit(**OPTIONS)
def _take(signal, hop, state):
    """Transform the stretches that end in a frame, and put them into the ring, their phases referred to a common time.

    A stretch with samples that are missing or beyond `LARGEST_SAMPLE` is not valid; it is left as zeros.
    """
    samples, window, spectra, turns, counts = state.samples, state.window, state.spectra, state.turns, state.counts
    n = signal.shape[0]
    kept = samples.shape[0] - n
    for t in range(kept):
        samples[t] = samples[t + n]
    for t in range(n):
        samples[kept + t] = signal[t]
    counts[SAMPLES] += n
    state.stretches[:2] = 0.0
    hops = n // hop
    heard = False
    for i in range(hops):  # the last one ends with the frame
        stretch = samples[samples.shape[0] - (hops - 1 - i) * hop - window.shape[0] :]
        whole = True
        for t in range(window.shape[0]):
            whole &= abs(stretch[t]) < LARGEST_SAMPLE
            heard |= stretch[t] != 0.0
        for t in range(window.shape[0] if whole else 0):
            state.stretches[t % 2, t // 2, i] = stretch[t] * window[t]
        state.valid[(counts[TAKEN] + i) % state.valid.shape[0]] = whole
    re, im = as_lanes(state.stretches[0], FRAME_HOPS), as_lanes(state.stretches[1], FRAME_HOPS)
    if heard:
        work_re, work_im = as_lanes(state.stretches[2], FRAME_HOPS), as_lanes(state.stretches[3], FRAME_HOPS)
        real_transform(re, im, work_re, work_im, turns)
    for i in range(hops):
        column = counts[TAKEN] % state.valid.shape[0]
        counts[TAKEN] += 1
        ends = counts[SAMPLES] - (hops - 1 - i) * hop
        for b in range(spectra.shape[0]):
            transform = complex(state.stretches[0, b, i], state.stretches[1, b, i])
            spectra[b, column] = transform * turns[b * ends % turns.shape[0]]


@njit(**OPTIONS)
def _follow(hop, lowest, turns, whole, repeating, fainter, state, peaks, measures):
    """Find the most prominent lines of the newest transforms and describe each."""
    spectra, power, reliefs, relief, counts = state.spectra, state.power, state.reliefs, state.relief, state.counts
    counts[GROWN] = False
    state.cycle[:] = math.nan
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
    state.wholes[column] = math.log(whole + TINY)
    state.repeating[column] = repeating
    state.crests[column] = math.inf if turns or count == 0 else relief[peaks[0]]
    leapt = has_leapt(spectra, state.valid, counts[TAKEN], FRAME_HOPS, lowest, state.totals, counts[FRAMES])
    for b in range(relief.shape[0]):
        reliefs[b, column] = relief[b]
        state.powers[b, column] = state.sums[b + 1] - state.sums[b]
    beside = louder_beside_pump(reliefs, state.powers, state.levels, lowest, counts[FRAMES])
    rings = Rings(state.levels, state.totals, state.wholes, state.crests, state.repeating)
    familiar, mode, quiet = what_sounded(reliefs, state.powers, state.totals, lowest, counts[FRAMES], state.sums)
    counts[GROWN] = mode
    several = are_several(relief, power, total, peaks[:count])
    pump = is_pump(reliefs, state.powers, state.crests, lowest, counts[FRAMES])
    largest = share(power, total, peaks[0]) if count > 0 else 0.0
    signs = Signs(fainter, pump, leapt, beside, familiar, several, quiet, largest)
    state.cutting[column] = engaged(rings, signs, counts[FRAMES], state.air, state.scratch)
    clock = counts[TAKEN], counts[FRAMES], counts[SAMPLES], hop
    ring = spectra, state.valid, state.powers, state.totals
    hear_band(*ring, lowest, repeating, clock, state.turns, state.band, state.cycle)
    low = fell(state.totals, state.wholes, counts[FRAMES], state.air, state.scratch)
    counts[FALLEN] = counts[FALLEN] + 1 if low else 0
    known = min(frames, counts[ALIKE])
    since = state.air[SINCE]
    # how many frames a line is compared with: of all that is known, of this cut, of a second, of those since it fell
    columns, cut = state.columns, (state.levels, state.cutting, state.crests, counts[FRAMES])
    here = compared(*cut, int(min(known, since)), columns)
    recent = compared(*cut, min(state.valid.shape[0] // FRAME_HOPS, known), columns)
    fallen = compared(*cut, min(counts[FALLEN], known), columns)
    long = compared(*cut, known, columns)
    for i in range(count):
        b, out, line, scratch = peaks[i], measures[i], state.line, state.scratch
        put_in_order(spectra[b], state.valid, counts[TAKEN], line)
        out[SHARE] = share(power, total, b)
        out[VARIATION], out[GROWTH], out[COHERENCE] = behaviour(line, scratch)
        out[BIN] = b + beat(line, state.turns.shape[0] / hop, crest(power, b))
        out[PROMINENCE] = relief[b]
        out[RISE] = line_rise(reliefs, state.powers, columns[:recent], min(here, recent), b, scratch)
        out[LONG_RISE] = line_rise(reliefs, state.powers, columns[:long], here, b, scratch)
        out[ABSOLUTE_RISE] = power_rise(state.powers, columns[:long], here, b, scratch)
        if 0 < counts[FALLEN] < known:  # nothing has risen out of what was louder
            above = line_rise(reliefs, state.powers, columns[:fallen], min(here, fallen), b, scratch)
            out[RISE], out[LONG_RISE] = min(out[RISE], above), min(out[LONG_RISE], above)
            above = power_rise(state.powers, columns[:fallen], min(here, fallen), b, scratch)
            out[ABSOLUTE_RISE] = min(out[ABSOLUTE_RISE], above)
        if abs(out[LONG_RISE]) < AS_BEFORE:  # it may go with the rest
            out[VARIATION] = min(out[VARIATION], variation_beside(line, state.levels, counts[FRAMES], scratch))
        out[ARRIVAL] = arrival(reliefs, state.cutting, since, counts[FRAMES], known, b, scratch)
        out[NEWS] = news(reliefs, state.cutting, since, counts[FRAMES], known, b, scratch)
    return count
