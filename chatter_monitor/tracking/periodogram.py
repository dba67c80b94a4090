"""Averaged periodogram of a running signal, with exponential forgetting."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from chatter_monitor.kernels import peaks as kernel
from chatter_monitor.kernels.comb import power_of
from chatter_monitor.kernels.conditioning import copy_present
from chatter_monitor.kernels.rarma import LARGEST_SAMPLE

Array = NDArray[np.float64]

_OUTLIER_SIGMA = 4.5
_HANN_BANDWIDTH = 1.5  # equivalent noise bandwidth of the window in bins

# Up to where modes are looked for.
_HIGHEST_MODE = 0.6  # of half the sample rate
# Another peak stands out of its surroundings by so much, in power.
_OTHER_PEAK = 10.0

# A segment louder or quieter than the average by more than this (in power) belongs to another cut.
_OTHER_LEVEL = 10.0


@cache
def _window(segment: int, hop: int) -> tuple[Array, Array]:
    """Hann window, and how much two of them so many hops apart have in common. All channels share them."""
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(segment) / segment)
    squared = window**2
    overlap = np.array([squared[d:] @ squared[: segment - d] for d in range(0, segment, hop)])
    window.flags.writeable = overlap.flags.writeable = False
    return window, overlap


class AveragedPeriodogram:
    """Overlapping Hann windows on a fixed grid of the sample index (Welch 1967), each scaled to unit power.

    The scaling makes a segment count by its length and not by its loudness. Segments with missing samples are left out;
    when the level changes by more than 10 dB, the average starts anew.

    Parameters
    ----------
    segment : int
        Samples in a window.
    hop : int
        Samples from one window to the next.
    memory : float
        Time constant of the forgetting in samples.
    lowest_bin : int
        Bins below are emptied: an offset should not hide a change of level.
    """

    def __init__(self, segment: int, hop: int, memory: float, lowest_bin: int = 0) -> None:
        self._segment = segment
        self._lowest_bin = lowest_bin
        self._hop = hop
        self._forgetting = math.exp(-hop / memory)
        self._window, self._overlap = _window(segment, hop)
        self._area = float((self._window**2).sum())
        self._recent = np.zeros(2 * segment)  # the last samples, at its end after the hop in which they reach it
        self._end = segment  # of the last whole hop in it
        self._windowed = np.zeros(segment)
        self._complete = False  # whether a window waits there for its transform
        self._filled = 0
        self._since_missing = 0
        self.restart()

    def restart(self) -> None:
        """Forget the average, but not the samples."""
        self._sum = np.zeros(self._segment // 2 + 1)
        self._weights = np.zeros(len(self._overlap))  # of the last windows, the present one first
        self._total = 0.0
        self._common = 0.0
        self._level = 0.0

    def interrupt(self) -> None:
        """Forget the samples, too: no window may reach back beyond this moment."""
        self.restart()
        self._complete = False
        self._since_missing = 0

    def skip(self, samples: int) -> None:
        """Let samples pass unheard after an interruption; the grid of the windows goes on."""
        self._filled = (self._filled + samples) % self._hop

    def take(self, samples: Array) -> bool:
        """Take the samples up to the next hop, at most; tell whether there is a window to `add`, within the next hop.

        Raises
        ------
        ValueError
            When they go beyond the hop.
        """
        if len(samples) > self.missing_to_hop:
            raise ValueError(len(samples))
        if self._end + self._hop > len(self._recent):
            self._recent[: self._segment] = self._recent[self._end - self._segment : self._end]
            self._end = self._segment
        begin = self._end + self._filled
        present = copy_present(samples, LARGEST_SAMPLE, self._recent[begin : begin + len(samples)])
        self._filled += len(samples)
        self._since_missing = present + (self._since_missing if present == len(samples) else 0)
        if self._filled < self._hop:
            return False
        self._age()
        self._end += self._hop
        self._filled = 0
        window = self._recent[self._end - self._segment : self._end]
        self._complete = self._since_missing >= self._segment and bool(window[-1] or window.any())
        if self._complete:
            np.multiply(self._window, window, out=self._windowed)
        return self._complete

    @property
    def missing_to_hop(self) -> int:
        """Samples that complete the present hop."""
        return self._hop - self._filled

    @property
    def spectrum(self) -> Array:
        """Power in each bin, shape (segment / 2 + 1,)."""
        return self._sum / self._total

    @property
    def windows(self) -> float:
        """Independent stretches of a segment's length in the average: what one bin knows.

        A window function v(t) = sum of the forgotten squared windows averages as much as (sum v)^2 / sum v^2 samples.
        """
        return self._area**2 * self._total**2 / (self._common * self._segment)

    def add(self) -> bool:
        """Add the window that the last hop completed to the average; tell whether there was one with anything in it."""
        if not self._complete:
            return False
        power = np.empty_like(self._sum)
        power_of(fft.rfft(self._windowed), power)
        self._complete = False
        power[: self._lowest_bin] = 0.0
        level = float(power.sum())
        if not 0.0 < level < math.inf:
            return False
        if self._total > 0.0 and not self._level / _OTHER_LEVEL < level < self._level * _OTHER_LEVEL:
            self.restart()
        self._weights[0] = 1.0
        self._sum += power / level
        self._total += 1.0
        self._common += self._overlap[0] + 2.0 * float(self._overlap[1:] @ self._weights[1:])
        self._level += (level - self._level) / self._total
        return True

    def _age(self) -> None:
        """Let a hop pass."""
        self._sum *= self._forgetting
        self._total *= self._forgetting
        self._common *= self._forgetting**2
        self._weights = np.concatenate(([0.0], self._forgetting * self._weights[:-1]))


def exceeded_by_chance(windows: float) -> float:
    """What the ratio of an averaged periodogram to its spectrum hardly exceeds, at 4.5 sigma.

    The ratio has a gamma distribution, whose third root is nearly normal (Wilson and Hilferty 1931).
    """
    variance = 1.0 / (9.0 * _HANN_BANDWIDTH * windows)
    return (1.0 - variance + _OUTLIER_SIGMA * math.sqrt(variance)) ** 3


def spindle_lines(spectrum: Array, bin_hz: float, rotation_hz: float, windows: float) -> NDArray[np.bool_]:
    """Bins around those multiples of the rotation frequency that stand out of their surroundings.

    Parameters
    ----------
    spectrum : ndarray of float64, shape (n,)
        Averaged periodogram from 0 Hz on.
    bin_hz, rotation_hz : float
        Distance of its bins, and of the lines.
    windows : float
        Independent windows in the average.
    """
    lines = np.empty(len(spectrum), np.bool_)
    scratch = np.empty(2 * kernel.SURROUNDINGS + 1)
    kernel.mark_multiples(spectrum, rotation_hz / bin_hz, exceeded_by_chance(windows), scratch, lines)
    return lines


def strongest_peak_hz(spectrum: Array, lines: NDArray[np.bool_], bin_hz: float) -> float:
    """Frequency around which the power is most concentrated, lines apart, to a few percent: combs are averaged."""
    size = len(spectrum)
    bins = int(_HIGHEST_MODE * size)
    return bin_hz * int(kernel.strongest(spectrum, lines, bins, np.empty(size + 1), np.empty(size + 1, np.int64)))


def other_peak_hz(
    spectrum: Array,
    lines: NDArray[np.bool_],
    bin_hz: float,
    peak_hz: float,
    rotation_hz: float,
    teeth: int,
    uncertainty: float,
) -> float | None:
    """Frequency of what stands out most besides a peak, lines, and whatever is near to a multiple of what turns.

    The uncertainty is the relative standard deviation of the rotation frequency.
    """
    size = len(spectrum)
    first, end = int(np.argmax(spectrum > 0.0)), int(_HIGHEST_MODE * size)  # the lowest bins are empty
    work = np.empty(size + 1), np.empty(size + 1, np.int64), np.empty(size + 1)
    places = peak_hz / bin_hz, rotation_hz / bin_hz, rotation_hz * teeth / bin_hz, 2.0 * uncertainty
    found = int(kernel.most_prominent(spectrum, lines, first, end, *places, _OTHER_PEAK, *work))
    return bin_hz * found if found >= 0 else None
