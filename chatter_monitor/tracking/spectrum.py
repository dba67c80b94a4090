"""Short-time spectrum of one channel over the last second, and the lines that stand out in it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from chatter_monitor.kernels import lines

# 25 ms tell lines 40 Hz apart and follow an amplitude that grows e-fold within that time.
WINDOW_S = 0.025
# Transforms of a frame: half a window apart.
HOPS = 4
# How far back the amplitude of a line is looked at.
HISTORY_S = 1.0
LONG_S = 8.0
# A chattering mode is heard within this relative distance of where it was before.
NEAR = 0.12
DECIBELS = 10.0 / math.log(10.0)
# Lines looked at in a frame.
LINES = 3
# What is below is offset and drift.
LOWEST_HZ = 50.0


@dataclass(frozen=True, slots=True)
class Line:
    """A line of the short-time spectrum and how it has behaved.

    Attributes
    ----------
    frequency_hz : float
        Where it is, interpolated between the bins.
    share : float
        Of the power, over the last 50 ms.
    prominence_db : float
        Over the level around it.
    variation : float
        Coefficient of variation of its amplitude over half a second: 0.52 for a mode that noise drives for long.
    growth_per_s, growth_sd_per_s : float
        Rate at which its amplitude grows, over the last 150 ms, with standard deviation.
    rise, long_rise : float
        Logarithm of its present amplitude over the median of the last second, and of the last eight, beyond what its
        surroundings have risen: a cut that begins or grows louder lifts everything.
    usual_db : float
        What stood out near it, in the mean of the last seconds: a mode that is driven is heard before it chatters.
    coherence : tuple of float
        Correlation of its complex amplitude after 25, 50, 100 and 200 ms: exp(-zeta omega t) for a mode.
    """

    frequency_hz: float
    share: float
    prominence_db: float
    variation: float
    growth_per_s: float
    growth_sd_per_s: float
    rise: float
    long_rise: float
    usual_db: float
    coherence: tuple[float, ...]

    @property
    def damping_ratio(self) -> float:
        """Damping that the loss of coherence within 25 ms would have; what else there is in the line adds to it."""
        return -math.log(max(self.coherence[0], 1e-6)) / (2.0 * math.pi * self.frequency_hz * WINDOW_S)


class Spectrum:
    """Ring of the latest transforms of a signal that comes in frames.

    Parameters
    ----------
    sample_rate_hz : float
        Of the signal.
    interval : int
        Samples of a whole frame.
    """

    def __init__(self, sample_rate_hz: float, interval: int) -> None:
        self._hop = interval // HOPS
        self._hop_s = self._hop / sample_rate_hz
        self._window = np.hanning(round(WINDOW_S * sample_rate_hz) + 1)[:-1]
        self._points = 1 << int(np.ceil(np.log2(1.5 * len(self._window))))
        self._bin_hz = sample_rate_hz / self._points
        bins = self._points // 2 + 1
        rows = round(HISTORY_S / self._hop_s)
        self._spectra = np.zeros((rows, bins), complex)
        self._valid = np.zeros(rows, bool)
        self._head = 0
        # powers of the root of unity, which refer the phase of every transform to the same time
        self._turns = np.exp(-2j * np.pi * np.arange(self._points) / self._points)
        self._taken = 0
        self._before = np.full(len(self._window), np.nan)
        self._power = np.zeros(bins)
        self._peaks = np.zeros(LINES, np.int64)
        self._lowest = round(LOWEST_HZ / self._bin_hz)
        self._sums = np.zeros(bins + 1)
        self._reliefs = np.zeros((round(LONG_S * rows / HISTORY_S) // HOPS, bins))
        self._reliefs_sum = np.zeros(bins)
        self._frames = 0
        self._scratch = np.zeros(max(rows, len(self._reliefs)))
        self._measures = np.zeros(lines.MEASURES)

    def take(self, signal: NDArray[np.float64]) -> list[Line]:
        """Take the samples of the next frame (NaN where they are missing); returns its lines, most prominent first."""
        known = np.concatenate([self._before, signal])
        self._before = known[len(known) - len(self._window) :]
        hops = len(signal) // self._hop
        first = len(signal) - hops * self._hop + self._hop
        pieces = sliding_window_view(known, len(self._window))[first :: self._hop]
        rows = np.arange(self._head, self._head + hops) % len(self._spectra)
        starts = self._taken + first + self._hop * np.arange(hops)
        self._taken += len(signal)
        turns = self._turns[np.outer(starts, np.arange(self._spectra.shape[1])) % self._points]
        self._valid[rows] = np.isfinite(pieces).all(axis=1)
        self._spectra[rows] = np.fft.rfft(pieces * self._window, self._points) * turns
        self._head += hops
        if not lines.recent_power(self._spectra, self._valid, self._head, HOPS, self._power):
            return []
        relief = self._reliefs[self._frames % len(self._reliefs)]
        self._frames += 1
        self._reliefs_sum -= relief
        lines.stand_out(self._power, self._lowest, self._sums, relief)
        self._reliefs_sum += relief
        count = lines.most_prominent(relief, self._lowest, self._peaks)
        return [self._line(int(peak)) for peak in self._peaks[:count]]

    def _line(self, peak: int) -> Line:
        ring = (self._spectra, self._valid, self._head)
        lines.describe(*ring, self._power, self._lowest, peak, self._scratch, self._measures)
        share, variation, growth, growth_sd, *coherence = self._measures.tolist()
        rise, long_rise = (
            float(lines.rise(self._reliefs, self._frames, frames, peak, self._scratch))
            for frames in (len(self._valid) // HOPS, len(self._reliefs))
        )
        reach = max(2, min(round(NEAR * peak), peak))
        frames_known = min(self._frames, len(self._reliefs))
        before, here, after = np.log(np.maximum(self._power[peak - 1 : peak + 2], 1e-300)).tolist()
        bend = before - 2.0 * here + after
        offset = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
        offset = min(max(offset, -0.5), 0.5)
        return Line(
            frequency_hz=(peak + offset) * self._bin_hz,
            share=share,
            prominence_db=DECIBELS * float(self._reliefs[(self._frames - 1) % len(self._reliefs), peak]),
            variation=variation,
            growth_per_s=growth / self._hop_s,
            growth_sd_per_s=growth_sd / self._hop_s,
            rise=rise,
            long_rise=long_rise,
            usual_db=DECIBELS * float(self._reliefs_sum[peak - reach : peak + reach + 1].max()) / frames_known,
            coherence=tuple(coherence),
        )
