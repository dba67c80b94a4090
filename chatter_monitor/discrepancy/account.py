"""The figures of a report: other explanations, what could have been seen, the fit, the calibration."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from chatter_monitor.discrepancy.case import Case
from chatter_monitor.discrepancy.findings import estimate
from chatter_monitor.discrepancy.known import coefficients
from chatter_monitor.discrepancy.locate import whiteness_p
from chatter_monitor.discrepancy.report import Alternative, Calibration, Estimate, Finding, Fit, Information

DETECT_NATS = 10.0


def alternatives(case: Case, findings: Sequence[Finding]) -> list[Alternative]:
    """Other explanations, best first."""
    taken = {finding.name for finding in findings}
    entries = [Alternative(s.candidate.name, float(s.evidence_nats)) for s in case.ranking]
    if case.local is not None:
        there = {each.name for each in case.local.as_likely}
        entries = [*case.local.as_likely, *(each for each in entries if each.name not in there)]
    entries += [Alternative(name, float(gain)) for name, gain in case.base.alternatives]
    entries.append(Alternative("force_surface", float(case.ceiling.held_out_nats)))
    return sorted((e for e in entries if e.name not in taken), key=lambda each: -each.evidence_nats)[:8]


def information(case: Case) -> list[Information]:
    """How small an effect the recording would have shown."""
    inn, evidence = case.innovations, case.evidence
    w2 = inn.linear.modes[0].omega ** 2
    x, v = inn.motion.x[0], inn.motion.v[0]
    restoring = w2 * float(np.std(x))
    linear = np.linalg.qr(np.column_stack([x, v, np.ones_like(x)]))[0]
    tried = [(s.candidate.term, s.candidate.unit(s.candidate.linear[0])) for s in case.ranking]
    found: dict[str, Information] = {}
    for scored, (force, _) in zip(case.ranking, inn.forces(tried), strict=True):
        candidate = scored.candidate
        rest = force - linear @ (force @ linear)
        sd = float(evidence.regress(scored.all_columns[:1], ~case.training).sd[0])
        detectable = sd * math.sqrt(2.0 * DETECT_NATS) * float(np.std(rest)) / restoring
        seconds = case.whole.seconds * (detectable / 0.02) ** 2
        found.setdefault(candidate.name, Information(candidate.name, float(detectable), float(seconds)))
    return list(found.values())


def held_out_fit(case: Case) -> Fit:
    """How well base and named terms predict the held-out blocks."""
    evidence, held = case.evidence, ~case.training
    local = case.columns.get("local", [])
    columns = [*local, *(c for scored in case.named for c in scored.columns)]
    with case.contest.without(local):
        base, full = evidence.regress([], case.training), evidence.regress(columns, case.training)
        gain = evidence.gain_on(full, columns, base, held)
        rest = evidence.rest(base, [], held)
    samples = float(evidence.samples[held].sum())
    scale = float(np.mean(np.log(1.0 / case.weight[case.weight > 0.0])))
    before = scale + 0.5 * math.log(2.0 * math.pi) + rest / samples
    white = case.innovations.white
    explained = case.explained()
    used = case.innovations.used
    blocks = [(i * case.block_s, min((i + 1) * case.block_s, case.whole.seconds)) for i in np.flatnonzero(held)]
    return Fit(
        [(round(float(a), 3), round(float(b), 3)) for a, b in blocks],
        before,
        before - gain / samples,
        float(gain),
        float(gain / math.log(2.0)),
        whiteness_p(white, used),
        whiteness_p(explained, used),
    )


def one_cut(case: Case) -> list[str]:
    """What one recording cannot say about a damping ratio above that of the model."""
    given, fitted = case.system.modes[0].damping_ratio, case.base.fitted
    ratio, sd = case.base.machine.modes[0].damping_ratio, float(fitted.sd[1])
    if ratio * math.exp(-3.0 * sd) <= given:
        return []
    return [
        f"The damping ratio is {100 * ratio:.3g} %, the model has {100 * given:.3g} %. Whether the structure or the "
        "cut (process damping) damps, one recording cannot tell; recordings at several cutting speeds can."
    ]


def calibration(case: Case) -> Calibration:
    """Modes, and coefficients of the forces that the model has, as given and as fitted."""
    before: dict[str, float] = {}
    after: dict[str, Estimate] = {}
    fitted = case.base.fitted
    at = 0
    for i, (given, now) in enumerate(zip(case.system.modes, case.base.machine.modes, strict=False), 1):
        before[f"mode.{i}.frequency_hz"] = given.frequency_hz
        before[f"mode.{i}.damping_ratio"] = given.damping_ratio
        after[f"mode.{i}.frequency_hz"] = estimate(now.frequency_hz, now.frequency_hz * fitted.sd[at], "Hz")
        after[f"mode.{i}.damping_ratio"] = estimate(now.damping_ratio, now.damping_ratio * fitted.sd[at + 1], "1")
        at += 2 + (i > 1)
    if not case.system.terms or not case.columns:
        return Calibration(before, after)
    given_terms = (case.uncorrected or case.system).terms
    for (number, name), pair in coefficients(case).items():
        unit = next(p.unit for p in given_terms[number].term.parameters if p.name == name)
        before[f"term.{number + 1}.{name}"] = given_terms[number].parameters[name]
        after[f"term.{number + 1}.{name}"] = estimate(*pair, unit)
    return Calibration(before, after)
