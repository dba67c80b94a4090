"""The random force on the machine, at every integration step."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from chatter_monitor.physics.model import MachiningSystem


def random_force(
    system: MachiningSystem, time_s: NDArray[np.float64], step_s: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Pulses of the excitation at the integration steps, to be interpolated linearly between them.

    White pulses of variance sigma^2 = 2 pi S_0 / step have the spectrum of eq. (6). The other kinds keep the mean
    intensity S_0 at low frequency.

    Parameters
    ----------
    system : MachiningSystem
        Its excitation may be any but "measured".
    time_s : ndarray of float64, shape (n,)
        Times of the steps.
    step_s : float
        Their distance.
    rng : numpy.random.Generator
        Where the numbers come from.

    Returns
    -------
    ndarray of float64, shape (n,)
        Force per unit mass in u/s^2.
    """
    excitation = system.excitation
    pulses = rng.standard_normal(time_s.size)
    match excitation.kind:
        case "coloured":
            shaping = signal.butter(2, excitation.corner_hz, fs=1.0 / step_s, output="sos")
            pulses = signal.sosfilt(shaping, pulses)
        case "impulsive":
            chance = min(1.0, excitation.impacts_per_s * step_s)
            impacts = (rng.random(time_s.size) < chance) * rng.standard_normal(time_s.size) / np.sqrt(chance)
            share = excitation.impact_share
            pulses = np.sqrt(1.0 - share) * pulses + np.sqrt(share) * impacts
        case "modulated":
            depth = excitation.modulation_depth
            swell = 1.0 + depth * np.cos(2.0 * np.pi * excitation.modulation_hz * time_s)
            pulses *= swell / np.sqrt(1.0 + 0.5 * depth**2)
    intensity = system.drifting("excitation.intensity", time_s, system.intensity)
    return pulses * np.sqrt(2.0 * np.pi * intensity / step_s)
