"""Forces that belong to no term: bumps over the phase plane, over the amplitude, along time and spindle angle.

Each basis asks one question ("is there any static force?", "does it depend on the amplitude?", "on the time?") without
naming an answer.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp

from chatter_monitor.discrepancy.innovations import Innovations
from chatter_monitor.kernels.observer import Motion
from chatter_monitor.kernels.splines import cubic_splines

Matrix = NDArray[np.float64]

BUMPS = 7  # per axis of the phase plane
AXIS_BUMPS = 19  # over displacement or velocity alone: a third of the rms from one to the next
REACH = 3.2  # of the bumps, in standard deviations
AMPLITUDES = 5
WAVES = 4  # of slow changes along the recording
MEMORIES_S = (0.02, 0.08, 0.32)  # of what depends on the motion before
HARMONICS = 3  # of the spindle and of the teeth


def splines(u: Matrix, count: int, low: float, high: float) -> Matrix:
    """Cubic B-splines on equal knots; what lies beyond the ends counts as at the ends.

    Parameters
    ----------
    u : ndarray of float64, any shape
    count : int
        How many.

    Returns
    -------
    ndarray of float64, shape (count, *u.shape)
    """
    found = np.empty((count, u.size))
    cubic_splines(np.ascontiguousarray(u, dtype=np.float64).ravel(), low, high, found)
    return found.reshape(count, *u.shape)


def scales(motion: Motion) -> tuple[float, float]:
    """Rms displacement and velocity about their mean."""
    return float(np.std(motion.x[0])), float(np.std(motion.v[0]))


def retuning(innovations: Innovations) -> Matrix:
    """Signatures of a spring, of a damper, and of a constant force where the sensor sees what it does."""
    motion = innovations.motion
    forces = [motion.x, motion.v]
    if innovations.linear.quantity == "displacement":  # elsewhere nothing is left of it but how it began
        forces.append(np.ones_like(motion.x))
    return innovations.respond(forces)


def surface(innovations: Innovations) -> Matrix:
    """Signatures of BUMPS x BUMPS bumps over the phase plane, displacement first."""
    sd_x, sd_v = scales(innovations.motion)
    over_x = splines(innovations.motion.x / sd_x, BUMPS, -REACH, REACH)
    over_v = splines(innovations.motion.v / sd_v, BUMPS, -REACH, REACH)
    return innovations.respond(over_x, over_v)


def along(u: Matrix) -> Matrix:
    """AXIS_BUMPS bumps over displacement or velocity alone, given in standard deviations."""
    return splines(u, AXIS_BUMPS, -REACH, REACH)


def surface_at(coefficients: Matrix, x: Matrix, v: Matrix) -> Matrix:
    """Force surface of coefficients of `surface`, at x and v in standard deviations."""
    over_x, over_v = splines(x, BUMPS, -REACH, REACH), splines(v, BUMPS, -REACH, REACH)
    return np.asarray(np.einsum("ij,i...,j...->...", coefficients.reshape(BUMPS, BUMPS), over_x, over_v))


def by_amplitude(innovations: Innovations) -> Matrix:
    """Signatures of a spring and of a damper at each of several amplitudes."""
    motion = innovations.motion
    sd_x, sd_v = scales(motion)
    amplitude = np.hypot(motion.x / sd_x, motion.v / sd_v)
    bumps = splines(amplitude, AMPLITUDES, 0.0, 3.5)
    w = sd_v / sd_x
    return innovations.respond([w * w * motion.x, w * motion.v], bumps)


def by_memory(innovations: Innovations) -> Matrix:
    """Signatures of a spring and of a damper that follow the energy of the last moments."""
    motion = innovations.motion
    sd_x, sd_v = scales(motion)
    energy = 0.5 * ((motion.x / sd_x) ** 2 + (motion.v / sd_v) ** 2)
    w = sd_v / sd_x
    followed = []
    for memory_s in MEMORIES_S:
        kept = float(np.exp(-innovations.observer.step_s / memory_s))
        past = dsp.lfilter([1.0 - kept], [1.0, -kept], energy[0])
        followed.append(np.stack([past, kept * past + (1.0 - kept) * energy[1]]))
    return innovations.respond(followed, [w * w * motion.x, w * motion.v])


def along_time(innovations: Innovations) -> Matrix:
    """Signatures of a spring and of a damper that change slowly along the recording."""
    motion = innovations.motion
    n = motion.x.shape[1]
    phase = np.pi * (np.arange(n) + 0.5) / n
    waves = [np.broadcast_to(np.cos(k * phase), (2, n)) for k in range(1, WAVES + 1)]
    return innovations.respond([motion.x, motion.v], waves)


def along_angle(innovations: Innovations) -> Matrix:
    """Signatures of forces, and of springs, that turn with the spindle."""
    spindle = innovations.linear.spindle
    if spindle is None:
        return np.empty((0, innovations.errors.size))
    motion = innovations.motion
    n = motion.x.shape[1]
    angle = innovations.observer.turn * np.stack([np.arange(n), np.arange(1, n + 1)])
    orders = sorted(set(range(1, HARMONICS + 1)) | {k * spindle.teeth for k in range(1, HARMONICS + 1)})
    waves = [wave(k * angle) for k in orders for wave in (np.cos, np.sin)]
    return innovations.respond(waves, [np.ones_like(motion.x), motion.x])
