"""The observer of `kernels.observer`, some samples at a time, with the forces of many terms along the way.

What a recording as a whole allows is left out here: the state is taken for known (no cubature about it), and the
memory of a term makes one step where it makes several there. A few samples at a time go through stages, each of which
is a loop over long rows: the motion, where on it forces are evaluated, each force, and all signatures side by side.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.forces import call_force, call_row
from chatter_monitor.kernels.observer import NODES, SMOOTH, SUBSTEPS, Motion, about, delayed, node_of, on_step
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.signatures import carry, respond, whiten

FEW = 64  # samples that go through a stage together
_ITERATIONS = 2  # of the predicted step with the forces that the observer knows


class Path(NamedTuple):
    """What an observer carries from one sample to the next; m terms are known to it, c are tried."""

    state: np.ndarray  # (n,) predicted for the next sample
    ahead: np.ndarray  # (n,) scratch
    late: np.ndarray  # (1,) known force predicted for the next sample
    last: np.ndarray  # (2,) displacement and velocity at the last sample
    known_memory: np.ndarray  # (m,)
    memory: np.ndarray  # (c,)
    past: np.ndarray  # (p,) displacements: FEW samples, and before them those of the longest delay


class Along(NamedTuple):
    """Scratch: the motion over FEW samples, and forces along it."""

    errors: np.ndarray  # (FEW,)
    motion: Motion
    nodes: np.ndarray  # (2, 2, 4, SUBSTEPS * FEW): as `place` fills each
    lagged_v: np.ndarray  # (2, FEW) velocity one delay ago, beside the displacement in `motion`
    memory: np.ndarray  # (2, FEW) of a term, at the sample and as predicted for the next
    between: np.ndarray  # (2, SUBSTEPS * FEW) memory at the nodes: none, and that of a term
    along: np.ndarray  # (SUBSTEPS * FEW,) force at the nodes
    force: np.ndarray  # (FEW,)


class Answers(NamedTuple):
    """Rows of `lanes` columns, one after the other: none for the errors, then forces and their signatures.

    What went before comes first.
    """

    begins: np.ndarray  # (FEW rows,) phi(k)
    ends: np.ndarray  # (1 + FEW rows,) p(k+1)
    states: np.ndarray  # (n, 1 + FEW rows) d(k)
    raw: np.ndarray  # (t - 1 + FEW rows,) s(k), the errors in their place


@njit(**OPTIONS)
def over_step(term, j, x0, v0, x1, v1, lagged0, lagged1, angle, observer, z0, z1):
    """Force over a step as the straight line of the same mean and first moment: its values at the ends."""
    substeps, p = term.substeps[j], term.parameters.ctypes.data + 8 * term.columns[j]
    mean = slope = square = 0.0
    for i in range(substeps):
        s = NODES[node_of(substeps, i)]
        x, v = on_step(s, x0, v0, x1, v1, observer.step_s)
        lagged, z = (1.0 - s) * lagged0 + s * lagged1, (1.0 - s) * z0 + s * z1
        force = call_force(term.forces[j], x, v, lagged, angle + s * observer.turn, observer.omega, z, p)
        mean += force
        slope += force * (s - 0.5)
        square += (s - 0.5) * (s - 0.5)
    mean /= substeps
    slope /= square
    return mean - 0.5 * slope, mean + 0.5 * slope


@njit(**OPTIONS)
def at_sample(term, j, x0, v0, lagged, angle, observer, z):
    """Mean force about a sample, for a sensor that feels it."""
    substeps, p = term.substeps[j], term.parameters.ctypes.data + 8 * term.columns[j]
    mean = 0.0
    for i in range(substeps):
        s = NODES[node_of(substeps, i)]
        x, v = about(s, x0, v0, observer.omega, observer.step_s)
        mean += call_force(term.forces[j], x, v, lagged, angle + (s - 0.5) * observer.turn, observer.omega, z, p)
    return mean / substeps


@njit(**OPTIONS)
def remembered(rate, p, x0, v0, x1, v1, lagged, angle, omega, z, step_s):
    """Memory of a term at the end of a step: one linearly implicit midpoint step."""
    if rate == 0:
        return z
    x, v = 0.5 * (x0 + x1), 0.5 * (v0 + v1)
    probe = 1e-6 * (abs(z) + abs(v) * step_s) + 1e-300
    slope = call_force(rate, x, v, lagged, angle, omega, z, p)
    change = call_force(rate, x, v, lagged, angle, omega, z + probe, p) - slope
    return z + step_s * slope * probe / (probe - 0.5 * step_s * min(change, 0.0))


@njit(**OPTIONS)
def predict(observer, known, y, missing, first, path, along):
    """Predict FEW samples, each from those before.

    Parameters
    ----------
    observer : Observer
    known : Forces
        Forces of the model.
    y : ndarray of float64, shape (FEW,)
    missing : ndarray of bool, shape (FEW,)
        Samples that are not to be used; their errors are 0.
    first : int
        Samples since the spindle's angle was 0.
    path : Path
        Carried on.
    along : Along
        Its errors and motion are filled.
    """
    errors, motion = along.errors, along.motion
    order, count, size = observer.gain.size, known.forces.size, path.past.size
    state, ahead = path.state, path.ahead
    feels = observer.feed != 0.0
    omega, turn, step = observer.omega, observer.turn, observer.step_s
    for i in range(size - FEW):
        path.past[i] = path.past[i + FEW]
    for k in range(FEW):
        at = size - FEW + k
        late = path.late[0]
        predicted = observer.feed * late
        for i in range(order):
            predicted += observer.output[i] * state[i]
        e = 0.0 if missing[k] else y[k] - predicted
        errors[k] = e
        angle = turn * (first + k)
        lagged = lagged_next = 0.0
        if observer.delay > 0.0:
            lagged, lagged_next = delayed(path.past, at, observer.delay), delayed(path.past, at + 1, observer.delay)
        early = 0.0
        if feels and count:
            x = v = 0.0
            for i in range(order):
                x += observer.tool[0, i] * (state[i] + observer.gain[i] * e)
                v += observer.tool[1, i] * (state[i] + observer.gain[i] * e)
            for j in range(count):
                early += at_sample(known, j, x, v, lagged, angle, observer, path.known_memory[j])
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
        path.past[at] = x
        for i in range(order):
            total = 0.0
            for j in range(order):
                total += observer.transition[i, j] * state[j]
            ahead[i] = total
        # The force on the way to the next sample, from where the tool would go with the force as it was.
        if not feels:
            early = late
        for attempt in range(_ITERATIONS if count else 0):
            xp = vp = 0.0
            for i in range(order):
                reached = ahead[i] + observer.begin[i] * early + observer.end[i] * late
                xp += observer.tool[0, i] * reached
                vp += observer.tool[1, i] * reached
            late = 0.0
            early = early if feels else 0.0
            for j in range(count):
                z = path.known_memory[j]
                p = known.parameters.ctypes.data + 8 * known.columns[j]
                ended = remembered(known.rates[j], p, x, v, xp, vp, lagged_next, angle, omega, z, step)
                if feels:
                    late += at_sample(known, j, xp, vp, lagged_next, angle + turn, observer, ended)
                else:
                    begin, end = over_step(known, j, x, v, xp, vp, lagged, lagged_next, angle, observer, z, ended)
                    early += begin
                    late += end
                if attempt == _ITERATIONS - 1:
                    path.known_memory[j] = ended
        path.late[0] = late
        xp = vp = 0.0
        for i in range(order):
            state[i] = ahead[i] + observer.begin[i] * early + observer.end[i] * late
            xp += observer.tool[0, i] * state[i]
            vp += observer.tool[1, i] * state[i]
        motion.x[0, k], motion.v[0, k], motion.lagged[0, k] = x, v, lagged
        motion.x[1, k], motion.v[1, k], motion.lagged[1, k] = xp, vp, lagged_next
        for row in range(2 if observer.delay > 0.0 else 0):
            sooner, later = observer.delay - 0.5, observer.delay + 0.5
            moved = delayed(path.past, at + row, sooner) - delayed(path.past, at + row, later)
            along.lagged_v[row, k] = moved / step


@njit(**OPTIONS)
def place(observer, motion, first, row, nodes):
    """Nodes of FEW steps, or for a sensor that feels the force about FEW samples: as known (row 0) or predicted (1)."""
    omega, turn, step = observer.omega, observer.turn, observer.step_s
    x0, v0, lagged0 = motion.x[0], motion.v[0], motion.lagged[0]
    x1, v1, lagged1 = motion.x[1], motion.v[1], motion.lagged[1]
    for kind in range(2):
        substeps = SMOOTH if kind == 0 else SUBSTEPS
        for i in range(substeps):
            s = NODES[node_of(substeps, i)]
            part = slice(i * FEW, (i + 1) * FEW)
            x, v, lagged, angle = nodes[kind, 0, part], nodes[kind, 1, part], nodes[kind, 2, part], nodes[kind, 3, part]
            if observer.feed != 0.0:
                for k in range(FEW):
                    x[k], v[k] = about(s, motion.x[row, k], motion.v[row, k], omega, step)
                    lagged[k] = motion.lagged[row, k]
                    angle[k] = (first + k + row + s - 0.5) * turn
            else:
                for k in range(FEW):
                    x[k], v[k] = on_step(s, x0[k], v0[k], x1[k], v1[k], step)
                    lagged[k] = (1.0 - s) * lagged0[k] + s * lagged1[k]
                    angle[k] = (first + k + s) * turn


@njit(**OPTIONS)
def parameters_of(tried, j):
    """Address of the parameters of a force."""
    return tried.parameters.ctypes.data + 8 * tried.parameters.shape[1] * j


@njit(**OPTIONS)
def remember(observer, tried, j, motion, first, path, memory):
    """Memory of a term at FEW samples, and as predicted for the sample after each."""
    omega, step, rate, p = observer.omega, observer.step_s, tried.rates[j], parameters_of(tried, j)
    x, v, z = path.last[0], path.last[1], path.memory[j]
    for k in range(FEW):
        x0, v0, x1, v1 = motion.x[0, k], motion.v[0, k], motion.x[1, k], motion.v[1, k]
        lagged, lagged_next = motion.lagged[0, k], motion.lagged[1, k]
        angle = observer.turn * (first + k)
        z = remembered(rate, p, x, v, x0, v0, lagged, angle, omega, z, step)
        memory[0, k] = z
        memory[1, k] = remembered(rate, p, x0, v0, x1, v1, lagged_next, angle, omega, z, step)
        x, v = x0, v0
    path.memory[j] = z


@njit(**OPTIONS)
def evaluate(tried, j, nodes, omega, memory, along):
    """Force of a term at the nodes of FEW samples."""
    node = nodes[0 if tried.substeps[j] == SMOOTH else 1].ctypes.data
    row = 8 * nodes.shape[2]
    call_row(
        tried.rows[j], node, node + row, node + 2 * row, node + 3 * row, omega, memory.ctypes.data,
        parameters_of(tried, j), tried.substeps[j] * FEW, along.ctypes.data,
    )  # fmt: skip


@njit(**OPTIONS)
def as_lines(substeps, along, lanes, column, begins, ends):
    """Straight lines of the mean and first moment of forces at the nodes of FEW steps: their ends, into a column.

    An end is a weighted sum of what is at the nodes; there is an even number of them.
    """
    square = 0.0
    for i in range(substeps):
        square += (NODES[node_of(substeps, i)] - 0.5) ** 2
    for i in range(0, substeps, 2):
        here, there = along[i * FEW : (i + 1) * FEW], along[(i + 1) * FEW : (i + 2) * FEW]
        half_here = 0.5 * (NODES[node_of(substeps, i)] - 0.5) / square
        half_there = 0.5 * (NODES[node_of(substeps, i + 1)] - 0.5) / square
        mean = 1.0 / substeps
        for k in range(FEW):
            at = k * lanes + column
            begin = (mean - half_here) * here[k] + (mean - half_there) * there[k]
            end = (mean + half_here) * here[k] + (mean + half_there) * there[k]
            begins[at] = begins[at] + begin if i else begin
            ends[at] = ends[at] + end if i else end


@njit(**OPTIONS)
def as_means(substeps, along, force):
    """Means of forces at the nodes about FEW samples."""
    for k in range(FEW):
        force[k] = 0.0
    for i in range(substeps):
        here = along[i * FEW : (i + 1) * FEW]
        for k in range(FEW):
            force[k] += here[k] / substeps


@njit(**OPTIONS)
def put(row, lanes, column, values):
    """Put values into a column of rows that lie one after the other."""
    for k in range(FEW):
        row[k * lanes + column] = values[k]


@njit(**OPTIONS)
def forces_of(observer, tried, linear, first, lanes, path, along, begins, ends):
    """Displacement, velocity, both one delay ago, and the forces tried, along FEW samples: into columns 1, 2, 3, ...

    Of the first four, `linear` are wanted.

    As straight lines over the step that follows each sample; for a sensor that feels the force, at the sample as known,
    and at the next one as predicted.
    """
    motion, omega, feels = along.motion, observer.omega, observer.feed != 0.0
    for row in range(2 if feels else 1):
        place(observer, motion, first, row, along.nodes[row])
    for row in range(2):
        columns = begins if row == 0 else ends
        put(columns, lanes, 1, motion.x[row])
        put(columns, lanes, 2, motion.v[row])
        if linear > 2:
            put(columns, lanes, 3, motion.lagged[row])
            put(columns, lanes, 4, along.lagged_v[row])
    for j in range(tried.rows.size):
        substeps, remembers = tried.substeps[j], tried.rates[j] != 0
        between = along.between[1 if remembers else 0]
        if remembers:
            remember(observer, tried, j, motion, first, path, along.memory)
        for row in range(2 if feels else 1):
            for i in range(substeps):
                s = row if feels else NODES[node_of(substeps, i)]
                z = between[i * FEW : (i + 1) * FEW]
                for k in range(FEW if remembers else 0):
                    z[k] = (1.0 - s) * along.memory[0, k] + s * along.memory[1, k]
            evaluate(tried, j, along.nodes[row], omega, between, along.along)
            if feels:
                as_means(substeps, along.along, along.force)
                put(begins if row == 0 else ends, lanes, 1 + linear + j, along.force)
        if not feels:
            as_lines(substeps, along.along, lanes, 1 + linear + j, begins, ends)
    path.last[0], path.last[1] = motion.x[0, FEW - 1], motion.v[0, FEW - 1]


@njit(cache=True, nogil=True)
def watch(observer, known, tried, linear, response, y, missing, first, path, along, answers, white):
    """Whitened prediction errors of the next samples, and whitened signatures beside them.

    Parameters
    ----------
    observer : Observer
    known : Forces
        Forces of the model.
    tried : Tried
    linear : int
        2, or 4 where the machine has a delay.
    response : Response
        Of the observer; a multiple of four of its taps follow the first.
    y : ndarray of float64, shape (n,)
        n is a multiple of FEW.
    missing : ndarray of bool, shape (n,)
        Samples that are not to be used; their errors are 0.
    first : int
        Samples since the spindle's angle was 0.
    path, answers : Path, Answers
        Carried on.
    along : Along
        Scratch.
    white : ndarray of float, shape (n, lanes)
        Filled with errors (column 0) and signatures: of displacement and velocity as forces, of the same one delay ago
        if `linear` is 4, and of what is tried.
    """
    lanes = white.shape[1]
    few = FEW * lanes
    for at in range(0, y.size, FEW):
        part = slice(at, at + FEW)
        predict(observer, known, y[part], missing[part], first + at, path, along)
        carry(answers.ends, few)
        carry(answers.raw, few)
        for n in range(response.output.size):
            carry(answers.states[n], few)
        forces_of(observer, tried, linear, first + at, lanes, path, along, answers.begins, answers.ends[lanes:])
        respond(response, lanes, answers.begins, answers.ends, answers.states, answers.raw[answers.raw.size - few :])
        put(answers.raw[answers.raw.size - few :], lanes, 0, along.errors)
        whiten(response.taps, lanes, answers.raw, white[part].reshape(few))
