"""Motion of one mode under a hidden force: exact in everything linear, split in time for the rest.

Kicks by the hidden force alternate with the exact linear motion and the exact increments of the white force (Strang
splitting, second order; the motion is read in the middle of a kick). Dry friction is applied implicitly in the kick, so
that it stops the motion where it would reverse it. The random increments of a long step follow from those of two short
ones (`coarser`), so that convergence can be seen on one and the same path of the noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from chatter_monitor.discrepancy.prove.blind.laws import CONTACT, dry, lag_s, memory_rate, push

Array = NDArray[np.float64]

FINITE = -1
_LONGEST_LAG_S = 0.16
_MOST = 4  # numbers that a law takes


class Hidden(NamedTuple):
    """A hidden force and where it acts.

    Attributes
    ----------
    law : int
        One of `laws`.
    p : ndarray of float64
        Its amplitude and shapes.
    w : float
        Angular frequency of the mode.
    from_s, until_s : float
        When it acts.
    above : float
        It acts where the amplitude sqrt(x^2 + (v / w)^2) exceeds this.
    """

    law: int
    p: Array
    w: float
    from_s: float = -math.inf
    until_s: float = math.inf
    above: float = 0.0


def transition(w: float, zeta: float, seconds: float) -> Array:
    """Exact motion of the free mode over a time, shape (2, 2), for the state (x, v)."""
    decay, wd = math.exp(-zeta * w * seconds), w * math.sqrt(1.0 - zeta * zeta)
    c, s = math.cos(wd * seconds), math.sin(wd * seconds) / wd
    return decay * np.array([[c + zeta * w * s, s], [-w * w * s, c - zeta * w * s]])


def noise_factor(modes: Sequence[tuple[float, float]], step_s: float) -> Array:
    """L with L L' the covariance of what unit white noise adds to the states of all modes in a step.

    The integral of Phi(s) b b' Phi(s)' over the step is taken by Gauss-Legendre quadrature, exact to rounding for
    steps far below a period.

    Parameters
    ----------
    modes : sequence of (float, float)
        Angular frequency and damping ratio of each; all feel the same noise.
    step_s : float
        The step.

    Returns
    -------
    ndarray of float64, shape (2 modes, 2 modes)
    """
    size = 2 * len(modes)
    nodes, weights = np.polynomial.legendre.leggauss(size + 2)
    at = 0.5 * step_s * (nodes + 1.0)
    columns = np.array([np.concatenate([transition(w, z, s)[:, 1] for w, z in modes]) for s in at])
    _, upper = np.linalg.qr(columns * np.sqrt(0.5 * step_s * weights)[:, None])
    return np.ascontiguousarray(upper.T)


def coarser(increments: Array, fine: Array) -> Array:
    """Increments over steps twice as long, on the same path; `fine` is the transition of the short step."""
    return np.asarray(increments[0::2] @ fine.T + increments[1::2])


def march(
    hidden: Hidden,
    zeta: float,
    step_s: float,
    increments: Array,
    drive: Array,
    start_s: float,
    x: Array,
    v: Array,
    force: Array,
) -> int:
    """Run one mode from rest.

    Parameters
    ----------
    hidden : Hidden
        What is concealed in it.
    zeta : float
        Damping ratio.
    step_s : float
        Step.
    increments : ndarray of float64, shape (n, 2)
        What the white force adds to (x, v) in each step.
    drive : ndarray of float64, shape (n,) or (0,)
        Smooth force per unit mass at the beginning of each step, if there is one.
    start_s : float
        Time of the first step; the recording begins at 0.
    x, v, force : ndarray of float64, shape (n,)
        Filled with displacement, velocity and hidden force at the beginning of each step.

    Returns
    -------
    int
        `FINITE`, or the step at which the motion left the range of numbers.
    """
    past = np.zeros(math.ceil(_LONGEST_LAG_S / step_s) + 4)
    p = np.zeros(_MOST)
    p[: hidden.p.size] = hidden.p
    window = (hidden.from_s, hidden.until_s, hidden.above)
    phi = transition(hidden.w, zeta, step_s)
    # Numbers travel by value in a tuple; an array would be counted at every call.
    run = _march(hidden.law, tuple(p), hidden.w, window, phi, step_s, increments, drive, start_s, past, x, v, force)
    return int(run)


@njit(cache=True, nogil=True)
def _lagged(past, n, steps):
    """Displacement some steps before step n, linear between the steps."""
    whole = int(steps)
    share = steps - whole
    if n - whole - 1 < 0:
        return 0.0
    return (1.0 - share) * past[(n - whole) % past.size] + share * past[(n - whole - 1) % past.size]


@njit(cache=True, nogil=True)
def _kick(law, p, w, gate, x, v, z, lagged, time_s, outer, seconds):
    """Velocity, memory and hidden force after a time at a fixed displacement (midpoint rule, friction implicit)."""
    half_v = v + 0.5 * seconds * (outer - gate * push(law, x, v, z, lagged, time_s, w, p))
    half_z = z + 0.5 * seconds * memory_rate(law, x, v, z, p)
    force = gate * push(law, x, half_v, half_z, lagged, time_s, w, p)
    v += seconds * (outer - force)
    z += seconds * memory_rate(law, x, half_v, half_z, p)
    friction = gate * dry(law, x, v, p)
    if friction > 0.0:
        held = math.copysign(min(friction * seconds, abs(v)), v)
        v -= held
        force += held / seconds
    return v, z, force


@njit(cache=True, nogil=True)
def _march(law, p, w, window, phi, step_s, increments, drive, start_s, past, x, v, force):
    from_s, until_s, above = window
    a = 0.0
    b = 0.0
    z = 0.0
    for n in range(increments.shape[0]):
        time_s = start_s + n * step_s
        gate = 1.0 if from_s <= time_s < until_s else 0.0
        if above > 0.0 and a * a + (b / w) ** 2 < above**2:
            gate = 0.0
        outer = drive[n] if drive.size > 0 else 0.0
        lagged = 0.0
        lag = lag_s(law, a, p)
        if lag > 0.0:
            past[n % past.size] = a
            lagged = _lagged(past, n, lag / step_s)
            if law == CONTACT:  # the surface stays as the tooth before left it where the tool is out of the cut
                past[n % past.size] = min(a, lagged + p[2])
        # The second half of the kick that ends a step and the first half of the next one's, in one.
        kicked, z, force[n] = _kick(law, p, w, gate, a, b, z, lagged, time_s, outer, step_s)
        x[n] = a
        v[n] = 0.5 * (b + kicked)
        if not math.isfinite(kicked) or abs(a) > 1e6:
            return n
        a, b = (
            phi[0, 0] * a + phi[0, 1] * kicked + increments[n, 0],
            phi[1, 0] * a + phi[1, 1] * kicked + increments[n, 1],
        )
    return FINITE
