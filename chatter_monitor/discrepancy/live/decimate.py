"""A signal that comes in pieces, reduced to the band of the modes, a block at a time."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp

from chatter_monitor.kernels.live_signatures import FEW

Vector = NDArray[np.float64]

SAMPLES_PER_PERIOD = 10.0  # of the fastest mode, at least: room for its fourth harmonic
BLOCK_S = 0.5  # about, of what is given at once
LEAST_BLOCK = 512  # samples: the spectrum of fewer has less than a few ordinates in each band that is looked at
_ROW = 16  # samples of the lower rate that the low-pass reaches to either side, and that it makes at once; divides FEW
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
    block : int
        Samples that go at once; a multiple of `FEW`.
    """

    def __init__(self, rate_hz: float, highest_mode_hz: float) -> None:
        least = min(SAMPLES_PER_PERIOD * highest_mode_hz / rate_hz, 1.0)
        self.ratio = min(Fraction(up, int(up / least + 1e-9)) for up in _UP)
        self.rate_hz = rate_hz * float(self.ratio)
        self.block = max(FEW * round(BLOCK_S * self.rate_hz / FEW), LEAST_BLOCK)
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
        # What has come and is needed yet: all that a block is made of, when that is complete. Before the first sample
        # there is none.
        self._came = np.full((self.block // _ROW + 2) * self._advance, np.nan)
        self._filled = self._advance

    def take(self, samples: Vector) -> list[tuple[Vector, NDArray[np.bool_]]]:
        """Take the next samples, NaN for those that are missing; returns the blocks that they complete.

        Returns
        -------
        list of (ndarray of float64, ndarray of bool), shape (block,)
            Each with which of it is missing.
        """
        blocks = []
        while samples.size:
            few = min(samples.size, self._came.size - self._filled)
            self._came[self._filled : self._filled + few] = samples[:few]
            self._filled += few
            samples = samples[few:]
            if self._filled == self._came.size:
                blocks.append(self._block_of(self._came))
                self._filled = 2 * self._advance
                self._came[: self._filled] = self._came[-self._filled :]
        return blocks

    def _block_of(self, came: Vector) -> tuple[Vector, NDArray[np.bool_]]:
        absent = ~np.isfinite(came)
        if not absent.any():
            return self._product(came, self._lowpass), np.zeros(self.block, dtype=bool)
        return self._product(np.where(absent, 0.0, came), self._lowpass), self._product(absent, self._within)

    def _product(self, came: NDArray[Any], weights: NDArray[Any]) -> NDArray[Any]:
        """A block of what goes, from its rows and those around."""
        parts = came.reshape(-1, self._advance)
        around = np.concatenate([parts[:-2], parts[1:-1], parts[2:]], axis=1)
        return np.asarray(around @ weights).reshape(-1)
