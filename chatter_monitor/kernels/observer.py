"""Prediction errors of a machine.

An `Observer` predicts the next sample of a recording from those before it: the steady Kalman filter of the linear
machine, which knows forces of the catalogue besides. Between two samples forces change linearly, and that linear part
is discretised exactly.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.forces import call_force
from chatter_monitor.kernels.options import OPTIONS, WITHIN

SUBSTEPS = 4  # of a force that jumps, and of a term's memory, between two samples
SMOOTH = 2  # of a force that does not jump: Gauss points
_GAUSS = 0.5 / np.sqrt(3.0)
# Parts of a step at which forces are evaluated: those that jump, and those that do not.
NODES = (*((i + 0.5) / SUBSTEPS for i in range(SUBSTEPS)), 0.5 - _GAUSS, 0.5 + _GAUSS)
# Where `Observer.spread` holds the nodes before the sample at the end of the step is seen, and after; that sample, once
# it is seen, and before.
BEFORE, AFTER, SEEN, AHEAD = 0, len(NODES), 2 * len(NODES), 2 * len(NODES) + 1
# Standard deviations of the velocity within which a force that jumps at 0 is averaged on both sides of that.
BOTH_SIDES = 3.0
_ROOT_2 = np.sqrt(2.0)
_INVERSE_ROOT_2PI = 1.0 / np.sqrt(2.0 * np.pi)
_TAIL = (0.319381530, -0.356563782, 1.781477937, -1.821255978, 1.330274429)


class Observer(NamedTuple):
    """A steady Kalman filter with n states; forces are per unit mass, positive ones push back."""

    transition: np.ndarray  # (n, n) Phi
    begin: np.ndarray  # (n,) Gamma_0: answer to the force at the beginning of a step
    end: np.ndarray  # (n,) Gamma_1: and at its end
    gain: np.ndarray  # (n,) K
    output: np.ndarray  # (n,) H
    feed: float  # D: answer of the sensor to a force at the same instant
    tool: np.ndarray  # (2, n) displacement and velocity of the tool
    spread: np.ndarray  # (AHEAD + 1, 2, 2) square roots of the covariance of their errors
    back: np.ndarray  # (2,) what a prediction error tells of them one sample before
    step_s: float
    omega: float  # angular frequency of the first mode
    delay: float  # from one tooth to the next, in samples; 0 for none
    turn: float  # spindle angle per sample, rad
    chip: float = np.inf  # thickness beyond which x - x(t - tau) means that the tool has left the cut


class Forces(NamedTuple):
    """Forces that the observer knows: addresses, of the rates of their memory (0 for none), and parameters."""

    forces: np.ndarray  # (t,)
    rates: np.ndarray  # (t,)
    substeps: np.ndarray  # (t,) SUBSTEPS or SMOOTH
    columns: np.ndarray  # (t,) first parameter of each
    parameters: np.ndarray  # (p,)
    laws: np.ndarray  # (t,) addresses of the same forces wherever the tool is
    above: np.ndarray  # (t,) amplitude from which on they act; 0 for all
    between: np.ndarray  # (t, 2) first sample from which on they act, and first at which they do not any more


class Motion(NamedTuple):
    """Motion of the tool as the observer sees it, with sample k known (row 0) and as predicted for k + 1 (row 1)."""

    x: np.ndarray  # (2, n)
    v: np.ndarray  # (2, n)
    lagged: np.ndarray  # (2, n)


@njit(**OPTIONS)
def delayed(x, now, delay):
    """Displacement `delay` samples before index `now`, between samples by a cubic; 0 before the start.

    A straight line would take 2.5 % off a vibration of 14 samples a period, half way between two of them; it has to do
    at the ends.
    """
    back = int(np.floor(delay))
    share = delay - back
    i = now - back
    if i < 1 or delay < 1.0:
        return 0.0
    rest = 1.0 - share
    if i < 2 or delay < 2.0:
        return rest * x[i] + share * x[i - 1]
    inner = (1.0 + rest) * (1.0 + share) * (rest * x[i] + share * x[i - 1])
    outer = rest * share * ((1.0 + rest) * x[i + 1] + (1.0 + share) * x[i - 2]) / 3.0
    return 0.5 * (inner - outer)


@njit(cache=True, nogil=True)
def cut_by_the_tooth_before(observer, chip, motion, lagged):
    """Surface that the tooth before left, along a motion that is known: what `observe` does with `Observer.chip`.

    Where the tool is out of the cut the surface stays as it was.

    Parameters
    ----------
    observer : Observer
    chip : float
        Mean uncut chip thickness.
    motion : Motion
    lagged : ndarray of float64, shape (2, n)
        Filled, as `motion.lagged` is for a tool that never leaves.
    """
    x = motion.x[0]
    surface = np.zeros(x.size)
    for k in range(x.size):
        lagged[0, k] = delayed(surface, k, observer.delay)
        surface[k] = min(x[k], lagged[0, k] + chip)
        lagged[1, k] = delayed(surface, k + 1, observer.delay)


@njit(**OPTIONS)
def either_side(expected):
    """A normal variable of unit variance where it is below 0, and where it is above.

    For each side the chance of it, the mean there from what was expected, and the scatter. The tail is that of
    Abramowitz and Stegun (26.2.17), good to 1e-7.
    """
    far = abs(expected)
    density = _INVERSE_ROOT_2PI * math.exp(-0.5 * far * far)
    t = 1.0 / (1.0 + 0.2316419 * far)
    ratio = t * (_TAIL[0] + t * (_TAIL[1] + t * (_TAIL[2] + t * (_TAIL[3] + t * _TAIL[4]))))
    beyond = density * ratio  # on the side that is not expected
    mean, other = 1.0 / ratio, density / (1.0 - beyond)
    scatter = math.sqrt(max(1.0 - mean * (mean - far), 0.0))
    wider = math.sqrt(max(1.0 - other * (other + far), 0.0))
    if expected < 0.0:
        return (1.0 - beyond, -other, wider), (beyond, mean, scatter)
    return (beyond, -mean, scatter), (1.0 - beyond, other, wider)


@njit(**OPTIONS)
def on_both_sides(address, far, column, x, v, lagged, angle, omega, z, parameters, spread):
    """Force averaged over two points, as far on both sides of the tool's state along a column of the spread."""
    dx, dv = far * spread[0, column], far * spread[1, column]
    force = call_force(address, x + dx, v + dv, lagged, angle, omega, z, parameters)
    return 0.5 * (force + call_force(address, x - dx, v - dv, lagged, angle, omega, z, parameters))


@njit(**OPTIONS)
def averaged(address, x, v, lagged, angle, omega, z, parameters, spread, column):
    """Smooth force averaged over what is not known of the tool's state: two cubature points for each column in turn."""
    return on_both_sides(address, _ROOT_2, column, x, v, lagged, angle, omega, z, parameters, spread)


@njit(**OPTIONS)
def averaged_jump(address, x, v, lagged, angle, omega, z, parameters, spread):
    """Force that jumps, averaged over what is not known of the tool's state.

    It does so where the velocity, the first column of the spread, is 0: each side of that gives two points, so that the
    average is a smooth function of all that it depends on.
    """
    if abs(v) >= BOTH_SIDES * spread[1, 0]:
        return on_both_sides(address, 1.0, 0, x, v, lagged, angle, omega, z, parameters, spread)
    force = 0.0
    for share, mean, scatter in either_side(v / spread[1, 0]):
        for point in (mean - scatter, mean + scatter):
            dx, dv = point * spread[0, 0], point * spread[1, 0]
            force += 0.5 * share * call_force(address, x + dx, v + dv, lagged, angle, omega, z, parameters)
    return force


@njit(**OPTIONS)
def share_above(above, x, v, omega, spread):
    """Chance that the amplitude sqrt(x^2 + (v / w)^2) is at least `above`, with what is not known of the tool's state.

    It is near enough a normal variable: what is not known across the direction of (x, v / w) makes it larger, what is
    not known along it makes it scatter.
    """
    if above == 0.0:
        return 1.0
    amplitude = math.hypot(x, v / omega)
    cos, sin = x / amplitude, v / (omega * amplitude)
    along = across = 0.0
    for i in range(2):
        dx, dv = spread[0, i], spread[1, i] / omega
        along += (cos * dx + sin * dv) ** 2
        across += (cos * dv - sin * dx) ** 2
    expected = amplitude + 0.5 * across / amplitude
    return 0.5 * math.erfc((above - expected) / (_ROOT_2 * math.sqrt(along)))


@njit(**OPTIONS)
def node_of(substeps, i):
    """Which of `NODES` the i-th is at which a force is evaluated that jumps (SUBSTEPS), or does not (SMOOTH)."""
    return SUBSTEPS + i if substeps == SMOOTH else i


@njit(**OPTIONS)
def on_step(s, x0, v0, x1, v1, step_s):
    """Displacement and velocity on a step over which the tool moves along a cubic, s from 0 to 1."""
    r = 1.0 - s
    x = r * r * (1.0 + 2.0 * s) * x0 + s * s * (1.0 + 2.0 * r) * x1 + step_s * s * r * (r * v0 - s * v1)
    v = 6.0 * s * r * (1.0 / step_s) * (x1 - x0) + r * (1.0 - 3.0 * s) * v0 + s * (3.0 * s - 2.0) * v1
    return x, v


@njit(**OPTIONS)
def about(s, x, v, omega, step_s):
    """Displacement and velocity from half a step before a sample to half a step after, s from 0 to 1."""
    t = (s - 0.5) * step_s
    return x + t * v, v - t * omega * omega * x


# Left to itself the compiler takes the loop over a step out of that over the samples, for its size. All that is the
# same at every sample is then loaded again at each of them, which is a sixth of the time of a smooth force.
@njit(**WITHIN)
def over_step(
    address, substeps, above, x0, v0, x1, v1, lagged0, lagged1, angle, turn, omega, z0, z1, parameters, spread, when,
    step_s,
):  # fmt: skip
    """Force over one step as a straight line, its values at both ends, for a sensor of what the force has moved.

    Between the samples the tool moves along a cubic; the line has the mean and the first moment of the force on
    it, so that a jump within the step (friction, contact) counts when it happens. What is not known of the tool's state
    there, BEFORE or AFTER its end is seen, is averaged over.
    """
    mean = 0.0
    slope = 0.0
    square = 0.0
    for i in range(substeps):
        node = node_of(substeps, i)
        s = NODES[node]
        x, v = on_step(s, x0, v0, x1, v1, step_s)
        lagged = (1.0 - s) * lagged0 + s * lagged1
        z = (1.0 - s) * z0 + s * z1
        turned = angle + s * turn
        there = spread[when + node]
        if substeps == SMOOTH:
            force = averaged(address, x, v, lagged, turned, omega, z, parameters, there, i)
        else:
            force = averaged_jump(address, x, v, lagged, turned, omega, z, parameters, there)
            force *= share_above(above, x, v, omega, there)
        mean += force
        slope += force * (s - 0.5)
        square += (s - 0.5) ** 2
    mean *= 1.0 / substeps
    slope *= 1.0 / square
    return mean - 0.5 * slope, mean + 0.5 * slope


@njit(**OPTIONS)
def at_sample(address, substeps, above, x0, v0, lagged, angle, turn, omega, z, parameters, spread, step_s):
    """Force at a sample, for a sensor that feels the force itself.

    Its low-pass and the filter's own idea of the force, one number per sample, leave of a jump the mean from half a
    step before to half a step after; a smooth force is taken as it is.
    """
    if substeps == SMOOTH:
        force = averaged(address, x0, v0, lagged, angle, omega, z, parameters, spread, 0)
        return 0.5 * (force + averaged(address, x0, v0, lagged, angle, omega, z, parameters, spread, 1))
    mean = 0.0
    for i in range(substeps):
        s = NODES[i]
        x, v = about(s, x0, v0, omega, step_s)
        turned = angle + turn * (s - 0.5)
        force = averaged_jump(address, x, v, lagged, turned, omega, z, parameters, spread)
        mean += force * share_above(above, x, v, omega, spread)
    return mean / substeps


@njit(**OPTIONS)
def remembered(rate_address, x0, v0, x1, v1, lagged, angle, omega, z, parameters, step_s):
    """Memory of a term at the end of a step over which the tool moves from (x0, v0) to (x1, v1).

    Linearly implicit midpoint steps, which a joint that yields within a fraction of the step cannot upset.
    """
    h = step_s / SUBSTEPS
    for i in range(SUBSTEPS):
        share = (i + 0.5) / SUBSTEPS
        x, v = x0 + share * (x1 - x0), v0 + share * (v1 - v0)
        probe = 1e-6 * (abs(z) + abs(v) * h) + 1e-300
        rate = call_force(rate_address, x, v, lagged, angle, omega, z, parameters)
        slope = (call_force(rate_address, x, v, lagged, angle, omega, z + probe, parameters) - rate) / probe
        z += h * rate / (1.0 - 0.5 * h * min(slope, 0.0))
    return z


@njit(**WITHIN)
def known_over_step(observer, known, x0, v0, x1, v1, lagged0, lagged1, angle, memory, when, reached, k):
    """Known forces over the step from sample k at its two ends, for a sensor that feels the force at its end alone.

    `reached` is filled with their memory at the end.
    """
    omega, turn, step, spread = observer.omega, observer.turn, observer.step_s, observer.spread
    begins = ends = 0.0
    for j in range(known.forces.size):
        address, substeps, above = known.laws[j], known.substeps[j], known.above[j]
        if not known.between[j, 0] <= k < known.between[j, 1]:
            reached[j] = 0.0
            continue
        p = known.parameters.ctypes.data + 8 * known.columns[j]
        z = memory[j]
        if known.rates[j] != 0:
            z = remembered(known.rates[j], x0, v0, x1, v1, lagged1, angle, omega, z, p, step)
        reached[j] = z
        if observer.feed != 0.0:
            there = spread[SEEN if when == AFTER else AHEAD]
            ends += at_sample(address, substeps, above, x1, v1, lagged1, angle + turn, turn, omega, z, p, there, step)
        else:
            begin, end = over_step(
                address, substeps, above, x0, v0, x1, v1, lagged0, lagged1, angle, turn, omega, memory[j], z, p, spread,
                when, step,
            )  # fmt: skip
            begins += begin
            ends += end
    return begins, ends


@njit(cache=True, nogil=True)
def observe(observer, known, y, missing, settled, errors, motion):
    """Predict every sample from those before it.

    Parameters
    ----------
    observer : Observer
    known : Forces
        Forces of the model.
    y : ndarray of float64, shape (n,)
        The recording.
    missing : ndarray of bool, shape (n,)
        Samples that are not to be used; their errors are 0.
    settled : ndarray of bool, shape (n,)
        Samples at which the filter has forgotten where it began; what it takes for the motion before is no reason for a
        force (a start at rest lets a filter of accelerations swing far out, and a hard spring would throw it farther).
    errors : ndarray of float64, shape (n,)
        Filled with the prediction errors (innovations).
    motion : Motion
        Filled.
    """
    order = observer.gain.size
    state = np.zeros(order)
    ahead = np.zeros(order)
    count = known.forces.size
    memory, reached = np.zeros(count), np.zeros(count)
    early = late = 0.0  # known forces predicted for the two ends of the step to this sample
    feels = observer.feed != 0.0
    surface = np.zeros(y.size)
    x = v = lagged = 0.0
    for k in range(y.size):
        predicted = observer.feed * late
        for i in range(order):
            predicted += observer.output[i] * state[i]
        e = 0.0 if missing[k] else y[k] - predicted
        errors[k] = e
        angle = observer.turn * k
        # Once the sample is seen the forces on the way to it are known better than they were predicted.
        x_before, v_before, lagged_before = x + observer.back[0] * e, v + observer.back[1] * e, lagged
        lagged = delayed(surface, k, observer.delay)
        x = v = 0.0
        for i in range(order):
            x += observer.tool[0, i] * (state[i] + observer.gain[i] * e)
            v += observer.tool[1, i] * (state[i] + observer.gain[i] * e)
        if count and k > 0 and settled[k] and settled[k - 1]:
            begins, ends = known_over_step(
                observer, known, x_before, v_before, x, v, lagged_before, lagged, angle - observer.turn, memory, AFTER,
                reached, k - 1,
            )  # fmt: skip
            for j in range(count):
                memory[j] = reached[j]
            if not missing[k]:
                e -= observer.feed * (ends - late)
                for i in range(order):
                    news = observer.end[i] * (ends - late)
                    if not feels:
                        news += observer.begin[i] * (begins - early)
                    state[i] += news
                    e -= observer.output[i] * news
            late = ends
        x = v = 0.0
        for i in range(order):
            state[i] += observer.gain[i] * e
            x += observer.tool[0, i] * state[i]
            v += observer.tool[1, i] * state[i]
        motion.x[0, k] = x
        motion.v[0, k] = v
        motion.lagged[0, k] = lagged
        surface[k] = min(x, lagged + observer.chip)
        for i in range(order):
            total = 0.0
            for j in range(order):
                total += observer.transition[i, j] * state[j]
            ahead[i] = total
        # The force on the way to the next sample, from where the tool would go with the force as it was.
        lagged_next = delayed(surface, k + 1, observer.delay)
        if not settled[k]:
            late = 0.0
        early = late
        xp = vp = 0.0
        for attempt in range(3 if count and settled[k] else 1):
            if attempt > 0:
                begins, late = known_over_step(
                    observer, known, x, v, xp, vp, lagged, lagged_next, angle, memory, BEFORE, reached, k
                )
                early = early if feels else begins
            xp = vp = 0.0
            for i in range(order):
                reaching = ahead[i] + observer.begin[i] * early + observer.end[i] * late
                xp += observer.tool[0, i] * reaching
                vp += observer.tool[1, i] * reaching
        for i in range(order):
            state[i] = ahead[i] + observer.begin[i] * early + observer.end[i] * late
        motion.x[1, k] = xp
        motion.v[1, k] = vp
        motion.lagged[1, k] = lagged_next
