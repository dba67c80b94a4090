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
    """Lines of a spectrum, strongest first: frequencies and their tolerances (Hz), powers (mean square)."""

    frequency_hz: NDArray[np.float64]
    tolerance_hz: NDArray[np.float64]
    power: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Comb:
    """Fundamental (Hz) with its standard deviation, log odds against chance, and the lines' power on its multiples."""

    fundamental_hz: float
    fundamental_sd_hz: float
    evidence: float
    power: float


def find_lines(samples: NDArray[np.float64], sample_rate_hz: float, lowest_hz: float) -> Lines:
    """The strongest lines that stand out of the noise around them, shape (n,) samples."""
    n = len(samples)
    window = np.hanning(n)
    size = 1 << (n - 1).bit_length()
    power = np.abs(np.fft.rfft(samples * window, size)) ** 2
    bin_hz = sample_rate_hz / size
    floor = _floor(power)
    inner = power[1:-1]
    peaks = np.flatnonzero((inner > power[:-2]) & (inner >= power[2:]) & (inner > LINE_TO_NOISE * floor[1:-1])) + 1
    peaks = peaks[peaks * bin_hz >= lowest_hz]
    strongest = peaks[np.argsort(-power[peaks], kind="stable")][: 4 * STRONGEST]
    left, middle, right = (np.log(power[strongest + shift]) for shift in (-1, 0, 1))
    frequency = (strongest + 0.5 * (left - right) / (left - 2.0 * middle + right)) * bin_hz
    tolerance = EXACT_BINS * sample_rate_hz / n + EXACT_SHARE * frequency
    kept: list[int] = []
    for i in range(len(frequency)):
        # a line whose frequency moves has several crests
        if all(abs(frequency[i] - frequency[j]) > 3.0 * tolerance[i] for j in kept):
            kept.append(i)
    kept = kept[:STRONGEST]
    return Lines(frequency[kept], tolerance[kept], power[strongest[kept]] * 2.0 / np.sum(window) ** 2)


def _floor(power: NDArray[np.float64]) -> NDArray[np.float64]:
    """Noise level at every bin: medians of stretches, of an exponential distribution, and straight lines between."""
    stretches = len(power) // FLOOR_BINS
    medians = np.median(power[: stretches * FLOOR_BINS].reshape(stretches, FLOOR_BINS), axis=1) / math.log(2.0)
    return np.interp(np.arange(len(power)), (np.arange(stretches) + 0.5) * FLOOR_BINS, medians)


def find_comb(lines: Lines, low_hz: float, high_hz: float, teeth: int | None = None) -> Comb | None:
    """The comb with a fundamental in a range for which there is most evidence, None where there is not enough.

    Parameters
    ----------
    lines : Lines
        Of one spectrum.
    low_hz, high_hz : float
        Range of the fundamental.
    teeth : int, optional
        When the range is that of a known spindle: lines that are all multiples of one order are then taken for a comb
        only if that order divides the teeth. Otherwise only if their own fundamental is in the range.
    """
    frequency = lines.frequency_hz
    if len(frequency) < 3:
        return None
    candidates = np.concatenate(
        [f / np.arange(max(1, math.ceil(f / high_hz)), math.floor(f / low_hz) + 1) for f in frequency]
    )
    if not len(candidates):
        return None
    gains, on = _gains(lines, candidates)
    rival = _best_offset_comb(lines)
    for i in np.argsort(-gains, kind="stable"):
        if gains[i] < max(ENOUGH, rival):
            return None
        orders = np.round(frequency[on[i]] / candidates[i]).astype(int)
        if _stands(orders, candidates[i], high_hz, teeth):
            return _fit(lines, on[i], candidates[i], float(gains[i]))
    return None


def _gains(lines: Lines, candidates: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Log odds against chance of each candidate, and which lines are on its multiples."""
    order = np.round(lines.frequency_hz / candidates[:, np.newaxis])
    off = np.abs(lines.frequency_hz - order * candidates[:, np.newaxis])
    on = (off <= lines.tolerance_hz) & (order >= 1)
    chance = np.minimum(1.0, 2.0 * lines.tolerance_hz / candidates[:, np.newaxis])
    surprise = np.where(on, -np.log(chance), 0.0)
    # the line that the candidate was made from is on it for certain
    gains = surprise.sum(axis=1) - surprise.max(axis=1)
    return gains - _choices(len(lines.frequency_hz) - 1, on.sum(axis=1) - 1) - math.log(len(candidates)), on


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


def _stands(orders: NDArray[np.int64], fundamental_hz: float, high_hz: float, teeth: int | None) -> bool:
    """Whether the orders make a comb of this fundamental even without any one of them."""
    orders = np.unique(orders)
    if len(orders) < 3:
        return False
    for left_out in range(len(orders)):
        common = int(np.gcd.reduce(np.delete(orders, left_out)))
        if common > 1 and (common * fundamental_hz > high_hz if teeth is None else teeth % common):
            return False
    return True


def _fit(lines: Lines, on: NDArray[np.bool_], fundamental_hz: float, evidence: float) -> Comb:
    """Least squares over the comb's lines."""
    frequency, weight = lines.frequency_hz[on], lines.tolerance_hz[on] ** -2.0
    order = np.round(frequency / fundamental_hz)
    information = float(np.sum(weight * order * order))
    fundamental = float(np.sum(weight * order * frequency)) / information
    return Comb(fundamental, information**-0.5, evidence, float(lines.power[on].sum()))
