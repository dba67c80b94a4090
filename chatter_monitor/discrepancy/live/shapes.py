"""What a weak second mode does to the spectrum of a machine: the shape to look for in a change of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy.live.refit import SEPARATE
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.discrepancy.spectrum import log_densities
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
    loud = LOUDNESS * np.abs(linear.receptance(at))
    impedance = 2.0 * main.damping_ratio * (2.0 * np.pi * at) ** 2  # at resonance, of one that takes part wholly
    participation = np.sqrt(loud * impedance)
    others = [
        Mode(float(at[i]), main.damping_ratio, float(participation[i])) for i in np.flatnonzero(np.all(apart, axis=0))
    ]
    with_others = [replace(linear, modes=(*linear.modes, other)) for other in others]
    now, *then = log_densities([linear, *with_others], at, nyquist_hz)
    change = np.array(then).reshape(-1, bands) - now
    change -= change.mean(axis=1, keepdims=True)
    return np.asarray(change / np.linalg.norm(change, axis=1, keepdims=True))
