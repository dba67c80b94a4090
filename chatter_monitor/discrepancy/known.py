"""Forces that the model file has, in a spectrum.

A spectrum shows the machine with all its forces. In noise, a force f(x, x') is in it much like the spring and the
damper that come nearest to it along the motion (statistical linearisation: Caughey 1963, J. Acoust. Soc. Am. 35, 1706).
What is left of the force beside them makes harmonics and broadens peaks, which a linear machine would need another mode
or another noise for; its response is taken out of the recording before a spectrum is fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft, stats

from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.case import Case
from chatter_monitor.discrepancy.columns import known_units
from chatter_monitor.discrepancy.innovations import Innovations
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm

Vector = NDArray[np.float64]

CORRECTED_P = 1e-3  # chance at which a coefficient of the model file is not believed


def coefficients(case: Case) -> dict[tuple[int, str], tuple[float, float]]:
    """Coefficients of the model's forces with their standard deviations, by number of the term and name."""
    found = {}
    with case.contest.without(case.columns["known"]) as evidence:
        fit = evidence.regress(case.columns["known"])
    for (number, name, _), change, sd in zip(known_units(case.system), fit.coefficients, fit.sd, strict=True):
        found[number, name] = case.system.terms[number].parameters[name] + float(change), float(sd)
    fitted = case.base.fitted
    for number, applied in enumerate(case.system.terms):
        if applied.term.delayed:  # the spectrum tells
            found[number, "coefficient"] = fitted.linear.regeneration, float(fitted.sd[fitted.regeneration_at])
    return dict(sorted(found.items()))


def wrong_coefficients(case: Case) -> list[str]:
    """Which coefficients of the model file do not hold, in words."""
    given = (case.uncorrected or case.system).terms
    surely = float(stats.norm.isf(0.5 * CORRECTED_P))
    return [
        f"{name} of {given[number].term.name} is {value:.3g}, not {given[number].parameters[name]:.3g}"
        for (number, name), (value, sd) in coefficients(case).items()
        if abs(value - given[number].parameters[name]) > surely * sd
    ]


def corrected(case: Case) -> MachiningSystem | None:
    """The model with coefficients of its forces as the recording has them; None if they are as good as given."""
    known = case.columns["known"]
    if not known:
        return None
    with case.contest.without(known) as evidence:
        if evidence.p_value(known, evidence.everything) > CORRECTED_P:
            return None
    terms = list(case.system.terms)
    for (number, name), (value, _) in coefficients(case).items():
        applied = terms[number]
        lower = next(p.lower for p in applied.term.parameters if p.name == name)
        terms[number] = replace(applied, parameters={**applied.parameters, name: max(value, lower)})
    return replace(case.system, terms=tuple(terms))


def linearised(
    recorded: Recorded, linear: Linear, terms: Sequence[AppliedTerm], omega: float
) -> tuple[Recorded, tuple[float, float]]:
    """The recording with a spring and a damper in the place of forces, and these two, per unit mass; (0, 0) for none.

    Parameters
    ----------
    recorded : Recorded
        Within its band.
    linear : Linear
        Machine that the spectrum shows, which tells the motion.
    terms : sequence of AppliedTerm
        The forces; regeneration is none of them, a spectrum shows it as what it is.
    omega : float
        Angular frequency of the model's first mode, to which coefficients of stiffness refer.
    """
    terms = [applied for applied in terms if not applied.term.delayed]
    if not terms:
        return recorded, (0.0, 0.0)
    inn = Innovations(recorded, linear)
    inn.observer = inn.observer._replace(omega=omega)
    x, v = inn.motion.x[0], inn.motion.v[0]
    force = inn.forces([(applied.term, applied.values) for applied in terms])[:, 0].sum(axis=0)
    columns = np.column_stack([x, v, np.ones_like(x)])
    spring, damper, mean = np.linalg.lstsq(columns[inn.used], force[inn.used], rcond=None)[0]
    rest = np.where(inn.used, force - columns @ (spring, damper, mean), 0.0)
    samples = recorded.samples + _answer(rest, linear, recorded.rate_hz)
    samples = np.where(recorded.missing, 0.0, samples)
    return replace(recorded, samples=samples), (float(spring), float(damper))


def _answer(force: Vector, linear: Linear, rate_hz: float) -> Vector:
    """What the sensor sees of a force that pushes, shape (n,)."""
    n = fft.next_fast_len(2 * force.size, real=True)
    frequency_hz = fft.rfftfreq(n, 1.0 / rate_hz)
    answer = linear.receptance(frequency_hz)
    if linear.delay_s is not None:
        lag = np.exp(-2j * np.pi * frequency_hz * linear.delay_s)
        answer /= 1.0 + linear.regeneration * linear.modes[0].omega ** 2 * (1.0 - lag) * answer
    return np.asarray(fft.irfft(linear.sensed(frequency_hz) * answer * fft.rfft(force, n), n)[: force.size])
