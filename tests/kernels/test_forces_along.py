"""Forces along rows of states against the same forces sample by sample, by the observer or, if they jump, naively."""

import numpy as np
import pytest

from chatter_monitor.discrepancy.innovations import rate_of, substeps_of, tried_forces
from chatter_monitor.discrepancy.observer import Linear, observer, sized
from chatter_monitor.kernels.forces_along import MEDIANS, SHARES, forces_along
from chatter_monitor.kernels.observer import (
    AHEAD,
    BEFORE,
    NODES,
    SEEN,
    SUBSTEPS,
    Motion,
    about,
    at_sample,
    on_step,
    over_step,
    remembered,
)
from chatter_monitor.physics.parts import Mode, Spindle
from chatter_monitor.physics.terms import CATALOGUE

TRIED = [
    (CATALOGUE["cubic_stiffness"], (1.0,)),
    (CATALOGUE["hysteresis"], (1.0, 0.7, 0.6)),
    (CATALOGUE["coulomb_friction"], (1.0, 0.0)),
    (CATALOGUE["hysteresis"], (2.0, 0.2, 0.9)),
    (CATALOGUE["stribeck_friction"], (0.4, 1.0, 900.0)),
    (CATALOGUE["loss_of_contact"], (1.0, 0.5)),
]


def sample_by_sample(o, motion, settled, term, values):
    """One term alone."""
    force, z = np.zeros((2, settled.size)), 0.0
    address, rate, substeps = term.compiled_force.address, rate_of(term), substeps_of(term)
    parameters = np.array(values)
    p, omega, step = parameters.ctypes.data, o.omega, o.step_s
    for k in np.arange(settled.size):
        if not settled[k]:
            z = 0.0
            continue
        (x, xp), (v, vp), (lagged, lp) = motion.x[:, k], motion.v[:, k], motion.lagged[:, k]
        angle = o.turn * k
        ahead = remembered(rate, x, v, xp, vp, lp, angle, omega, z, p, step) if rate else z
        if o.feed:
            force[0, k] = at_sample(
                address, substeps, 0.0, x, v, lagged, angle, o.turn, omega, z, p, o.spread[SEEN], step
            )
            force[1, k] = at_sample(
                address, substeps, 0.0, xp, vp, lp, angle + o.turn, o.turn, omega, ahead, p, o.spread[AHEAD], step
            )
        else:
            force[:, k] = over_step(
                address,
                substeps,
                0.0,
                x,
                v,
                xp,
                vp,
                lagged,
                lp,
                angle,
                o.turn,
                omega,
                z,
                ahead,
                p,
                o.spread,
                BEFORE,
                step,
            )
        if rate and k + 1 < settled.size:
            xn, vn, ln = motion.x[0, k + 1], motion.v[0, k + 1], motion.lagged[0, k + 1]
            z = remembered(rate, x, v, xn, vn, ln, angle, omega, z, p, step)
    return force


def jumping(o, motion, settled, term, values):
    """One term that jumps at v = 0 and feels nothing but the velocity, over each step as a straight line."""
    force = np.zeros((2, settled.size))
    parts = np.array(NODES[:SUBSTEPS])

    def at(v, node, spread):
        far, share = MEDIANS[node % 2], SHARES[node % 2]
        if abs(v) >= MEDIANS[0][1] * spread[1, 0]:
            far, share = (1.0,), (0.5,)
        there = [v + sign * d * spread[1, 0] for d in far for sign in (-1.0, 1.0)]
        return np.repeat(share, 2) @ [term.force(0.0, u, 0.0, 0.0, o.omega, 0.0, values) for u in there]

    for k in np.flatnonzero(settled):
        (x, xp), (v, vp) = motion.x[:, k], motion.v[:, k]
        if o.feed:
            for row, (x0, v0, spread) in enumerate(((x, v, o.spread[SEEN]), (xp, vp, o.spread[AHEAD]))):
                along = [about(s, x0, v0, o.omega, o.step_s)[1] for s in parts]
                force[row, k] = np.mean([at(u, node, spread) for node, u in enumerate(along)])
        else:
            along = [on_step(s, x, v, xp, vp, o.step_s)[1] for s in parts]
            found = np.array([at(u, node, o.spread[BEFORE + node]) for node, u in enumerate(along)])
            slope = found @ (parts - 0.5) / np.sum((parts - 0.5) ** 2)
            force[:, k] = found.mean() - 0.5 * slope, found.mean() + 0.5 * slope
    return force


@pytest.mark.parametrize("quantity", ["displacement", "acceleration"])
def test_forces_of_many_terms_are_those_of_each_alone(quantity):
    """Over any number of samples and with gaps, near a jump and away from it, with memory and without."""
    rng = np.random.default_rng(3)
    n = 203
    linear = Linear((Mode(400.0, 0.02),), quantity, 1e-3, spindle=Spindle(9000.0))
    o = sized(observer(linear, 5600.0), 0.3)
    t = o.omega * np.arange(n + 1) * o.step_s
    x, v = np.sin(t), o.omega * np.cos(t)
    rows = [np.stack([row[:-1], row[1:]]) for row in (x, v, np.roll(x, 9))]
    motion = Motion(*(row + 0.05 * np.std(row) * rng.standard_normal(row.shape) for row in rows))
    settled = (np.arange(n) > 20) & (np.arange(n) // 40 != 2)
    found = np.full((len(TRIED), 2, n), np.nan)
    forces_along(o, motion, settled, tried_forces(TRIED), found)
    for (term, values), force in zip(TRIED, found, strict=True):
        expected = (sample_by_sample if term.smooth else jumping)(o, motion, settled, term, values)
        assert np.any(expected)
        # A memory changes by a slope that is a difference: it keeps ten digits.
        np.testing.assert_allclose(force, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())
