"""Recursions side by side: RARMA step and poles sample by sample, their meaning tile by tile.

Each recursion, of one octave of one channel, has a row of numbers, its state. Some of them go through their samples in
step, each in a lane of the processor's vectors (docs/decisions/0037-lanes.md). Which ones is no matter to any of them.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels import odp, poles, rarma, udu
from chatter_monitor.kernels.lanes import as_lanes, floor, part, select, spread
from chatter_monitor.kernels.odp import TILE
from chatter_monitor.kernels.options import EXACT

# What a mode's values stand for; the same numbers as `chatter_monitor.records.ModeStatus`.
OSCILLATORY = 0
REAL_PAIR = 1
HELD = 2
STARTING = 3

LANES = 2  # of four octaves, the first has more samples than the others together


class Recursions(NamedTuple):
    """Recursions that may go side by side.

    Attributes
    ----------
    memory : ndarray of float64, shape (recursions, rows)
        State of each: `rarma.parts`, then `poles.parts`, then lambda = 1 - 1 / (memory in samples).
    rate : ndarray of float64, shape (recursions,)
        Sample rates in Hz.
    side : ndarray of float64, shape (more rows, lanes)
        Work space: the states side by side, and what belongs to one step only.
    signals : ndarray of float64, shape (recursions, samples)
        Samples to come; those that are not finite count as missing.
    left, taken, filled : ndarray of int64, shape (recursions,)
        How many of them are left, and begun after how many; where the next result goes.
    together : ndarray of int64, shape (lanes,)
        Work space: who goes side by side.
    samples, meaning, shown : ndarray of float64, shape (TILE,), (TILE,), (modes TILE,)
        Work space: a tile of samples, of what their values stand for, and of what those of each mode do.
    tile : ndarray of float64
        Work space (`odp`).
    stretch : Stretch
        Work space.
    c, zeros, search : ndarray, ndarray, Search
        Work space of single lanes (`rarma.Work`, `poles.Search`).
    """

    memory: np.ndarray
    rate: np.ndarray
    signals: np.ndarray
    left: np.ndarray
    taken: np.ndarray
    filled: np.ndarray
    together: np.ndarray
    side: np.ndarray
    samples: np.ndarray
    meaning: np.ndarray
    shown: np.ndarray
    tile: np.ndarray
    stretch: poles.Stretch
    c: np.ndarray
    zeros: np.ndarray
    search: poles.Search


def new_state(p: int, q: int, forgetting: np.ndarray, rate: np.ndarray, longest: int) -> Recursions:
    """Fresh state of recursions of RARMA(p, q), for at most so many samples of each at a time."""
    learned = rarma.rows(p, q)
    rows = learned + poles.rows(p) + 1
    memory = np.zeros((len(rate), rows))
    for state, factor in zip(memory, forgetting, strict=True):
        rarma.begin(p, q, state)
        poles.begin(p, state[learned:-1])
        state[-1] = factor
    return Recursions(
        memory=memory,
        rate=rate,
        signals=np.zeros((len(rate), longest)),
        left=np.zeros(len(rate), np.int64),
        taken=np.zeros(len(rate), np.int64),
        filled=np.zeros(len(rate), np.int64),
        together=np.zeros(LANES, np.int64),
        side=np.zeros((rows + _work_rows(p, q), LANES)),
        samples=np.zeros(TILE),
        meaning=np.zeros(TILE),
        shown=np.zeros(p // 2 * TILE),
        tile=odp.new_tile(p),
        stretch=poles.new_stretch(p),
        c=np.zeros(q),
        zeros=np.zeros((2, q), dtype=np.complex128),
        search=poles.new_search(p),
    )


def _work_rows(p: int, q: int) -> int:
    return p + q + q + 1 + int(rarma.learned_rows(p, q))


@njit(**EXACT)
def _choose(state):
    """Choose those with most samples left, the first again in lanes to spare; the result is for how many samples."""
    count = 0
    for lane in range(state.together.shape[0]):
        best = state.together[0] if lane else 0
        most = 0
        for k in range(state.left.shape[0]):
            free = True
            for other in range(lane):
                free = free and state.together[other] != k
            if free and state.left[k] > most:
                best, most = k, state.left[k]
        state.together[lane] = best
        count = min(count, most) if lane and most else max(count, most)
    return count


@njit(forceinline=True, **EXACT)
def _interpret(p, meaning, factors, shown):
    """Fill in what the values of each mode stand for; there are none while the model starts. Rows of a tile."""
    meaning, factors, shown = as_lanes(meaning, TILE), as_lanes(factors, TILE), as_lanes(shown, TILE)
    starting = meaning[0] == STARTING
    for m in range(p // 2):
        b, c = factors[2 * m], factors[2 * m + 1]
        shown[m] = select(starting | (b * b < 4.0 * c), meaning[0], REAL_PAIR)
        factors[2 * m] = select(starting, math.nan, b)


@njit(inline="always", **EXACT)
def recurse(p, q, lanes, state, out):
    """Run recursions through the samples that are left to them and fill in the ODPs of every one.

    Parameters
    ----------
    p, q : int
        Orders of A (even) and C.
    lanes : int
        How many go side by side: a constant.
    state : Recursions
        Changed in place.
    out : tuple of ndarray, shape (recursions, p / 2, samples) each
        frequency (Hz), damping ratio, their standard deviations (float32), status (uint8).
    """
    frequency, damping, frequency_sd, damping_sd, status = out
    together, taken, filled = state.together, state.taken, state.filled
    modes, n = p // 2, p + q
    rows = rarma.rows(p, q)
    end = rows + poles.rows(p)
    gain = end + 1
    scratch = gain + n
    learned = scratch + q + 1
    numbers = state.side[:gain]
    memory = as_lanes(state.side, lanes)
    model, followed = rarma.parts(p, q, memory), poles.parts(p, part(memory, rows, end))
    work = rarma.Work(
        gain=part(memory, gain, scratch),
        scratch=part(memory, scratch, learned),
        learned=part(memory, learned, memory.shape[0]),
        c=state.c,
        zeros=state.zeros,
    )
    samples, meaning, tile = as_lanes(state.samples, lanes), as_lanes(state.meaning, lanes), as_lanes(state.tile, lanes)
    coefficients, asked = as_lanes(state.stretch.coefficients, lanes), as_lanes(state.stretch.asked, lanes)
    factors = part(state.tile, odp.factor_row(0), odp.factor_row(modes))
    tall = TILE // lanes
    count = _choose(state)
    while count > 0:
        for row in range(gain):
            for lane in range(lanes):
                numbers[row, lane] = state.memory[together[lane], row]
        forgetting = memory[end]
        full = floor(1.0 / (1.0 - forgetting))
        begin = 0
        while begin < count:
            size = count - begin
            for lane in range(lanes):
                size = min(size, tall - int(numbers[end - 1, lane]))  # to the end of a stretch
            for lane in range(lanes):
                k = together[lane]
                for t in range(size):
                    state.samples[t * lanes + lane] = state.signals[k, taken[k] + begin + t]
            for t in range(size):
                adapted = rarma.step(p, q, samples[t], model, memory, work, numbers, forgetting)
                adaptations = model.level[rarma.ADAPTED]
                starting = adaptations < rarma.SAMPLES_PER_COEFFICIENT * n
                near = select(adaptations == full, poles.AFRESH, spread(poles.NEAR, forgetting))
                asked[t] = select(adapted & ~starting, near, poles.NOTHING)
                meaning[t] = select(starting, STARTING, select(adapted, OSCILLATORY, spread(HELD, forgetting)))
                for i in range(p):
                    coefficients[i * tall + t] = model.theta[q + i]
                scale = model.level[rarma.SCATTER] * model.level[rarma.WINDOW_SQUARED] / model.level[rarma.WINDOW]
                for j in range(p):
                    place = odp.covariance_row(p, j) // lanes + t
                    for i in range(j):
                        tile[place + i * tall] = model.u[udu.column(q + j) + q + i]
                    tile[place + j * tall] = scale * model.d[q + j]
            for t in range(size, tall):
                asked[t] = spread(poles.NOTHING, forgetting)
            poles.follow(p, lanes, size, followed, numbers[rows:end], state.stretch, factors, state.search)
            _interpret(p, state.meaning, factors, state.shown)
            for m in range(modes):
                odp.evaluate(p, m, state.tile)
                for lane in range(lanes):
                    k = together[lane]
                    hertz = state.rate[k] / (2.0 * math.pi)
                    row = filled[k] + begin
                    for t in range(size):
                        i = t * lanes + lane
                        frequency[k, m, row + t] = state.tile[odp.OMEGA + i] * hertz
                        damping[k, m, row + t] = state.tile[odp.DAMPING + i]
                        frequency_sd[k, m, row + t] = state.tile[odp.OMEGA_SD + i] * hertz
                        damping_sd[k, m, row + t] = state.tile[odp.DAMPING_SD + i]
                        status[k, m, row + t] = int(state.shown[m * TILE + i])
            begin += size
        for lane in range(lanes):
            k = together[lane]
            if lane == 0 or k != together[0]:
                for row in range(end):
                    state.memory[k, row] = numbers[row, lane]
                state.left[k] -= count
                taken[k] += count
                filled[k] += count
        count = _choose(state)


@njit(**EXACT)
def _track_4_3(state, out):
    """`recurse` with the orders of the paper known to the compiler, which makes it several times faster."""
    recurse(4, 3, LANES, state, out)


@njit(**EXACT)
def _track_any(p, q, state, out):
    """`recurse` for orders that are known at run time only."""
    recurse(p, q, LANES, state, out)


def track(p: int, q: int, signals: np.ndarray, state: Recursions, out: tuple[np.ndarray, ...]) -> None:
    """Run all recursions over a stretch of samples and fill in the ODPs of every one of them.

    Parameters
    ----------
    p, q : int
        Orders of A (even) and C.
    signals : ndarray of float64, shape (recursions, samples)
        A signal for each; non-finite samples count as missing.
    state : Recursions
        Changed in place; carry it over to the next stretch.
    out : tuple of ndarray, shape (recursions, p / 2, samples) each
        frequency (Hz), damping ratio, their standard deviations (float32), status (uint8).
    """
    state = state._replace(signals=signals)
    state.left[:] = signals.shape[1]
    state.taken[:] = 0
    state.filled[:] = 0
    if (p, q) == (4, 3):
        _track_4_3(state, out)
    else:
        _track_any(p, q, state, out)
