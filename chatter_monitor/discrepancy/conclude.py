"""From what was found to what is said: verdict, findings, a plain summary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from chatter_monitor.discrepancy.above import named_above
from chatter_monitor.discrepancy.account import alternatives, calibration, held_out_fit, information, one_cut
from chatter_monitor.discrepancy.augment import Augmented, Start, augment, calibrated, fullest
from chatter_monitor.discrepancy.case import SURE, Case, Local
from chatter_monitor.discrepancy.columns import beside
from chatter_monitor.discrepancy.diagnosis import offset_beside
from chatter_monitor.discrepancy.faults import restlessness
from chatter_monitor.discrepancy.findings import (
    IN_WORDS,
    is_harmonic,
    of_clipping,
    of_local,
    of_omission,
    of_term,
    plain,
    strongest,
    tones_of,
)
from chatter_monitor.discrepancy.innovations import Diverged
from chatter_monitor.discrepancy.known import wrong_coefficients
from chatter_monitor.discrepancy.linear import MECHANICAL, Omission
from chatter_monitor.discrepancy.name import MOST_TERMS, PRICE_NATS, Scored
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.discrepancy.partial import above, applied_there, in_stretch, regressed, without_it
from chatter_monitor.discrepancy.report import Finding, Fit, Located, Report, Verdict
from chatter_monitor.discrepancy.unnamed import POWERS_AND_SIDES, Unnamed, examine_rest, out_of_range
from chatter_monitor.discrepancy.whereabouts import MAPPED_P, whereabouts
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm

RETUNED_P = 1e-3  # of the modes of the model file
# What a force of no name has to explain beside what is named, and as a share of that: no law is exact, nor is a filter;
# a regression, which takes the motion from the base model, much less so.
REST_NATS = 6.0
REST_SHARE, FITTED_REST_SHARE = 0.2, 0.02
SECOND_SHARE = 0.8  # of what a second name explains that another power or symmetry of the first may explain, too
MOST_LAWS = 2  # that are believed to act together; more of them imitate one that is none of theirs
RIVALS = 3  # fitted fully
RIVAL_NATS, RIVAL_SHARE = 6.0, 0.05  # how near to the leader's evidence, for that
_FEIGNED = ("second_mode", "coloured_excitation")  # by the noise of another machine
_TIED = "a force that acts"  # so begins what several names explain about equally
_STATIC = ("phase_plane", "displacement", "velocity", "amplitude")  # forces that have no memory


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """The whole answer.

    Attributes
    ----------
    report : Report
    case : Case
        How it came about.
    base : MachiningSystem
        The base model, calibrated.
    augmented : Augmented, optional
        With the terms that were found, if there are any.
    model : MachiningSystem
        What to simulate with.
    """

    report: Report
    case: Case
    base: MachiningSystem
    augmented: Augmented | None

    @property
    def model(self) -> MachiningSystem:
        """The augmented model; the calibrated base if nothing has to be added."""
        return self.augmented.system if self.augmented else self.base


def base_of(case: Case) -> MachiningSystem:
    """The base model, calibrated."""
    return calibrated(case, case.base.machine, case.system.terms)


def conclude(case: Case) -> Diagnosis:
    """Say what was found."""
    linear = case.innovations.linear
    base = base_of(case)
    retuned = case.base.retuning_p < RETUNED_P or case.base.quantity != case.system.sensor.quantity
    wrong = wrong_coefficients(case) if case.system.terms and case.columns else []
    findings: list[Finding] = []
    warnings: list[str] = []
    if case.clipped is not None and not case.maps[1:]:
        findings.append(of_clipping(case.clipped))
        located = Located(amplitude=(case.clipped.level, case.clipped.level), maps=case.maps)
        summary = (
            f"The sensor clips at {case.clipped.level:.3g}: {case.clipped.samples} samples are cut off. "
            "Nothing can be said about the machine before it is recorded with less gain."
        )
        fit = Fit([], None, None, 0.0, 0.0, None, None)
        report = Report("missing_physics", summary, located, findings, [], [], fit, calibration(case))
        return Diagnosis(report, case, base, None)
    if case.clipped is not None:
        warnings.append(f"{case.clipped.samples} samples at the end of the sensor's range were left out.")
    if case.whole.missing.any():
        warnings.append(f"{np.mean(case.whole.missing):.1%} of the samples are missing, silent or clipped.")
    strange: list[str] = []
    tones, foreign = tones_of(case)
    findings += strongest(tones)
    leaves_cut = any(scored.candidate.term.chip_thickness for scored in case.named)
    omissions = case.base.omissions
    rest = restlessness(case.explained(), case.telling, case.recorded.rate_hz)
    if rest.kind is not None:
        findings.append(plain(rest.kind, None, {}, rest.gain_nats, rest.p_value))
    augmented, left, partly = None, None, False
    delayed = list(case.innovations.terms[len(case.system.terms) :])
    fullest = _fullest(case) if case.named else None
    if case.named and fullest is None:
        case.named = []
        strange.append("a force with which the model runs away from it")
    if fullest is not None:
        first, augmented, omissions = fullest
        case.named = [first]
        left = _left(case, augmented)
        # Further terms may stand for no more than what the first, fitted fully, leaves.
        further = _further(case, first, augmented) if max(left.smooth.values()) > REST_NATS else []
        # A law that is a little another explains it as simply as two that are right.
        if further and max(left.variations.values()) < SECOND_SHARE * further[0].fit.gain:
            terms = [*augmented.system.terms[-1:], *(_applied(case, scored) for scored in further)]
            try:
                augmented = augment(case, terms, augmented.innovations.linear)
                case.named += further
                left = _left(case, augmented)
            except Diverged:
                pass  # then the first has to do
        case.threshold = named_above(case)
        begun = _begun(case, augmented)
        partly = begun is not None
        for scored, parameters in zip(case.named, (begun or augmented).parameters, strict=True):
            findings.append(of_term(scored, parameters))
        if not _begins(case, left):
            strange += _other_laws(case, augmented, left)
        case.offset_p = offset_beside(case, augmented.innovations, augmented.system.terms[-len(case.named) :])
        augmented = begun or augmented
    elif delayed or omissions:
        terms = [*case.system.terms, *delayed]
        augmented = Augmented(calibrated(case, linear, terms), case.innovations, [], [], omissions[0].gain_nats)
    findings += [
        of_omission(case, o.name)
        for o in omissions
        if not is_harmonic(case, o) and not (o.name == "regenerative_delay" and leaves_cut)
    ]
    if case.local is not None and len(case.local.as_likely) == 1:
        finding, there = _there(case, case.local, augmented, base)
        findings.append(finding)
        augmented, partly = there or augmented, there is not None
    elif case.local is not None:
        names = " and ".join(IN_WORDS[each.name] for each in case.local.as_likely)
        strange.append(f"{_TIED} {case.local.where} only: {names} explain it about equally")
    if case.offset_p < SURE:
        findings.append(plain("offset_drift", None, {}, 0.0, case.offset_p))
    left = left or examine_rest(case, case.innovations, [case.matrix[i] for i in case.evidence.nuisance])
    if case.drift is not None and not any(f.name in ("nonstationary_excitation", "impacts") for f in findings):
        findings.append(plain("parameter_drift", None, {}, 0.5 * case.drift.value, case.drift.p_value))
    # Another machine's tones were taken out before anything was fitted. Its noise is still there, and has a colour.
    if foreign and findings and not any(finding.name in _FEIGNED for finding in findings):
        listed = ", ".join(f"{frequency:.4g}" for frequency in foreign)
        warnings.append(f"Tones that belong neither to the spindle nor to the mains were left out: {listed} Hz.")
    elif foreign:
        strange.append("a tone that belongs neither to the spindle nor to the mains")
    strange += _unexplained(case, left, bool(findings))
    verdict: Verdict
    if strange:
        verdict = "unknown"
    elif findings:
        verdict = "missing_physics"
    else:
        verdict = "parameters" if retuned or wrong else "none"
    if verdict == "unknown" and findings:
        warnings.append(f"Named, but not all that is there: {', '.join(f.name for f in findings)}.")
    if verdict == "missing_physics" and not partly and any(_where(case, finding) for finding in findings):
        has = "has this force all along" if case.local is None else "is the machine without this force"
        warnings.append(f"No model that begins or ends there was found: model.toml {has}.")
    if verdict == "parameters":
        warnings += one_cut(case)
    where = whereabouts(case, findings, strange)
    report = Report(
        verdict,
        _summary(case, verdict, findings, strange, augmented, wrong),
        where,
        findings if verdict != "unknown" else [],
        alternatives(case, findings if verdict != "unknown" else []),
        information(case),
        held_out_fit(case),
        calibration(case),
        warnings,
    )
    return Diagnosis(report, case, base, augmented)


def _fullest(case: Case) -> tuple[Scored, Augmented, list[Omission]] | None:
    """Whichever of the leaders explains most once everything is fitted through the nonlinear filter.

    A nonlinear force makes a spectrum that looks like a linear omission: what the base was found to lack stays
    only if the leaders explain less without it. None if all of them run away from the recording.
    """
    leader = case.named[0]
    least = leader.evidence_nats - max(RIVAL_NATS, RIVAL_SHARE * leader.evidence_nats)
    rivals = [
        leader,
        *(each for each in case.ranking if each.evidence_nats > least and each.candidate != leader.candidate),
    ][:RIVALS]
    inn, base = case.innovations, case.base
    machine = [omission for omission in base.omissions if omission.name in MECHANICAL]
    price = PRICE_NATS * sum(len(omission.parameters) for omission in machine)
    starts = [Start((_applied(case, scored),), _retuned(inn.linear, scored), inn.terms, price) for scored in rivals]
    if machine:
        alone = [scored for scored in rivals if not scored.candidate.term.chip_thickness]
        # Where a mode more fits the spectrum, the first of the two is nearer to the machine than one mode for both.
        first = replace(inn.linear, modes=inn.linear.modes[:1])
        of_one = len(inn.linear.modes) == 1
        single = [_retuned(base.machine, s) if of_one else first for s in alone]
        starts += [Start((_applied(case, s),), lin, case.system.terms) for s, lin in zip(alone, single, strict=True)]
        rivals += alone
    try:
        number, augmented = fullest(case, starts)
    except Diverged:
        return None
    without = starts[number].linear is not inn.linear
    return rivals[number], augmented, [] if without else base.omissions


def _further(case: Case, first: Scored, augmented: Augmented) -> list[Scored]:
    """What explains more beside the first term, with its columns before the base model."""
    contest = beside(case, augmented.innovations, augmented.columns, first.candidate)
    further, _ = contest.run(most=MOST_TERMS - 1)
    columns = dict(case.contest.entries)
    found = []
    for scored in further:
        there = dict(zip(scored.all_columns, columns[scored.candidate], strict=True))
        kept = [there[column] for column in scored.columns]
        found.append(replace(scored, all_columns=columns[scored.candidate], columns=kept))
    return found


def _retuned(linear: Linear, scored: Scored) -> Linear:
    """Without the stiffness and the damping that the base has in place of a term."""
    if len(linear.modes) > 1 or scored.candidate.term.chip_thickness:
        return linear
    spring, damper = scored.fit.all_coefficients[:2]
    return linear.beside(float(spring), float(damper))


def _applied(case: Case, scored: Scored) -> AppliedTerm:
    fitted = dict(zip(scored.columns, scored.fit.coefficients, strict=True))
    coefficients = [float(fitted.get(column, 0.0)) for column in scored.all_columns]
    if scored.candidate.term.chip_thickness:  # the delay that the base was found to have is the same force
        coefficients = [case.base.linear.regeneration]
    return AppliedTerm(scored.candidate.term, scored.candidate.with_coefficients(coefficients))


def _left(case: Case, augmented: Augmented) -> Unnamed:
    """What the augmented model leaves."""
    named = augmented.system.terms[-len(case.named) :]
    return examine_rest(case, augmented.innovations, augmented.columns, named)


def _begins(case: Case, left: Unnamed) -> bool:
    """Whether it is best explained by an amplitude above which it acts, that the named law leaves something."""
    others = [*left.smooth.values(), *left.variations.values()]
    return case.threshold is not None and case.threshold.gain_nats > max(others)


def _begun(case: Case, augmented: Augmented) -> Augmented | None:
    """The model in which the one named force begins at an amplitude; None if it does not, or is none better."""
    if case.threshold is None:
        return None
    try:
        fitted, threshold = above(case, augmented.system.terms[-1], case.threshold, augmented.innovations.linear)
    except Diverged:
        return None
    if fitted.gain_nats < augmented.gain_nats:
        return None
    case.threshold = threshold
    return fitted


def _there(
    case: Case, local: Local, augmented: Augmented | None, base: MachiningSystem
) -> tuple[Finding, Augmented | None]:
    """What acts in a part as a finding, and the model with it; None if there is none."""
    fit = regressed(case)
    applied = applied_there(local, fit)
    if applied is not None and local.between_s is not None:
        before = augmented or Augmented(base, case.innovations, [], [], local.as_likely[0].evidence_nats)
        return of_local(local, fit), replace(before, system=in_stretch(before.system, applied, local.between_s))
    if applied is None or local.threshold is None or case.named:
        return of_local(local, fit), None
    try:
        fitted, threshold = above(case, applied, local.threshold, without_it(case.innovations.linear, fit))
    except Diverged:
        return of_local(local, fit), None
    case.local = replace(local, threshold=threshold)
    return of_local(case.local, fit, fitted.parameters[0]), fitted


def _other_laws(case: Case, augmented: Augmented, left: Unnamed) -> list[str]:
    """Names whose law is not quite that of the recording, in words."""
    strange: list[str] = []
    for scored, applied, parameters in zip(
        case.named, augmented.system.terms[-len(case.named) :], augmented.parameters, strict=True
    ):
        name = scored.candidate.name
        variations = {how: left.variations[name, how] for how in POWERS_AND_SIDES}
        clearest = max(variations, key=lambda how: variations[how])
        if variations[clearest] > max(REST_NATS, FITTED_REST_SHARE * scored.evidence_nats):
            strange.append(f"a force like {IN_WORDS[name]}, but one that {POWERS_AND_SIDES[clearest]}")
        elif (shape := out_of_range(augmented.innovations, applied, parameters)) is not None:
            strange.append(f"a force like {IN_WORDS[name]}, but with a {shape.replace('_', ' ')} beyond that of one")
    return strange


def _unexplained(case: Case, left: Unnamed, something: bool) -> list[str]:
    """What is located and not named, in words."""
    strange: list[str] = []
    if case.unrest is not None and case.unrest.kind == "impacts":
        return strange  # the tests suppose errors without heavy tails
    named = sum(max(scored.evidence_nats, 0.0) for scored in case.named)
    share = FITTED_REST_SHARE if case.named and not _begins(case, left) else REST_SHARE
    if case.local is not None:
        named += case.local.as_likely[0].evidence_nats
    least = max(REST_NATS, share * named)
    if (laws := len(case.named) + (case.local is not None)) > MOST_LAWS:
        strange.append(f"a force that {laws} laws of the catalogue together imitate")
    if max(left.smooth[name] for name in _STATIC) > least and (named or not something):
        strange.append("a force that depends on displacement and velocity like nothing in the catalogue")
    elif left.smooth["memory"] > least:
        strange.append("a force that depends on how the tool moved before like nothing in the catalogue")
    if left.echo.p_value < MAPPED_P and left.echo.gain_nats > least and not case.tones:
        case.echo = left.echo
        strange.append(f"a force that follows {left.echo}")
    lag, angle = case.rest_maps
    if angle.p_value < MAPPED_P:
        strange.append("a stiffness that swings periodically")
    if lag.p_value < MAPPED_P and not case.tones and case.echo is None:
        strange.append("innovations that are correlated over a long lag")
    return strange


def _where(case: Case, finding: Finding) -> str:
    """In words, of a term that does not act all along."""
    if case.local is not None and finding.name == case.local.as_likely[0].name:
        return f", {case.local.where} only"
    if case.threshold is not None and finding.name == case.named[0].candidate.name:
        return f", {case.threshold} only"
    return ""


def _summary(
    case: Case,
    verdict: Verdict,
    findings: Sequence[Finding],
    strange: Sequence[str],
    augmented: Augmented | None,
    wrong: Sequence[str],
) -> str:
    beside = augmented if verdict == "missing_physics" else None
    mode = beside.system.modes[0] if beside else case.base.machine.modes[0]
    where = f"at {mode.frequency_hz:.4g} Hz with {100.0 * mode.damping_ratio:.3g} % damping."
    tuned = f"{'Beside it the' if beside else 'The'} mode is {where}"
    if wrong:
        tuned += f" Of the forces in the model, {' and '.join(wrong)}."
    if case.base.quantity != case.system.sensor.quantity:
        tuned += f" The recording looks like {case.base.quantity}, not like {case.system.sensor.quantity}."
    match verdict:
        case "none":
            return f"The simulation explains the recording. {tuned}"
        case "parameters":
            return f"The simulation explains the recording once its parameters are corrected. {tuned}"
        case "unknown":
            shown = "; and ".join(strange)
            if all(each.startswith(_TIED) for each in strange):
                return f"The recording shows {shown}. It cannot tell which, so none is named. {tuned}"
            return f"The recording shows {shown}. No term of the catalogue explains it, so none is named. {tuned}"
    spoken = "; ".join(IN_WORDS[f.name] + (f" ({f.sense})" if f.sense else "") + _where(case, f) for f in findings)
    return f"The simulation lacks {spoken}. {tuned}"
