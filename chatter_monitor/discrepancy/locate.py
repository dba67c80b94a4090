"""Where recording and model differ: seven maps of the innovations, each with a p-value.

time, frequency, phase plane, amplitude, memory, lag, angle: under a model that explains everything each p-value is
uniform.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp
from scipy import stats

from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.innovations import Innovations
from chatter_monitor.discrepancy.name import subspace_p
from chatter_monitor.discrepancy.report import Statistic
from chatter_monitor.discrepancy.spectrum import COLOURS, Periodogram, SpectralFit
from chatter_monitor.discrepancy.whitening import ORDER

Vector = NDArray[np.float64]
BANDS = 40
LAGS_S = 0.5  # of the map over lag, at most


@dataclass(frozen=True, slots=True, eq=False)
class Modulation:
    """A stiffness that swings with one frequency: the strongest, and what chance does as well."""

    frequency_hz: float
    p_value: float


def frequency_map(spectrum: Periodogram, fitted: SpectralFit) -> tuple[Statistic, Vector, Vector]:
    """Ratio of measured and fitted spectrum in bands, and its test."""
    edges = np.linspace(0, spectrum.count.size, BANDS + 1).astype(np.int64)
    weight = np.add.reduceat(spectrum.count, edges[:-1])
    ratio = np.add.reduceat(spectrum.count * fitted.ratio, edges[:-1]) / weight
    centre = np.add.reduceat(spectrum.count * spectrum.frequency_hz, edges[:-1]) / weight
    value = float(np.sum(weight * (ratio - 1.0) ** 2))
    freedom = BANDS - COLOURS - 2
    return Statistic("frequency", value, float(stats.chi2.sf(value, freedom))), centre, ratio


def lag_map(white: Vector, used: NDArray[np.bool_], rate_hz: float) -> tuple[Statistic, Vector, Vector]:
    """Correlation of whitened errors at lags beyond the whitener, in standard deviations, and its largest."""
    e = np.where(used, white, 0.0)
    e = e / np.sqrt(np.mean(e[used] ** 2))
    longest = min(int(LAGS_S * rate_hz), e.size // 10)
    size = 1 << int(np.ceil(np.log2(2 * e.size)))
    power = np.abs(np.fft.rfft(e, size)) ** 2
    pairs = np.fft.irfft(np.abs(np.fft.rfft(used.astype(float), size)) ** 2, size)[1 : longest + 1]
    correlation = np.fft.irfft(power, size)[1 : longest + 1] / np.sqrt(np.maximum(pairs, 1.0))
    beyond = np.abs(correlation[ORDER + 5 :])
    value = float(beyond.max())
    p = -math.expm1(beyond.size * math.log1p(-min(2.0 * float(stats.norm.sf(value)), 1.0 - 1e-12)))
    return Statistic("lag", value, p), np.arange(1, longest + 1) / rate_hz, correlation


def whiteness_p(white: Vector, used: NDArray[np.bool_]) -> float:
    """Portmanteau test (Ljung and Box 1978) over the lags after those of the whitener."""
    e = np.where(used, white, 0.0)
    n = int(used.sum())
    r0 = float(e @ e)
    lags = np.arange(ORDER + 1, 3 * ORDER + 1)
    r = np.array([e[lag:] @ e[:-lag] for lag in lags]) / r0
    return float(stats.chi2.sf(n * np.sum(r**2), lags.size))


def subspace_map(name: str, evidence: Evidence, columns: list[int]) -> Statistic:
    """Test of many columns together."""
    value, p, _ = subspace_p(evidence, columns)
    return Statistic(name, value, p)


def modulation(innovations: Innovations, weight: Vector, spring: Vector) -> Modulation:
    """Look for a stiffness that swings harmonically, by the spectrum of error times signature of a spring."""
    e = innovations.white * weight
    s = spring * weight
    e = e - s * float(e @ s) / float(s @ s)
    product = e * s
    product = product - np.mean(product)
    n = product.size
    power = np.abs(np.fft.rfft(product)) ** 2
    top = int(
        min(2.5 * innovations.linear.modes[0].frequency_hz, 0.45 * innovations.recorded.rate_hz)
        / innovations.recorded.rate_hz
        * n
    )
    # The product is not white: each ordinate against the smooth spectrum around it.
    floor = dsp.oaconvolve(power, np.full(201, 1.0 / 201), "same")
    ordinates = (power / np.maximum(floor, 1e-300))[5:top]
    peak = int(np.argmax(ordinates))
    # Taken out of the mean of 201, an ordinate of size u is u (1 - u / 201) above the rest.
    excess = float(ordinates[peak])
    excess = excess * 200.0 / max(201.0 - excess, 1.0)
    p = -math.expm1(
        ordinates.size * math.log1p(-min(math.exp(-min(excess, 700.0)) * (1.0 + excess**2 / 400.0), 1.0 - 1e-12))
    )
    return Modulation((peak + 5) * innovations.recorded.rate_hz / n, p)
