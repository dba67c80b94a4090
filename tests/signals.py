"""Signals whose modes are known."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

RATE_HZ = 12_800.0


def factor(frequency_hz: float, damping_ratio: float, rate_hz: float = RATE_HZ) -> NDArray[np.float64]:
    """z^2 + b z + c of a mode, as [1, b, c]."""
    angle = 2 * np.pi * frequency_hz / rate_hz
    mu = np.exp(angle * (-damping_ratio + 1j * np.sqrt(1 - damping_ratio**2)))
    return np.array([1.0, -2 * mu.real, abs(mu) ** 2])


def vibration(
    samples: int, modes: Iterable[tuple[float, float]], seed: int = 1, rate_hz: float = RATE_HZ
) -> NDArray[np.float64]:
    """Sum of modes (frequency in Hz, damping ratio) of unit rms, each driven by white noise of its own."""
    rng = np.random.default_rng(seed)
    total = np.zeros(samples)
    for frequency_hz, damping_ratio in modes:
        part = lfilter([1.0], factor(frequency_hz, damping_ratio, rate_hz), rng.standard_normal(samples))
        total += part / np.std(part)
    return total


def onset(
    samples: int, begins: int, frequency_hz: float = 900.0, growth_s: float = 0.1, rate_hz: float = RATE_HZ
) -> NDArray[np.float64]:
    """A mode that noise drives, out of which a vibration grows by itself: e-fold within `growth_s`, fiftyfold in all.

    A caricature of the onset of chatter with its beginning, its rate and its end known.
    """
    since_s = (np.arange(samples) - begins) / rate_hz
    amplitude = np.where(since_s > 0.0, 0.01 * np.exp(np.clip(since_s / growth_s, 0.0, np.log(50.0))), 0.0)
    noise = 0.01 * vibration(samples, [(frequency_hz, 0.03)], rate_hz=rate_hz)
    return noise + amplitude * np.sin(2 * np.pi * frequency_hz * since_s)
