"""Lines of a short-time spectrum: where they are, how they stand out, how they behave, what they were before.

The ring ``spectra[bins, hops]`` holds the latest transforms, column ``head - 1`` the newest, and ``valid[hops]``
whether a transform saw samples at all. The amplitudes of a line lie side by side, because that is how they are read.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.engagement import SINCE, engaged, fell, new_air
from chatter_monitor.kernels.narrowband import FRAME_HOPS, beat, behaviour, variation_beside
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.prominence import TINY, crest, most_prominent, recent_power, share, stand_out
from chatter_monitor.kernels.rise import news, rise

# A line that stands out neither twice nor half as much as before (natural logarithm of the amplitude).
AS_BEFORE = 0.7
# Indices into what is told of a line, in the order of `tracking.spectrum.Line`: the bin that it is at, interpolated;
# share of the power; how far it stands out; coefficient of variation of its modulus over half of the ring; growth of
# its logarithm in a hop; rise within the time of the ring, and within that of the reliefs, and the latter whatever the
# surroundings did; coherence; how much more it stands out than in cuts before and the air between.
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
        out[SHARE] = share(power, total, b)
        out[VARIATION], out[GROWTH], out[COHERENCE] = behaviour(spectra[b], state.valid, counts[TAKEN], state.scratch)
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
