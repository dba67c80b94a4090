"""From a force balance to what is said: verdict, findings in units of model and input, the model that runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from chatter_monitor.discrepancy.all_along import REST_SHARE
from chatter_monitor.discrepancy.candidates import Candidate
from chatter_monitor.discrepancy.case import BLOCK_S
from chatter_monitor.discrepancy.conclude import RETUNED_P
from chatter_monitor.discrepancy.driven.balance import LINEAR
from chatter_monitor.discrepancy.driven.case import DrivenCase
from chatter_monitor.discrepancy.driven.output_error import FreeRun, free_run
from chatter_monitor.discrepancy.findings import IN_WORDS, SENSES, estimate
from chatter_monitor.discrepancy.locate import whiteness_p
from chatter_monitor.discrepancy.name import Scored
from chatter_monitor.discrepancy.report import (
    Alternative,
    Calibration,
    Estimate,
    Finding,
    Fit,
    ForceBalance,
    Located,
    Report,
    Verdict,
)
from chatter_monitor.discrepancy.whereabouts import MAPPED_P
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Mode


@dataclass(frozen=True, slots=True, eq=False)
class DrivenDiagnosis:
    """The whole answer.

    Attributes
    ----------
    report : Report
    case : DrivenCase
        How it came about.
    model : MachiningSystem
        What to simulate with.
    """

    report: Report
    case: DrivenCase
    model: MachiningSystem


def conclude_driven(case: DrivenCase, progress: Callable[[str], None] = lambda _step: None) -> DrivenDiagnosis:
    """Say what was found."""
    strange = case.after.p_value < MAPPED_P and (case.rest_nats > REST_SHARE * case.gain_nats or not case.named)
    mode = _mode(case, named=True)
    base = case.system if mode is None else replace(case.system, modes=(mode,))
    applied = [_applied(case, scored, base) for scored in case.named]
    findings = [_finding(case, scored, term) for scored, term in zip(case.named, applied, strict=True)]
    model = base if strange else replace(base, terms=(*base.terms, *applied))
    warnings: list[str] = []
    if mode is None:
        warnings.append(
            "The balance shows no vibrating mode (mass, spring, weak damping); that of the model is left as given."
        )
    if strange and findings:
        warnings.append(f"Named, but not all that is there: {', '.join(f.name for f in findings)}.")
    before = after = None
    if mode is not None and model.terms:
        progress("free runs")
        before, after = _runs(case, model)
        model = after.system if after is not None else model
    verdict: Verdict
    if strange:
        verdict = "unknown"
    elif findings:
        verdict = "missing_physics"
    else:
        verdict = "parameters" if _retuned_p(case) < RETUNED_P else "none"
    closed = ForceBalance(
        case.balance.edge_hz,
        case.residual(named=False),
        case.residual(named=True),
        before.error if before else None,
        after.error if after else None,
    )
    report = Report(
        verdict,
        _summary(verdict, findings, closed),
        Located(statistic=case.before, maps=[case.before, case.after]),
        [] if strange else findings,
        _alternatives(case),
        [],
        _fit(case),
        _calibration(case, model.modes[0] if mode is not None else None),
        warnings,
        force_balance=closed,
    )
    return DrivenDiagnosis(report, case, model)


def _mode(case: DrivenCase, named: bool) -> Mode | None:
    """The mode that the balance shows, with what is named or with the linear part alone; None if it shows none."""
    mass, damping, stiffness = (float(value) for value in case.linear(named)[:3])
    if mass <= 0.0 or stiffness <= 0.0 or damping < 0.0:
        return None
    ratio = damping / (2.0 * math.sqrt(stiffness * mass))
    return Mode(math.sqrt(stiffness / mass) / (2.0 * math.pi), ratio) if ratio < 1.0 else None


def _runs(case: DrivenCase, model: MachiningSystem) -> tuple[FreeRun | None, FreeRun | None]:
    """Free runs of the linear model at its best, and of the one with everything."""
    runs = []
    for named, system in ((False, replace(case.system, terms=())), (True, model)):
        mode = _mode(case, named)
        mass = float(case.linear(named)[0])
        start = replace(system, modes=(mode,)) if mode is not None else None
        runs.append(free_run(start, case.force, case.displacement, mass) if start is not None else None)
    return runs[0], runs[1]


def _applied(case: DrivenCase, scored: Scored, base: MachiningSystem) -> AppliedTerm:
    """A named term in the units of the model: per unit mass, and over w^2 where the term has it."""
    mass = case.coefficients[0][0]
    found = []
    for i, column in zip(scored.candidate.linear, scored.all_columns, strict=True):
        force, _ = case.coefficients.get(column, (0.0, 0.0))
        found.append(force / ((mass if mass > 0.0 else 1.0) * _w_power(scored.candidate, i, base.modes[0].omega)))
    return AppliedTerm(scored.candidate.term, scored.candidate.with_coefficients(found))


def _w_power(candidate: Candidate, i: int, omega: float) -> float:
    """What the force of a unit coefficient is multiplied by if w is not 1."""
    state, unit = (3.7, 2.9, 0.0, 0.0), candidate.unit(i)
    one = candidate.term.force(*state, 1.0, 1.0, unit)
    return candidate.term.force(*state, omega, 1.0, unit) / one if one else 1.0


def _finding(case: DrivenCase, scored: Scored, applied: AppliedTerm) -> Finding:
    """A named term; coefficients in units of the model and of the input, shapes as on the grid."""
    term, candidate = scored.candidate.term, scored.candidate
    parameters: dict[str, Estimate] = {}
    for i, parameter in enumerate(term.parameters):
        value = applied.parameters[parameter.name]
        if i not in candidate.linear:
            parameters[parameter.name] = Estimate(value, (value, value), parameter.unit)
            continue
        column = scored.all_columns[candidate.linear.index(i)]
        if column in case.coefficients:
            force, sd = case.coefficients[column]
            parameters[parameter.name] = estimate(value, abs(value / force) * sd, parameter.unit)
            parameters[f"{parameter.name}_as_force"] = estimate(force, sd, f"input ({parameter.unit} with w = 1)")
    sense = None
    if term.name in SENSES:
        sense = SENSES[term.name][0 if parameters["coefficient"].value > 0.0 else 1]
    why = (
        f"{IN_WORDS[term.name].capitalize()}: explains held-out stretches better by {scored.held_out_nats:.1f} nats "
        f"(p = {scored.p_value:.1g}); {term.equation}."
    )
    return Finding(term.name, sense, parameters, float(scored.evidence_nats), float(scored.p_value), why)


def _retuned_p(case: DrivenCase) -> float:
    """How often chance moves spring and damper as far from those of the model; the gain of the input is free."""
    mode = case.system.modes[0]
    linear, sd = (np.array(each) for each in zip(*(case.coefficients[i] for i in range(3)), strict=True))
    expected = linear[0] * np.array([2.0 * mode.damping_ratio * mode.omega, mode.omega**2])
    spread = np.hypot(sd[1:], expected * sd[0] / linear[0])
    return float(stats.chi2.sf(float(np.sum(((linear[1:] - expected) / spread) ** 2)), 2))


def _alternatives(case: DrivenCase) -> list[Alternative]:
    taken = {scored.candidate.name for scored in case.named}
    entries = [Alternative(s.candidate.name, float(s.evidence_nats)) for s in case.ranking]
    entries.append(Alternative("force_surface", float(case.ceiling_nats)))
    return sorted((e for e in entries if e.name not in taken), key=lambda each: -each.evidence_nats)[:8]


def _fit(case: DrivenCase) -> Fit:
    seconds = case.balance.present.size * case.balance.step_s
    blocks = [
        (float(i) * BLOCK_S, min(float(i + 1) * BLOCK_S, seconds)) for i in np.flatnonzero(~case.contest.training)
    ]
    evidence = case.evidence
    white = []
    for chosen in ([], case.chosen):
        coefficients = evidence.regress(chosen).all_coefficients
        rest = evidence.errors - coefficients @ evidence.columns[[*evidence.nuisance, *chosen]]
        white.append(whiteness_p(rest, evidence.used))
    return Fit(blocks, None, None, case.gain_nats, case.gain_nats / math.log(2.0), white[0], white[1])


def _calibration(case: DrivenCase, mode: Mode | None) -> Calibration:
    given = case.system.modes[0]
    before = {"mode.1.frequency_hz": given.frequency_hz, "mode.1.damping_ratio": given.damping_ratio}
    after = {f"input.{name}": estimate(*case.coefficients[i], "input") for i, name in enumerate(LINEAR)}
    if mode is not None:
        mass, damping, stiffness = (abs(sd / value) for value, sd in (case.coefficients[i] for i in range(3)))
        half = 0.5 * math.hypot(mass, stiffness)
        after["mode.1.frequency_hz"] = estimate(mode.frequency_hz, mode.frequency_hz * half, "Hz")
        spread = abs(mode.damping_ratio) * math.hypot(damping, half)
        after["mode.1.damping_ratio"] = estimate(mode.damping_ratio, spread, "1")
    return Calibration(before, after)


def _summary(verdict: Verdict, findings: Sequence[Finding], closed: ForceBalance) -> str:
    left = f"Of the measured force {100 * closed.residual_before:.3g} % is left by the linear model"
    if findings:
        left += f", {100 * closed.residual_after:.3g} % with what is named (held-out stretches)"
    match verdict:
        case "none":
            return f"The model explains the recording. {left}."
        case "parameters":
            return f"The model explains the recording once its parameters are corrected. {left}."
        case "unknown":
            return f"The force depends on the motion like nothing in the catalogue, so nothing is named. {left}."
    spoken = "; ".join(IN_WORDS[f.name] + (f" ({f.sense})" if f.sense else "") for f in findings)
    return f"The model lacks {spoken}. {left}."
