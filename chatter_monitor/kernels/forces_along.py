"""Forces of terms that an observer does not know, along the motion that it sees.

As in `kernels.observer` a force is averaged over where the tool may be, but the motion is there already: a few
samples at a time, the states at which forces are evaluated are laid out in rows, the same for all terms, and each term
goes along them inlined (`kernels.forces.compile_row`).
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.forces import call_lanes, call_row
from chatter_monitor.kernels.observer import (
    AHEAD,
    BEFORE,
    NODES,
    SEEN,
    SMOOTH,
    SUBSTEPS,
    about,
    node_of,
    on_step,
)
from chatter_monitor.kernels.options import OPTIONS

_FEW = 64  # samples that go through a stage together
# What jumps is averaged over a normal variable at both signs of two values, and at two others at every second node:
# medians of eight shares of it, the outer ones smaller, because a far crossing of zero counts as well. A force that the
# observer knows needs an average that its parameters move smoothly; a column of a regression does not.
MEDIANS = ((0.266, 2.054), (0.824, 1.405))
SHARES = ((0.42, 0.08), (0.34, 0.16))


class Tried(NamedTuple):
    """Forces whose signatures are wanted."""

    rows: np.ndarray  # (c,) addresses of terms for `call_row`
    rates: np.ndarray  # (c,) addresses of the rates of their memory, for `call_force`; 0 for none
    lanes: np.ndarray  # (c,) and for `call_lanes`
    substeps: np.ndarray  # (c,) SMOOTH or SUBSTEPS
    parameters: np.ndarray  # (c, MOST_PARAMETERS)


class States(NamedTuple):
    """Where forces are evaluated: at each of some nodes, on both sides of what is expected, for `few` samples each.

    Where a jump is near, another such pair follows; those pairs stand behind all others.
    """

    state: np.ndarray  # (5, p) displacement, velocity, delayed displacement, angle, memory
    share: np.ndarray  # (p / 2,) of each pair in the mean of its node
    when: np.ndarray  # (p / 2,) on the step, from 0 to 1
    sample: np.ndarray  # (p / 2,) which of the few
    force: np.ndarray  # (p,)


class Lanes(NamedTuple):
    """Memories of terms side by side, and room for their changes."""

    parameters: np.ndarray  # (MOST_PARAMETERS, c)
    known: np.ndarray  # (c,) at the last sample
    ahead: np.ndarray  # (c,) and as predicted
    probe: np.ndarray  # (c,) changes
    probed: np.ndarray  # (c,) memories changed by that
    rate: np.ndarray  # (c,)
    other: np.ndarray  # (c,) rate of those


@njit(cache=True, nogil=True)
def forces_along(observer, motion, settled, tried, force):
    """Evaluate terms along the motion.

    Parameters
    ----------
    observer : Observer
    motion : Motion
    settled : ndarray of bool, shape (n,)
        As for `kernels.observer.observe`.
    tried : Tried
        c terms.
    force : ndarray of float64, shape (c, 2, n)
        Filled with the forces over the step from sample k as a straight line, at its beginning and its end; for a
        sensor that feels the force, with the force at sample k once it is known, and with what is predicted for k + 1.
    """
    count, n = tried.rows.size, settled.size
    feels = observer.feed != 0.0
    pairs = 2 * SUBSTEPS * _FEW
    states = States(
        np.zeros((5, 2 * pairs)), np.zeros(pairs), np.zeros(pairs), np.zeros(pairs, dtype=np.int64), np.zeros(2 * pairs)
    )
    # Terms whose memory changes by the same law are remembered side by side.
    lanes = Lanes(
        np.ascontiguousarray(tried.parameters.T), np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count),
        np.zeros(count), np.zeros(count),
    )  # fmt: skip
    memories = np.zeros((count, 2, _FEW))
    mean, slope = np.zeros(_FEW), np.zeros(_FEW)
    for at in range(0, n, _FEW):
        few = min(_FEW, n - at)
        begin = 0
        for end in range(1, count + 1):
            if end == count or tried.lanes[end] != tried.lanes[begin]:
                if tried.lanes[begin] != 0:
                    remember(observer, motion, settled, tried.lanes[begin], begin, end, at, few, lanes, memories)
                begin = end
        for kind in (SMOOTH, SUBSTEPS):
            for row in range(2 if feels else 1):
                placed = 0
                for j in range(count):
                    if tried.substeps[j] != kind:
                        continue
                    if placed == 0:
                        placed = place(observer, motion, at, few, kind, row, states)
                    if tried.rates[j] != 0:
                        recall(memories[j], row, feels, placed, states)
                    evaluate(tried, j, observer.omega, placed, states)
                    average(states, placed, few, kind, mean, slope)
                    for k in range(few):
                        half = 0.0 if feels else 0.5 * slope[k]
                        acts = 1.0 if settled[at + k] else 0.0
                        force[j, row, at + k] = acts * (mean[k] - half)
                        if not feels:
                            force[j, 1, at + k] = acts * (mean[k] + half)
                    if tried.rates[j] != 0:
                        states.state[4] = 0.0


@njit(**OPTIONS)
def remember(observer, motion, settled, address, begin, end, at, few, lanes, memories):
    """Memory of some terms at some samples, and as predicted for the sample after each."""
    omega, step, part = observer.omega, observer.step_s, slice(begin, end)
    known, ahead = lanes.known[part], lanes.ahead[part]
    for k in range(few):
        i = at + k
        if not settled[i]:
            for j in range(known.size):
                known[j] = 0.0
            continue
        x, v, angle = motion.x[0, i], motion.v[0, i], observer.turn * i
        for j in range(known.size):
            memories[begin + j, 0, k] = ahead[j] = known[j]
        advance(
            address, begin, lanes, ahead, x, v, motion.x[1, i], motion.v[1, i], motion.lagged[1, i], angle, omega, step
        )
        for j in range(known.size):
            memories[begin + j, 1, k] = ahead[j]
        if i + 1 < settled.size:
            i += 1
            advance(
                address, begin, lanes, known, x, v, motion.x[0, i], motion.v[0, i], motion.lagged[0, i], angle, omega,
                step,
            )  # fmt: skip


@njit(**OPTIONS)
def advance(address, begin, lanes, z, x0, v0, x1, v1, lagged, angle, omega, step_s):
    """Bring memories to the end of a step, as `kernels.observer.remembered` does one."""
    n, h = z.size, step_s / SUBSTEPS
    probe, probed = lanes.probe[begin : begin + n], lanes.probed[begin : begin + n]
    rate, other = lanes.rate[begin : begin + n], lanes.other[begin : begin + n]
    p, apart = lanes.parameters.ctypes.data + 8 * begin, lanes.parameters.shape[1]
    for i in range(SUBSTEPS):
        share = (i + 0.5) / SUBSTEPS
        x, v = x0 + share * (x1 - x0), v0 + share * (v1 - v0)
        for j in range(n):
            probe[j] = 1e-6 * (abs(z[j]) + abs(v) * h) + 1e-300
            probed[j] = z[j] + probe[j]
        call_lanes(address, x, v, lagged, angle, omega, z.ctypes.data, p, apart, n, rate.ctypes.data)
        call_lanes(address, x, v, lagged, angle, omega, probed.ctypes.data, p, apart, n, other.ctypes.data)
        for j in range(n):
            slope = (other[j] - rate[j]) / probe[j]
            z[j] += h * rate[j] / (1.0 - 0.5 * h * min(slope, 0.0))


@njit(**OPTIONS)
def place(observer, motion, at, few, kind, row, states):
    """Lay out the states for terms of a kind, as known (row 0) or predicted (row 1); how many pairs there are."""
    omega, turn, step, feels = observer.omega, observer.turn, observer.step_s, observer.feed != 0.0
    jumps = kind != SMOOTH
    pair = kind * few  # of those that follow
    for i in range(kind):
        node = node_of(kind, i)
        s = NODES[node]
        spread = observer.spread[BEFORE + node] if not feels else observer.spread[AHEAD if row == 1 else SEEN]
        side = spread[:, 0 if jumps else i]
        for k in range(few):
            x0, v0, lagged = motion.x[row, at + k], motion.v[row, at + k], motion.lagged[row, at + k]
            if not feels:
                x, v = on_step(s, x0, v0, motion.x[1, at + k], motion.v[1, at + k], step)
                lagged = (1.0 - s) * lagged + s * motion.lagged[1, at + k]
                angle = turn * (at + k) + s * turn
            else:
                x, v, angle = x0, v0, turn * (at + k + row)
                if jumps:
                    x, v = about(s, x0, v0, omega, step)
                    angle += (s - 0.5) * turn
            near = jumps and abs(v) < MEDIANS[0][1] * abs(side[1])
            far = MEDIANS[i % 2][0] if near else 1.0 if jumps else 1.4142135623730951
            share = SHARES[i % 2][0] if near else 0.5
            put(states, i * few + k, s, k, share, x, v, lagged, angle, far * side[0], far * side[1])
            if near:
                far, share = MEDIANS[i % 2][1], SHARES[i % 2][1]
                put(states, pair, s, k, share, x, v, lagged, angle, far * side[0], far * side[1])
                pair += 1
    return pair


@njit(**OPTIONS)
def put(states, pair, when, sample, share, x, v, lagged, angle, dx, dv):
    """One pair of states."""
    states.when[pair], states.sample[pair], states.share[pair] = when, sample, share
    for sign in range(2):
        at, side = 2 * pair + sign, 2 * sign - 1
        states.state[0, at] = x + side * dx
        states.state[1, at] = v + side * dv
        states.state[2, at] = lagged
        states.state[3, at] = angle


@njit(**OPTIONS)
def recall(memories, row, feels, pairs, states):
    """Memory of one term at the states."""
    for pair in range(pairs):
        s, k = states.when[pair], states.sample[pair]
        z = memories[row, k] if feels else (1.0 - s) * memories[0, k] + s * memories[1, k]
        states.state[4, 2 * pair] = states.state[4, 2 * pair + 1] = z


@njit(**OPTIONS)
def evaluate(tried, j, omega, pairs, states):
    """Force of a term at the states."""
    first, row = states.state.ctypes.data, 8 * states.state.shape[1]
    parameters = tried.parameters.ctypes.data + 8 * tried.parameters.shape[1] * j
    call_row(
        tried.rows[j], first, first + row, first + 2 * row, first + 3 * row, omega, first + 4 * row, parameters,
        2 * pairs, states.force.ctypes.data,
    )  # fmt: skip


@njit(**OPTIONS)
def average(states, pairs, few, kind, mean, slope):
    """Mean and slope of a force over each step; of a sensor that feels it, the mean about each sample."""
    square = 0.0
    for i in range(kind):
        square += (states.when[i * few] - 0.5) ** 2
    for k in range(few):
        mean[k] = slope[k] = 0.0
    for pair in range(pairs):
        part = states.share[pair] * (states.force[2 * pair] + states.force[2 * pair + 1])
        mean[states.sample[pair]] += part
        slope[states.sample[pair]] += part * (states.when[pair] - 0.5)
    for k in range(few):
        mean[k] /= kind
        slope[k] /= square
