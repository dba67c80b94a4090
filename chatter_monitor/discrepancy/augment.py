"""The augmented model: every parameter of the named terms fitted through the nonlinear filter, with intervals.

The regression on signatures is linear in the coefficients and takes the motion from the base model. Here the filter
itself knows the terms; Gauss-Newton steps on its whitened errors move coefficients, shapes and modes until they stay,
which takes the bias out that strong effects have in the regression.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy.diagnosis import Case
from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.innovations import Innovations
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Excitation

Vector = NDArray[np.float64]

STEPS = 8
_SETTLED_NATS = 0.02
_LARGEST_STEP = 0.5  # relative, of a shape
_DERIVATIVE_STEP = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Augmented:
    """The augmented model.

    Attributes
    ----------
    system : MachiningSystem
        What `simulate` runs.
    innovations : Innovations
        Of the augmented model on the recording.
    parameters : list of dict of str to (float, float)
        For each added term, its parameters with their standard deviations.
    columns : list of ndarray of float64, shape (n,)
        Signatures of everything that was fitted.
    gain_nats : float
        Gain of the whitened likelihood over the base model, on all samples, errors of the nonlinear filter itself.
    """

    system: MachiningSystem
    innovations: Innovations
    parameters: list[dict[str, tuple[float, float]]]
    columns: list[Vector]
    gain_nats: float


def augment(case: Case, found: Sequence[AppliedTerm]) -> Augmented:
    """Fit the terms that were found together with the modes.

    Parameters
    ----------
    case : Case
    found : sequence of AppliedTerm
        Terms with the coefficients of the regression, beside those that the base has.
    """
    weight = case.weight
    linear, terms = case.innovations.linear, [*case.innovations.terms, *found]
    first = len(case.innovations.terms)
    parameters: list[dict[str, tuple[float, float]]] = [{} for _ in found]
    columns: list[Vector] = []
    best: tuple[float, Innovations, Linear, list[AppliedTerm]] = (math.inf, case.innovations, linear, terms)
    for _ in range(STEPS + 1):
        inn = Innovations(case.recorded, linear, terms)
        loss = _loss(inn, weight)
        if loss > best[0] + 2.0:
            break  # the step went too far
        settled = best[0] - loss < _SETTLED_NATS
        if loss < best[0]:
            best = (loss, inn, linear, list(terms))
        columns, where = _columns(case, inn, terms[first:])
        evidence = Evidence(inn.white, np.array(columns), weight, [], case.evidence.block)
        fit = evidence.regress(list(range(len(columns))))
        for term, name, i in where:
            parameters[term][name] = (terms[first + term].parameters[name], float(fit.sd[i]))
        if settled:
            break
        linear = _retuned(linear, fit.coefficients[:2])
        terms = [*terms[:first], *_moved(terms[first:], where, fit.coefficients)]
    _, inn, linear, terms = best
    for term, known in enumerate(parameters):
        for name in known:
            known[name] = (terms[first + term].parameters[name], known[name][1])
    gain = _loss(case.innovations, weight) - best[0]
    return Augmented(calibrated(case, linear, terms), inn, parameters, columns, gain)


def _loss(inn: Innovations, weight: Vector) -> float:
    rest = inn.white * weight
    count = np.count_nonzero(weight)
    return 0.5 * count * math.log(float(rest @ rest) / count)


def _columns(
    case: Case, inn: Innovations, terms: Sequence[AppliedTerm]
) -> tuple[list[Vector], list[tuple[int, str, int]]]:
    """Signatures of the modes' retuning, of the nuisance, and of every parameter that is free."""
    motion = inn.motion
    columns = [inn.respond(motion.x), inn.respond(motion.v), inn.respond(np.ones_like(motion.x))]
    columns += [case.matrix[i] for i in case.evidence.nuisance[3:]]
    where: list[tuple[int, str, int]] = []
    for number, applied in enumerate(terms):
        for parameter in applied.term.parameters:
            value = applied.parameters.get(parameter.name, parameter.default or 0.0)
            free = parameter.linear or (value != 0.0 and parameter.name != "cutting_speed_m_s")
            if not free:
                continue
            step = 1.0 if parameter.linear else _DERIVATIVE_STEP * abs(value)
            ends = []
            for sign in (1.0, -1.0):
                shifted = dict(applied.parameters) | {parameter.name: value + sign * step}
                if not parameter.allows(value + sign * step) and not parameter.linear:
                    shifted[parameter.name] = value
                ends.append((inn.force(applied.term, _values(applied, shifted)), shifted[parameter.name]))
            slope = (ends[0][0] - ends[1][0]) / (ends[0][1] - ends[1][1])
            where.append((number, parameter.name, len(columns)))
            columns.append(inn.respond(slope))
    return columns, where


def _values(applied: AppliedTerm, parameters: dict[str, float]) -> list[float]:
    return [float(parameters.get(p.name, p.default or 0.0)) for p in applied.term.parameters]


def _moved(terms: Sequence[AppliedTerm], where: Sequence[tuple[int, str, int]], change: Vector) -> list[AppliedTerm]:
    """Terms after a Gauss-Newton step, within their bounds."""
    values = [dict(applied.parameters) for applied in terms]
    for number, name, i in where:
        parameter = next(p for p in terms[number].term.parameters if p.name == name)
        before, step = values[number][name], float(change[i])
        if not parameter.linear:
            step = float(np.clip(step, -_LARGEST_STEP * abs(before), _LARGEST_STEP * abs(before)))
        after = min(max(before + step, parameter.lower), parameter.upper)
        values[number][name] = after if parameter.allows(after) else before
    return [AppliedTerm(applied.term, parameters) for applied, parameters in zip(terms, values, strict=True)]


def _retuned(linear: Linear, change: Vector) -> Linear:
    """Modes with the spring and the damper that the regression adds to the tool; with several modes they stay."""
    if len(linear.modes) > 1:
        return linear
    mode = linear.modes[0]
    stiffness = mode.omega**2 + float(change[0]) * mode.participation**2
    damping = 2.0 * mode.damping_ratio * mode.omega + float(change[1]) * mode.participation**2
    if stiffness <= 0.0:
        return linear
    omega = math.sqrt(stiffness)
    ratio = min(max(damping / (2.0 * omega), 1e-5), 0.9)
    return replace(linear, modes=(replace(mode, frequency_hz=omega / (2.0 * math.pi), damping_ratio=ratio),))


def calibrated(case: Case, linear: Linear, terms: Sequence[AppliedTerm]) -> MachiningSystem:
    """A system with calibrated modes, intensity and noise, for `simulate`."""
    fitted = case.base.fitted
    intensity = math.exp(fitted.level) / (4.0 * math.pi)  # one-sided density in Hz of W is 4 pi S0
    noise = abs(case.system.sensor.gain) * math.sqrt(fitted.noise_density * 0.5 * case.whole.rate_hz)
    kind = case.system.excitation.kind
    excitation = replace(case.system.excitation, intensity=intensity) if kind != "measured" else Excitation("measured")
    sensor = replace(case.system.sensor, quantity=linear.quantity, noise_rms=noise)
    return MachiningSystem(linear.modes, tuple(terms), excitation, linear.spindle, sensor)
