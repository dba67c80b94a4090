"""Several recordings against one model: each by itself, then what they share, then one answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from scipy import stats

from chatter_monitor.discrepancy.augment import Augmented, augment
from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.conclude import Diagnosis, conclude
from chatter_monitor.discrepancy.diagnosis import examine
from chatter_monitor.discrepancy.findings import IN_WORDS, SENSES, estimate
from chatter_monitor.discrepancy.innovations import Diverged
from chatter_monitor.discrepancy.name import PRICE_NATS
from chatter_monitor.discrepancy.report import (
    Alternative,
    Calibration,
    Compared,
    Estimate,
    Finding,
    Fit,
    Located,
    Report,
    Verdict,
)
from chatter_monitor.discrepancy.together import shared
from chatter_monitor.discrepancy.together.shared import PROCESS_DAMPING, Shared
from chatter_monitor.errors import InputError
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Cut
from chatter_monitor.physics.terms import CATALOGUE

IN_WORDS_SHARED = IN_WORDS | {PROCESS_DAMPING: "process damping, which falls as the cutting speed rises"}


@dataclass(frozen=True, slots=True, eq=False)
class Together:
    """The answer to several recordings.

    Attributes
    ----------
    report : Report
    cuts : tuple of Cut
    diagnoses : tuple of Diagnosis
        Of each recording by itself.
    shared : Shared
    model : MachiningSystem
        What to simulate with, as in the first cut.
    """

    report: Report
    cuts: tuple[Cut, ...]
    diagnoses: tuple[Diagnosis, ...]
    shared: Shared
    model: MachiningSystem


def diagnose_together(
    recordings: Sequence[tuple[str, Recorded]],
    system: MachiningSystem,
    folders: Sequence[str],
    progress: Callable[[str], None] = lambda _step: None,
) -> Together:
    """Diagnose recordings that share a machine.

    Parameters
    ----------
    recordings : sequence of (str, Recorded)
        Two or more, with the names of their files.
    system : MachiningSystem
        The model; its cuts say at which speed each was recorded.
    folders : sequence of str
        Where the report of each will be, from the directory of the common one.
    progress : callable, optional
        Told the name of every step.

    Raises
    ------
    InputError
        If a recording cannot be used, or there is no cut for it.
    """
    machines = [system.in_cut(name) for name, _ in recordings]
    cuts = [_cut(system, name) for name, _ in recordings]
    diagnoses = []
    for (name, recorded), machine in zip(recordings, machines, strict=True):
        progress(name)
        diagnoses.append(conclude(examine(recorded, shared.with_process_damping(machine), progress)))
    modes = {len(each.case.innovations.linear.modes) for each in diagnoses}
    if len(modes) > 1:
        raise InputError(
            "some recordings show more modes than others, so they share no machine",
            got=", ".join(
                f"{name}: {len(d.case.innovations.linear.modes)}"
                for (name, _), d in zip(recordings, diagnoses, strict=True)
            ),
            remedy="Add the further mode to the model, or diagnose them one by one.",
        )
    progress("what they share")
    terms, fits, alternatives = _best_set(diagnoses)
    seen = shared.seen([each.case.base for each in diagnoses], cuts)
    if terms:
        seen = [_retuned(each, fitted) for each, fitted in zip(seen, fits, strict=True)]
    found = shared.share(seen)
    return _concluded(system, cuts, diagnoses, found, fits if terms else [], alternatives, folders)


def _cut(system: MachiningSystem, name: str) -> Cut:
    for cut in system.cuts:
        if cut.recording == name:
            return cut
    return Cut(name, system.spindle.speed_rpm if system.spindle else 1.0)


def _mechanical(diagnosis: Diagnosis) -> tuple[str, ...]:
    return tuple(sorted(scored.candidate.name for scored in diagnosis.case.named))


def _best_set(diagnoses: Sequence[Diagnosis]) -> tuple[tuple[str, ...], list[Augmented], list[Alternative]]:
    """Of the sets of terms that were named in any recording, the one that explains most of all recordings.

    Each is fitted to every recording with coefficients of its own; that these agree is tested afterwards.
    """
    sets: dict[tuple[str, ...], tuple[AppliedTerm, ...]] = {}
    for diagnosis in diagnoses:
        if diagnosis.augmented is not None and diagnosis.case.named and diagnosis.report.verdict == "missing_physics":
            added = [
                applied for applied in diagnosis.augmented.system.terms if applied.term.name in _mechanical(diagnosis)
            ]
            sets.setdefault(_mechanical(diagnosis), tuple(added))
    best: tuple[float, tuple[str, ...], list[Augmented]] = (0.0, (), [])
    tried = []
    for names, applied in sets.items():
        fits: list[Augmented] = []
        for diagnosis in diagnoses:
            own = diagnosis.augmented
            if own is not None and _mechanical(diagnosis) == names:
                fits.append(own)
                continue
            try:
                fits.append(augment(diagnosis.case, applied))
            except Diverged:
                break
        if len(fits) < len(diagnoses):
            continue
        gain = sum(each.gain_nats - PRICE_NATS * sum(len(p) for p in each.parameters) for each in fits)
        tried.append(Alternative(" + ".join(names), float(gain)))
        if gain > best[0]:
            best = (gain, names, fits)
    _, names, fits = best
    return names, fits, [each for each in tried if each.name != " + ".join(names)]


def _retuned(seen: shared.Seen, fitted: Augmented) -> shared.Seen:
    """Values of the modes with the terms that were named; how sure they are the base tells."""
    values = seen.values.copy()
    for i, mode in enumerate(fitted.system.modes):
        values[2 * i : 2 * i + 2] = np.log(mode.frequency_hz), 2.0 * mode.damping_ratio * mode.omega
    return replace(seen, values=values, modes=fitted.system.modes)


def _agreed(fits: Sequence[Augmented], cuts: Sequence[Cut]) -> tuple[list[Finding], list[str]]:
    """Terms with the mean of their parameters over the recordings, and what does not agree."""
    findings, apart = [], []
    first = fits[0]
    added = first.system.terms[len(first.system.terms) - len(first.parameters) :]
    for number, applied in enumerate(added):
        units = {p.name: p.unit for p in applied.term.parameters}
        parameters: dict[str, Estimate] = {}
        least = 1.0
        for name in first.parameters[number]:
            values, sd = np.array([each.parameters[number].get(name, (np.nan, np.inf)) for each in fits]).T
            there = np.isfinite(values) & (sd > 0.0) & np.isfinite(sd)
            weight = sd[there] ** -2.0
            mean = float(weight @ values[there] / weight.sum())
            scatter = float(weight @ (values[there] - mean) ** 2)
            least = min(least, float(stats.chi2.sf(scatter, max(int(there.sum()) - 1, 1))))
            parameters[name] = estimate(mean, float(weight.sum() ** -0.5), units[name])
        if least < shared.DISAGREE_P:
            apart.append(f"the parameters of {applied.term.name} differ between the recordings (p = {least:.1g})")
        sense = None
        if applied.term.name in SENSES:
            sense = SENSES[applied.term.name][0 if parameters["coefficient"].value > 0.0 else 1]
        gain = sum(each.gain_nats for each in fits)
        why = (
            f"{IN_WORDS[applied.term.name].capitalize()}: fitted to all {len(cuts)} recordings it explains {gain:.1f} "
            f"nats more than the base; {applied.term.equation}."
        )
        findings.append(
            Finding(applied.term.name, sense, parameters, float(gain), float(stats.chi2.sf(2.0 * gain, len(fits))), why)
        )
    return findings, apart


def _process_damping(found: Shared, cuts: Sequence[Cut]) -> Finding:
    value, sd = found.process_damping or (0.0, 0.0)
    unit = next(p.unit for p in CATALOGUE[PROCESS_DAMPING].parameters if p.linear)
    ratios = [found.damping_ratio(0, cut) for cut in cuts]
    why = (
        f"Process damping: with b / v_c the damping ratio goes from {100 * min(ratios):.3g} to "
        f"{100 * max(ratios):.3g} %; the structure alone has {100 * found.modes[0].damping_ratio:.3g} %. A damping "
        f"that is the same at all speeds is worse by {found.gain_nats:.1f} nats (p = {found.p_value:.1g})."
    )
    return Finding(
        PROCESS_DAMPING, None, {"coefficient": estimate(value, sd, unit)}, found.gain_nats, found.p_value, why
    )


def _concluded(
    system: MachiningSystem,
    cuts: Sequence[Cut],
    diagnoses: Sequence[Diagnosis],
    found: Shared,
    fits: Sequence[Augmented],
    alternatives: list[Alternative],
    folders: Sequence[str],
) -> Together:
    findings, strange = _agreed(fits, cuts) if fits else ([], [])
    model_has = any(applied.term.name == PROCESS_DAMPING for applied in system.terms)
    if found.process_damped and not model_has:
        findings.append(_process_damping(found, cuts))
    if found.regeneration is not None:
        value, sd = found.regeneration
        best = max((o for d in diagnoses for o in d.case.base.omissions), key=lambda o: o.gain_nats)
        parameters = {"coefficient": estimate(value, sd, "1")}
        why = f"{IN_WORDS['regenerative_delay'].capitalize()}, at the delay of each recording's own spindle speed."
        findings.append(Finding("regenerative_delay", None, parameters, best.gain_nats, best.p_value, why))
    of_all = {finding.name for finding in findings}
    for cut, diagnosis in zip(cuts, diagnoses, strict=True):
        if diagnosis.report.verdict == "unknown":
            strange.append(f"in {cut.recording}, something that no term explains")
        for finding in diagnosis.report.terms:
            if finding.name not in of_all and finding.name not in CATALOGUE:
                findings.append(msgspec.structs.replace(finding, why=f"{finding.why} In {cut.recording}."))
    words = {"frequency": "natural frequency", "damping": "damping", "regeneration": "regeneration"}
    for family, p in found.disagreement.items():
        if p < shared.DISAGREE_P:
            law = " as process damping does not explain" if family == "damping" and found.process_damping else ""
            strange.append(f"a {words[family]} that differs between the recordings{law} (p = {p:.1g})")
    warnings = _warnings(system, cuts, found)
    verdict: Verdict = "none"
    if strange:
        verdict = "unknown"
    elif findings:
        verdict = "missing_physics"
    elif any(each.report.verdict == "parameters" for each in diagnoses):
        verdict = "parameters"
    after = shared.estimates(found)
    given = system.modes[0]
    before = {"mode.1.frequency_hz": given.frequency_hz, "mode.1.damping_ratio": given.damping_ratio}
    compared = [
        Compared(
            cut.recording,
            cut.speed_rpm if system.spindle or system.cuts else None,
            cut.cutting_speed_m_s,
            each.report.verdict,
            each.report.calibration.after["mode.1.frequency_hz"],
            each.report.calibration.after["mode.1.damping_ratio"],
            found.damping_ratio(0, cut),
            f"{folder}/report.html",
        )
        for cut, each, folder in zip(cuts, diagnoses, folders, strict=True)
    ]
    held = [each.report.fit.gain_nats for each in diagnoses]
    report = Report(
        verdict,
        _summary(verdict, findings, strange, found, len(cuts)),
        Located(statistic=min((m for d in diagnoses for m in d.report.located.maps), key=lambda m: m.p_value)),
        findings if verdict != "unknown" else [],
        alternatives,
        [],
        Fit([], None, None, float(sum(held)), float(sum(held) / np.log(2.0)), None, None),
        Calibration(before, after),
        warnings
        + (
            [f"Named, but not all that is there: {', '.join(f.name for f in findings)}."]
            if strange and findings
            else []
        ),
        recordings=compared,
    )
    return Together(
        report, tuple(cuts), tuple(diagnoses), found, _model(system, cuts, diagnoses, found, fits, findings)
    )


def _warnings(system: MachiningSystem, cuts: Sequence[Cut], found: Shared) -> list[str]:
    """What the recordings do not allow to say."""
    if found.process_damping is None:
        if len({cut.speed_rpm for cut in cuts}) == 1:
            what = (
                "All recordings are of one speed" if system.cuts else "The model file has no [[cut]] with their speeds"
            )
            return [f"{what}: process damping cannot be told from structural damping."]
        return ["Without cutting_speed_m_s in every [[cut]] process damping cannot be told from structural damping."]
    if not found.checked:
        return ["Two cutting speeds give a line, but cannot tell that damping follows b / v_c; a third would."]
    return []


def _summary(verdict: Verdict, findings: Sequence[Finding], strange: Sequence[str], found: Shared, count: int) -> str:
    mode = found.modes[0]
    tuned = (
        f"The {count} recordings share a mode at {mode.frequency_hz:.4g} Hz with {100 * mode.damping_ratio:.3g} ± "
        f"{196 * float(found.damping_sd[0]):.2g} % damping"
    )
    tuned += " of the structure." if found.process_damped else "."
    match verdict:
        case "none":
            return f"The simulation explains the recordings. {tuned}"
        case "parameters":
            return f"The simulation explains the recordings once its parameters are corrected. {tuned}"
        case "unknown":
            return f"The recordings show {'; and '.join(strange)}. {tuned}"
    spoken = "; ".join(IN_WORDS_SHARED[f.name] + (f" ({f.sense})" if f.sense else "") for f in findings)
    return f"The simulation lacks {spoken}. {tuned}"


def _model(
    system: MachiningSystem,
    cuts: Sequence[Cut],
    diagnoses: Sequence[Diagnosis],
    found: Shared,
    fits: Sequence[Augmented],
    findings: Sequence[Finding],
) -> MachiningSystem:
    """The machine with what is shared, as in the first cut; the others are in its list of cuts."""
    like = fits[0].system if fits else diagnoses[0].model
    values = {finding.name: {name: e.value for name, e in finding.parameters.items()} for finding in findings}
    geometry = {
        "width_m": cuts[0].width_m or shared.UNIT_WIDTH_M,
        "cutting_speed_m_s": cuts[0].cutting_speed_m_s or 1.0,
    }
    terms = [
        replace(applied, parameters={**applied.parameters, **values.get(applied.term.name, {})})
        for applied in like.terms
    ]
    known = any(applied.term.name == PROCESS_DAMPING for applied in system.terms)
    if found.process_damped and found.process_damping is not None and (known or PROCESS_DAMPING in values):
        parameters = {"coefficient": found.process_damping[0], **geometry}
        terms.append(AppliedTerm(CATALOGUE[PROCESS_DAMPING], parameters))
    if found.regeneration is not None and not any(applied.term.delayed for applied in terms):
        coefficient = {"coefficient": max(found.regeneration[0], 0.0)}
        terms.append(AppliedTerm(CATALOGUE["regenerative_delay"], coefficient))
    return replace(like, modes=found.modes, terms=tuple(terms), cuts=system.cuts)
