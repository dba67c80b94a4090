"""Whether a recording can be told from its best linear simulation by its spectrum or its distribution.

The best linear simulation is one mode under white noise through the same sensor chain, its four numbers (frequency,
damping, level, sensor noise) fitted to the spectrum by Whittle's likelihood. The log-spectral distance of the recording
from the expected spectrum of that model is compared with the same distance of linear recordings, each with a fit of its
own (parametric bootstrap); an expected spectrum is a simulation without its scatter, so the comparison is stricter
than one simulation against another. The distribution is tested on samples so far apart that they are independent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import fft, signal, stats

from chatter_monitor.discrepancy.prove.blind.chain import RATE_HZ, gain_at

Array = NDArray[np.float64]

REPLICATES = 40
LEVEL = 0.05
_HIGHEST_HZ = 5400.0  # beyond, the anti-alias filter begins
_ITERATIONS = 12
_STEPS = (1e-4, 1e-3, 1e-3, 1e-3)  # of the four logarithms: frequency, damping ratio, level, noise
_LONGEST = np.array([0.01, 0.3, 0.5, 1.0])
_SHAPIRO_MOST = 5000  # samples that the test's approximation holds for
_INDEPENDENT = 3.0  # correlation times 1 / (zeta w) between samples that count as independent


@dataclass(frozen=True)
class Concealment:
    """How well a recording hides what is in it.

    Attributes
    ----------
    distance : float
        Root-mean-square difference of the log spectra (natural logarithm of power) from the best linear simulation.
    band95 : float
        95 % quantile of the same distance for linear recordings.
    spectrum_p : float
        Share of the linear recordings that are as far away or farther.
    normality_p : float
        Of the Shapiro-Wilk test.
    independent : int
        Samples in that test.
    """

    distance: float
    band95: float
    spectrum_p: float
    normality_p: float
    independent: int

    @property
    def concealed(self) -> bool:
        """Neither spectrum nor distribution gives the effect away."""
        return self.distance <= self.band95 and self.normality_p >= LEVEL


@dataclass(frozen=True)
class LinearSpectrum:
    """Expected Welch spectra of one mode under white noise, seen through the chain.

    Attributes
    ----------
    quantity : str
        What the sensor measures.
    segment : int
        Length of Welch's segments (Hann windows, half overlapping).
    centre_hz : float
        Where to look: from a quarter to five times this frequency.
    """

    quantity: str
    segment: int
    centre_hz: float

    def density(self, theta: Array, bins: int) -> Array:
        """One-sided density of the sampled recording at ``bins`` frequencies from 0 to half the rate."""
        f = np.linspace(0.0, 0.5 * RATE_HZ, bins)
        total = np.zeros_like(f)
        for seen in (f, RATE_HZ - f):  # what lies above half the rate folds back
            w, z, omega = 2.0 * np.pi * math.exp(theta[0]), math.exp(theta[1]), 2.0 * np.pi * seen
            total += gain_at(seen, self.quantity) / ((w * w - omega**2) ** 2 + (2.0 * z * w * omega) ** 2)
        return np.asarray(math.exp(theta[2]) * total + math.exp(theta[3]))

    def expected(self, theta: Array) -> Array:
        """Expected Welch estimate in the band: the density smeared by the window."""
        size = 8 * self.segment
        covariance = fft.irfft(self.density(theta, size // 2 + 1))[: self.segment]
        tapered = covariance * self._overlap
        smeared = 2.0 * fft.rfft(tapered, self.segment).real - tapered[0]
        return np.asarray(smeared[self._band])

    def estimate(self, samples: Array) -> Array:
        """Welch's estimate in the band."""
        pieces = np.lib.stride_tricks.sliding_window_view(samples, self.segment)[:: self.segment // 2]
        power = np.abs(fft.rfft(self._window * pieces, axis=1)[:, self._band]) ** 2
        return np.asarray(2.0 * power.mean(axis=0) / (RATE_HZ * (self._window**2).sum()))

    @cached_property
    def _window(self) -> Array:
        return np.asarray(signal.get_window("hann", self.segment))

    @cached_property
    def _overlap(self) -> Array:
        """Autocorrelation of the window, 1 at lag 0."""
        both = signal.correlate(self._window, self._window, method="fft")[self.segment - 1 :]
        return np.asarray(both / both[0])

    @cached_property
    def _band(self) -> NDArray[np.intp]:
        f = np.fft.rfftfreq(self.segment, 1.0 / RATE_HZ)
        return np.flatnonzero((f >= 0.25 * self.centre_hz) & (f <= min(5.0 * self.centre_hz, _HIGHEST_HZ)) & (f > 0.0))

    def slopes(self, theta: Array) -> Array:
        """Derivatives of the logarithm of the expected spectrum, shape (bins, 4)."""
        columns = []
        for i, step in enumerate(_STEPS):
            offset = np.zeros(4)
            offset[i] = step
            columns.append(np.log(self.expected(theta + offset) / self.expected(theta - offset)) / (2.0 * step))
        return np.column_stack(columns)

    def improved(self, theta: Array, slopes: Array, estimate: Array) -> Array:
        """One step of Fisher scoring for Whittle's likelihood, the sum of ln S + P / S."""
        step = np.linalg.lstsq(slopes, estimate / self.expected(theta) - 1.0, rcond=None)[0]
        return np.asarray(theta + np.clip(step, -_LONGEST, _LONGEST))

    def distance(self, theta: Array, estimate: Array) -> float:
        """Root-mean-square difference of the log spectra."""
        return float(np.sqrt(np.mean(np.log(estimate / self.expected(theta)) ** 2)))


def concealment(
    samples: Array, quantity: str, frequency_hz: float, damping_ratio: float, snr_db: float, rng: np.random.Generator
) -> Concealment:
    """Measure the concealment of a recording.

    Parameters
    ----------
    samples : ndarray of float64, shape (n,)
        The recording, at the rate of the chain.
    quantity : str
        What the sensor measures.
    frequency_hz, damping_ratio, snr_db : float
        Where to begin the fit.
    rng : numpy.random.Generator
        For the linear recordings.
    """
    # A resolution of about the half-power width: the finest averaging that does not smear the resonance.
    segment = 2 * fft.next_fast_len(round(0.5 * RATE_HZ / (math.pi * damping_ratio * frequency_hz)))
    spectrum = LinearSpectrum(quantity, segment, frequency_hz)
    estimate = spectrum.estimate(samples)
    theta = _start(spectrum, samples, frequency_hz, damping_ratio, snr_db)
    for _ in range(_ITERATIONS):
        theta = spectrum.improved(theta, spectrum.slopes(theta), estimate)
    distance = spectrum.distance(theta, estimate)
    density, slopes = spectrum.density(theta, samples.size + 1), spectrum.slopes(theta)
    linear = np.array(
        [
            _refitted_distance(spectrum, theta, slopes, replicate)
            for _ in range(REPLICATES // 2)
            for replicate in _two_drawn(density, rng)
        ]
    )
    thin = math.ceil(_INDEPENDENT * RATE_HZ / (2.0 * math.pi * math.exp(theta[0] + theta[1])))
    apart = samples[:: max(thin, math.ceil(samples.size / _SHAPIRO_MOST))]
    return Concealment(
        distance=distance,
        band95=float(np.quantile(linear, 1.0 - LEVEL)),
        spectrum_p=float((1 + (linear >= distance).sum()) / (1 + REPLICATES)),
        normality_p=float(stats.shapiro(apart).pvalue),
        independent=int(apart.size),
    )


def _start(spectrum: LinearSpectrum, samples: Array, frequency_hz: float, damping_ratio: float, snr_db: float) -> Array:
    """First guess from the nominal mode and the variance of the recording."""
    theta = np.array([math.log(frequency_hz), math.log(damping_ratio), 0.0, -200.0])
    shape = spectrum.density(theta, 1 << 17)
    variance = float(samples.var())
    theta[2] = math.log(variance / (shape.mean() * 0.5 * RATE_HZ))
    theta[3] = math.log(variance * 10.0 ** (-snr_db / 10.0) / (0.5 * RATE_HZ))
    return theta


def _refitted_distance(spectrum: LinearSpectrum, theta: Array, slopes: Array, samples: Array) -> float:
    """Distance of a linear recording from its own best fit, which lies so close to `theta` that the slopes hold."""
    estimate = spectrum.estimate(samples)
    for _ in range(2):
        theta = spectrum.improved(theta, slopes, estimate)
    return spectrum.distance(theta, estimate)


def _two_drawn(density: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Two Gaussian recordings of the given one-sided density: the halves of a periodic one."""
    n = density.size - 1
    spectrum = np.sqrt(0.5 * density * RATE_HZ * n) * (rng.standard_normal(n + 1) + 1j * rng.standard_normal(n + 1))
    spectrum[[0, -1]] = 0.0
    both = fft.irfft(spectrum, 2 * n)
    return both[:n], both[n:]
