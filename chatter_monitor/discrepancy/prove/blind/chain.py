"""The sensor chain up to the converter: quantity and anti-alias filter, and their transfer function."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import signal

Array = NDArray[np.float64]

RATE_HZ = 12800
QUANTITIES = ("displacement", "velocity", "acceleration", "pressure")
LOW_CUT_HZ = 20.0  # of the pressure sensor, first order
_ROLL_OFF = 0.15  # flat to 42.5 % of the rate, half the amplitude at 50 %: the band stays full to near its edge
_REACH = 24  # of the filter, in samples of the recording


def measure(x: Array, v: Array, quantity: str, oversampling: int) -> Array:
    """What an ideal sensor delivers at `RATE_HZ` from the motion at so many times that rate.

    Acceleration is the mean over a step, from the velocities at its ends: the white force makes it jump in between.
    """
    step_s = 1.0 / (RATE_HZ * oversampling)
    fine = {"displacement": x, "velocity": v}.get(quantity)
    if fine is None:
        fine = np.diff(v, append=v[-1]) / step_s
    taps = _raised_cosine(np.arange(-_REACH * oversampling, _REACH * oversampling + 1) / oversampling) / oversampling
    seen = np.asarray(signal.upfirdn(taps, fine, down=oversampling))[_REACH : _REACH + x.size // oversampling]
    if quantity == "pressure":
        r = math.exp(-2.0 * math.pi * LOW_CUT_HZ / RATE_HZ)
        seen = seen - signal.lfilter([1.0 - r], [1.0, -r], seen)
    return np.asarray(seen, dtype=np.float64)


def gain_at(frequency_hz: Array, quantity: str) -> Array:
    """Squared magnitude of the chain from displacement to the recording, at frequencies up to the whole rate."""
    w2 = (2.0 * np.pi * frequency_hz) ** 2
    u = np.abs(frequency_hz) / RATE_HZ
    edge = np.clip((u - 0.5 * (1.0 - _ROLL_OFF)) / _ROLL_OFF, 0.0, 1.0)
    power = np.cos(0.5 * np.pi * edge) ** 4 * w2 ** {"displacement": 0, "velocity": 1}.get(quantity, 2)
    if quantity == "pressure":
        r = math.exp(-2.0 * math.pi * LOW_CUT_HZ / RATE_HZ)
        turn = np.exp(-2j * np.pi * u)
        power = power * np.abs(1.0 - (1.0 - r) / (1.0 - r * turn)) ** 2
    return np.asarray(power)


def _raised_cosine(t: Array) -> Array:
    """Impulse response of the raised cosine, t in samples of the recording."""
    edge = 1.0 - (2.0 * _ROLL_OFF * t) ** 2
    singular = np.abs(edge) < 1e-9
    taps = np.sinc(t) * np.cos(np.pi * _ROLL_OFF * t) / np.where(singular, 1.0, edge)
    return np.where(singular, 0.25 * np.pi * np.sinc(0.5 / _ROLL_OFF), taps)
