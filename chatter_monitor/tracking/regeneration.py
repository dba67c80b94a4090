"""Maximum-likelihood fit of one mode with a regenerative delay to an averaged periodogram.

Kappa, the modal parameters, the delay and the sensor's colour and noise come from one likelihood, so that what the
delay does to the poles is not taken for damping, nor the noise for a lack of regeneration.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.kernels.delay_roots import critical_coefficient
from chatter_monitor.kernels.peaks import LINE_BINS
from chatter_monitor.kernels.regeneration import VALUE, Likelihood, begin_climb, climb, posterior, race
from chatter_monitor.kernels.regenerative_spectrum import (
    DELAYS,
    KAPPA,
    LOG_FLOOR,
    LOG_OMEGA,
    LOG_SPREAD,
    LOG_TAU,
    LOG_ZETA,
    MODULATION,
    PARAMETERS,
    SLOPE,
)
from chatter_monitor.kernels.whittle import REACH, WORK
from chatter_monitor.tracking.periodogram import exceeded_by_chance

Array = NDArray[np.float64]
T = TypeVar("T")
# Work in pieces that may be done at different times; each tells how many bins have been evaluated in it.
Pieces = Generator[int, None, T]

# What is believed before the first sample: sensors respond to displacement up to acceleration, structures are damped by
# 0.5 to 10 %, spindles wander by 0.1 to 0.7 % within seconds, teeth modulate the process by 0 if they stay engaged, by
# 1 if they leave as soon as they have entered. As wide as that is, it only matters where the spectrum does not tell.
_SLOPE_MEAN, _SLOPE_SD = 2.0, 2.0
_LOG_ZETA_MEAN, _LOG_ZETA_SD = np.log(0.025), 1.0
_LOG_SPREAD_MEAN, _LOG_SPREAD_SD = np.log(0.0025), 0.5
_MODULATION_MEAN, _MODULATION_SD = 0.4, 0.4
_LOG_FLOOR_SD = 5.0

_GROUPS, _LEAST_GROUP = 60, 8  # for the lack of fit

_STEPS = 40
_STEPS_OF_RACE = 6
_STEPS_ALONE = 12  # of a mode without regeneration, from its peak
_BINS_OF_RACE = 250  # where the starts are told apart; they need not be fitted exactly
# That are evaluated in one piece, at most, but for one evaluation: about a quarter of a millisecond.
_BINS_AT_ONCE = 3000
# Of the mode within the delay. With fewer a spindle that wanders moves the comb by less than the comb's own width.
_FEW_WAVES = 8.0
_DELAY_RANGE = 2.5  # standard deviations of the given delay that are searched
# What rises less than this above the median of its surroundings is no mode.
_STANDS_OUT = 4.0
# Standard deviations of its mean by which a line that may be expected stands out.
_EXPECTED_LINE = 3.0
# How far the skirt of a multiple of the teeth reaches, over its frequency, and at most over the distance to the next.
_SKIRT, _SKIRT_OF_SPACING = 0.02, 0.12
_NOTHING_ELSE = 1e9  # precision of what is known
_LOG_SLIGHTLY_DAMPED = math.log(0.01)
_BY_CHANCE = 2.0  # standard deviations
_DETERMINED = 1e-9  # least eigenvalue of an information matrix scaled to a diagonal of 1; rounding is 1e-16


class Band:
    """The part of an averaged periodogram that one mode is fitted to.

    Parameters
    ----------
    periodogram : ndarray of float64, shape (n,)
        Averaged, of Hann windows, from 0 Hz on.
    lines : ndarray of bool, shape (n,)
        Bins to leave out.
    bin_hz : float
        Distance of the bins.
    mode_hz : float
        Frequency of the mode, roughly.
    width : float
        The band reaches from mode_hz / width to mode_hz width.
    weight : float
        Independent windows in the average, in lengths of the window: the information of one bin.
    """

    def __init__(
        self, periodogram: Array, lines: NDArray[np.bool_], bin_hz: float, mode_hz: float, width: float, weight: float
    ) -> None:
        self._whole, self._width, self._lines = periodogram, width, lines
        first = max(REACH, round(mode_hz / width / bin_hz))
        last = min(len(periodogram) - 1, round(mode_hz * width / bin_hz))
        self.periodogram = periodogram[first:last]
        self.used = ~lines[first:last]
        self.weight = weight
        self.mode_hz = mode_hz
        self.bin_hz = bin_hz
        self.first_hz = first * bin_hz
        self._log_frequency = np.log((np.arange(first - 1, last + 2) - [[0.0], [0.5]]) * bin_hz / mode_hz)
        self._work, self._spectrum = np.zeros(WORK), np.zeros(last - first)

    def coarse(self, bins: int) -> Band:
        """The same with neighbouring bins averaged, so that there are about so many."""
        together = max(1, len(self.periodogram) // bins) | 1  # odd: they are where their middle one is
        if together == 1:
            return self
        begin = together // 2 + 1
        groups = slice(begin, begin + (len(self._whole) - begin) // together * together)
        periodogram = self._whole[groups].reshape(-1, together).mean(axis=1)
        lines = self._lines[groups].reshape(-1, together).any(axis=1)
        periodogram, lines = np.append(self._whole[0], periodogram), np.append(self._lines[0], lines)
        return Band(periodogram, lines, together * self.bin_hz, self.mode_hz, self._width, together * self.weight)

    @property
    def floor(self) -> float:
        """Where the sensor's noise may be, to an order of magnitude."""
        rank = 0.05 * (len(self.periodogram) - 1)
        below, above = np.partition(self.periodogram, (int(rank), int(rank) + 1))[int(rank) :][:2]
        quantile = below + (above - below) * (rank % 1.0)  # np.quantile takes thirty times as long
        return float(np.maximum(quantile, 1e-9 * self.periodogram.max()))

    def delays(self, theta: Array) -> int:
        """How many delays the spectrum has to be averaged over."""
        return DELAYS if self.mode_hz * math.exp(theta[LOG_TAU]) > _FEW_WAVES else 1

    def likelihood(self, prior: Prior | None = None, delays: int = 1) -> Likelihood:
        """What the kernels fit parameters to."""
        nothing = np.zeros(PARAMETERS)
        return Likelihood(
            first=2.0 * math.pi * self.first_hz,
            bin_width=2.0 * math.pi * self.bin_hz,
            delays=delays,
            log_frequency=self._log_frequency,
            periodogram=self.periodogram,
            used=self.used,
            work=self._work,
            spectrum=self._spectrum,
            weight=float(self.weight),
            prior_mean=nothing if prior is None else prior.mean,
            prior_precision=nothing if prior is None else prior.precision,
        )

    def evaluate(self, theta: Array) -> tuple[float, Array, Array]:
        """Negative log-likelihood, its negative gradient and the Fisher information."""
        score, information = np.empty(PARAMETERS), np.empty((PARAMETERS, PARAMETERS))
        value = posterior(theta, self.likelihood(delays=self.delays(theta)), score, information)
        return float(value), score, information

    def leave_out_outliers(self) -> None:
        """Leave out what stands out of the spectrum that was evaluated last: lines of other sources, narrow modes."""
        strange = self.periodogram > exceeded_by_chance(self.weight) * self._spectrum
        self.used &= ~np.convolve(strange, np.ones(2 * LINE_BINS + 1, np.bool_), "same")

    def leave_out_teeth(self, tooth_hz: float, width: float) -> None:
        """Leave out the multiples of the teeth that stand out of it, whole: a spindle that wanders makes them broad.

        Parameters
        ----------
        tooth_hz : float
            How often a tooth passes.
        width : float
            How far such a line reaches to either side, over its frequency.
        """
        bins = len(self.periodogram)
        first, last = (math.ceil((self.first_hz + at * self.bin_hz) / tooth_hz) for at in (0, bins))
        lines = np.arange(first, last) * tooth_hz
        middle, half = (lines - self.first_hz) / self.bin_hz, np.maximum(LINE_BINS, width * lines / self.bin_hz)
        begin, end = (np.clip(np.rint(edge), 0, bins).astype(np.int64) for edge in (middle - half, middle + half + 1.0))
        excess = np.append(0.0, np.cumsum(np.where(self.used, self.periodogram / self._spectrum - 1.0, 0.0)))
        used = np.append(0, np.cumsum(self.used))
        spread = np.sqrt((used[end] - used[begin]) / self.weight)
        strange = excess[end] - excess[begin] > _EXPECTED_LINE * spread
        edges = np.zeros(bins + 1)
        np.add.at(edges, begin[strange], 1.0)
        np.add.at(edges, end[strange], -1.0)
        self.used &= np.cumsum(edges[:-1]) == 0.0

    def leave_out_skirts(self, tooth_hz: float) -> None:
        """Leave out all that is near to a multiple of the teeth: a load that varies makes a skirt of each of them."""
        hertz = self.first_hz + np.arange(len(self.periodogram)) * self.bin_hz
        away = abs(hertz - np.rint(hertz / tooth_hz) * tooth_hz)
        self.used &= away > np.minimum(_SKIRT * hertz, _SKIRT_OF_SPACING * tooth_hz)

    @property
    def lack_of_fit(self) -> float:
        """Scatter of the periodogram about the spectrum evaluated last, on the scale of a few bins: 1 by chance alone.

        Not below 1, so that a variance may be multiplied by it.
        """
        excess = (self.periodogram / self._spectrum - 1.0)[self.used]
        size = max(_LEAST_GROUP, len(excess) // _GROUPS)
        groups = len(excess) // size
        sums = excess[: groups * size].reshape(groups, size).sum(axis=1)
        return max(1.0, float(self.weight * (sums @ sums) / size) / max(1, groups - PARAMETERS))

    @property
    def stands_out(self) -> bool:
        """Whether the largest of the spectrum that was evaluated last stands out of its median."""
        below = np.count_nonzero(self._spectrum < self._spectrum.max() / _STANDS_OUT)
        return bool(2 * below > len(self._spectrum))


@dataclass(frozen=True, slots=True)
class Prior:
    """Normal distribution of the parameters, independent; no precision where nothing is believed."""

    mean: Array
    precision: Array

    @classmethod
    def of(cls, delay_s: float, delay_uncertainty: float, floor: float) -> Prior:
        """Prior for a delay known to a relative standard deviation and a floor known to its order of magnitude."""
        mean, precision = np.zeros(PARAMETERS), np.zeros(PARAMETERS)
        for index, centre, sd in (
            (SLOPE, _SLOPE_MEAN, _SLOPE_SD),
            (LOG_ZETA, _LOG_ZETA_MEAN, _LOG_ZETA_SD),
            (LOG_TAU, np.log(delay_s), delay_uncertainty),
            (LOG_SPREAD, _LOG_SPREAD_MEAN, _LOG_SPREAD_SD),
            (MODULATION, _MODULATION_MEAN, _MODULATION_SD),
            (LOG_FLOOR, np.log(floor), _LOG_FLOOR_SD),
        ):
            mean[index], precision[index] = centre, sd**-2
        return cls(mean, precision)

    def unmodulated(self) -> Prior:
        """Return the same for teeth that do not modulate the process."""
        mean, precision = self.mean.copy(), self.precision.copy()
        mean[MODULATION], precision[MODULATION] = 0.0, _NOTHING_ELSE
        return Prior(mean, precision)


@dataclass(frozen=True, slots=True)
class Fit:
    """Where the posterior is largest.

    Attributes
    ----------
    theta : ndarray of float64, shape (9,)
        Parameters in the order of `kernels.regeneration`.
    information : ndarray of float64, shape (9, 9)
        Expected Hessian of the negative log-posterior.
    value : float
        Negative log-posterior.
    """

    theta: Array
    information: Array
    value: float

    @property
    def covariance(self) -> Array:
        """Of the parameters, shape (9, 9); infinite where the information does not determine them."""
        return covariance_of(self.information)

    @property
    def may_be(self) -> bool:
        """Whether kappa is not less than nothing, as far as is known."""
        return bool(self.theta[KAPPA] > -_BY_CHANCE * math.sqrt(self.covariance[KAPPA, KAPPA]))


def fit(band: Band, prior: Prior, start: Array, steps: int = _STEPS, delays: int | None = None) -> Pieces[Fit]:
    """Fisher scoring with Levenberg's damping from a start; over so many delays, or as many as it takes."""
    theta = start.copy()
    likelihood, space, information, progress = band.likelihood(prior, delays or band.delays(theta)), *_room()
    bins = len(band.periodogram)
    begin_climb(theta, likelihood, steps, space, information, progress)
    yield bins
    at_once = max(1, _BINS_AT_ONCE // bins)
    while climb(theta, likelihood, at_once, space, information, progress):
        yield at_once * bins
    return Fit(theta, information, float(progress[VALUE]))


def _room() -> tuple[Array, Array, Array]:
    """What a climb keeps from piece to piece, the information where it ends, and its progress."""
    return np.empty((2 * PARAMETERS + 4, PARAMETERS)), np.empty((PARAMETERS, PARAMETERS)), np.empty(3)


def covariance_of(information: Array) -> Array:
    """Covariance; infinite where the information does not determine the parameters.

    Near to singular, rounding would give an inverse with negative variances.
    """
    scale = np.sqrt(np.maximum(information.diagonal(), 1e-300))
    scales = scale[:, np.newaxis] * scale
    relative = information / scales
    if np.linalg.eigvalsh(relative)[0] < _DETERMINED:
        return np.full(information.shape, np.inf)
    return np.asarray(np.linalg.inv(relative) / scales, dtype=np.float64)


def without_regeneration(band: Band, prior: Prior, found: Fit) -> Pieces[float]:
    """How much less likely the band is without regeneration, but with any damping, than with what was found (nats)."""
    alone = prior.unmodulated()
    alone.precision[KAPPA], alone.precision[LOG_ZETA] = _NOTHING_ELSE, 0.0
    start = found.theta.copy()
    start[KAPPA], start[MODULATION], start[LOG_ZETA] = 0.0, 0.0, _LOG_SLIGHTLY_DAMPED
    start[LOG_OMEGA] = math.log(2.0 * math.pi * band.mode_hz)
    mode = yield from fit(band, alone, start, _STEPS_ALONE, delays=1)
    return band.evaluate(mode.theta)[0] - band.evaluate(found.theta)[0]


def search(band: Band, prior: Prior) -> Pieces[Fit]:
    """Fit from many starts: every one goes a few steps, the best to the end, then along the delay.

    The likelihood has a maximum for nearly every whole number of waves that the delay may hold within its prior, and
    between them others, where kappa is negative. No cut pulls its tool in: those are left for one that may be. What the
    teeth modulate is left to the fit that follows.
    """
    prior = prior.unmodulated()
    delay_s = float(np.exp(prior.mean[LOG_TAU]))
    start = yield from _race(band.coarse(_BINS_OF_RACE), prior, delay_s)
    best = yield from fit(band, prior, start)
    spread = float(prior.precision[LOG_TAU]) ** -0.5
    waves = delay_s * float(np.exp(best.theta[LOG_OMEGA])) / (2.0 * np.pi)
    halves = int(2.0 * _DELAY_RANGE * spread * waves)
    for shift in range(-halves, halves + 1):
        theta = best.theta.copy()
        theta[LOG_TAU] = prior.mean[LOG_TAU] + 0.5 * shift / waves
        challenger = yield from fit(band, prior, theta, _STEPS_OF_RACE)
        if challenger.value < best.value or not best.may_be:
            challenger = yield from fit(band, prior, challenger.theta)
            best = min(best, challenger, key=lambda found: (not found.may_be, found.value))
    return best


def _race(band: Band, prior: Prior, delay_s: float) -> Pieces[Array]:
    """Parameters of the start that is ahead after a few steps."""
    likelihood, space, information, progress = band.likelihood(prior), *_room()
    mean = band.periodogram.mean()
    ends: list[tuple[float, Array]] = []
    for theta in _starts(band, delay_s):
        ends.append((race(theta, likelihood, mean, _STEPS_OF_RACE, space, information, progress), theta))
        yield len(band.periodogram)  # as if it were one evaluation: three to six starts a frame
    return min(ends, key=lambda end: end[0])[1]


def _starts(band: Band, delay_s: float) -> Iterator[Array]:
    """Parameters from which one fit or another finds the way: with much and little regeneration, beside the peak."""
    log_floor, log_delay = math.log(band.floor), math.log(delay_s)
    for shift in (0.97, 1.0, 1.03):
        for zeta in (0.012, 0.035):
            for share in (0.1, 0.7):
                theta = np.zeros(PARAMETERS)
                omega = 2.0 * math.pi * band.mode_hz * shift
                theta[SLOPE] = _SLOPE_MEAN
                theta[LOG_OMEGA] = math.log(omega)
                theta[LOG_ZETA] = math.log(zeta)
                theta[KAPPA] = share * min(critical_coefficient(omega, zeta, delay_s), 10.0 * zeta)
                theta[LOG_TAU] = log_delay
                theta[LOG_SPREAD] = _LOG_SPREAD_MEAN
                theta[LOG_FLOOR] = log_floor
                yield theta
