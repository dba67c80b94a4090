"""Where a vibration stays at its limit the tool leaves the cut in every wave: what such a cycle says of regeneration.

The wave itself tells little: one that repeats follows itself at every delay that holds a whole number of waves. But
noise disturbs it all the time, and with regeneration what has disturbed a wave comes back with the next tooth, one
delay later, and not some waves sooner or later. So the machine with the tool leaving the cut is fitted to the filter's
prediction errors, with the spindle's delay and with others that hold some waves less or more. Seconds of a cycle say
far more than the rise before it, which is over within a few turns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.chatter.growth import (
    DAMPING_SD,
    FREQUENCY_SD,
    NOISE,
    SPEED_ERROR,
    Regeneration,
    Vibration,
    doubt,
)
from chatter_monitor.discrepancy.innovations import Diverged, Innovations
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.discrepancy.side_by_side import each
from chatter_monitor.discrepancy.whitening import ORDER
from chatter_monitor.kernels.delay_roots import critical_coefficient
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Spindle
from chatter_monitor.physics.terms import CATALOGUE

Vector = NDArray[np.float64]

LONGEST_S = 3.0  # of a cycle that is looked at
TURNS, LEAD_S = 2.2, 0.2  # after which the surface and the filter have forgotten where they began
LEAST_S = 0.5  # that is left then
OFF = (0, -1, 1, -2, 2, -4, 4, -7, 7)  # waves more than in the spindle's delay; one off is another speed, or nothing
SHORTEST, LONGEST = 0.5, 1.8  # delays that are tried, over the nominal one
LEAST_WRONG = 2  # of them have to be none of the spindle's
OVER_LIMIT, CHIPS = (1.2, 1.6, 2.2, 3.2), (0.2, 0.3, 0.45, 0.7, 1.0, 1.4)  # starts: coefficients, chips over amplitudes
PHASES = (-0.2, 0.0, 0.2)  # of a period
WAVES = 4  # which of a model's numbers that is
# Of these numbers: what is known of them beforehand, how far a fit goes at first, and where slopes are taken.
PRIOR_SD = np.array([np.inf, np.inf, 1.0, 1.0, np.inf, 3.0])
SCALE = np.array([0.1, 0.1, 0.3, 0.3, 0.03, 1.0])
SLOPE = 0.01 * SCALE
# How far coefficient and chip may be from where they start; the others from nothing.
LOWEST = np.array([-3.0, -3.0, -6.0, -6.0, -0.5, -8.0])
# How far the filter's steps, within which the tool leaves the cut, put coefficient, chip, frequency and damping off.
APPROXIMATE = np.array([0.03, 0.02, 0.1, 0.1, 0.0, 0.0])
FROM_AFAR, FROM_NEAR = 20, 6  # steps
DETERMINED = 1e-9  # least eigenvalue of information scaled to a diagonal of 1; rounding is 1e-16
FAR = 1e3  # errors of a model that runs away, over those of one that does not
# Errors are not whitened: a whitener predicts whatever repeats, and takes a wrong model's cycle for noise.
_AS_THEY_ARE = np.eye(1, ORDER + 1)[0]


class _Cycle:
    """Part of a recording in which a vibration is strong, and how badly models predict it.

    A model is a vector: the logarithms of coefficient and chip over the vibration's amplitude; how far frequency and
    damping are from the model file, in standard deviations of what it knows; how many waves more the delay holds than
    the spindle's; and the logarithm of the noise's variance over a usual one.
    """

    def __init__(
        self, whole: Recorded, system: MachiningSystem, spindle: Spindle, found: Vibration, first_s: float
    ) -> None:
        rate = whole.rate_hz
        begin, end = found.strong_s
        part = slice(round(begin * rate), round(min(end, begin + LONGEST_S) * rate))
        self.recorded = Recorded(whole.samples[part], whole.missing[part], rate)
        self.system, self.spindle, self.found, self.given = system, spindle, found, system.modes[found.mode]
        self.nominal_s, self.period_s = spindle.delay_s, 1.0 / found.frequency_hz
        # The filter takes it in proportion to what noise drives, which is that much less than what excites itself.
        self.noise = NOISE * (found.level / found.quiet) ** 2
        self.known = [applied for applied in system.terms if not applied.term.delayed]
        self.used = np.arange(self.recorded.samples.size) >= round(first_s * rate)
        self.error_sd: float | None = None

    def delay_s(self, model: Vector) -> float:
        """Delay of a model."""
        return self.nominal_s + float(model[WAVES]) * self.period_s

    def machine(self, model: Vector) -> MachiningSystem:
        """The machining system of a model."""
        coefficient, chip, frequency, damping, _, _ = model.tolist()
        modes = list(self.system.modes)
        modes[self.found.mode] = replace(
            self.given,
            frequency_hz=self.given.frequency_hz * math.exp(FREQUENCY_SD * frequency),
            damping_ratio=self.given.damping_ratio * math.exp(DAMPING_SD * damping),
        )
        values = {"coefficient": math.exp(coefficient), "chip_thickness": self.found.level * math.exp(chip)}
        return replace(
            self.system,
            modes=tuple(modes),
            terms=(*self.known, AppliedTerm(CATALOGUE["loss_of_contact"], values)),
            spindle=replace(self.spindle, speed_rpm=60.0 / (self.spindle.teeth * self.delay_s(model))),
        )

    def errors(self, model: Vector) -> Vector:
        """Prediction errors of a model, 0 where they do not count; infinite where it runs away."""
        machine, sensor = self.machine(model), self.system.sensor
        noise = self.noise * math.exp(float(model[-1]))
        linear = Linear(machine.modes, sensor.quantity, noise, sensor.low_cut_hz, machine.spindle)
        try:
            found = Innovations(self.recorded, linear, machine.terms, _AS_THEY_ARE, self.error_sd)
        except Diverged:
            return np.full(self.used.size, np.inf)
        return np.where(self.used & found.used, found.errors, 0.0)

    def misfit(self, model: Vector) -> float:
        """Negative logarithm of likelihood and prior, nats, the errors' size where it is best."""
        errors = self.errors(model)
        count = int(np.count_nonzero(errors))
        size = float(errors @ errors)
        if not 0.0 < size < math.inf:
            return math.inf
        return 0.5 * count * math.log(size / count) + 0.5 * float(np.sum((model / PRIOR_SD) ** 2))


@dataclass(frozen=True, slots=True, eq=False)
class _Fitted:
    """A model where it predicts best."""

    model: Vector
    misfit: float


def cycle_of(
    whole: Recorded, system: MachiningSystem, found: Vibration, rise: Regeneration | None
) -> Regeneration | None:
    """Regeneration with the tool leaving the cut, fitted to where a vibration is strong.

    None if it is not strong for long enough, or if the delay holds too few waves to be told from wrong ones.

    Parameters
    ----------
    whole : Recorded
        In units of motion.
    system : MachiningSystem
    found : Vibration
    rise : Regeneration, optional
        What its rise looks like: a place to start from.
    """
    if system.spindle is None:
        return None
    nominal = system.spindle.delay_s
    held = nominal * found.frequency_hz
    off = [waves for waves in OFF if SHORTEST < 1.0 + waves / held < LONGEST]
    rights = [waves for waves in off if abs(waves) <= SPEED_ERROR * held]
    wrongs = [waves for waves in off if abs(waves) > max(SPEED_ERROR * held, 1.0)]
    first_s = LEAD_S + TURNS * nominal * (1.0 + max(off) / held)
    begin, end = found.strong_s
    if len(wrongs) < LEAST_WRONG or min(end - begin, LONGEST_S) < first_s + LEAST_S:
        return None
    cycle = _Cycle(whole, system, system.spindle, found, first_s)
    start = _start(cycle, rise)
    for _ in range(2):  # the first time the errors are larger than they should be
        cycle.error_sd = _size(cycle.errors(start))
        start = _fit(cycle, start, 0, FROM_AFAR).model
    tried = each(lambda waves: _fit(cycle, start, waves, FROM_NEAR), [*rights, *wrongs])
    right = min(tried[: len(rights)], key=lambda one: one.misfit + doubt(cycle.delay_s(one.model), nominal))
    beyond = min(one.misfit for one in tried[len(rights) :]) - right.misfit
    covariance = _covariance(cycle, right)
    if covariance is None:
        return None
    machine = cycle.machine(right.model)
    values = machine.terms[-1].parameters
    mode = machine.modes[found.mode]
    coefficient, chip = values["coefficient"], values["chip_thickness"]
    scale = np.diag([mode.frequency_hz * FREQUENCY_SD, mode.damping_ratio * DAMPING_SD, coefficient, chip])
    order = [2, 3, 0, 1]
    away = right.model[2:4]
    return Regeneration(
        mode=mode,
        delay_s=cycle.delay_s(right.model),
        coefficient=coefficient,
        covariance=scale @ covariance[np.ix_(order, order)] @ scale,
        gain_nats=beyond - doubt(cycle.delay_s(right.model), nominal),
        wrong_nats=0.0,
        misfit_p=float(stats.chi2.sf(float(away @ away), 2)),
        chip=chip,
    )


def _start(cycle: _Cycle, rise: Regeneration | None) -> Vector:
    """The best of a grid of coefficients, chips and phases; with what the rise looks like."""
    given, first = cycle.given, cycle.system.modes[0]
    limit = critical_coefficient(given.omega, given.damping_ratio, cycle.nominal_s)
    limit *= (given.omega / (first.omega * given.participation)) ** 2
    machines = [(math.log(over * limit), 0.0, 0.0, phase) for over, phase in product(OVER_LIMIT, PHASES)]
    if rise is not None and rise.coefficient > 0.0:
        frequency = math.log(rise.mode.frequency_hz / given.frequency_hz) / FREQUENCY_SD
        damping = math.log(rise.mode.damping_ratio / given.damping_ratio) / DAMPING_SD
        shift = (rise.delay_s - cycle.nominal_s) / cycle.period_s
        machines.append((math.log(rise.coefficient), frequency, damping, shift))
    tried = [
        np.array([coefficient, math.log(chip), frequency, damping, shift, 0.0])
        for (coefficient, frequency, damping, shift), chip in product(machines, CHIPS)
    ]
    return tried[int(np.argmin([cycle.misfit(model) for model in tried]))]


def _fit(cycle: _Cycle, start: Vector, waves: int, steps: int) -> _Fitted:
    """Least squares of the errors, over their size at the start, and of what is known beforehand.

    With so many waves more in the delay than the spindle's, to half a wave.
    """
    middle = np.array([start[0], start[1], 0.0, 0.0, waves, 0.0])
    within = middle + LOWEST, middle - LOWEST
    start = start + (waves - round(float(start[WAVES]))) * np.eye(start.size)[WAVES]
    start = np.clip(start, within[0] + SLOPE, within[1] - SLOPE)
    size = _size(cycle.errors(start))

    def scaled(model: Vector) -> Vector:
        return np.append(np.nan_to_num(cycle.errors(model) / size, posinf=FAR), model / PRIOR_SD)

    def slopes(model: Vector) -> NDArray[np.float64]:
        here = scaled(model)
        return np.stack([scaled(model + step) - here for step in np.diag(SLOPE)], axis=1) / SLOPE

    found = optimize.least_squares(scaled, start, slopes, bounds=within, x_scale=SCALE, max_nfev=steps)
    model = np.asarray(found.x, dtype=np.float64)
    return _Fitted(model, cycle.misfit(model))


def _size(errors: Vector) -> float:
    """Root mean square of the errors that count."""
    return math.sqrt(float(errors @ errors) / max(1, int(np.count_nonzero(errors))))


def _covariance(cycle: _Cycle, fitted: _Fitted) -> NDArray[np.float64] | None:
    """Of a model's numbers; None where the errors do not tell them all."""
    errors = cycle.errors(fitted.model)
    size = _size(errors)
    moved = [cycle.errors(fitted.model + step) - errors for step in np.diag(SLOPE)]
    columns = np.stack(moved) / (SLOPE[:, None] * size)
    information = columns @ columns.T + np.diag(PRIOR_SD**-2.0)
    known = np.sqrt(np.diag(information))
    if not np.isfinite(information).all() or not known.all():  # a tool that stays in the cut tells no chip
        return None
    relative = information / np.outer(known, known)
    if float(np.linalg.eigvalsh(relative)[0]) < DETERMINED:
        return None
    return np.asarray(np.linalg.inv(relative) / np.outer(known, known), dtype=np.float64) + np.diag(APPROXIMATE**2)
