"""From the motion of the tool to what the sensor delivers."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from chatter_monitor.physics.parts import Sensor


def sense(
    sensor: Sensor,
    displacement: NDArray[np.float64],
    velocity: NDArray[np.float64],
    acceleration: NDArray[np.float64],
    sample_rate_hz: float,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Output of the sensor: the quantity it measures, what it adds, and where it clips.

    Parameters
    ----------
    sensor : Sensor
        Its properties.
    displacement, velocity, acceleration : ndarray of float64, shape (n,)
        Motion of the tool, already limited to the band.
    sample_rate_hz : float
        Rate of all of them.
    rng : numpy.random.Generator
        For the sensor's own noise.

    Returns
    -------
    ndarray of float64, shape (n,)
    """
    match sensor.quantity:
        case "displacement":
            measured = displacement
        case "velocity":
            measured = velocity
        case "acceleration":
            measured = acceleration
        case "pressure":
            low_cut = signal.butter(1, sensor.low_cut_hz, "highpass", fs=sample_rate_hz, output="sos")
            measured = signal.sosfilt(low_cut, acceleration)
    time_s = np.arange(measured.size) / sample_rate_hz
    output = sensor.gain * measured + sensor.offset + sensor.drift_per_s * time_s
    output += sensor.hum_amplitude * np.sin(2.0 * np.pi * sensor.hum_hz * time_s)
    output += sensor.noise_rms * rng.standard_normal(measured.size)
    return output if sensor.clip_level is None else np.clip(output, -sensor.clip_level, sensor.clip_level)
