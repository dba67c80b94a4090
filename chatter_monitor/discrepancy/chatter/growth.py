"""A cut that the model calls stable and that chatters: what its rise and its limit say about regeneration.

A recording that chatters is no answer of a linear machine to noise, so nothing is fitted to its spectrum. While it
rises the tool is in the cut, and the machine is linear with a delay: stiffness, damping and regeneration are fitted to
the prediction errors of that stretch, no matter how many characteristic roots rise at once. A vibration that rises
tells less of the machine than noise does, so the model file counts as knowledge of the mode. That it is regeneration,
the delay has to say: errors follow the displacement one delay before, and not that of other delays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp
from scipy import stats

from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.innovations import Innovations
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Mode
from chatter_monitor.physics.terms import CATALOGUE

Vector = NDArray[np.float64]

COHERENT = 0.6  # over three decay times of the model's mode, which leave 0.05 of a vibration that noise drives
NEAR = 0.15  # relative distance of the vibration from a mode
WIDTH = 0.12  # relative, of the band around it
PAD_S = 0.2
FREQUENCY_SD, DAMPING_SD = 0.01, 0.3  # relative: how well a model file knows its machine
SPEED_SD, SPEED_ERROR = 0.002, 0.04  # of the nominal spindle speed: as a rule, and at most
WRONG = (0.55, 0.65, 0.75, 0.85, 1.18, 1.33, 1.5, 1.7)  # delays that are none of the spindle's, over the nominal
BEYOND_WRONG_NATS = 8.0
BELIEVED_P = 1e-3
STEADY, LASTS_S = 0.6, 0.2  # of the plateau over the largest amplitude
BEGINS, LEAST = 1.5, 0.01  # of the rise, over what was before, and over the largest amplitude
LEAVES = (0.3, 0.2, 0.13, 0.09, 0.06)  # of the largest amplitude, where the tool may still be in the cut
RISES = 1.5
EVEN_P = 0.02  # of errors that are as large at the end of a rise as before: the tool has not left the cut
LEAD_S = 0.3  # of recording before the rise, for the filter
NOISE = 1e-4  # variance of the sensor's noise over that of the signal
STEPS = 6


@dataclass(frozen=True, slots=True, eq=False)
class Vibration:
    """A coherent vibration near a mode.

    Attributes
    ----------
    mode : int
        Which of the model's, from 0.
    amplitude : ndarray of float64, shape (n,)
        Of the displacement, u.
    frequency_hz : float
        While it is strong.
    quiet : float
        Amplitude before it rises, u.
    plateau : float
        Amplitude that it stays at, u; NaN if it does not stay.
    rises_s : tuple of (float, float)
        Stretches in which it rises, up to `LEAVES` of its largest amplitude.
    steady_s : (float, float), optional
        Where it stays.
    strong_s : (float, float)
        From where it is strong first to where it is last, whether it stays or comes and goes.
    level : float
        Root mean square of its amplitude there, u.
    """

    mode: int
    amplitude: Vector
    frequency_hz: float
    quiet: float
    plateau: float
    rises_s: tuple[tuple[float, float], ...]
    steady_s: tuple[float, float] | None
    strong_s: tuple[float, float]
    level: float


def vibration(whole: Recorded, system: MachiningSystem) -> Vibration | None:
    """The coherent vibration of a recording near one of the modes of its model; None if noise may drive what is there.

    Parameters
    ----------
    whole : Recorded
        In units of motion.
    system : MachiningSystem
    """
    rate = whole.rate_hz
    frequency, density = dsp.welch(whole.samples, rate, nperseg=min(whole.samples.size, int(0.5 * rate)))
    best: tuple[float, int, float] | None = None
    for i, mode in enumerate(system.modes):
        near = abs(frequency / mode.frequency_hz - 1.0) < NEAR
        if near.any() and (best is None or float(density[near].max()) > best[0]):
            best = float(density[near].max()), i, float(frequency[near][np.argmax(density[near])])
    if best is None:
        return None
    _, number, peak_hz = best
    mode = system.modes[number]
    z = _analytic(whole, peak_hz)
    lag = max(1, round(3.0 / (mode.damping_ratio * mode.omega) * rate))
    loud = float(np.sum(np.abs(z) ** 2))
    if lag >= z.size // 3 or abs(complex(np.vdot(z[:-lag], z[lag:]))) < COHERENT * loud:
        return None
    z = z / _per_displacement(system, peak_hz)
    return _described(z, number, peak_hz, rate)


def _analytic(whole: Recorded, centre_hz: float) -> NDArray[np.complex128]:
    """Analytic signal of the band around a frequency."""
    n = whole.samples.size + round(PAD_S * whole.rate_hz)  # its end is not to be heard at its beginning
    spectrum = np.fft.fft(whole.samples, n)
    away = np.abs(np.fft.fftfreq(n, 1.0 / whole.rate_hz) / centre_hz - 1.0) / WIDTH
    window = np.where(away < 1.0, np.cos(0.5 * np.pi * np.minimum(away, 1.0)) ** 2, 0.0)
    return np.asarray(np.fft.ifft(2.0 * spectrum * window)[: whole.samples.size])


def _per_displacement(system: MachiningSystem, frequency_hz: float) -> float:
    """What the sensor shows of a displacement of 1 u at a frequency; its gain is taken out already."""
    omega = 2.0 * math.pi * frequency_hz
    power = {"displacement": 0, "velocity": 1, "acceleration": 2, "pressure": 2}[system.sensor.quantity]
    low = system.sensor.low_cut_hz / frequency_hz if system.sensor.quantity == "pressure" else 0.0
    return omega**power / math.hypot(1.0, low)


def _described(z: NDArray[np.complex128], number: int, peak_hz: float, rate: float) -> Vibration:
    """Rise and plateau of a vibration."""
    step = max(1, round(4.0 * rate / peak_hz))
    smooth = np.asarray(dsp.oaconvolve(np.abs(z), np.ones(step) / step, "same"))
    top = float(np.quantile(smooth, 0.95))
    strong = np.flatnonzero(smooth > STEADY * top)
    first, last = int(strong[0]), int(strong[-1])
    turn = complex(np.vdot(z[first:last], z[first + 1 : last + 1]))
    inside = smooth[first:last]
    halves = [float(np.mean(part)) for part in np.array_split(inside, 2)]
    lasts = (last - first) / rate > LASTS_S and float(np.mean(inside > STEADY * top)) > 0.9
    steady = lasts and abs(halves[1] / halves[0] - 1.0) < 0.3
    loud = int(np.argmax(smooth > LEAVES[0] * top))
    quiet = float(np.median(smooth[: max(loud, 1)]))
    still = np.flatnonzero(smooth[:loud] <= max(BEGINS * quiet, LEAST * top))
    rises = []
    if still.size:
        begin = int(still[-1])
        ends = [begin + int(np.argmax(smooth[begin:] > level * top)) for level in LEAVES]
        rises = [(begin / rate, end / rate) for end in ends if smooth[end] > RISES * smooth[begin]]
    strong_s, level = (first / rate, last / rate), float(np.sqrt(np.mean(inside**2)))
    return Vibration(
        mode=number,
        amplitude=smooth,
        frequency_hz=float(np.angle(turn)) * rate / (2.0 * math.pi),
        quiet=quiet,
        plateau=level if steady else math.nan,
        rises_s=tuple(rises),
        steady_s=strong_s if steady else None,
        strong_s=strong_s,
        level=level,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Regeneration:
    """Mode, delay and coefficient with which a vibration that excites itself is predicted best.

    Attributes
    ----------
    mode : Mode
    delay_s, coefficient : float
        The coefficient counts in w^2 of the model's first mode.
    covariance : ndarray of float64, shape (3, 3) or (4, 4)
        Of the mode's frequency in Hz, its damping ratio, the coefficient, and the chip if that is known. The delay is
        not sure either, and the model file's knowledge of mode and speed counts.
    gain_nats, wrong_nats : float
        What the displacement one delay before explains, and the most that a delay does which is none of the spindle's;
        over the latter where a cycle tells it.
    misfit_p : float
        How often a model file is as far from its machine as the mode has to be.
    chip : float
        Thickness beyond which the tool leaves the cut, u, where that is seen; NaN otherwise.
    """

    mode: Mode
    delay_s: float
    coefficient: float
    covariance: NDArray[np.float64]
    gain_nats: float
    wrong_nats: float
    misfit_p: float
    chip: float = math.nan

    @property
    def sd(self) -> Vector:
        """Standard deviations of frequency, damping ratio, coefficient and chip, if that is known."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def sure(self) -> bool:
        """Whether it is regeneration at the spindle's delay, on a machine that may be that of the model file."""
        return (
            self.coefficient > 3.0 * float(self.sd[2])
            and self.gain_nats > self.wrong_nats + BEYOND_WRONG_NATS
            and self.misfit_p > BELIEVED_P
        )


def regeneration_of(whole: Recorded, system: MachiningSystem, found: Vibration) -> Regeneration | None:
    """Fit regeneration to the stretch in which a vibration rises; None without one, or without a spindle.

    Gauss-Newton steps on the filter's prediction errors, as for every augmented model; the model file's mode is prior
    knowledge, because a vibration that rises at one rate and frequency cannot tell mode from regeneration.
    """
    tried = []
    for rise in found.rises_s:
        fitted = _fitted(whole, system, found, rise)
        if fitted is None:
            return None
        made, even_p = fitted
        if made.sure and even_p > EVEN_P:
            return made
        tried.append(made)
    return max(tried, key=lambda made: made.gain_nats - made.wrong_nats, default=None)


def _fitted(
    whole: Recorded, system: MachiningSystem, found: Vibration, rise_s: tuple[float, float]
) -> tuple[Regeneration, float] | None:
    """Regeneration from one stretch, and how often errors that stay of one size are as uneven in it."""
    if system.spindle is None:
        return None
    nominal, given = system.spindle.delay_s, system.modes[found.mode]
    if nominal * given.frequency_hz < 0.6:
        return None
    rate = whole.rate_hz
    begin, end = (round(at * rate) for at in rise_s)
    lead = round((LEAD_S + 1.1 * nominal) * rate)
    part = slice(max(begin - lead, 0), end)
    recorded = Recorded(whole.samples[part], whole.missing[part], rate)
    inside = np.arange(recorded.samples.size) >= begin - part.start
    known = [applied for applied in system.terms if not applied.term.delayed]
    period = 1.0 / given.frequency_hz
    shares = np.arange(-SPEED_ERROR, SPEED_ERROR + 1e-9, max(0.05 * period / nominal, 0.002))
    near = [float(nominal * (1.0 + share)) for share in shares]
    scan = _Stretch(recorded, inside, system, given, nominal, 0.0, known)
    gains = [scan.gain(delay, given) - doubt(delay, nominal) for delay in near]
    delay = near[int(np.argmax(gains))]
    wrong = max(scan.gain(nominal * factor, given) for factor in WRONG)
    w2 = system.modes[0].omega ** 2
    mode, coefficient = given, 0.0
    for step in range(STEPS):
        fine = np.linspace(-0.04, 0.04, 9) * period / (1 + step)
        here = _Stretch(recorded, inside, system, mode, delay, coefficient, known)
        around = [delay + float(shift) for shift in fine]
        delay = around[int(np.argmax([here.gain(each, given) - doubt(each, nominal) for each in around]))]
        change, sd = here.step(delay, given)
        stiffness = mode.omega**2 + change[0] * given.participation**2
        damping = 2.0 * mode.damping_ratio * mode.omega + change[1] * given.participation**2
        if stiffness <= 0.0:
            return None
        omega = math.sqrt(float(stiffness))
        ratio = min(max(float(damping) / (2.0 * omega), 1e-3 * given.damping_ratio), 0.9)
        mode = replace(given, frequency_hz=omega / (2.0 * math.pi), damping_ratio=ratio)
        coefficient += float(change[2]) / w2
        if abs(change[2]) < 0.02 * sd[2]:
            break
    away = (
        math.log(mode.frequency_hz / given.frequency_hz) / FREQUENCY_SD,
        math.log(mode.damping_ratio / given.damping_ratio) / DAMPING_SD,
    )
    p = float(stats.chi2.sf(away[0] ** 2 + away[1] ** 2, 2))
    last = _Stretch(recorded, inside, system, mode, delay, coefficient, known)
    # Stiffness and damping of the mode, and delayed stiffness, in the report's parameters.
    share = given.participation**2 / (2.0 * mode.omega)
    turn = np.array([share / (2.0 * math.pi), share, 1.0 / w2])
    covariance = last.covariance(delay, given) * np.outer(turn, turn)
    made = Regeneration(mode, delay, coefficient, covariance, max(gains), wrong, p)
    return made, last.even_p


def doubt(delay_s: float, nominal_s: float) -> float:
    """What a delay costs, nats: speeds are nearly always as said, and now and then far from it (Cauchy)."""
    return math.log1p(((delay_s / nominal_s - 1.0) / SPEED_SD) ** 2)


class _Stretch:
    """Prediction errors of a machine with some regeneration in the stretch of rise."""

    def __init__(
        self,
        recorded: Recorded,
        inside: NDArray[np.bool_],
        system: MachiningSystem,
        mode: Mode,
        delay_s: float,
        coefficient: float,
        known: list[AppliedTerm],
    ) -> None:
        spindle = system.spindle
        if spindle is None:
            raise ValueError("regeneration has a spindle")
        self.spindle, self.rate_hz = replace(spindle, speed_rpm=60.0 / (spindle.teeth * delay_s)), recorded.rate_hz
        modes = tuple(mode if each.participation == mode.participation else each for each in system.modes)
        linear = Linear(modes, system.sensor.quantity, NOISE, system.sensor.low_cut_hz, self.spindle)
        terms = [*known, AppliedTerm(CATALOGUE["regenerative_delay"], {"coefficient": max(coefficient, 0.0)})]
        self.mode, self.innovations = mode, Innovations(recorded, linear, terms)
        self.already = coefficient * system.modes[0].omega ** 2
        inn = self.innovations
        self.fixed = inn.respond([inn.motion.x, inn.motion.v])
        weight = np.where(inside & inn.used, 1.0, 0.0)
        self.weight = weight / float(np.std(inn.white[weight > 0.0]))
        self.displacement, self.velocity = inn.motion.x[0], inn.motion.v[0]

    def _normal(self, delay_s: float, given: Mode) -> tuple[Vector, Vector]:
        """Normal equations of stiffness, damping and delayed stiffness, the mode's prior in them."""
        column = self.innovations.respond([_before(self.displacement, delay_s * self.rate_hz)])
        columns = np.concatenate([self.fixed, column])
        evidence = Evidence(self.innovations.white, columns, self.weight, [], self.weight.size)
        total = evidence.over(np.array([True]))
        # Regeneration pushes with coefficient w^2 [x - x(t - tau)].
        turn = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
        normal, right = turn.T @ total[1:, 1:] @ turn, turn.T @ total[1:, 0]
        wide = np.array([2.0 * FREQUENCY_SD * given.omega**2, DAMPING_SD * 2.0 * given.damping_ratio * given.omega])
        now, then = (np.array([m.omega**2, 2.0 * m.damping_ratio * m.omega]) for m in (self.mode, given))
        normal[:2, :2] += np.diag(wide**-2.0)
        right[:2] += (then - now) / wide**2
        return normal, right

    def gain(self, delay_s: float, given: Mode) -> float:
        """What regeneration with that delay explains beyond a mode that is a little off, nats; 0 if it would pull."""
        normal, right = self._normal(delay_s, given)
        solved = np.linalg.solve(normal, right)
        if solved[2] <= -self.already:
            return 0.0
        return 0.5 * float(right @ solved - right[:2] @ np.linalg.solve(normal[:2, :2], right[:2]))

    @property
    def even_p(self) -> float:
        """Whether the errors of the last third are as large as those before: F test."""
        left = self.innovations.white[self.weight > 0.0]
        early, late = np.split(left, [2 * left.size // 3])
        return float(stats.f.sf(np.mean(late**2) / np.mean(early**2), late.size, early.size))

    def step(self, delay_s: float, given: Mode) -> tuple[Vector, Vector]:
        """Change of stiffness, damping and delayed stiffness, and their standard deviations."""
        normal, right = self._normal(delay_s, given)
        covariance = np.linalg.inv(normal)
        return covariance @ right, np.sqrt(np.diag(covariance))

    def covariance(self, delay_s: float, given: Mode) -> NDArray[np.float64]:
        """Of stiffness, damping and delayed stiffness, the delay fitted beside them."""
        normal, _ = self._normal(delay_s, given)
        forces = [_before(state, delay_s * self.rate_hz) for state in (self.displacement, self.velocity)]
        lagged, moving = self.innovations.respond(forces)
        # d/d tau of coefficient w^2 [x - x(t - tau)]
        columns = np.array([*self.fixed, self.fixed[0] - lagged, self.already * moving]) * self.weight
        by_delay = columns @ columns[3]
        beside = by_delay[:3] / math.sqrt(by_delay[3] + (SPEED_SD * delay_s) ** -2.0)
        return np.asarray(np.linalg.inv(normal - np.outer(beside, beside)))


def _before(x: Vector, samples: float) -> NDArray[np.float64]:
    """Displacement some samples before, between the samples as its band has it; at a sample and at the next."""
    n = x.size
    size = 1 << int(np.ceil(np.log2(2 * n)))
    spectrum = np.fft.rfft(x, size)
    turns = np.arange(spectrum.size) / size
    rows = [np.fft.irfft(spectrum * np.exp(-2j * np.pi * turns * (samples - ahead)), size)[:n] for ahead in (0.0, 1.0)]
    start = math.ceil(samples) + 1
    found = np.stack(rows)
    found[:, :start] = 0.0
    return found
