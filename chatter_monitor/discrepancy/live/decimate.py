"""A signal that comes in pieces, reduced to the band of the modes."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp

SAMPLES_PER_PERIOD = 10.0  # of the fastest mode, at least: room for its fourth harmonic
_MOST_UP = 3
_REACH = 16  # of the low-pass, in samples of the lower rate


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
        self.ratio = min(Fraction(up, int(up / least + 1e-9)) for up in range(1, _MOST_UP + 1))
        self.rate_hz = rate_hz * float(self.ratio)
        up, down = self.ratio.numerator, self.ratio.denominator
        # 6 dB down at the new edge: what lies around it folds back, and the band stays full.
        if self.ratio != 1:
            self._taps = up * dsp.firwin(2 * _REACH * down + 1, 1.0 / down, window=("kaiser", 6.0))
        self._reach = -(-_REACH * down // up)  # of the low-pass, in samples that come
        self._kept = np.zeros(0)
        self._start = 0  # of what is kept: a multiple of `down`
        self._done = 0

    def take(self, samples: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Take the next samples, NaN for those that are missing.

        Returns
        -------
        ndarray of float64, shape (n,)
            What they complete.
        ndarray of bool, shape (n,)
            Which of it is missing.
        """
        if self.ratio == 1:
            absent = ~np.isfinite(samples)
            return np.where(absent, 0.0, samples), absent
        up, down = self.ratio.numerator, self.ratio.denominator
        self._kept = np.concatenate([self._kept, samples])
        end = (self._start + self._kept.size - 1 - self._reach) * up // down + 1
        if end <= self._done:
            return np.zeros(0), np.zeros(0, dtype=bool)
        first = self._start * up // down
        here = slice(self._done - first, end - first)
        absent = ~np.isfinite(self._kept)
        lowered = np.asarray(dsp.upfirdn(self._taps, np.where(absent, 0.0, self._kept), up, down))[_REACH:][here]
        missing = np.zeros(lowered.size, dtype=bool)
        if absent.any():
            gone = np.concatenate([[0], np.cumsum(absent)])
            at = np.arange(self._done, end) * down // up - self._start
            begin, stop = np.clip(at - self._reach, 0, None), np.clip(at + self._reach + 2, None, absent.size)
            missing = gone[stop] > gone[begin]
        if self._done * down < _REACH * down:  # there the low-pass saw nothing before the first sample
            missing |= np.arange(self._done, end) < _REACH
        self._done = end
        keep_from = max((end * down // up - self._reach) // down * down, self._start)
        self._kept = self._kept[keep_from - self._start :]
        self._start = keep_from
        return lowered, missing
