"""A signal that comes in pieces, reduced to the band of the modes."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp

SAMPLES_PER_PERIOD = 10.0  # of the fastest mode, at least: room for its fourth harmonic
CHUNK = 512  # samples that are given at once: fewer, and the calls would cost more than what they do
# Samples of the lower rate that the low-pass reaches to either side, and that it makes at once; divides CHUNK.
_ROW = 16
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
        # What the low-pass reaches of the rows before and after: as far as the rows are long.
        came = np.arange(3 * self._advance)[:, None] - self._advance
        lag = np.arange(_ROW) * down - came * up
        half = _ROW * down if self.ratio != 1 else 0
        # 6 dB down at the new edge: what lies around it folds back, and the band stays full.
        taps = up * dsp.firwin(2 * half + 1, 1.0 / down, window=("kaiser", 6.0)) if half else np.ones(1)
        self._within = abs(lag) <= half
        self._lowpass = np.where(self._within, taps[np.clip(lag + half, 0, 2 * half)], 0.0)
        self._kept = [np.full(self._advance, np.nan)]  # before the first sample there is none
        self._waiting = self._advance

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
        self._waiting += samples.size
        rows = CHUNK // _ROW
        chunks = (self._waiting // self._advance - 2) // rows
        if chunks <= 0:
            return np.zeros(0), np.zeros(0, dtype=bool)
        came = np.concatenate(self._kept)
        done = chunks * rows * self._advance
        self._kept, self._waiting = [came[done:]], came.size - done
        absent = ~np.isfinite(came)
        anything = bool(absent.any())
        if anything:
            came = np.where(absent, 0.0, came)
        # A product for each chunk: the same one, whatever came at once.
        lowered = [self._product(came, i * rows, self._lowpass) for i in range(chunks)]
        missing = np.zeros(chunks * CHUNK, dtype=bool)
        if anything:
            missing = np.concatenate([self._product(absent, i * rows, self._within) for i in range(chunks)])
        return np.concatenate(lowered), missing

    def _product(self, came: NDArray[Any], first: int, weights: NDArray[Any]) -> NDArray[Any]:
        """A chunk of what goes, of rows from the first one on and those around."""
        rows, size = CHUNK // _ROW, self._advance
        parts = came[first * size : (first + rows + 2) * size].reshape(rows + 2, size)
        around = np.concatenate([parts[:-2], parts[1:-1], parts[2:]], axis=1)
        return np.asarray(around @ weights).reshape(-1)
