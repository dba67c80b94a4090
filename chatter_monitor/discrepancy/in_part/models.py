"""Models with a force that acts above an amplitude, or in a stretch of the recording, only; `simulate` runs them.

Above an amplitude the force goes through the nonlinear filter, coefficients, amplitude and mode fitted, as forces do
that act all along: the machine of the whole recording has a part of it in its stiffness and damping.
In a stretch it goes through the filter as well, beside whatever acts all along.
"""

from __future__ import annotations

from dataclasses import replace

from chatter_monitor.discrepancy.augment import Augmented, Start, augment, fullest
from chatter_monitor.discrepancy.case import Case, Local, Threshold
from chatter_monitor.discrepancy.evidence import Regressed
from chatter_monitor.discrepancy.findings import of_local
from chatter_monitor.discrepancy.innovations import Diverged
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.discrepancy.report import Finding
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Drift
from chatter_monitor.physics.terms import ABOVE

EDGE_S = 1e-3  # within which a force sets in and ceases


def begins_above(case: Case, augmented: Augmented) -> Augmented | None:
    """The model in which the one named force begins at an amplitude; None if it does not, or is none better."""
    if case.threshold is None:
        return None
    try:
        fitted, threshold = _above(case, augmented.system.terms[-1], case.threshold, augmented.innovations.linear)
    except Diverged:
        return None
    if fitted.gain_nats < augmented.gain_nats:
        return None
    case.threshold = threshold
    return fitted


def acts_there(
    case: Case, local: Local, augmented: Augmented | None, base: MachiningSystem
) -> tuple[Finding, Augmented | None]:
    """What acts in a part as a finding, and the model with it; None if there is none.

    Parameters
    ----------
    case : Case
    local : Local
    augmented : Augmented, optional
        Model with what acts all along.
    base : MachiningSystem
        The same without anything that was found.
    """
    fit = _regressed(case)
    applied = _applied(local, fit)
    if applied is not None and local.between_s is not None:
        before = augmented or Augmented(base, case.innovations, [], [], [], local.as_likely[0].evidence_nats)
        fitted = _fitted_there(case, applied, local.between_s, before)
        if fitted is None:
            return of_local(local, fit), replace(before, system=_in_stretch(before.system, applied, local.between_s))
        system = replace(before.system, modes=fitted.system.modes)
        system = _in_stretch(system, fitted.system.terms[-1], local.between_s)
        return of_local(local, fit, fitted.parameters[0]), replace(fitted, system=system)
    if applied is None or local.threshold is None or case.named:
        return of_local(local, fit), None
    try:
        fitted, threshold = _above(case, applied, local.threshold, _without_it(case.innovations.linear, fit))
    except Diverged:
        return of_local(local, fit), None
    case.local = local = replace(local, threshold=threshold)
    return of_local(local, fit, fitted.parameters[0]), fitted


def _regressed(case: Case) -> Regressed:
    """Coefficients of what acts in a part, beside all else that is fitted."""
    columns = case.columns["local"]
    with case.contest.without(columns) as evidence:
        return evidence.regress(columns)


def _applied(local: Local, fit: Regressed) -> AppliedTerm | None:
    """The force that acts in a part, by the regression; None if it is a spring and a damper that change there."""
    if local.candidate is None:
        return None
    found = dict(zip(local.units, fit.coefficients, strict=False))
    coefficients = [float(found.get(i, 0.0)) for i in local.candidate.linear]
    return AppliedTerm(local.candidate.term, local.candidate.with_coefficients(coefficients))


def _without_it(linear: Linear, fit: Regressed) -> Linear:
    """The machine without what it has in its stiffness and damping of a force above an amplitude."""
    spring, damper = fit.all_coefficients[:2]
    return linear.beside(float(spring), float(damper)) if len(linear.modes) == 1 else linear


def _above(case: Case, applied: AppliedTerm, threshold: Threshold, linear: Linear) -> tuple[Augmented, Threshold]:
    """Fit a force that begins at an amplitude, from a machine without it; and that amplitude.

    Raises
    ------
    Diverged
        If the model runs away from the recording.
    """
    begun = AppliedTerm(applied.term.above_amplitude, {**applied.parameters, ABOVE.name: threshold.above})
    fitted = augment(case, [begun], linear)
    above, sd = fitted.parameters[0].pop(ABOVE.name)
    return fitted, replace(threshold, above=above, ci95=(above - 1.96 * sd, above + 1.96 * sd))


def _fitted_there(
    case: Case, applied: AppliedTerm, between_s: tuple[float, float], before: Augmented
) -> Augmented | None:
    """Fit a force that acts in a stretch, beside what acts all along; None if it runs away."""
    start = Start((applied,), before.innovations.linear, before.system.terms, between_s=between_s)
    try:
        return fullest(case, [start])[1]
    except Diverged:
        return None


def _in_stretch(system: MachiningSystem, applied: AppliedTerm, between_s: tuple[float, float]) -> MachiningSystem:
    """The machine with a force that is there in a stretch only."""
    begins, ends = between_s
    at = (begins - EDGE_S, begins, ends, ends + EDGE_S)
    number = len(system.terms) + 1
    drifts = tuple(
        Drift(f"term.{number}.{p.name}", at, (0.0, value, value, 0.0))
        for p, value in zip(applied.term.parameters, applied.values, strict=True)
        if p.linear
    )
    return replace(system, terms=(*system.terms, applied), drifts=(*system.drifts, *drifts))
