"""The hidden forces, per unit mass on the side of the restoring force, written for this generator alone.

`p` holds the amplitude first, then the shapes; `w` is the angular frequency of the mode. What jumps with the sign of
the velocity is apart (`dry`), because the integrator treats it implicitly.
"""

import math

from numba import njit

(
    NONE,
    CUBE,
    SQUARE,
    GAP,
    DRY,
    STRIBECK,
    MICROSLIP,
    DRAG,
    ENERGY,
    DELAY,
    CONTACT,
    CUTTING,
    TONE,
    DRIFT,
    NOTCH,
    ROOT,
    INERTIA,
    ONE_SIDED,
    PARAMETRIC,
    FADING,
    WANDERING_DELAY,
    RECTIFIED,
) = range(22)


@njit(cache=True, nogil=True)
def push(law, x, v, z, lagged, time_s, w, p):
    """Force that is smooth in the velocity."""
    stiff = p[0] * w * w
    if law == CUBE:
        return stiff * x**3
    if law == SQUARE:
        return stiff * x * x
    if law == GAP:
        return stiff * math.copysign(max(abs(x) - p[1], 0.0), x)
    if law == MICROSLIP:
        return stiff * z
    if law == DRAG:
        return p[0] * abs(v) * v
    if law == ENERGY:
        return p[0] * v * x * x
    if law in (DELAY, WANDERING_DELAY):
        return stiff * (x - lagged)
    if law == CONTACT:
        return stiff * min(p[2], x - lagged)
    if law == CUTTING:
        u = v / p[1]
        return p[0] * u * u * (p[2] - p[3] * u)
    if law == TONE:
        return -p[0] * math.cos(p[1] * time_s + p[2])
    if law == DRIFT:  # the natural frequency goes from 1 - p[0] to 1 + p[0] of its mean in p[1] seconds
        now = p[0] * min(max(2.0 * time_s / p[1] - 1.0, -1.0), 1.0)
        return w * w * now * (2.0 + now) * x
    if law == NOTCH:
        u = (x - p[1]) / p[2]
        return stiff * p[2] * u * math.exp(-u * u)
    if law == ROOT:
        return p[0] * math.copysign(math.sqrt(abs(v)), v)
    if law == INERTIA:
        return p[0] * x * v * v
    if law == PARAMETRIC:
        return stiff * x * math.cos(p[1] * time_s)
    if law == FADING:  # stiffness follows the energy of the last p[1] seconds
        return stiff * x * (z - 1.0)
    if law == RECTIFIED:
        return p[0] * max(v, 0.0)
    return 0.0


@njit(cache=True, nogil=True)
def dry(law, x, v, p):
    """Magnitude of the force that opposes the velocity whatever its size."""
    if law == DRY:
        return p[0]
    if law == STRIBECK:
        return p[0] * (1.0 + p[1] * math.exp(-((v / p[2]) ** 2)))
    if law == ONE_SIDED and x > 0.0:
        return p[0]
    return 0.0


@njit(cache=True, nogil=True)
def memory_rate(law, x, v, z, p):
    """Rate of the internal state."""
    if law == MICROSLIP:  # Bouc-Wen of exponent 1, p[1] the displacement at which it slips
        return v - 0.5 * (abs(v) * z + v * abs(z)) / p[1]
    if law == FADING:
        return ((x / p[2]) ** 2 - z) / p[1]
    return 0.0


@njit(cache=True, nogil=True)
def lag_s(law, x, p):
    """How far back the delayed displacement lies; 0 where there is none."""
    if law in (DELAY, CONTACT):
        return p[1]
    if law == WANDERING_DELAY:
        return p[1] * (1.0 + 0.5 * math.tanh((x / p[2]) ** 2))
    return 0.0
