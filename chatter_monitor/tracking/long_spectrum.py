"""Power spectrum of the whole signal of one channel over a stretch that is long enough to tell lines of a comb apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Spectrum = NDArray[np.float32]

# Of a signal that is heard for so long the bins are 2.5 Hz apart, and lines 5 Hz apart are told apart.
LENGTH_S = 0.4
BIN_HZ = 1.0 / LENGTH_S
# Spectra overlap by half.
OVERLAP = 2
# Beyond this there is little that does not come from below.
HIGHEST_HZ = 5120.0
BINS = round(HIGHEST_HZ / BIN_HZ)


class LongSpectrum:
    """The latest samples of a signal that comes in frames.

    Parameters
    ----------
    sample_rate_hz : float
        Of the signal.
    interval : int
        Samples of a frame.
    """

    def __init__(self, sample_rate_hz: float, interval: int) -> None:
        self._frames = round(LENGTH_S * sample_rate_hz / interval)
        self._samples = np.full(self._frames * interval, np.nan)
        self._window = np.hanning(self._samples.size)
        self._heard = 0

    def hear(self, frame: NDArray[np.float64]) -> Spectrum | None:
        """Hear the next frame, of shape (interval,), NaN where samples are missing.

        Returns
        -------
        ndarray of float32, shape (BINS,), or None
            Power of each bin, `BIN_HZ` apart from 0 on, in squares of the source's units, not scaled, with every fourth
            frame; None between, and while samples are missing.
        """
        self._samples[: -frame.size] = self._samples[frame.size :]
        self._samples[-frame.size :] = frame
        self._heard += 1
        if self._heard % (self._frames // OVERLAP):
            return None
        transform = np.fft.rfft(self._samples * self._window)[:BINS]
        power = (transform.real**2 + transform.imag**2).astype(np.float32)
        return power if np.isfinite(power[0]) else None
