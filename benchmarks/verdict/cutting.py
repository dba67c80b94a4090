"""The cutting process: modes, a chip whose thickness depends on earlier passes, and the tool leaving the cut.

Written for the benchmark from the equations alone. It shares no code with ``chatter_monitor``: a monitor that is scored
on its own simulator would be scored on its own mistakes as well.

With x the displacement of the tool away from the workpiece, r the run-out of the tooth that cuts and s the surface that
it leaves, both as deviations from the nominal feed h0 a pass,

    h(t) = max(0, h0 - x(t) + r(t) + s(t - tau))          chip thickness
    s(t) = min(s(t - tau) + h0, x(t) - r(t))              a pass that misses leaves the older surface standing
    F(t) = K(t) [h(t) + b/w1 max(0, -x'(t) - vs(t))] + d(t)
                                                          force per unit mass of the first mode
    K(t) = kappa(t) w1^2 alpha(t) (1 + nu(t))             process stiffness: teeth enter and leave, chips vary
    q_i'' + 2 zeta_i w_i q_i' + w_i^2 q_i = g_i F,   x = sum q_i

which is multiple regeneration with loss of contact (Tlusty and Ismail 1981) and a flank that rubs where the vibration
is steeper than the clearance angle, x' < -vs (Eynian and Altintas 2009): it limits chatter well before the tool leaves
the cut. Linear about the nominal cut it is x'' + 2 zeta w x' + w^2 x + kappa alpha w^2 (x - x(t - tau)) = ....
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import expm

Sensor = Literal["displacement", "velocity", "acceleration"]
# b: damping of the rubbing flank over the process stiffness. Regeneration feeds in at most half of kappa as negative
# damping, and one-sided rubbing takes out a quarter of b kappa: 6 saturates every cut.
FLANK = 6.0
SENSORS: tuple[Sensor, ...] = ("displacement", "velocity", "acceleration")


@dataclass(frozen=True)
class Mode:
    """One mode of the structure.

    Attributes
    ----------
    frequency_hz, damping_ratio : float
        Undamped natural frequency and damping of the structure alone.
    compliance : float
        g_i: how much of the force drives it and shows at the tool, against the first mode's 1.
    heard : float
        Its weight in what the sensor picks up.
    """

    frequency_hz: float
    damping_ratio: float
    compliance: float = 1.0
    heard: float = 1.0

    @property
    def omega(self) -> float:
        """Angular frequency in rad/s."""
        return 2.0 * math.pi * self.frequency_hz


@dataclass(frozen=True, eq=False)
class Drive:
    """What the process is driven with, at every step of the integration; arrays of shape (n,).

    Attributes
    ----------
    stiffness : ndarray
        kappa w1^2 alpha (1 + nu), in rad^2/s^2.
    feed : ndarray
        h0.
    run_out : ndarray
        r.
    delay_steps : ndarray
        tau, in steps.
    disturbance : ndarray
        d, force per unit mass from elsewhere.
    steepest : ndarray
        vs, velocity into the workpiece from which on the flank rubs.
    """

    stiffness: NDArray[np.float64]
    feed: NDArray[np.float64]
    run_out: NDArray[np.float64]
    delay_steps: NDArray[np.float64]
    disturbance: NDArray[np.float64]
    steepest: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Motion:
    """What comes of it; arrays of shape (n,).

    Attributes
    ----------
    seen : ndarray
        The quantity that the sensor measures, from the modes.
    force : ndarray
        F.
    into : ndarray
        -x', velocity of the tool into the workpiece.
    limited : ndarray of bool
        Steps in which the tool is out of the cut or the flank rubs: what keeps a vibration from growing further.
    """

    seen: NDArray[np.float64]
    force: NDArray[np.float64]
    into: NDArray[np.float64]
    limited: NDArray[np.bool_]


def vibration(modes: tuple[Mode, ...], drive: Drive, rate_hz: float, sensor: Sensor) -> Motion:
    """Integrate the cut at `rate_hz` from rest.

    The modes are discretised exactly for a force that is linear between the steps; the force at the end of a step
    contains the displacement there and is solved for, so that nothing delays the process stiffness by half a step
    (that would add -kappa w dt / 4 to the damping).
    """
    transition, before, after = (np.empty((len(modes), 2, *tail)) for tail in ((2,), (), ()))
    for i, mode in enumerate(modes):
        transition[i], before[i], after[i] = _discretised(mode, 1.0 / rate_hz)
    table = np.array([(m.omega**2, 2 * m.damping_ratio * m.omega, m.compliance, m.heard) for m in modes])
    n = drive.stiffness.size
    motion = Motion(np.empty(n), np.empty(n), np.empty(n), np.empty(n, np.bool_))
    _integrate(
        transition,
        before,
        after,
        table,
        drive.stiffness,
        drive.feed,
        drive.run_out,
        drive.delay_steps,
        drive.disturbance,
        drive.steepest,
        SENSORS.index(sensor),
        motion.seen,
        motion.force,
        motion.into,
        motion.limited,
    )
    return motion


def _discretised(mode: Mode, step_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Exact step of (q, v) for a linear force: transition, and the weights of the force before and after."""
    generator = np.zeros((4, 4))
    generator[0, 1] = 1.0
    generator[1, :3] = -(mode.omega**2), -2.0 * mode.damping_ratio * mode.omega, mode.compliance
    generator[2, 3] = 1.0 / step_s
    step = expm(generator * step_s)
    after = step[:2, 3]
    return step[:2, :2], step[:2, 2] - after, after


@njit(cache=True)
def _integrate(  # type: ignore[no-untyped-def]
    transition,
    before,
    after,
    table,
    stiffness,
    feed,
    run_out,
    delay_steps,
    disturbance,
    steepest,
    sensor,
    seen,
    forces,
    velocities,
    limited,
):
    modes = table.shape[0]
    longest = 8
    for k in range(delay_steps.size):
        longest = max(longest, int(delay_steps[k]) + 8)
    surface = np.zeros(longest)
    state = np.zeros((modes, 2))
    yielding = 0.0
    for i in range(modes):
        yielding += after[i, 0]
    force = 0.0
    for k in range(seen.size):
        free = 0.0
        into = 0.0
        for i in range(modes):
            q = transition[i, 0, 0] * state[i, 0] + transition[i, 0, 1] * state[i, 1] + before[i, 0] * force
            v = transition[i, 1, 0] * state[i, 0] + transition[i, 1, 1] * state[i, 1] + before[i, 1] * force
            state[i, 0], state[i, 1] = q, v
            free += q
            into -= v
        # the surface one delay ago, by a cubic through four steps
        back = k - delay_steps[k]
        earlier = 0.0
        if back >= 2.0:
            j = int(back)
            u = back - j
            s0 = surface[(j - 1) % longest]
            s1 = surface[j % longest]
            s2 = surface[(j + 1) % longest]
            s3 = surface[(j + 2) % longest]
            earlier = (
                -u * (u - 1.0) * (u - 2.0) / 6.0 * s0
                + (u + 1.0) * (u - 1.0) * (u - 2.0) / 2.0 * s1
                - (u + 1.0) * u * (u - 2.0) / 2.0 * s2
                + (u + 1.0) * u * (u - 1.0) / 6.0 * s3
            )
        rubbing = max(0.0, into - steepest[k]) * FLANK / table[0, 0] ** 0.5
        push = stiffness[k] * rubbing + disturbance[k]
        chip = feed[k] - free - yielding * push + run_out[k] + earlier
        limited[k] = stiffness[k] > 0.0 and (chip <= 0.0 or rubbing > 0.0)
        chip = chip / (1.0 + yielding * stiffness[k]) if chip > 0.0 else 0.0
        force = stiffness[k] * chip + push
        x = 0.0
        heard = 0.0
        for i in range(modes):
            state[i, 0] += after[i, 0] * force
            state[i, 1] += after[i, 1] * force
            q, v = state[i, 0], state[i, 1]
            x += q
            if sensor == 0:
                heard += table[i, 3] * q
            elif sensor == 1:
                heard += table[i, 3] * v
            else:
                heard += table[i, 3] * (table[i, 2] * force - table[i, 1] * v - table[i, 0] * q)
        surface[k % longest] = min(earlier + feed[k], x - run_out[k])
        seen[k] = heard
        forces[k] = force
        velocities[k] = into
