"""Linear machines against the spectrum of a recording: Whittle's likelihood, by Fisher scoring.

The density of a machine in white noise seen by a noisy sensor is S(f) = C(f) [sum_i |G_i(f)|^2 + noise], where C is a
smooth colour, the exponential of a few cosines (Bloomfield 1973): what the force or the sensor may have of it without
being a finding. Periodogram ordinates are exponentially distributed about S, so with I the mean of m of them

    -log L = sum m [log S + I / S],   score = sum m (I / S - 1) dlog S,   information = sum m dlog S dlog S'.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp

from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.kernels.density import add_noise, respond
from chatter_monitor.physics.parts import Mode

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

COLOURS = 4  # cosines of the colour
COLOUR_SD = 0.3  # expected size of each, in nepers of power; tells colour from noise where both would do
UPPER_EDGE = 0.85  # of the band: beyond it are the skirts of low-passes
RESOLUTION = 0.1  # width of the bins over half the bandwidth of the mode
LEAST_NOISE, MOST_NOISE = 1e-8, 1.0
_STEPS = 60
_DERIVATIVE_STEP = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Periodogram:
    """Means of `count` ordinates each, at their mean frequency; one-sided density."""

    frequency_hz: Vector
    density: Vector
    count: Vector
    nyquist_hz: float


@dataclass(frozen=True, slots=True, eq=False)
class SpectralFit:
    """A linear machine fitted to a periodogram.

    Attributes
    ----------
    linear : Linear
    covariance : ndarray of float64, shape (p, p)
        Of the vector of parameters, see `_Density`.
    nll : float
        Negative logarithm of Whittle's likelihood.
    parameters : int
        How many were fitted.
    ratio : ndarray of float64, shape (bins,)
        I / S.
    corner_at, regeneration_at : int
        Where these stand in the vector, if they were fitted.
    level : float
        Logarithm of the force's one-sided density.
    noise_density : float
        One-sided density of the sensor's noise.
    lowest_density : float
        One-sided density of the recording towards 0 Hz.
    """

    linear: Linear
    vector: Vector
    covariance: Vector
    nll: float
    parameters: int
    ratio: Vector
    corner_at: int
    regeneration_at: int
    level: float
    noise_density: float
    lowest_density: float

    @property
    def sd(self) -> Vector:
        """Standard deviations of the vector."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


def periodogram(recorded: Recorded, width_hz: float) -> Periodogram:
    """Periodogram of a recording with a slightly tapered window, in bins of at least one ordinate.

    Parameters
    ----------
    recorded : Recorded
        Missing samples count as zero.
    width_hz : float
        Width of the bins.
    """
    present = ~recorded.missing
    mean = float(np.mean(recorded.samples[present]))
    window = dsp.windows.tukey(recorded.samples.size, 0.1) * present
    transform = np.fft.rfft((recorded.samples - mean) * window)
    density = np.abs(transform) ** 2 * 2.0 / (recorded.rate_hz * float(window @ window))
    nyquist = 0.5 * recorded.rate_hz
    line = recorded.rate_hz / recorded.samples.size
    group = max(1, round(width_hz / line))
    first = max(2, math.ceil(0.002 * nyquist / line))
    last = int(UPPER_EDGE * nyquist / line)
    bins = (last - first) // group
    ordinates = density[first : first + bins * group].reshape(bins, group)
    frequency = (np.arange(first, first + bins * group) * line).reshape(bins, group).mean(axis=1)
    # A window with tapers counts as fewer samples than it is long.
    effective = float(np.sum(window**2)) ** 2 / (float(np.sum(window**4)) * window.size)
    return Periodogram(frequency, ordinates.mean(axis=1), np.full(bins, group * effective), nyquist)


class _Density:
    """Logarithm of S as a function of a vector.

    The vector holds log frequency, log damping and, from the second mode on, the participation of each mode; then the
    logarithm of the corner and the regeneration, where the start has them; the logarithm of the noise; the colours.
    """

    def __init__(self, start: Linear, spectrum: Periodogram, colours: int, fixed_modes: bool) -> None:
        self.start, self.spectrum = start, spectrum
        f = spectrum.frequency_hz
        self.sensed = np.abs(start.sensed(f)) ** 2
        self.cosines = np.cos(np.pi * np.outer(np.arange(colours + 1), f / spectrum.nyquist_hz))
        self.step_hz = np.gradient(f)
        self.modes = 0 if fixed_modes else len(start.modes)
        self.corner_at = max(3 * self.modes - 1, 0)
        self.regeneration_at = self.corner_at + (start.corner_hz is not None)
        self.noise_at = self.regeneration_at + (start.delay_s is not None)
        self.lag = np.exp(-2j * np.pi * f * start.delay_s) if start.delay_s is not None else np.zeros(0, np.complex128)

    @property
    def zero(self) -> Vector:
        """The vector of the start."""
        start = self.start
        vector = [
            value
            for i, mode in enumerate(start.modes[: self.modes])
            for value in (math.log(mode.frequency_hz), math.log(mode.damping_ratio), *([mode.participation] * (i > 0)))
        ]
        if start.corner_hz is not None:
            vector.append(math.log(start.corner_hz))
        if start.delay_s is not None:
            vector.append(start.regeneration)
        response = float(self.response(start) @ self.step_hz)
        level = math.log(float(self.spectrum.density @ self.step_hz) / response)
        return np.array([*vector, math.log(start.noise), level, *[0.0] * (len(self.cosines) - 1)])

    @property
    def bounds(self) -> tuple[Vector, Vector]:
        """Smallest and largest vector."""
        bounds = []
        for i, mode in enumerate(self.start.modes[: self.modes]):
            centre = math.log(mode.frequency_hz)
            bounds += [(centre - 0.3, centre + 0.3), (math.log(1e-5), math.log(0.7)), *([(-30.0, 30.0)] * (i > 0))]
        if self.start.corner_hz is not None:
            bounds.append((math.log(0.1 * self.start.modes[0].frequency_hz), math.log(4.0 * self.spectrum.nyquist_hz)))
        if self.start.delay_s is not None:
            bounds.append((-0.9, 0.9))
        bounds += [(math.log(LEAST_NOISE), math.log(MOST_NOISE)), (-math.inf, math.inf)]
        bounds += [(-5.0, 5.0)] * (len(self.cosines) - 1)
        low, high = np.array(bounds).T
        return low, high

    def _modes(self, vector: Vector) -> list[tuple[float, float, float]]:
        """Frequency in Hz, damping and participation of each mode."""
        modes = [(mode.frequency_hz, mode.damping_ratio, mode.participation) for mode in self.start.modes]
        at = 0
        for i, (_, _, participation) in enumerate(modes[: self.modes]):
            share = float(vector[at + 2]) if i else participation
            modes[i] = math.exp(vector[at]), math.exp(vector[at + 1]), share or 1e-9
            at += 2 + (i > 0)
        return modes

    def _corner_hz(self, vector: Vector) -> float | None:
        return math.exp(vector[self.corner_at]) if self.start.corner_hz is not None else None

    def _regeneration(self, vector: Vector) -> float:
        return float(vector[self.regeneration_at]) if self.start.delay_s is not None else 0.0

    def linear(self, vector: Vector) -> Linear:
        """Machine that a vector stands for."""
        return replace(
            self.start,
            modes=tuple(Mode(*mode) for mode in self._modes(vector)),
            noise=math.exp(vector[self.noise_at]),
            corner_hz=self._corner_hz(vector),
            regeneration=self._regeneration(vector),
        )

    def response(self, linear: Linear) -> Vector:
        """Squared response of what the sensor measures to the force."""
        modes = [(mode.frequency_hz, mode.damping_ratio, mode.participation) for mode in linear.modes]
        return self._response(modes, linear.regeneration, linear.corner_hz)

    def _response(
        self, modes: list[tuple[float, float, float]], regeneration: float, corner_hz: float | None
    ) -> Vector:
        rows = np.array([(2.0 * math.pi * frequency, damping, share) for frequency, damping, share in modes])
        squared = np.empty(self.spectrum.frequency_hz.size)
        white = math.inf if corner_hz is None else corner_hz
        respond(self.spectrum.frequency_hz, self.sensed, rows, regeneration, self.lag, white, squared)
        return squared

    def noise(self, linear: Linear) -> float:
        """Density of the noise over that of the force."""
        return linear.noise * float(self.response(linear) @ self.step_hz) / self.spectrum.nyquist_hz

    def __call__(self, vector: Vector) -> Vector:
        """Log S at the bins of the periodogram."""
        response = self._response(self._modes(vector), self._regeneration(vector), self._corner_hz(vector))
        colour = vector[self.noise_at + 1 :] @ self.cosines
        share = math.exp(vector[self.noise_at]) / self.spectrum.nyquist_hz
        add_noise(response, self.step_hz, share, colour, response)
        return response


def log_densities(machines: Sequence[Linear], frequency_hz: Vector, nyquist_hz: float) -> Matrix:
    """Logarithm of the density of what a sensor shows of some machines, up to the level of the force.

    Parameters
    ----------
    machines : sequence of Linear
        They differ in nothing but their modes and the share of the noise.
    frequency_hz : ndarray of float64, shape (bins,)
        Over the whole band: it tells the share of the noise.
    nyquist_hz : float

    Returns
    -------
    ndarray of float64, shape (machines, bins)
    """
    ones = np.ones(frequency_hz.size)
    density = _Density(machines[0], Periodogram(frequency_hz, ones, ones, nyquist_hz), colours=0, fixed_modes=True)
    found, level = np.empty((len(machines), frequency_hz.size)), np.zeros(frequency_hz.size)
    for linear, row in zip(machines, found, strict=True):
        add_noise(density.response(linear), density.step_hz, linear.noise / nyquist_hz, level, row)
    return found


def fit(spectrum: Periodogram, start: Linear, *, colours: int = COLOURS, fixed_modes: bool = False) -> SpectralFit:
    """Fit a linear machine to a periodogram.

    Parameters
    ----------
    spectrum : Periodogram
    start : Linear
        Where the search begins; what is not searched stays.
    colours : int
        Cosines of the smooth colour.
    fixed_modes : bool
        Keep the modes and fit noise and colour only.
    """
    density = _Density(start, spectrum, colours, fixed_modes)
    vector = density.zero
    low, high = density.bounds
    count, measured = spectrum.count, spectrum.density
    log_s = density(vector)
    penalty = np.concatenate([np.zeros(vector.size - colours), np.full(colours, COLOUR_SD**-2)])

    def minus_log(at: Vector, log_density: Vector) -> float:
        return float(count @ (log_density + measured * np.exp(-log_density)) + 0.5 * penalty @ at**2)

    nll = minus_log(vector, log_s)
    damping = 1e-3
    information = np.eye(vector.size)
    for _ in range(_STEPS):
        slopes = np.empty((vector.size, log_s.size))
        slopes[density.noise_at + 1 :] = density.cosines
        for i in range(density.noise_at + 1):
            moved = vector.copy()
            moved[i] += _DERIVATIVE_STEP
            slopes[i] = (density(moved) - log_s) / _DERIVATIVE_STEP
        weight = measured * np.exp(-log_s) - 1.0
        score = slopes @ (count * weight) - penalty * vector
        information = (slopes * count) @ slopes.T + np.diag(penalty + 1e-9)
        improved = False
        while damping < 1e8 and not improved:
            step = np.linalg.solve(information + damping * np.diag(np.diag(information)), score)
            trial = np.clip(vector + np.clip(step, -1.0, 1.0), low, high)
            trial_s = density(trial)
            trial_nll = minus_log(trial, trial_s)
            improved = bool(trial_nll < nll)
            damping *= 0.2 if improved else 6.0
        if not improved:
            break
        gain, vector, log_s, nll = nll - trial_nll, trial, trial_s, trial_nll
        if gain < 1e-4:
            break
    values, vectors = np.linalg.eigh(information)
    covariance = (vectors / np.maximum(values, 1e-9)) @ vectors.T
    linear = density.linear(vector)
    level = float(vector[density.noise_at + 1])
    return SpectralFit(
        linear,
        vector,
        covariance,
        nll,
        vector.size,
        measured * np.exp(-log_s),
        density.corner_at,
        density.regeneration_at,
        level,
        density.noise(linear) * math.exp(level),
        math.exp(float(log_s[0])),
    )
