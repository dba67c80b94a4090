"""The observer of `kernels.signatures`, some samples at a time, with the forces of many terms along the way.

What a recording as a whole allows is left out here: the state is taken for known (no cubature about it), and the
memory of a term makes one step where it makes several there.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.forces import call_force
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.signatures import SMOOTH, delayed, filtered, respond

NODES = 4  # per step, at which forces that jump are evaluated
FEW = 64  # samples whose columns are filtered side by side
_ITERATIONS = 2  # of the predicted step with the forces that the observer knows
_GAUSS = 0.5 / np.sqrt(3.0)


class Path(NamedTuple):
    """What an observer carries from one sample to the next; m terms are known to it, c are tried."""

    state: np.ndarray  # (n,) predicted for the next sample
    ahead: np.ndarray  # (n,) scratch
    late: np.ndarray  # (1,) known force predicted for the next sample
    motion: np.ndarray  # (2,) displacement and velocity at the last sample
    known_memory: np.ndarray  # (m,)
    memory: np.ndarray  # (c,)
    past: np.ndarray  # (p,) displacements: FEW samples, and before them those of the longest delay
    nodes: np.ndarray  # (2, 4, NODES) scratch, for forces that do not jump and those that do: x, v, lagged, angle


class Answers(NamedTuple):
    """What the signatures carry from one sample to the next: none for the errors, then 3 + c, side by side."""

    state: np.ndarray  # (2, n, 4 + c) error of the predicted state
    ended: np.ndarray  # (4 + c,) force predicted for the next sample
    news: np.ndarray  # (4 + c,) scratch
    seen: np.ndarray  # (4 + c,) scratch
    errors: np.ndarray  # (FEW,) scratch


@njit(**OPTIONS)
def position(substeps, i):
    """Where on a step, from 0 to 1, a force is evaluated: Gauss points for one that does not jump."""
    return 0.5 + (2 * i - 1) * _GAUSS if substeps == SMOOTH else (i + 0.5) / substeps


@njit(**OPTIONS)
def along_step(nodes, x0, v0, x1, v1, lagged0, lagged1, angle, turn, step_s):
    """Nodes of a step from one sample to the next, over which the tool moves along a cubic."""
    for kind in range(2):
        substeps, row = (SMOOTH, nodes[0]) if kind == 0 else (NODES, nodes[1])
        for i in range(substeps):
            s = position(substeps, i)
            r = 1.0 - s
            row[0, i] = r * r * (1.0 + 2.0 * s) * x0 + s * s * (1.0 + 2.0 * r) * x1 + step_s * s * r * (r * v0 - s * v1)
            row[1, i] = 6.0 * s * r * (x1 - x0) / step_s + r * (1.0 - 3.0 * s) * v0 + s * (3.0 * s - 2.0) * v1
            row[2, i] = r * lagged0 + s * lagged1
            row[3, i] = angle + s * turn


@njit(**OPTIONS)
def about_sample(nodes, x, v, lagged, angle, turn, omega, step_s):
    """Nodes from half a step before a sample to half a step after."""
    for kind in range(2):
        substeps, row = (SMOOTH, nodes[0]) if kind == 0 else (NODES, nodes[1])
        for i in range(substeps):
            s = position(substeps, i) - 0.5
            row[0, i] = x + s * step_s * v
            row[1, i] = v - s * step_s * omega * omega * x
            row[2, i] = lagged
            row[3, i] = angle + turn * s


@njit(**OPTIONS)
def as_line(term, j, nodes, omega, z0, z1):
    """Force of a term over a step as the straight line of the same mean and first moment: its values at the ends."""
    substeps, p = term.substeps[j], term.parameters.ctypes.data + 8 * term.columns[j]
    row = nodes[0] if substeps == SMOOTH else nodes[1]
    mean = slope = square = 0.0
    for i in range(substeps):
        s = position(substeps, i)
        z = (1.0 - s) * z0 + s * z1
        force = call_force(term.forces[j], row[0, i], row[1, i], row[2, i], row[3, i], omega, z, p)
        mean += force
        slope += force * (s - 0.5)
        square += (s - 0.5) * (s - 0.5)
    mean /= substeps
    slope /= square
    return mean - 0.5 * slope, mean + 0.5 * slope


@njit(**OPTIONS)
def as_mean(term, j, nodes, omega, z):
    """Mean force of a term over the nodes."""
    substeps, p = term.substeps[j], term.parameters.ctypes.data + 8 * term.columns[j]
    row = nodes[0] if substeps == SMOOTH else nodes[1]
    mean = 0.0
    for i in range(substeps):
        mean += call_force(term.forces[j], row[0, i], row[1, i], row[2, i], row[3, i], omega, z, p)
    return mean / substeps


@njit(**OPTIONS)
def remembered(term, j, x0, v0, x1, v1, lagged, angle, omega, z, step_s):
    """Memory of a term at the end of a step: one linearly implicit midpoint step."""
    rate, p = term.rates[j], term.parameters.ctypes.data + 8 * term.columns[j]
    if rate == 0:
        return z
    x, v = 0.5 * (x0 + x1), 0.5 * (v0 + v1)
    probe = 1e-6 * (abs(z) + abs(v) * step_s) + 1e-300
    slope = call_force(rate, x, v, lagged, angle, omega, z, p)
    steeper = (call_force(rate, x, v, lagged, angle, omega, z + probe, p) - slope) / probe
    return z + step_s * slope / (1.0 - 0.5 * step_s * min(steeper, 0.0))


@njit(**OPTIONS)
def advance(observer, known, tried, y, missing, first, carried, errors, begins, ends):
    """Predict samples from those before, and evaluate forces on the way.

    Parameters
    ----------
    observer : Observer
    known, tried : Forces
        Forces of the model, and those whose signatures are wanted.
    y : ndarray of float64, shape (n,)
    missing : ndarray of bool, shape (n,)
        Samples that are not to be used; their errors are 0.
    first : int
        Samples since the spindle's angle was 0.
    carried : Path
        Carried on.
    errors : ndarray of float64, shape (n,)
        Filled with the prediction errors.
    begins, ends : ndarray of float64, shape (n, 4 + c)
        Filled with 0 (the errors' place), unit spring, unit damper, 1, and the forces tried: as straight lines over the
        step that follows each sample; for a sensor that feels the force, at the sample as known, and at the next one
        as predicted.
    """
    order = observer.gain.size
    state, ahead, nodes = carried.state, carried.ahead, carried.nodes
    feels = observer.feed != 0.0
    omega, turn, step = observer.omega, observer.turn, observer.step_s
    size, count = carried.past.size, known.forces.size
    for i in range(size - y.size):
        carried.past[i] = carried.past[i + y.size]
    for k in range(y.size):
        at = size - y.size + k
        late = carried.late[0]
        predicted = observer.feed * late
        for i in range(order):
            predicted += observer.output[i] * state[i]
        e = 0.0 if missing[k] else y[k] - predicted
        errors[k] = e
        angle = turn * (first + k)
        lagged, lagged_next = delayed(carried.past, at, observer.delay), delayed(carried.past, at + 1, observer.delay)
        x = v = 0.0
        for i in range(order):
            x += observer.tool[0, i] * (state[i] + observer.gain[i] * e)
            v += observer.tool[1, i] * (state[i] + observer.gain[i] * e)
        early = 0.0
        if feels and count:
            about_sample(nodes, x, v, lagged, angle, turn, omega, step)
            for j in range(count):
                early += as_mean(known, j, nodes, omega, carried.known_memory[j])
            news = early - late
            e -= 0.0 if missing[k] else observer.feed * news
            for i in range(order):
                state[i] += observer.end[i] * news
                e -= 0.0 if missing[k] else observer.output[i] * observer.end[i] * news
        x = v = 0.0
        for i in range(order):
            state[i] += observer.gain[i] * e
            x += observer.tool[0, i] * state[i]
            v += observer.tool[1, i] * state[i]
        carried.past[at] = x
        x0, v0 = carried.motion[0], carried.motion[1]
        for j in range(tried.forces.size):
            z = carried.memory[j]
            carried.memory[j] = remembered(tried, j, x0, v0, x, v, lagged, angle, omega, z, step)
        carried.motion[0], carried.motion[1] = x, v
        for i in range(order):
            total = 0.0
            for j in range(order):
                total += observer.transition[i, j] * state[j]
            ahead[i] = total
        # The force on the way to the next sample, from where the tool would go with the force as it was.
        if not feels:
            early = late
        xp = vp = 0.0
        for attempt in range(_ITERATIONS if count else 1):
            xp = vp = 0.0
            for i in range(order):
                reached = ahead[i] + observer.begin[i] * early + observer.end[i] * late
                xp += observer.tool[0, i] * reached
                vp += observer.tool[1, i] * reached
            if feels:
                about_sample(nodes, xp, vp, lagged_next, angle + turn, turn, omega, step)
            else:
                along_step(nodes, x, v, xp, vp, lagged, lagged_next, angle, turn, step)
            if count:
                late = 0.0
                early = early if feels else 0.0
            for j in range(count):
                z = carried.known_memory[j]
                ended = remembered(known, j, x, v, xp, vp, lagged_next, angle, omega, z, step)
                if feels:
                    late += as_mean(known, j, nodes, omega, ended)
                else:
                    begin, end = as_line(known, j, nodes, omega, z, ended)
                    early += begin
                    late += end
                if attempt == _ITERATIONS - 1:
                    carried.known_memory[j] = ended
        carried.late[0] = late
        for i in range(order):
            state[i] = ahead[i] + observer.begin[i] * early + observer.end[i] * late
        begins[k, 0], begins[k, 1], begins[k, 2], begins[k, 3] = 0.0, x, v, 1.0
        ends[k, 0], ends[k, 1], ends[k, 2], ends[k, 3] = 0.0, xp, vp, 1.0
        for j in range(tried.forces.size):
            z = carried.memory[j]
            ended = remembered(tried, j, x, v, xp, vp, lagged_next, angle, omega, z, step)
            if feels:
                ends[k, 4 + j] = as_mean(tried, j, nodes, omega, ended)
            else:
                begins[k, 4 + j], ends[k, 4 + j] = as_line(tried, j, nodes, omega, z, ended)
        if feels:
            about_sample(nodes, x, v, lagged, angle, turn, omega, step)
            for j in range(tried.forces.size):
                begins[k, 4 + j] = as_mean(tried, j, nodes, omega, carried.memory[j])


@njit(cache=True, nogil=True)
def watch(observer, known, tried, y, missing, first, starts, carried, answers, forces, taps, raw, white):
    """Whitened prediction errors of the next samples, and whitened signatures beside them.

    Parameters
    ----------
    observer, known, tried, y, missing, first, carried
        As for `advance`; n is a multiple of FEW.
    starts : bool
        Whether these are the first samples.
    answers : Answers
        Carried on.
    forces : ndarray of float64, shape (2, FEW, 4 + c)
        Scratch.
    taps : ndarray of float64, shape (t,)
        The whitening filter.
    raw : ndarray of float64, shape (t - 1 + FEW, 4 + c)
        Carried on: errors and signatures before they are filtered.
    white : ndarray of float64, shape (n, 4 + c)
        Filled with errors (column 0) and signatures.
    """
    before = taps.size - 1
    a = answers
    for at in range(0, y.size, FEW):
        for k in range(before):
            raw[k] = raw[FEW + k]
        new = raw[before:]
        few = slice(at, at + FEW)
        advance(observer, known, tried, y[few], missing[few], first + at, carried, a.errors, forces[0], forces[1])
        begins = starts and at == 0
        # Columns of one array from beginning to end: only so does the compiler put them side by side.
        respond(observer, forces[0], forces[1], missing[few], begins, a.state, a.ended, a.news, a.seen, new)
        for k in range(FEW):
            new[k, 0] = a.errors[k]
        filtered(raw, taps, white[few])
