"""The observer of `kernels.observer`, some samples at a time, with the forces of many terms along the way.

What a recording as a whole allows is left out here: the state is taken for known (no cubature about it), and the
memory of a term makes one step where it makes several there. No sample is missing. A few samples at a time go through
stages, each of which is a loop over long rows: the motion, where on it forces are evaluated, each force, and all
signatures side by side.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.forces import call_force, call_row
from chatter_monitor.kernels.lanes import as_lanes, fma
from chatter_monitor.kernels.observer import NODES, SMOOTH, SUBSTEPS, Motion, about, delayed, node_of, on_step
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.signatures import GROUP, carry, respond, whiten

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
    states: np.ndarray  # (n, 1 + FEW) predicted for each sample, of an observer that knows no forces


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


class Summary(NamedTuple):
    """What is made of some samples: errors (column 0) and `lanes` columns beside them, whitened."""

    white: np.ndarray  # (FEW * lanes,) of the last FEW samples
    products: np.ndarray  # (lanes * lanes,) of all columns, summed
    sums: np.ndarray  # (lanes,)
    errors: np.ndarray  # (n,)


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
def predict_linear(observer, closed, y, path, along):
    """Predict FEW samples, each from those before; the observer knows no forces and no delay.

    What waits for the sample before is d(k+1) = M d(k) + Phi K y(k) alone; the rest goes along rows.

    Parameters
    ----------
    observer : Observer
    closed : ndarray of float64, shape (n, n)
        M, of `Response`.
    y : ndarray of float64, shape (FEW,)
    path : Path
        Carried on.
    along : Along
        Its errors and motion are filled.
    """
    errors, motion, states, state, push = along.errors, along.motion, path.states, path.state, path.ahead
    order = observer.gain.size
    for i in range(order):
        push[i] = 0.0
        for j in range(order):
            push[i] += observer.transition[i, j] * observer.gain[j]
        states[i, 0] = state[i]
    if order == 2:  # what each sample waits for need not go through memory
        one, other = state[0], state[1]
        for k in range(FEW):
            first = push[0] * y[k] + closed[0, 0] * one + closed[0, 1] * other
            other = push[1] * y[k] + closed[1, 0] * one + closed[1, 1] * other
            one = first
            states[0, k + 1], states[1, k + 1] = one, other
    else:
        for k in range(FEW):
            for i in range(order):
                total = push[i] * y[k]
                for j in range(order):
                    total += closed[i, j] * states[j, k]
                states[i, k + 1] = total
    for k in range(FEW):
        errors[k] = y[k]
    for i in range(order):
        state[i] = states[i, FEW]
        now = states[i]
        for k in range(FEW):
            errors[k] -= observer.output[i] * now[k]
    for part in range(2):
        known, ahead = (motion.x[0], motion.x[1]) if part == 0 else (motion.v[0], motion.v[1])
        news = 0.0
        for i in range(order):
            news += observer.tool[part, i] * observer.gain[i]
        for k in range(FEW):
            known[k], ahead[k] = news * errors[k], 0.0
        for i in range(order):
            shows, now, following = observer.tool[part, i], states[i], states[i, 1:]
            for k in range(FEW):
                known[k] += shows * now[k]
                ahead[k] += shows * following[k]


@njit(**OPTIONS)
def predict(observer, known, y, first, path, along):
    """Predict FEW samples, each from those before.

    Parameters
    ----------
    observer : Observer
    known : Forces
        Forces of the model.
    y : ndarray of float64, shape (FEW,)
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
        e = y[k] - predicted
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
            e -= observer.feed * news
            for i in range(order):
                state[i] += observer.end[i] * news
                e -= observer.output[i] * observer.end[i] * news
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
def motion_of(along, linear, lanes, begins, ends):
    """Displacement, velocity, both one delay ago, at FEW samples and the next: `linear` of them, from column 1 on."""
    motion = along.motion
    for row in range(2):
        columns = begins if row == 0 else ends
        put(columns, lanes, 1, motion.x[row])
        put(columns, lanes, 2, motion.v[row])
        if linear > 2:
            put(columns, lanes, 3, motion.lagged[row])
            put(columns, lanes, 4, along.lagged_v[row])


@njit(**OPTIONS)
def forces_of(observer, tried, linear, first, lanes, path, along, begins, ends):
    """Forces along FEW samples, each into a column, behind those of `motion_of`.

    As straight lines over the step that follows each sample; for a sensor that feels the force, at the sample as known,
    and at the next one as predicted.
    """
    motion, omega, feels = along.motion, observer.omega, observer.feed != 0.0
    for row in range(2 if feels else 1):
        place(observer, motion, first, row, along.nodes[row])
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


@njit(**OPTIONS)
def at_samples(tried, linear, lanes, omega, along, begins, ends):
    """The same, but nearly: forces as they are at samples as known and as predicted, joined by straight lines."""
    x, v, lagged = along.motion.x.ctypes.data, along.motion.v.ctypes.data, along.motion.lagged.ctypes.data
    angle = along.nodes[0, 0, 3].ctypes.data  # of no use to a force that does not ask where the spindle is
    for j in range(tried.rows.size):
        call_row(
            tried.rows[j], x, v, lagged, angle, omega, along.between[0].ctypes.data, parameters_of(tried, j), 2 * FEW,
            along.along.ctypes.data,
        )  # fmt: skip
        put(begins, lanes, 1 + linear + j, along.along)
        put(ends, lanes, 1 + linear + j, along.along[FEW:])


@njit(**OPTIONS)
def sum_up(white, lanes, products, sums):
    """Add products of the columns of FEW rows, and the columns themselves, to their sums."""
    aside = lanes // GROUP
    column = white
    white, products, sums = as_lanes(white, GROUP), as_lanes(products, GROUP), as_lanes(sums, GROUP)
    for group in range(aside):
        total = sums[group]
        for k in range(FEW):
            total = total + white[k * aside + group]
        sums[group] = total
        for i in range(0, lanes, 4):  # four sums side by side: none waits for another
            at = i * aside + group
            one, two = products[at], products[at + aside]
            three, four = products[at + 2 * aside], products[at + 3 * aside]
            for k in range(FEW):
                here, row = k * lanes + i, white[k * aside + group]
                one, two = fma(column[here], row, one), fma(column[here + 1], row, two)
                three, four = fma(column[here + 2], row, three), fma(column[here + 3], row, four)
            products[at], products[at + aside] = one, two
            products[at + 2 * aside], products[at + 3 * aside] = three, four


@njit(cache=True, nogil=True)
def watch(observer, known, tried, nearly, linear, response, y, first, path, along, answers, summary):
    """Whitened prediction errors of the next samples, and whitened signatures beside them.

    Parameters
    ----------
    observer : Observer
    known : Forces
        Forces of the model.
    tried : Tried
    nearly : bool
        Whether forces are evaluated at samples alone: for those without a memory that do not ask for the spindle's
        angle. Half of the work, and columns that are those of the forces but for their highest overtones.
    linear : int
        2, or 4 where the machine has a delay.
    response : Response
        Of the observer; a multiple of four of its taps follow the first.
    y : ndarray of float64, shape (n,)
        n is a multiple of FEW.
    first : int
        Samples since the spindle's angle was 0.
    path, answers : Path, Answers
        Carried on.
    along : Along
        Scratch.
    summary : Summary
        Filled, with errors and signatures: of displacement and velocity as forces, of the same one delay ago if
        `linear` is 4, and of what is tried.
    """
    lanes = summary.sums.size
    few = FEW * lanes
    without = known.forces.size == 0 and observer.delay == 0.0
    begins, ends = answers.begins, answers.ends[lanes:]
    newest = answers.raw[answers.raw.size - few :]
    summary.products[:] = 0.0
    summary.sums[:] = 0.0
    for at in range(0, y.size, FEW):
        part = slice(at, at + FEW)
        if without:
            predict_linear(observer, response.closed, y[part], path, along)
        else:
            predict(observer, known, y[part], first + at, path, along)
        carry(answers.ends, few)
        carry(answers.raw, few)
        for n in range(response.output.size):
            carry(answers.states[n], few)
        motion_of(along, linear, lanes, begins, ends)
        if nearly:
            at_samples(tried, linear, lanes, observer.omega, along, begins, ends)
        else:
            forces_of(observer, tried, linear, first + at, lanes, path, along, begins, ends)
        respond(response, lanes, begins, answers.ends, answers.states, newest)
        put(newest, lanes, 0, along.errors)
        whiten(response.taps, lanes, answers.raw, summary.white)
        sum_up(summary.white, lanes, summary.products, summary.sums)
        for k in range(FEW):
            summary.errors[at + k] = summary.white[k * lanes]
