"""From what was found to what is said: verdict, findings, a plain summary."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from chatter_monitor.discrepancy.account import alternatives, calibration, held_out_fit, information, one_cut
from chatter_monitor.discrepancy.all_along import FITTED_REST_SHARE, REST_NATS, REST_SHARE, begins, name_all_along
from chatter_monitor.discrepancy.augment import Augmented, calibrated
from chatter_monitor.discrepancy.case import SURE, Case
from chatter_monitor.discrepancy.faults import Clipping, restlessness
from chatter_monitor.discrepancy.findings import (
    IN_WORDS,
    is_harmonic,
    of_clipping,
    of_omission,
    plain,
    strongest,
    tones_of,
)
from chatter_monitor.discrepancy.in_part.models import acts_there
from chatter_monitor.discrepancy.known import wrong_coefficients
from chatter_monitor.discrepancy.report import Finding, Fit, Located, Report, Verdict
from chatter_monitor.discrepancy.unnamed import Rest, Unnamed
from chatter_monitor.discrepancy.whereabouts import MAPPED_P, whereabouts
from chatter_monitor.physics.model import MachiningSystem

RETUNED_P = 1e-3  # of the modes of the model file
MOST_LAWS = 2  # that are believed to act together; more of them imitate one that is none of theirs
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


@dataclass(slots=True)
class _Said:
    """What is said of a case, as it comes together.

    Attributes
    ----------
    findings : list of Finding
    strange : list of str
        What is there and has no name, in words.
    warnings : list of str
    augmented : Augmented, optional
        Model with what was named.
    partly : bool
        Whether its force begins or ends where that of the recording does.
    """

    findings: list[Finding] = field(default_factory=list)
    strange: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    augmented: Augmented | None = None
    partly: bool = False


def conclude(case: Case) -> Diagnosis:
    """Say what was found."""
    base = base_of(case)
    if case.clipped is not None and not case.maps[1:]:
        return _clipped(case, case.clipped, base)
    said = _Said(warnings=_left_out(case))
    tones, foreign = tones_of(case)
    said.findings += strongest(tones)
    rest = restlessness(case.explained(), case.telling, case.recorded.rate_hz)
    if rest.kind is not None:
        said.findings.append(plain(rest.kind, None, {}, rest.gain_nats, rest.p_value))
    leaves_cut = any(scored.candidate.term.chip_thickness for scored in case.named)
    named = name_all_along(case)
    said.findings += named.findings
    said.strange += named.strange
    said.augmented, said.partly = named.augmented, named.partly
    said.findings += [
        of_omission(case, o.name)
        for o in named.omissions
        if not is_harmonic(case, o) and not (o.name == "regenerative_delay" and leaves_cut)
    ]
    there = _name_in_part(case, said, base)
    if case.offset_p < SURE:
        said.findings.append(plain("offset_drift", None, {}, 0.0, case.offset_p))
    left = named.left or _left(case, there)
    if case.drift is not None and not any(f.name in ("nonstationary_excitation", "impacts") for f in said.findings):
        said.findings.append(plain("parameter_drift", None, {}, 0.5 * case.drift.value, case.drift.p_value))
    # Another machine's tones were taken out before anything was fitted. Its noise is still there, and has a colour.
    if foreign and said.findings and not any(finding.name in _FEIGNED for finding in said.findings):
        listed = ", ".join(f"{frequency:.4g}" for frequency in foreign)
        said.warnings.append(f"Tones that belong neither to the spindle nor to the mains were left out: {listed} Hz.")
    elif foreign:
        said.strange.append("a tone that belongs neither to the spindle nor to the mains")
    said.strange += _unexplained(case, left, bool(said.findings))
    return Diagnosis(_reported(case, said), case, base, said.augmented)


def _clipped(case: Case, clipped: Clipping, base: MachiningSystem) -> Diagnosis:
    """Of a recording of which nothing is left to say."""
    located = Located(amplitude=(clipped.level, clipped.level), maps=case.maps)
    summary = (
        f"The sensor clips at {clipped.level:.3g}: {clipped.samples} samples are cut off. "
        "Nothing can be said about the machine before it is recorded with less gain."
    )
    fit = Fit([], None, None, 0.0, 0.0, None, None)
    findings = [of_clipping(clipped)]
    return Diagnosis(
        Report("missing_physics", summary, located, findings, [], [], fit, calibration(case)), case, base, None
    )


def _left_out(case: Case) -> list[str]:
    """Samples that do not count, in words."""
    words = []
    if case.clipped is not None:
        words.append(f"{case.clipped.samples} samples at the end of the sensor's range were left out.")
    if case.whole.missing.any():
        words.append(f"{np.mean(case.whole.missing):.1%} of the samples are missing, silent or clipped.")
    return words


def _name_in_part(case: Case, said: _Said, base: MachiningSystem) -> Augmented | None:
    """Say what acts in a part of the recording only; its model, if that was fitted through the filter all along."""
    if case.local is None:
        return None
    if len(case.local.as_likely) > 1:
        names = " and ".join(IN_WORDS[each.name] for each in case.local.as_likely)
        said.strange.append(f"{_TIED} {case.local.where} only: {names} explain it about equally")
        return None
    finding, augmented = acts_there(case, case.local, said.augmented, base)
    said.findings.append(finding)
    said.augmented, said.partly = augmented or said.augmented, augmented is not None
    return augmented if case.local.threshold is not None else None


def _left(case: Case, fitted: Augmented | None) -> Unnamed:
    """What is left beside a model that has the force above an amplitude; beside the base if there is none."""
    if fitted is not None:
        return Rest(case, fitted.innovations, fitted.columns).examined()
    return Rest(case, case.innovations, [case.matrix[i] for i in case.evidence.nuisance]).examined()


def _reported(case: Case, said: _Said) -> Report:
    """The verdict and all that goes with it."""
    findings, strange, warnings = said.findings, said.strange, said.warnings
    wrong = wrong_coefficients(case) if case.system.terms else []
    other_modes = case.base.retuning_p < RETUNED_P or case.base.quantity != case.system.sensor.quantity
    verdict: Verdict
    if strange:
        verdict = "unknown"
    elif findings:
        verdict = "missing_physics"
    else:
        verdict = "parameters" if other_modes or wrong else "none"
    if verdict == "unknown" and findings:
        warnings.append(f"Named, but not all that is there: {', '.join(f.name for f in findings)}.")
    if verdict == "missing_physics" and not said.partly and any(_where(case, finding) for finding in findings):
        has = "has this force all along" if case.local is None else "is the machine without this force"
        warnings.append(f"No model that begins or ends there was found: model.toml {has}.")
    if verdict == "parameters":
        warnings += one_cut(case)
    where = whereabouts(case, findings, strange)
    named = findings if verdict != "unknown" else []
    return Report(
        verdict,
        _summary(case, verdict, said, wrong),
        where,
        named,
        alternatives(case, named),
        information(case),
        held_out_fit(case),
        calibration(case),
        warnings,
    )


def _unexplained(case: Case, left: Unnamed, something: bool) -> list[str]:
    """What is located and not named, in words."""
    strange: list[str] = []
    if case.unrest is not None and case.unrest.kind == "impacts":
        return strange  # the tests suppose errors without heavy tails
    named = sum(max(scored.evidence_nats, 0.0) for scored in case.named)
    share = FITTED_REST_SHARE if case.named and not begins(case, left) else REST_SHARE
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


def _summary(case: Case, verdict: Verdict, said: _Said, wrong: Sequence[str]) -> str:
    beside = said.augmented if verdict == "missing_physics" else None
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
            shown = "; and ".join(said.strange)
            if all(each.startswith(_TIED) for each in said.strange):
                return f"The recording shows {shown}. It cannot tell which, so none is named. {tuned}"
            return f"The recording shows {shown}. No term of the catalogue explains it, so none is named. {tuned}"
    spoken = "; ".join(IN_WORDS[f.name] + (f" ({f.sense})" if f.sense else "") + _where(case, f) for f in said.findings)
    return f"The simulation lacks {spoken}. {tuned}"
