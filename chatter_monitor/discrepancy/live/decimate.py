"""A signal that comes in pieces, reduced to the band of the modes."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp

SAMPLES_PER_PERIOD = 10.0  # of the fastest mode, at least: room for its fourth harmonic
CHUNK = 512  # samples that are given at once: fewer, and the calls would cost more than what they do
_REACH = 16  # of the low-pass, in samples of the lower rate
_ROW = 16  # samples that one product with the low-pass as a matrix makes; divides CHUNK
_UP = (1, 2, 4)  # numerators of the ratio; divide _ROW


class Decimator:
    """Resamples by a small fraction; sample k is the signal at k / `rate_hz`.

    Parameters
    ----------
    rate_hz : float
        Of the samples that come.
    highest_mode_hz : float

    Attributes
    ----------
    rate_hz : float
        Of the samples that go.
    ratio : Fraction
        Of the two.
    """

    def __init__(self, rate_hz: float, highest_mode_hz: float) -> None:
        least = min(SAMPLES_PER_PERIOD * highest_mode_hz / rate_hz, 1.0)
        self.ratio = min(Fraction(up, int(up / least + 1e-9)) for up in _UP)
        self.rate_hz = rate_hz * float(self.ratio)
        up, down = self.ratio.numerator, self.ratio.denominator
        self._advance = _ROW // up * down  # samples that come for a row of those that go
        self._reach = 0 if self.ratio == 1 else -(-_REACH * down // up)
        came = np.arange(self._advance + 2 * self._reach)[:, None] - self._reach
        lag = np.arange(_ROW) * down - came * up
        half = _REACH * down
        self._within = abs(lag) <= half if self._reach else lag == 0
        # 6 dB down at the new edge: what lies around it folds back, and the band stays full.
        taps = up * dsp.firwin(2 * half + 1, 1.0 / down, window=("kaiser", 6.0)) if self._reach else np.ones(2 * half + 1)
        self._lowpass = np.where(self._within, taps[np.clip(lag + half, 0, 2 * half)], 0.0)
        self._kept = [np.full(self._reach, np.nan)]  # before the first sample there is none

    def take(self, samples: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Take the next samples, NaN for those that are missing.

        Returns
        -------
        ndarray of float64, shape (n * CHUNK,)
            What they complete.
        ndarray of bool, shape (n * CHUNK,)
            Which of it is missing.
        """
        self._kept.append(samples)
        rows = CHUNK // _ROW
        chunks = (sum(part.size for part in self._kept) - 2 * self._reach) // (rows * self._advance)
        if chunks <= 0:
            return np.zeros(0), np.zeros(0, dtype=bool)
        came = np.concatenate(self._kept)
        absent = ~np.isfinite(came)
        windows = self._windows(np.where(absent, 0.0, came))
        # A product for each chunk: the same one, whatever came at once.
        lowered = [windows[i * rows : (i + 1) * rows] @ self._lowpass for i in range(chunks)]
        missing = np.zeros(chunks * CHUNK, dtype=bool)
        if absent.any():
            missing = (self._windows(absent)[: chunks * rows] @ self._within).reshape(-1)
        self._kept = [came[chunks * rows * self._advance :]]
        return np.concatenate(lowered).reshape(-1), missing

    def _windows(self, came: NDArray[Any]) -> NDArray[Any]:
        """What each row of samples that go is made of."""
        return np.lib.stride_tricks.sliding_window_view(came, self._lowpass.shape[0])[:: self._advance]
