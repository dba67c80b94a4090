"""Density of what a sensor shows against the formula, in NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.kernels.density import add_noise, respond


@pytest.mark.parametrize("delay_s", [None, 0.02])
@pytest.mark.parametrize("corner_hz", [np.inf, 600.0])
def test_response_and_noise_are_those_of_the_formula(delay_s: float | None, corner_hz: float) -> None:
    """Two modes seen as velocity, with and without regeneration and a force whose spectrum falls."""
    f = np.linspace(5.0, 2500.0, 300)
    s = 2j * np.pi * f
    modes = np.array([[2 * np.pi * 400.0, 0.02, 1.0], [2 * np.pi * 900.0, 0.03, -0.4]])
    regeneration = 0.1 if delay_s is not None else 0.0
    lag = np.exp(-s * delay_s) if delay_s is not None else np.zeros(0, np.complex128)
    receptance = sum(g**2 / (s**2 + 2 * z * w * s + w**2) for w, z, g in modes)
    if delay_s is not None:
        receptance = 1.0 / (1.0 / receptance + regeneration * modes[0, 0] ** 2 * (1.0 - lag))
    expected = np.abs(receptance * s) ** 2 / (1.0 + (f / corner_hz) ** 4)
    found = np.empty(f.size)
    respond(f, np.abs(s) ** 2, modes, regeneration, lag, corner_hz, found)
    np.testing.assert_allclose(found, expected, rtol=1e-10)
    step_hz, colour = np.gradient(f), np.linspace(-0.2, 0.3, f.size)
    add_noise(found, step_hz, 1e-3, colour, found)
    np.testing.assert_allclose(found, np.log(expected + 1e-3 * expected @ step_hz) + colour, rtol=1e-10)
