"""A harmonic series that is followed: angle, speed, amplitudes, and what is subtracted."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.kernels import orders as kernel
from chatter_monitor.kernels.binding import bound
from chatter_monitor.kernels.taken import strongest

# Relative change of speed in a second: of the steadiest spindle and of the most unsteady one that are followed.
LEAST_WANDER = 3e-4
MOST_WANDER = 0.02
# The band's edge is left alone.
HIGHEST = 0.49  # of the sample rate


@cache
def _bound() -> tuple[Callable[..., Any], Callable[..., Any]]:
    """`subtract` and `learn`, bound to their types, which those of all series are."""
    samples, state = np.zeros(1), kernel.new_state(1, 1.0, 1.0, (1.0, 1.0))
    return bound(kernel.subtract, samples, state, 1.0, samples), bound(kernel.learn, state, 1, 1.0)


class Harmonics:
    """Multiples of a spindle's rotation, taken out of a signal as they come.

    Parameters
    ----------
    rotation_hz, rotation_sd_hz : float
        First guess, and how far it may be off.
    sample_rate_hz : float
        Rate of the samples.
    memory_s : float
        Time over which a harmonic has to be steady.
    lowest_hz : float
        Harmonics below are let alone.
    """

    def __init__(
        self, rotation_hz: float, rotation_sd_hz: float, sample_rate_hz: float, *, memory_s: float, lowest_hz: float
    ) -> None:
        self._rate_hz = sample_rate_hz
        self._memory = memory_s * sample_rate_hz
        self._lowest = math.ceil(lowest_hz / rotation_hz)
        speed = self._speed(rotation_hz)
        drift = [(share * speed) ** 2 / sample_rate_hz for share in (LEAST_WANDER, MOST_WANDER)]
        orders = min(kernel.MOST_ORDERS, math.floor(HIGHEST * sample_rate_hz / rotation_hz))
        self._state = kernel.new_state(orders, speed, self._speed(rotation_sd_hz), (drift[0], drift[1]))
        self._corner = self._speed(lowest_hz / 2.0)  # its phase at the lowest harmonic does not matter yet
        self._subtract, self._learn = _bound()

    def _speed(self, rotation_hz: float) -> float:
        return 2.0 * math.pi * rotation_hz / self._rate_hz

    @property
    def rotation_hz(self) -> float:
        """Speed now."""
        return float(self._state.angle[kernel.SPEED]) * self._rate_hz / (2.0 * math.pi)

    @property
    def rotation_sd_hz(self) -> float:
        """Standard deviation of the speed."""
        return math.sqrt(self._state.angle[kernel.SPEED_VAR]) * self._rate_hz / (2.0 * math.pi)

    def subtract(self, samples: NDArray[np.float64], out: NDArray[np.float64]) -> None:
        """Write to ``out`` what remains of samples, shape (n,) both; missing samples are not finite."""
        self._subtract(samples, self._state, self._corner, out)

    def learn(self) -> None:
        """Move the amplitudes, if the spindle has turned at least once since they moved last."""
        state = self._state
        if state.angle[kernel.TURNED] < 2.0 * math.pi or not state.counts[kernel.FOLDED]:
            return
        self._learn(state, self._lowest, self._memory)

    def leave(self, order: int | None) -> None:
        """Leave one order in the signal from now on: something else is there, too; or none any more."""
        self._state.counts[kernel.LEFT] = order or 0

    def clear(self) -> NDArray[np.int64]:
        """Orders that are steady beyond doubt."""
        return np.flatnonzero(self._state.gate == 1.0) + 1

    def strongest(self, count: int) -> list[tuple[int, float]]:
        """Order and root mean square of what is subtracted, strongest first."""
        state = self._state
        orders, rms = np.empty(count, np.int64), np.empty(count)
        found = strongest(state.real, state.imag, state.gate, orders, rms)
        return list(zip(orders[:found].tolist(), rms[:found].tolist(), strict=True))
