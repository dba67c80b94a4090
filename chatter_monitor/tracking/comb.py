"""Combs among the lines of a spectrum.

A comb is harmonic: its lines are integer multiples of one frequency, through zero. Each line that lies closer to a
multiple than chance would have it is evidence, and a low fundamental, whose multiples are everywhere, earns little by
it. A self-excited vibration and its sidebands are evenly spaced as well, but offset; alone, it has its overtones. Both
are tried as explanations, and a comb that does no better than they is refused.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from chatter_monitor.kernels.comb import surprise

# Power of a line over the noise around it; noise alone, exponentially distributed, reaches it in one of 3 million bins.
LINE_TO_NOISE = 15.0
FLOOR_BINS = 64
STRONGEST = 12
# Lines are this exact: of the spectrum's resolution, and of the frequency, for a speed that is not quite constant.
EXACT_BINS = 0.7
EXACT_SHARE = 3e-4
# Log of the odds against chance, over all the combs that were tried.
ENOUGH = math.log(1000.0)


@dataclass(frozen=True, slots=True)
class Lines:
    """Lines of a spectrum, strongest first: frequencies and their tolerances (Hz)."""

    frequency_hz: NDArray[np.float64]
    tolerance_hz: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Target:
    """What comb to look for.

    Attributes
    ----------
    low_hz, high_hz : float
        Range of its fundamental.
    teeth : int, optional
        Of the spindle whose speed the range is about.
    """

    low_hz: float
    high_hz: float
    teeth: int | None = None

    def admits(self, fundamental_hz: float) -> bool:
        """Whether a fundamental is in the range."""
        return self.low_hz <= fundamental_hz <= self.high_hz

    def stands(self, orders: NDArray[np.int64], fundamental_hz: float) -> bool:
        """Whether these orders, ascending, make a comb of this fundamental, even without any one of them.

        Lines that are all multiples of one order are a comb of that order's frequency. It has to be in the range, or
        the order has to divide the teeth of the known spindle: a self-excited vibration has overtones, too.
        """
        if len(orders) < 3:
            return False
        up, down = np.gcd.accumulate(orders), np.gcd.accumulate(orders[::-1])[::-1]
        common = np.concatenate([down[1:2], np.gcd(up[:-2], down[2:]), up[-2:-1]])
        if self.teeth is None:
            return bool((common * fundamental_hz <= self.high_hz).all())
        return bool((self.teeth % common == 0).all())


@dataclass(frozen=True, slots=True)
class Comb:
    """Fundamental (Hz) with its standard deviation, and log odds against chance."""

    fundamental_hz: float
    fundamental_sd_hz: float
    evidence: float


class Spectrum:
    """Lines of stretches of a signal.

    Parameters
    ----------
    samples : int
        Of each stretch.
    sample_rate_hz : float
        Rate of the samples.
    lowest_hz : float
        Lines below are let alone.
    """

    def __init__(self, samples: int, sample_rate_hz: float, lowest_hz: float) -> None:
        self._window = np.hanning(samples)
        self._size = 1 << (samples - 1).bit_length()
        self._bin_hz = sample_rate_hz / self._size
        self._lowest_hz = lowest_hz
        self._exact_hz = EXACT_BINS * sample_rate_hz / samples

    def lines(self, samples: NDArray[np.float64]) -> Lines:
        """The strongest lines that stand out of the noise around them."""
        spectrum = np.fft.rfft(samples * self._window, self._size)[:-1]
        power = spectrum.real**2 + spectrum.imag**2
        inner, threshold = power[1:-1], LINE_TO_NOISE * _floor(power)[1:-1]
        peaks = np.flatnonzero((inner > power[:-2]) & (inner >= power[2:]) & (inner > threshold)) + 1
        peaks = peaks[peaks * self._bin_hz >= self._lowest_hz]
        strongest = peaks[np.argsort(-power[peaks], kind="stable")][: 4 * STRONGEST]
        left, middle, right = (np.log(power[strongest + shift]) for shift in (-1, 0, 1))
        frequency = (strongest + 0.5 * (left - right) / (left - 2.0 * middle + right)) * self._bin_hz
        tolerance = self._exact_hz + EXACT_SHARE * frequency
        kept: list[int] = []
        for i in range(len(frequency)):
            # a line whose frequency moves has several crests
            if all(abs(frequency[i] - frequency[j]) > 3.0 * tolerance[i] for j in kept):
                kept.append(i)
        kept = kept[:STRONGEST]
        return Lines(frequency[kept], tolerance[kept])


def _floor(power: NDArray[np.float64]) -> NDArray[np.float64]:
    """Noise level at every bin: from the median of its stretch, of an exponential distribution."""
    every_second = power.reshape(-1, FLOOR_BINS)[:, ::2]  # neighbours know little that is new
    return np.repeat(np.median(every_second, axis=1) / math.log(2.0), FLOOR_BINS)


def find_comb(lines: Lines, target: Target) -> Comb | None:
    """The comb for which there is most evidence, None where there is not enough."""
    frequency = lines.frequency_hz
    if len(frequency) < 3:
        return None
    room = int(np.sum(frequency / target.low_hz)) + 1
    candidates, gains, hits = np.empty(room), np.empty(room), np.empty(room, dtype=np.int64)
    made = surprise(frequency, lines.tolerance_hz, target.low_hz, target.high_hz, candidates, gains, hits)
    if made == 0:
        return None
    gains = gains[:made] - _choices(len(frequency) - 1, hits[:made] - 1) - math.log(made)
    promising = np.flatnonzero(gains > ENOUGH)
    if not len(promising):
        return None
    enough = _best_offset_comb(lines)
    for i in promising[np.argsort(-gains[promising], kind="stable")]:
        order = np.round(frequency / candidates[i]).astype(np.int64)
        on = (np.abs(frequency - order * candidates[i]) <= lines.tolerance_hz) & (order >= 1)
        if gains[i] > enough and target.stands(np.unique(order[on]), candidates[i]):
            return _fit(lines, on, candidates[i], float(gains[i]))
    return None


def _best_offset_comb(lines: Lines) -> float:
    """Log odds against chance of the best evenly spaced lines that are not multiples of their spacing."""
    frequency = lines.frequency_hz
    carrier, other = np.meshgrid(np.arange(len(frequency)), np.arange(len(frequency)))
    pairs = carrier < other
    carrier, other = carrier[pairs], other[pairs]
    best = -math.inf
    for k in (1, 2, 3):
        spacing = np.abs(frequency[other] - frequency[carrier]) / k
        good = spacing > 10.0 * lines.tolerance_hz.max()
        if not good.any():
            continue
        spacing, first = spacing[good, np.newaxis], frequency[carrier[good], np.newaxis]
        index = np.round((frequency - first) / spacing)
        on = np.abs(frequency - first - index * spacing) <= lines.tolerance_hz
        harmonic = np.abs(first - np.round(first / spacing) * spacing) <= 2.0 * lines.tolerance_hz[carrier[good], None]
        surprise = np.where(on, -np.log(np.minimum(1.0, 2.0 * lines.tolerance_hz / spacing)), 0.0)
        surprise.sort(axis=1)
        count = on.sum(axis=1)
        gain = surprise[:, :-2].sum(axis=1) - _choices(len(frequency) - 2, count - 2) - math.log(3 * len(carrier))
        gain[harmonic[:, 0] | (count < 3)] = -math.inf
        best = max(best, float(gain.max()))
    return best


def _choices(n: int, k: NDArray[np.int64]) -> NDArray[np.float64]:
    """Log of the number of ways to choose k of n."""
    k = np.clip(k, 0, n)
    result: NDArray[np.float64] = gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1)
    return result


def _fit(lines: Lines, on: NDArray[np.bool_], fundamental_hz: float, evidence: float) -> Comb:
    """Least squares over the comb's lines."""
    frequency, weight = lines.frequency_hz[on], lines.tolerance_hz[on] ** -2.0
    order = np.round(frequency / fundamental_hz)
    information = float(np.sum(weight * order * order))
    fundamental = float(np.sum(weight * order * frequency)) / information
    return Comb(fundamental, information**-0.5, evidence)
