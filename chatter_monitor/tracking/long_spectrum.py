"""Power spectrum of the whole signal of one channel, over a stretch long enough to tell lines of a comb apart."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.kernels.rarma import LARGEST_SAMPLE

Power = NDArray[np.float64]

# Of a signal that is heard for so long the bins are 2.5 Hz apart, and lines 5 Hz apart are told apart.
LENGTH_S = 0.4
BIN_HZ = 1.0 / LENGTH_S
# Spectra overlap by half.
OVERLAP = 2
# So many of them, if there are as many: beyond there is little that does not come from below.
MOST_BINS = 2048
# What is silent has this power, so that it has a logarithm.
SILENCE = 1e-200


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
        frames = round(LENGTH_S * sample_rate_hz / interval)
        self._frames = np.full((frames, interval), np.nan)  # a ring
        self._heard = 0
        self._every = frames // OVERLAP
        window = np.hanning(self._frames.size)
        # by which frame of the ring is the oldest: where a signal begins makes no difference to its power
        self._windows = [np.roll(window, oldest * interval) for oldest in range(0, frames, self._every)]

    def hear(self, frame: NDArray[np.float64]) -> Power | None:
        """Hear the next frame, of shape (interval,), NaN where samples are missing.

        Returns
        -------
        ndarray of float64, shape (bins,), or None
            With every fourth frame the power of each bin, `BIN_HZ` apart from 0 on, up to 5.1 kHz or half of the sample
            rate, in squares of the source's units, not scaled; None between, and while samples are missing.
        """
        self._frames[self._heard % len(self._frames)] = frame
        self._heard += 1
        if self._heard % self._every or not np.abs(self._frames).max() < LARGEST_SAMPLE:
            return None
        window = self._windows[self._heard // self._every % OVERLAP]
        transform = np.fft.rfft(self._frames.ravel() * window)[:MOST_BINS]
        return np.maximum(transform.real**2 + transform.imag**2, SILENCE)
