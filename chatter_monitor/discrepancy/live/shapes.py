"""What a weak second mode does to the spectrum of a machine: the shape to look for in a change of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy.live.refit import SEPARATE
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.discrepancy.spectrum import log_density
from chatter_monitor.physics.parts import Mode

# Of the other mode's response at its resonance over that of the machine there. Between two resonances the two are a
# quarter of a turn apart, so that a dip and a peak about as high stand side by side; a louder mode is seen anyway.
LOUDNESS = 0.6


def of_another_mode(linear: Linear, rate_hz: float, bands: int) -> NDArray[np.float64]:
    """Changes of the logarithm of a machine's spectrum by a mode at the middle of each band, away from those it has.

    Parameters
    ----------
    linear : Linear
        The machine.
    rate_hz : float
        Of the signal.
    bands : int
        Equal ones, up to half of the rate.

    Returns
    -------
    ndarray of float64, shape (modes, bands)
        Of unit length, orthogonal to a change of the level.
    """
    nyquist_hz = 0.5 * rate_hz
    at = (np.arange(bands) + 0.5) * nyquist_hz / bands
    main = linear.modes[0]
    apart = [abs(at - mode.frequency_hz) > SEPARATE * mode.damping_ratio * mode.frequency_hz for mode in linear.modes]
    shapes = []
    now = log_density(linear, at, nyquist_hz)
    for frequency_hz in at[np.all(apart, axis=0)]:
        loud = LOUDNESS * abs(_receptance(linear, float(frequency_hz)))
        added = Mode(float(frequency_hz), main.damping_ratio)
        participation = (loud / abs(_receptance(replace(linear, modes=(added,)), float(frequency_hz)))) ** 0.5
        modes = (*linear.modes, replace(added, participation=participation))
        change = log_density(replace(linear, modes=modes), at, nyquist_hz) - now
        shapes.append(change - change.mean())
    found = np.array(shapes).reshape(-1, bands)
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def _receptance(linear: Linear, frequency_hz: float) -> complex:
    """Displacement for a force, without regeneration."""
    s = 2j * np.pi * frequency_hz
    return sum(
        mode.participation**2 / (s**2 + 2.0 * mode.damping_ratio * mode.omega * s + mode.omega**2)
        for mode in linear.modes
    )
