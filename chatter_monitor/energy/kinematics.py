"""Displacement and velocity of one mode from a recording of displacement, velocity or acceleration.

Integration and differentiation are divisions and multiplications by i w on the Fourier lines within the band, all in
one transform, so they add no error of their own inside it; lines outside are dropped through raised-cosine edges. The
same transform resamples the motion to a fixed number of samples a period, which makes every later step independent of
the recording's rate. Both ends, where the transform sees the record's jump, are trimmed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from chatter_monitor.energy.band import DERIVATIVES, Band, Quantity

SAMPLES_PER_PERIOD = 32
EDGE = 0.2  # width of the band's edges relative to their distance from the peak, in octaves


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Displacement and velocity of one mode at a common rate.

    Attributes
    ----------
    x, v : ndarray, shape (n,)
        Displacement (unit of the signal, times s or s^2 where it was integrated) and velocity.
    rate_hz : float
        About 32 samples a period of the mode.
    """

    x: NDArray[np.float64]
    v: NDArray[np.float64]
    rate_hz: float


def motion(signal: NDArray[np.float64], rate_hz: float, quantity: Quantity, band: Band) -> Motion:
    """Band-limited displacement and velocity of the mode within `band`.

    Parameters
    ----------
    signal : ndarray, shape (n,)
        The recording at `rate_hz`.
    """
    samples = fft.next_fast_len(signal.size, real=True)
    padded = np.zeros(samples)
    padded[: signal.size] = signal - np.mean(signal)
    spectrum = fft.rfft(padded)
    frequency: NDArray[np.float64] = np.asarray(np.arange(spectrum.size) * (rate_hz / samples))
    last = int(np.searchsorted(frequency, band.high_hz)) + 1
    iw = 2j * np.pi * np.maximum(frequency[:last], frequency[1])
    displacement = spectrum[:last] * gain(frequency[:last], band) / iw ** DERIVATIVES[quantity]
    resampled = max(
        fft.next_fast_len(round(samples * SAMPLES_PER_PERIOD * band.peak_hz / rate_hz), real=True), 2 * last
    )
    scale = resampled / samples
    x = fft.irfft(displacement, resampled) * scale
    v = fft.irfft(displacement * iw, resampled) * scale
    rate = rate_hz * scale
    narrowest = band.low_hz * ((band.peak_hz / band.low_hz) ** EDGE - 1.0)
    margin = int(np.ceil(1.5 / narrowest * rate))
    kept = slice(margin, int(signal.size * scale) - margin)
    return Motion(x[kept], v[kept], rate)


def gain(frequency: NDArray[np.float64], band: Band) -> NDArray[np.float64]:
    """What is kept of the amplitude at each frequency: 1 inside the band, raised-cosine edges, 0 outside."""
    octaves = np.log(np.maximum(frequency, 1e-9 * band.peak_hz) / band.peak_hz)
    low = 1.0 - octaves / np.log(band.low_hz / band.peak_hz)
    high = 1.0 - octaves / np.log(band.high_hz / band.peak_hz)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.clip(np.minimum(low, high) / EDGE, 0.0, 1.0)))
