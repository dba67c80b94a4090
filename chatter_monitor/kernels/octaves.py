"""All recursions of one channel, an octave each, and the frame that is made of them.

The signal and what remains of it after halving its rate once, twice, three times are tracked by the same model. Each
octave has its results at its own rate; a frame shows some of its modes at every sample of the source. The states of the
octaves are stacked: a kernel that is handed few arrays starts sooner.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels import conditioning, poles, rarma, track
from chatter_monitor.kernels.binding import bound
from chatter_monitor.kernels.median import median_of_many
from chatter_monitor.kernels.options import EXACT, OPTIONS
from chatter_monitor.kernels.share import modal_shares
from chatter_monitor.kernels.slots import Slots, assign
from chatter_monitor.kernels.track import LANES, OSCILLATORY, REAL_PAIR, STARTING, recurse


class Columns(NamedTuple):
    """ODPs, ``shape (..., modes, samples)``: float32, status uint8."""

    frequency: np.ndarray
    damping: np.ndarray
    frequency_sd: np.ndarray
    damping_sd: np.ndarray
    status: np.ndarray


def new_columns(*shape: int) -> Columns:
    """Room for so many ODPs."""
    frequency, damping, frequency_sd, damping_sd = np.empty((4, *shape), np.float32)
    return Columns(frequency, damping, frequency_sd, damping_sd, np.empty(shape, np.uint8))


class Octaves(NamedTuple):
    """State of the octaves ``first``, ``first + 1``...; the first axis of all but the last five counts them.

    Attributes
    ----------
    recursions : Recursions
        ``filled`` are the samples in the columns.
    columns : Columns
        ODPs since the last frame at the octave's rate. Sample 0 is the last one before.
    shares : ndarray of float64, shape (octaves, modes)
        Of each mode in the power of the octave's signal.
    halvers : HalfBandState
        Of every halving, from the first on.
    high_pass : ndarray of float64, shape (2,)
    signal : ndarray of float64, shape (interval,)
        The signal of the frame that comes in, without offset.
    roots, values : ndarray
        Work space: complex128, shape (p,); float32, shape (interval + 2,).
    """

    recursions: track.Recursions
    columns: Columns
    shares: np.ndarray
    halvers: conditioning.HalfBandState
    high_pass: np.ndarray
    signal: np.ndarray
    roots: np.ndarray
    values: np.ndarray


def new_state(p: int, q: int, octaves: range, memory_s: float, rate_hz: float, interval: int) -> Octaves:
    """Fresh state.

    Parameters
    ----------
    p, q : int
        Orders of A and C.
    octaves : range
        How often the rate is halved, for each recursion.
    memory_s : float
        Time constant of the forgetting.
    rate_hz : float
        Of the source.
    interval : int
        Samples of the source in a frame.
    """
    count, modes = len(octaves), p // 2
    rates = rate_hz / 2.0 ** np.array(octaves)
    columns = new_columns(count, modes, 2 + interval // 2 ** octaves[0])
    for column in columns[:4]:
        column[..., 0] = np.nan
    columns.status[..., 0] = STARTING
    recursions = track.new_state(p, q, 1.0 - 1.0 / (memory_s * rates), rates, interval)
    recursions.filled[:] = 1
    return Octaves(
        recursions=recursions,
        columns=columns,
        shares=np.zeros((count, modes)),
        halvers=conditioning.HalfBandState(
            *(np.stack([part] * max(octaves[-1], 1)) for part in conditioning.new_half_band())
        ),
        high_pass=np.zeros(2),
        signal=np.zeros(interval),
        roots=np.zeros(p, np.complex128),
        values=np.zeros(interval + 2, np.float32),
    )


@njit(**OPTIONS)
def _halver(state, k):
    h = state.halvers
    return conditioning.HalfBandState(h.taps[k], h.even[k], h.odd[k], h.position[k])


@njit(**OPTIONS)
def _hand_out(first, samples, filled, corner, state):
    """Give every recursion its samples, at its own rate."""
    n = samples.shape[0]
    signal = state.signal[filled : filled + n]
    conditioning.high_pass(samples, corner, state.high_pass, signal)
    signals, left, taken = state.recursions.signals, state.recursions.left, state.recursions.taken
    for t in range(n):
        signals[0, t] = signal[t]
    for halvings in range(first + left.shape[0]):
        k = max(halvings - first, 0)
        if halvings > 0:
            n = conditioning.halve(signals[max(halvings - first - 1, 0), :n], _halver(state, halvings - 1), signals[k])
        left[k] = n
        taken[k] = 0


@njit(**EXACT)
def _advance_4_3(first, samples, filled, corner, state):
    """Take samples in, with the orders of the paper known to the compiler, which makes it several times faster."""
    _hand_out(first, samples, filled, corner, state)
    recurse(4, 3, LANES, state.recursions, state.columns)


@njit(**EXACT)
def _advance_any(p, q, first, samples, filled, corner, state):
    """Take samples in, with orders that are known at run time only."""
    _hand_out(first, samples, filled, corner, state)
    recurse(p, q, LANES, state.recursions, state.columns)


def advancing(p: int, q: int, first: int, corner: float, state: Octaves) -> Callable[[np.ndarray, int], None]:
    """How samples of a frame are taken in: into every octave.

    Parameters
    ----------
    p, q : int
        Orders of A and C.
    first : int
        Halvings before the first recursion.
    corner : float
        Of the high-pass, in radians per sample.
    state : Octaves
        To be changed in place.

    Returns
    -------
    callable
        Of samples, contiguous float64, shape (n,), those that are not finite missing; and of how many samples of the
        frame have come before: with these there may be at most as many as the state has room for.
    """
    kernel, orders = (_advance_4_3, ()) if (p, q) == (4, 3) else (_advance_any, (p, q))
    machine_code = bound(kernel, *orders, first, state.signal, 0, corner, state)
    return lambda samples, filled: machine_code(*orders, first, samples, filled, corner, state)


@njit(**OPTIONS)
def _complete(p, q, first, begin, state, slots, out):
    survey(p, q, first, begin, state, slots.frequencies, slots.powers)
    assign(slots)
    for slot in range(slots.hold.shape[0]):
        slots.hold[slot] = 1 << (first + max(slots.chosen[slot, 0], 0))
    show(first, begin, slots.chosen, state.columns, state.recursions.filled, out)


def completing(p: int, q: int, first: int, state: Octaves, slots: Slots) -> Callable[[int, Columns], None]:
    """How a frame, which ends with the samples taken last, is filled with the modes that it reports.

    Parameters
    ----------
    p, q, first : int
        As in `advancing`.
    state : Octaves
        To begin the next frame.
    slots : Slots
        To be left with what is reported.

    Returns
    -------
    callable
        Of the index of the frame's first sample in the source, and of the result, shape (slots, samples).
    """
    machine_code = bound(_complete, p, q, first, 0, state, slots, new_columns(0, 0))
    return lambda begin, out: machine_code(p, q, first, begin, state, slots, out)


@njit(**OPTIONS)
def survey(p, q, first, begin, state, frequencies, powers):
    """Tell what the modes of a frame are: it ends with the samples taken last.

    Parameters
    ----------
    p, q, first, begin : int
        As in `completing`.
    state : Octaves
        Its ``shares`` are brought up to date.
    frequencies : ndarray of float64, shape (octaves, modes)
        The result: median frequency in Hz, NaN where there was none for half of the frame or longer.
    powers : ndarray of float64, shape (octaves, modes)
        The result: power of each mode at this moment, by the model and the recent power of the octave's signal.
    """
    filled = state.recursions.filled
    for k in range(filled.shape[0]):
        memory = state.recursions.memory[k]
        recursion, factors = rarma.parts(p, q, memory), poles.parts(p, memory[rarma.rows(p, q) :])
        if factors.known[0] > 0.0:
            modal_shares(p, q, recursion.theta, factors.factors.reshape((p // 2, 2)), state.roots, state.shares[k])
        shown = _row(begin, begin, first + k)
        rows = filled[k] - shown
        for m in range(p // 2):
            powers[k, m] = state.shares[k, m] * recursion.heard[rarma.POWER]
            known = _known(state.columns.frequency[k, m, shown : filled[k]], state.values)
            frequencies[k, m] = median_of_many(state.values[:known]) if 2 * known > rows else math.nan


@njit(**OPTIONS)
def _known(frequencies, values):
    """Copy frequencies but for those that are NaN, as while the model starts; return how many."""
    known = 0
    for i in range(frequencies.shape[0]):
        values[i] = frequencies[i]
        known += not math.isnan(frequencies[i])
    if known < frequencies.shape[0]:
        known = 0
        for i in range(frequencies.shape[0]):
            values[known] = frequencies[i]
            known += not math.isnan(frequencies[i])
    return known


@njit(**OPTIONS)
def show(first, begin, chosen, columns, filled, out):
    """Fill a frame, which ends with the samples taken last, with chosen modes, a column each, and begin the next.

    Parameters
    ----------
    first, begin : int
        As in `completing`.
    chosen : ndarray of int64, shape (slots, 2)
        Octave (counted from the first recursion) and mode to be shown in each slot; -1 for none. That reads as a pair
        of real poles: no frequency; held or starting as its neighbours.
    columns, filled : Columns, ndarray
        Of the octaves; changed in place.
    out : Columns, shape (slots, samples)
        The result.
    """
    for slot in range(chosen.shape[0]):
        k, m = chosen[slot, 0], chosen[slot, 1]
        if k < 0:
            out.frequency[slot, :] = math.nan
            out.damping[slot, :] = math.nan
            out.frequency_sd[slot, :] = math.nan
            out.damping_sd[slot, :] = math.nan
            _hold(first, begin, columns.status[0, 0], out.status[slot])
            for t in range(out.status.shape[1]):
                if out.status[slot, t] == OSCILLATORY:
                    out.status[slot, t] = REAL_PAIR
        else:
            _hold(first + k, begin, columns.frequency[k, m], out.frequency[slot])
            _hold(first + k, begin, columns.damping[k, m], out.damping[slot])
            _hold(first + k, begin, columns.frequency_sd[k, m], out.frequency_sd[slot])
            _hold(first + k, begin, columns.damping_sd[k, m], out.damping_sd[slot])
            _hold(first + k, begin, columns.status[k, m], out.status[slot])
    for k in range(filled.shape[0]):
        last = filled[k] - 1
        for m in range(columns.status.shape[1]):
            columns.frequency[k, m, 0] = columns.frequency[k, m, last]
            columns.damping[k, m, 0] = columns.damping[k, m, last]
            columns.frequency_sd[k, m, 0] = columns.frequency_sd[k, m, last]
            columns.damping_sd[k, m, 0] = columns.damping_sd[k, m, last]
            columns.status[k, m, 0] = columns.status[k, m, last]
        filled[k] = 1


@njit(**OPTIONS)
def _hold(halvings, begin, values, out):
    """Show an octave's values at the samples of a frame, shape (samples,); each stands until the next."""
    samples, each = out.shape[0], 1 << halvings
    row = _row(begin, begin, halvings)
    shown = min(-begin % each, samples)  # of the value that stands since the frame before
    for t in range(shown):
        out[t] = values[row]
    row += shown > 0
    whole, rest = values[row:], out[shown:]
    rows = (samples - shown) // each
    if each == 1:
        _repeat(1, whole, rows, rest)
    elif each == 2:
        _repeat(2, whole, rows, rest)
    elif each == 4:
        _repeat(4, whole, rows, rest)
    else:
        _repeat(each, whole, rows, rest)
    for t in range(each * rows, rest.shape[0]):
        rest[t] = whole[rows]


@njit(forceinline=True, **OPTIONS)
def _repeat(each, values, rows, out):
    """Show each value so many times: where the compiler knows the number it has instructions for that."""
    for row in range(rows):
        for i in range(each):
            out[each * row + i] = values[row]


@njit(**OPTIONS)
def _row(sample, begin, halvings):
    """Row of an octave's columns that holds at a sample of the source: the first of so many makes one."""
    return (sample >> halvings) - ((begin - 1) >> halvings)


@njit(**OPTIONS)
def root_mean_square(samples):
    """Root mean square of those samples that are measurements; 0 where there are none."""
    total = 0.0
    count = 0
    for t in range(samples.shape[0]):
        if abs(samples[t]) < rarma.LARGEST_SAMPLE:
            total += samples[t] * samples[t]
            count += 1
    return math.sqrt(total / count) if count > 0 else 0.0
