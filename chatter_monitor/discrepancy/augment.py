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

from chatter_monitor.discrepancy.basis import retuning
from chatter_monitor.discrepancy.case import Case
from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.innovations import Diverged, Innovations
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Excitation

Vector = NDArray[np.float64]

STEPS = 8
_SETTLED_NATS = 0.02
_SHARES = (1.0, 0.4, 0.1)  # of a step, until it leads down
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

    Raises
    ------
    Diverged
        If the model runs away from the recording however little there is of the terms.
    """
    weight = case.weight
    before = list(case.innovations.terms)
    if any(applied.term.chip_thickness for applied in found):  # it stands for the delay whose chip never ends
        before = [applied for applied in before if not applied.term.delayed]
    linear, terms = case.innovations.linear, [*before, *found]
    first = len(before)
    here = _fitted(case, linear, terms, first, weight)
    for _ in range(STEPS):
        if here is None:  # too much of it even to begin with
            terms = [*before, *(_softened(applied) for applied in terms[first:])]
            here = _fitted(case, linear, terms, first, weight)
            continue
        if here.promised < _SETTLED_NATS:
            break
        there = None
        for share in _SHARES:
            change = share * here.change
            moved = [*before, *_moved(here.terms[first:], here.where, change)]
            there = _fitted(case, _retuned(here.linear, change[:2]), moved, first, weight, here.loss)
            if there is not None:
                break
        if there is None:
            break
        settled = here.loss - there.loss < _SETTLED_NATS
        here = there
        if settled:
            break
    if here is None:
        raise Diverged("the model with the terms that were found runs away")
    parameters: list[dict[str, tuple[float, float]]] = [{} for _ in found]
    for term, name, i in here.where:
        parameters[term][name] = (here.terms[first + term].parameters[name], float(here.sd[i]))
    gain = _loss(case.innovations, weight) - here.loss
    system = calibrated(case, here.linear, here.terms)
    return Augmented(system, here.innovations, parameters, here.columns, gain)


@dataclass(frozen=True, slots=True, eq=False)
class _Fitted:
    """A model on the recording, and where the next Gauss-Newton step would take it."""

    linear: Linear
    terms: list[AppliedTerm]
    innovations: Innovations
    loss: float
    columns: list[Vector]
    where: list[tuple[int, str, int]]
    change: Vector
    sd: Vector
    promised: float


def _fitted(
    case: Case, linear: Linear, terms: list[AppliedTerm], first: int, weight: Vector, beat: float = math.inf
) -> _Fitted | None:
    """Look at a model; None if it runs away from the recording, or does not beat the loss of another."""
    try:
        inn = Innovations(case.recorded, linear, terms)
    except Diverged:
        return None
    loss = _loss(inn, weight)
    if loss >= beat:
        return None
    columns, where = _columns(case, inn, terms[first:])
    evidence = Evidence(inn.white, np.array(columns), weight, [], case.evidence.block)
    fit = evidence.regress(list(range(len(columns))))
    return _Fitted(linear, terms, inn, loss, columns, where, fit.coefficients, fit.sd, fit.gain)


def _softened(applied: AppliedTerm) -> AppliedTerm:
    """Half as much of a term."""
    half = {p.name: 0.5 * applied.parameters[p.name] for p in applied.term.parameters if p.linear}
    return AppliedTerm(applied.term, {**applied.parameters, **half})


def _loss(inn: Innovations, weight: Vector) -> float:
    rest = inn.white * weight
    count = np.count_nonzero(weight)
    return 0.5 * count * math.log(float(rest @ rest) / count)


def _columns(
    case: Case, inn: Innovations, terms: Sequence[AppliedTerm]
) -> tuple[list[Vector], list[tuple[int, str, int]]]:
    """Signatures of the modes' retuning, of the nuisance, and of every parameter that is free."""
    nuisance = [*retuning(inn)]
    fitted_here = list(case.columns["retuning"])
    if any(applied.term.delayed for applied in terms):
        fitted_here += case.columns.get("lagged", [])
    nuisance += [case.matrix[i] for i in case.evidence.nuisance if i not in fitted_here]
    slopes: list[Vector] = []
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
            where.append((number, parameter.name, len(nuisance) + len(slopes)))
            slopes.append(slope)
    return [*nuisance, *inn.respond(slopes)], where


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
