"""Density of what a sensor shows of a linear machine under a white force, bin by bin."""

import math

from numba import njit

from chatter_monitor.kernels.options import OPTIONS


@njit(**OPTIONS)
def respond(frequency_hz, sensed, modes, regeneration, lag, corner_hz, out):
    """Squared response of what the sensor measures to the force.

    Parameters
    ----------
    frequency_hz, sensed : ndarray of float64, shape (bins,)
        And the squared response of the sensor to displacement.
    modes : ndarray of float64, shape (modes, 3)
        Angular frequency, damping ratio, participation.
    regeneration : float
        Of the first mode, in its stiffness.
    lag : ndarray of complex128, shape (bins,) or (0,)
        Displacement of a period ago for that of now; empty without regeneration.
    corner_hz : float
        Of the force; infinite where it is white.
    out : ndarray of float64, shape (bins,)
        The result.
    """
    stiffness = regeneration * modes[0, 0] * modes[0, 0]
    for b in range(frequency_hz.shape[0]):
        omega = 2.0 * math.pi * frequency_hz[b]
        receptance = complex(0.0, 0.0)
        for m in range(modes.shape[0]):
            re = modes[m, 0] * modes[m, 0] - omega * omega
            im = 2.0 * modes[m, 1] * modes[m, 0] * omega
            scale = modes[m, 2] * modes[m, 2] / (re * re + im * im)
            receptance += complex(re * scale, -im * scale)
        if lag.shape[0]:
            receptance /= 1.0 + stiffness * (1.0 - lag[b]) * receptance
        squared = (receptance.real * receptance.real + receptance.imag * receptance.imag) * sensed[b]
        over = frequency_hz[b] / corner_hz
        out[b] = squared / (1.0 + over * over * over * over)


@njit(**OPTIONS)
def add_noise(response, step_hz, share, colour, out):
    """Logarithm of response and noise, a share of the mean of the former, plus the colour; shape (bins,) each."""
    total = 0.0
    for b in range(response.shape[0]):
        total += response[b] * step_hz[b]
    for b in range(response.shape[0]):
        out[b] = math.log(response[b] + share * total) + colour[b]
