"""Which mode it may be that chatters, and where its cut would be stable: many that might be, each with its weight.

One mode with a regenerative delay (equation in `regeneration`) chatters above its own frequency. By how much depends on
its damping, on the depth and, most of all, on which part of a wave is left over between two teeth, which is more than
half of one. So a frequency and a delay say where the mode is, for each damping and depth that is usual.

But teeth that enter and leave couple two directions, and what deflects one of them may make the chip thicker. Then any
part of a wave may be left over and says nothing, and the mode is somewhere near the chatter. Where no single mode
explains it, it is that; else that may be, too.
"""

import math

import numpy as np
from numba import njit

from chatter_monitor.kernels.delay_roots import critical_coefficient, opposite_critical_coefficient, rightmost_root
from chatter_monitor.kernels.options import OPTIONS, WITHIN

# What is usual, all of it equally likely: damping ratios of a machine and its tool (Altintas, Manufacturing Automation,
# 2000), and how deep a cut that chatters is, over its limit.
DAMPING_RATIOS = (0.01, 0.017, 0.03, 0.05)
DEPTHS = (1.1, 1.4, 1.8, 2.4)
# Frequencies of a single mode over that of its chatter.
LOWEST, STEP, RATIOS = 0.7225, 0.005, 56
# How far off the chatter of such a mode may be, relatively: teeth enter and leave, and no machine has one mode alone.
TOLERANCE = 0.006
# A mode whose chatter would be farther off, by so many times that, is none.
FARTHEST = 3.5
# Frequencies of the modes of two directions over that of their chatter, and how likely it is theirs, whatever is left
# over of a wave.
FREQUENCY_RATIOS, TWO_DIRECTIONS = (0.98, 0.99, 1.0, 1.01, 1.02), 0.5
# How often a speed that suits such modes is stable: other modes have their limits, too (development cuts of
# `benchmarks.verdict` and of its milling).
SINGLE_HOLDS, COUPLED_HOLDS = 0.7, 0.55
# No more than so much depth over the present counts (natural logarithm): five times as deep or ten is all the same.
MOST_DEPTH = math.log(5.0)

SINGLE = RATIOS * len(DAMPING_RATIOS) * len(DEPTHS)
COUPLED = len(FREQUENCY_RATIOS) * len(DAMPING_RATIOS) * len(DEPTHS) * 2
OMEGA, ZETA, KAPPA, WEIGHT = range(4)


def room(delays: int) -> np.ndarray:
    """Return space for the modes of so many delays."""
    return np.empty((delays * SINGLE + COUPLED, WEIGHT + 1))


@njit(**OPTIONS)
def weigh_modes(chatter_hz, tau_s, modes):
    """Find out how likely each mode is that of the chatter.

    Parameters
    ----------
    chatter_hz : float
        Frequency of the chatter.
    tau_s : ndarray, shape (delays,)
        Time between two teeth in seconds; several where it is not known, equally likely.
    modes : ndarray of float64, shape (delays * SINGLE + COUPLED, 4)
        Angular frequency, damping ratio, kappa, negative where the chip gets thicker, and weight of each; the weights
        add up to how likely it is any of them alone. Overwritten.
    """
    delays = tau_s.shape[0]
    coupled = modes[delays * SINGLE :]
    _lay_out_coupled(chatter_hz, coupled)
    total = 0.0
    for delay in range(delays):
        single = modes[delay * SINGLE : (delay + 1) * SINGLE]
        whole = _weigh_single(chatter_hz, tau_s[delay], single)
        if whole > 0.0:
            # of a single mode one of these parts of a wave is left over, half of all: each is twice as likely
            share = 2.0 * (1.0 - TWO_DIRECTIONS)
            for row in range(SINGLE):
                single[row, WEIGHT] *= SINGLE_HOLDS * share / whole
            total += share
        _weigh_coupled(TWO_DIRECTIONS, tau_s[delay], coupled)
        total += TWO_DIRECTIONS
    for row in range(modes.shape[0]):
        modes[row, WEIGHT] /= total


@njit(**OPTIONS)
def _lay_out_coupled(chatter_hz, modes):
    """Modes of two directions, near the chatter and either way round, without a weight yet."""
    row = 0
    for ratio in FREQUENCY_RATIOS:
        for zeta in DAMPING_RATIOS:
            for depth in DEPTHS:
                for sign in (1.0, -1.0):
                    modes[row, OMEGA], modes[row, ZETA] = 2.0 * math.pi * chatter_hz * ratio, zeta
                    # over its limit at the worst speed
                    modes[row, KAPPA] = sign * depth * 2.0 * zeta * (1.0 + sign * zeta)
                    modes[row, WEIGHT] = 0.0
                    row += 1


@njit(**OPTIONS)
def _weigh_coupled(share, tau_s, modes):
    """Share out how likely it is any of them among those that are unstable with this delay."""
    unstable = 0
    for row in range(COUPLED):
        unstable += _over(modes[row], tau_s) <= 1.0
    for row in range(COUPLED):
        if _over(modes[row], tau_s) <= 1.0:
            modes[row, WEIGHT] += COUPLED_HOLDS * share / unstable


@njit(**OPTIONS)
def _weigh_single(chatter_hz, tau_s, modes):
    """Modes that chatter with this delay, by how near that is; returns the sum of the weights."""
    row, whole = 0, 0.0
    for i in range(RATIOS):
        ratio = LOWEST + STEP * i
        omega = 2.0 * math.pi * chatter_hz * ratio
        for zeta in DAMPING_RATIOS:
            limit = critical_coefficient(omega, zeta, tau_s)
            for depth in DEPTHS:
                kappa = depth * limit
                root = rightmost_root(omega, zeta, kappa, tau_s)
                off = abs(math.log(root.imag * ratio)) / TOLERANCE
                weight = math.exp(-0.5 * off * off) if off < FARTHEST else 0.0
                modes[row, OMEGA], modes[row, ZETA], modes[row, KAPPA], modes[row, WEIGHT] = omega, zeta, kappa, weight
                whole += weight
                row += 1
    return whole


@njit(**OPTIONS)
def chances(modes, tau_s, stable, deeper):
    """How likely the cut is stable with other delays, and how much deeper it could be than it is.

    Parameters
    ----------
    modes : ndarray
        As of `weigh_modes`.
    tau_s : ndarray, shape (n,)
        Time between two teeth.
    stable, deeper : ndarray of float64, shape (n,)
        Probability, and the mean natural logarithm of the limit over the depth; overwritten.
    """
    stable[:] = 0.0
    deeper[:] = 0.0
    for row in range(modes.shape[0]):
        weight = modes[row, WEIGHT]
        if weight == 0.0:
            continue
        for i in range(tau_s.shape[0]):
            over = _over(modes[row], tau_s[i])
            stable[i] += weight * (over > 1.0)
            deeper[i] += weight * min(math.log(over), MOST_DEPTH)


@njit(**WITHIN)
def _over(mode, tau_s):
    """Limit of a mode's kappa with a delay, over what it has; limits of either sign are apart."""
    if mode[KAPPA] < 0.0:
        return opposite_critical_coefficient(mode[OMEGA], mode[ZETA], tau_s) / mode[KAPPA]
    return critical_coefficient(mode[OMEGA], mode[ZETA], tau_s) / mode[KAPPA]
