"""From what was found to what is said: verdict, findings, a plain summary."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from chatter_monitor.discrepancy.augment import Augmented, augment, calibrated
from chatter_monitor.discrepancy.basis import scales, surface_at
from chatter_monitor.discrepancy.diagnosis import BLOCK_S, SURE, Case, Local, examine_rest
from chatter_monitor.discrepancy.faults import Clipping, Line, restlessness
from chatter_monitor.discrepancy.innovations import Diverged
from chatter_monitor.discrepancy.linear import Omission
from chatter_monitor.discrepancy.locate import lag_map, whiteness_p
from chatter_monitor.discrepancy.name import PRICE_NATS, Scored
from chatter_monitor.discrepancy.report import (
    Alternative,
    Calibration,
    Estimate,
    Finding,
    Fit,
    Information,
    Located,
    Report,
    Statistic,
    Verdict,
)
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm

RETUNED_P = 1e-3  # of the modes of the model file
MAPPED_P = 1e-5  # of a map that nothing explains
REST_SHARE = 0.2  # of a named term's held-out gain that an unnamed static force may add
REST_NATS = 6.0
RIVALS = 3  # fitted fully
RIVAL_NATS, RIVAL_SHARE = 6.0, 0.05  # how near to the leader's evidence, for that
_STATIC = ("phase_plane", "displacement", "velocity", "amplitude")  # maps of what has no memory
DETECT_NATS = 10.0
HARMONIC_WIDTH = 0.1  # about the orders 2 and 3 of the mode
_MAINS_HZ = (50.0, 60.0)
_SENSES = {
    "cubic_stiffness": ("hardening", "softening"),
    "quadratic_stiffness": ("stiffer outwards", "stiffer inwards"),
    "energy_damping": ("grows with amplitude", "falls with amplitude"),
}
_PLAIN = {
    "cubic_stiffness": "a spring that changes its stiffness with the deflection",
    "quadratic_stiffness": "a spring that is stiffer on one side",
    "clearance": "a clearance that closes at larger deflections",
    "coulomb_friction": "dry friction",
    "stribeck_friction": "dry friction that eases once it slides (Stribeck)",
    "hysteresis": "a joint that sticks and slips (hysteresis)",
    "quadratic_damping": "damping that grows with the speed, as of a fluid",
    "energy_damping": "damping that changes with the amplitude",
    "cutting_force_nonlinearity": "a cutting force that is not proportional to the speed",
    "regenerative_delay": "regeneration: the tool cuts the waves that it left one turn or tooth before",
    "loss_of_contact": "regeneration with the tool leaving the cut",
    "second_mode": "a second vibration mode",
    "coloured_excitation": "a force that is weaker at high frequencies",
    "periodic_forcing": "a periodic force at a multiple of the spindle frequency",
    "impacts": "impacts in the force",
    "nonstationary_excitation": "a force that swells and fades",
    "parameter_drift": "a machine that changes along the recording",
    "clipping": "a sensor that clips",
    "mains_hum": "mains hum in the sensor",
    "offset_drift": "an offset of the sensor that drifts",
}


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


def conclude(case: Case) -> Diagnosis:
    """Say what was found."""
    linear = case.innovations.linear
    base = calibrated(case, case.base.fitted.linear, case.system.terms)
    retuned = case.base.retuning_p < RETUNED_P or case.base.quantity != case.system.sensor.quantity
    findings: list[Finding] = []
    warnings: list[str] = []
    if case.clipped is not None and not case.maps[1:]:
        findings.append(_clipping(case.clipped))
        located = Located(amplitude=(case.clipped.level, case.clipped.level), maps=case.maps)
        summary = (
            f"The sensor clips at {case.clipped.level:.3g}: {case.clipped.samples} samples are cut off. "
            "Nothing can be said about the machine before it is recorded with less gain."
        )
        fit = Fit([], None, None, 0.0, 0.0, None, None)
        report = Report("missing_physics", summary, located, findings, [], [], fit, _calibration(case))
        return Diagnosis(report, case, base, None)
    if case.clipped is not None:
        warnings.append(f"{case.clipped.samples} samples at the end of the sensor's range were left out.")
    if case.whole.missing.any():
        warnings.append(f"{np.mean(case.whole.missing):.1%} of the samples are missing, silent or clipped.")
    strange: list[str] = []
    tones = [_tone(case, tone) for tone in case.tones]
    findings += _merged([each for each in tones if each is not None])
    if any(each is None for each in tones):
        strange.append("a tone that belongs neither to the spindle nor to the mains")
    leaves_cut = any(scored.candidate.term.chip_thickness for scored in case.named)
    findings += [
        _omission(case, o.name)
        for o in case.base.omissions
        if not _harmonic(case, o) and not (o.name == "regenerative_delay" and leaves_cut)
    ]
    if case.offset_p < SURE:
        findings.append(_plain("offset_drift", None, {}, 0.0, case.offset_p))
    rest = restlessness(case.explained(), case.innovations.used, case.recorded.rate_hz)
    if rest.kind is not None:
        findings.append(_plain(rest.kind, None, {}, rest.gain_nats, rest.p_value))
    augmented = None
    delayed = list(case.innovations.terms[len(case.system.terms) :])
    fullest = _fullest(case) if case.named else None
    if case.named and fullest is None:
        case.named = []
        strange.append("a force with which the model runs away from it")
    if fullest is not None:
        first, augmented = fullest
        case.rest, plane = examine_rest(case, augmented.innovations, augmented.columns)
        # Further terms may stand for no more than what the first, fitted fully, explains.
        left = min(each.p_value for each in plane) < MAPPED_P
        case.named = case.contest.run([first])[0] if left else [first]
        if len(case.named) > 1:
            try:
                augmented = augment(case, [_applied(case, scored) for scored in case.named])
                case.rest, plane = examine_rest(case, augmented.innovations, augmented.columns)
            except Diverged:
                case.named = [first]
        known = {each.name for each in plane}
        case.rest_maps = [*plane, *(each for each in case.rest_maps if each.name not in known)]
        for scored, parameters in zip(case.named, augmented.parameters, strict=True):
            findings.append(_finding(scored, parameters))
    elif delayed or case.base.omissions:
        terms = [*case.system.terms, *delayed]
        augmented = Augmented(
            calibrated(case, linear, terms), case.innovations, [], [], case.base.omissions[0].gain_nats
        )
    if case.local is not None:
        findings.append(_local_finding(case, case.local))
    maps = {each.name: each for each in case.rest_maps}
    if case.drift is not None and not any(f.name in ("nonstationary_excitation", "impacts") for f in findings):
        findings.append(_plain("parameter_drift", None, {}, 0.5 * case.drift.value, case.drift.p_value))
    strange += _unexplained(case, maps, bool(findings))
    verdict: Verdict
    if strange:
        verdict = "unknown"
    elif findings:
        verdict = "missing_physics"
    else:
        verdict = "parameters" if retuned else "none"
    if verdict == "unknown" and findings:
        warnings.append(f"Named, but not all that is there: {', '.join(f.name for f in findings)}.")
    located = _located(case, findings, strange)
    report = Report(
        verdict,
        _summary(case, verdict, findings, strange),
        located,
        findings if verdict != "unknown" else [],
        _alternatives(case, findings if verdict != "unknown" else []),
        _information(case),
        _fit(case),
        _calibration(case),
        warnings,
    )
    return Diagnosis(report, case, base, augmented)


def _plain(name: str, sense: str | None, parameters: dict[str, Estimate], nats: float, p: float) -> Finding:
    return Finding(name, sense, parameters, float(nats), float(p), f"The recording shows {_PLAIN[name]}.")


def _clipping(clipped: Clipping) -> Finding:
    level = clipped.level
    parameters = {"clip_level": Estimate(level, (level, level), "output")}
    return _plain("clipping", None, parameters, clipped.samples, 0.0)


def _estimate(value: float, sd: float, unit: str) -> Estimate:
    return Estimate(float(value), (float(value - 1.96 * sd), float(value + 1.96 * sd)), unit)


def _harmonic(case: Case, omission: Omission) -> bool:
    """Whether a second mode is a harmonic that a named force makes of the first."""
    if omission.name != "second_mode" or not case.named:
        return False
    order = omission.parameters["frequency_hz"][0] / case.base.fitted.linear.modes[0].frequency_hz
    near = round(order) in (2, 3) and abs(order - round(order)) < HARMONIC_WIDTH
    return near and case.named[0].evidence_nats > omission.gain_nats


def _omission(case: Case, name: str) -> Finding:
    omission = next(o for o in case.base.omissions if o.name == name)
    units = {"frequency_hz": "Hz", "corner_hz": "Hz"}
    parameters = {k: _estimate(*pair, units.get(k, "1")) for k, pair in omission.parameters.items()}
    return _plain(name, None, parameters, omission.gain_nats, omission.p_value)


def _tone(case: Case, tone: Line) -> Finding | None:
    """A line as mains hum or as a force of the spindle; None if it is neither."""
    width = 1.5 / case.recorded.seconds
    for mains in _MAINS_HZ:
        order = round(tone.frequency_hz / mains)
        if 1 <= order <= 12 and abs(tone.frequency_hz - order * mains) < max(width, 2e-3 * order * mains):
            parameters = {"hum_hz": _estimate(tone.frequency_hz, 0.3 * width, "Hz")}
            return _plain("mains_hum", None, parameters, tone.gain_nats, tone.p_value)
    spindle = case.system.spindle
    if spindle is not None:
        multiple = tone.frequency_hz / (spindle.speed_rpm / 60.0)
        if round(multiple) >= 1 and abs(multiple - round(multiple)) < min(0.04 * multiple, 0.15):
            parameters = {"order": _estimate(multiple, 0.3 * width / (spindle.speed_rpm / 60.0), "1")}
            return _plain("periodic_forcing", None, parameters, tone.gain_nats, tone.p_value)
    return None


def _merged(tones: Sequence[Finding]) -> list[Finding]:
    """One finding for all lines of a kind, the strongest."""
    best: dict[str, Finding] = {}
    for tone in tones:
        if tone.name not in best or tone.evidence_nats > best[tone.name].evidence_nats:
            best[tone.name] = tone
    return list(best.values())


def _fullest(case: Case) -> tuple[Scored, Augmented] | None:
    """Whichever of the leaders explains most once everything is fitted through the nonlinear filter.

    None if that runs away from the recording with each of them.
    """
    leader = case.named[0]
    least = leader.evidence_nats - max(RIVAL_NATS, RIVAL_SHARE * leader.evidence_nats)
    rivals = [
        leader,
        *(each for each in case.ranking if each.evidence_nats > least and each.candidate != leader.candidate),
    ]
    fits: list[tuple[float, Scored, Augmented]] = []
    for scored in rivals[:RIVALS]:
        try:
            augmented = augment(case, [_applied(case, scored)])
        except Diverged:
            continue
        fits.append((augmented.gain_nats - PRICE_NATS * len(augmented.parameters[0]), scored, augmented))
    if not fits:
        return None
    _, scored, augmented = max(fits, key=lambda each: each[0])
    return scored, augmented


def _applied(case: Case, scored: Scored) -> AppliedTerm:
    fitted = dict(zip(scored.columns, scored.fit.coefficients, strict=True))
    coefficients = [float(fitted.get(column, 0.0)) for column in scored.all_columns]
    if scored.candidate.term.chip_thickness:  # the delay that the base was found to have is the same force
        coefficients = [case.base.linear.regeneration]
    return AppliedTerm(scored.candidate.term, scored.candidate.with_coefficients(coefficients))


def _finding(scored: Scored, parameters: dict[str, tuple[float, float]]) -> Finding:
    term = scored.candidate.term
    units = {p.name: p.unit for p in term.parameters}
    estimates = {name: _estimate(*pair, units[name]) for name, pair in parameters.items()}
    sense = None
    if term.name in _SENSES:
        sense = _SENSES[term.name][0 if parameters["coefficient"][0] > 0.0 else 1]
    why = (
        f"{_PLAIN[term.name].capitalize()}: explains held-out stretches better by {scored.held_out_nats:.1f} nats "
        f"(p = {scored.p_value:.1g}); {term.equation}."
    )
    return Finding(term.name, sense, estimates, float(scored.evidence_nats), float(scored.p_value), why)


def _local_finding(case: Case, local: Local) -> Finding:
    begin, end = (block * BLOCK_S for block in local.blocks)
    *nuisance, confined = case.evidence.nuisance
    with case.contest.instead(nuisance) as evidence:
        fit = evidence.regress([confined])
    name = local.candidate.term.parameters[local.candidate.linear[0]]
    estimate = {name.name: _estimate(fit.coefficients[0], fit.sd[0], name.unit)}
    sense = None
    if local.candidate.name in _SENSES:
        sense = _SENSES[local.candidate.name][0 if fit.coefficients[0] > 0.0 else 1]
    why = f"{_PLAIN[local.candidate.name].capitalize()}, from {begin:.1f} to {end:.1f} s only."
    return Finding(local.candidate.name, sense, estimate, fit.gain, local.p_value, why)


def _unexplained(case: Case, maps: dict[str, Statistic], something: bool) -> list[str]:
    """What is located and not named, in words."""
    strange: list[str] = []
    if case.unrest is not None and case.unrest.kind == "impacts":
        return strange  # the tests of the maps suppose errors without heavy tails
    named = sum(max(scored.evidence_nats, 0.0) for scored in case.named)
    if case.local is not None:
        named += case.local.gain_nats + case.local.held_out_nats
    static = [maps[name] for name in _STATIC if name in maps]
    left = [_excess_nats(each) for each in static if each.p_value < MAPPED_P]
    if left and (max(left) > max(REST_NATS, REST_SHARE * named) if named else not something):
        strange.append("a force that depends on displacement and velocity like nothing in the catalogue")
    elif maps["memory"].p_value < MAPPED_P and _excess_nats(maps["memory"]) > max(REST_NATS, REST_SHARE * named):
        strange.append("a force that depends on how the tool moved before like nothing in the catalogue")
    if maps["angle"].p_value < MAPPED_P:
        strange.append("a stiffness that swings periodically")
    if maps["lag"].p_value < MAPPED_P and not case.tones:
        strange.append("innovations that are correlated over a long lag")
    return strange


def _excess_nats(statistic: Statistic) -> float:
    """What a map explains beyond what chance does with as many degrees of freedom."""
    return 0.5 * (statistic.value - _freedom(statistic))


def _freedom(statistic: Statistic) -> float:
    """Degrees of freedom that belong to a value and its p-value."""
    if not 0.0 < statistic.p_value < 1.0:
        return 0.0
    low, high = 0.5, 200.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        if float(stats.chi2.sf(statistic.value, middle)) < statistic.p_value:
            low = middle
        else:
            high = middle
    return low


def _located(case: Case, findings: Sequence[Finding], strange: Sequence[str]) -> Located:
    maps = case.maps
    significant = [each for each in maps if each.p_value < 1e-3]
    if not findings and not strange:
        return Located(maps=maps, statistic=min(maps, key=lambda each: each.p_value))
    time = [(0.0, round(case.whole.seconds, 3))]
    if case.local is not None:
        begin, end = (block * BLOCK_S for block in case.local.blocks)
        time = [(begin, min(end, case.whole.seconds))]
    bands = [(tone.frequency_hz, tone.frequency_hz) for tone in case.tones]
    for omission in case.base.omissions:
        if "frequency_hz" in omission.parameters:
            f = omission.parameters["frequency_hz"][0]
            width = omission.parameters["damping_ratio"][0] * f
            bands.append((f - width, f + width))
    by_lag = next(each for each in maps if each.name == "lag")
    delayed = any(o.name == "regenerative_delay" for o in case.base.omissions)
    lag_s = None
    if delayed and case.base.linear.delay_s is not None:
        lag_s = case.base.linear.delay_s
    elif by_lag.p_value < 1e-3:
        _, lags, correlation = lag_map(case.explained(), case.innovations.used, case.recorded.rate_hz)
        lag_s = float(lags[45 + int(np.argmax(np.abs(correlation[45:])))])
    amplitude, state = _where(case)
    order = None
    angle = next(each for each in maps if each.name == "angle")
    if angle.p_value < 1e-3 and case.system.spindle is not None and case.swing is not None:
        order = case.swing.frequency_hz / (case.system.spindle.speed_rpm / 60.0)
    if not bands and case.swing is not None and angle.p_value < MAPPED_P:
        bands = [(case.swing.frequency_hz, case.swing.frequency_hz)]
    clearest = min(significant or maps, key=lambda each: each.p_value)
    return Located(time, bands, amplitude, state, lag_s, order, clearest, maps)


def _where(case: Case) -> tuple[tuple[float, float] | None, str | None]:
    """Amplitudes and part of the phase plane in which an unnamed or named static force acts."""
    plane = next(each for each in case.maps if each.name == "phase_plane")
    if plane.p_value > 1e-3:
        return None, None
    sd_x, _ = scales(case.innovations.motion)
    axis = np.linspace(-2.5, 2.5, 41)
    x, v = np.meshgrid(axis, axis, indexing="ij")
    force = surface_at(case.ceiling.coefficients, x, v)
    density = np.exp(-0.5 * (x**2 + v**2))
    design = np.stack([np.ones_like(x), x, v])
    weighted = (design * density).reshape(3, -1)
    beta = np.linalg.solve(weighted @ design.reshape(3, -1).T, weighted @ force.ravel())
    force = force - np.einsum("i,i...->...", beta, design)
    total = float(np.sum(density * force**2))
    odd_x = 0.5 * (force - force[::-1])
    odd_v = 0.5 * (force - force[:, ::-1])
    share_x = float(np.sum(density * np.mean(odd_x, axis=1, keepdims=True) ** 2)) / total
    share_v = float(np.sum(density * np.mean(odd_v, axis=0, keepdims=True) ** 2)) / total
    if share_x > 0.6:
        state = "odd in the displacement: a spring"
    elif share_v > 0.6:
        state = "odd in the velocity: friction or damping"
    elif float(np.sum(density * odd_x**2)) / total < 0.3 and share_v < 0.3:
        state = "even in the displacement: one side differs from the other"
    else:
        state = "in displacement and velocity together"
    amplitude = np.hypot(x, v)
    acting = density * force**2
    energy = [float(np.sum(acting[(amplitude >= a) & (amplitude < a + 0.25)])) for a in np.arange(0.0, 3.0, 0.25)]
    share = np.cumsum(energy) / sum(energy)
    low, high = 0.25 * np.searchsorted(share, 0.1), 0.25 * (np.searchsorted(share, 0.9) + 1)
    return (float(low * sd_x), float(high * sd_x)), state


def _alternatives(case: Case, findings: Sequence[Finding]) -> list[Alternative]:
    taken = {finding.name for finding in findings}
    entries = [Alternative(s.candidate.name, float(s.evidence_nats)) for s in case.ranking]
    entries += [Alternative(name, float(gain)) for name, gain in case.base.alternatives]
    entries.append(Alternative("force_surface", float(case.ceiling.held_out_nats)))
    return sorted((e for e in entries if e.name not in taken), key=lambda each: -each.evidence_nats)[:8]


def _information(case: Case) -> list[Information]:
    """How small an effect the recording would have shown."""
    inn, evidence = case.innovations, case.evidence
    w2 = inn.linear.modes[0].omega ** 2
    x, v = inn.motion.x[0], inn.motion.v[0]
    restoring = w2 * float(np.std(x))
    linear = np.column_stack([x, v, np.ones_like(x)])
    found: dict[str, Information] = {}
    for scored in case.ranking:
        candidate = scored.candidate
        unit = candidate.unit(candidate.linear[0])
        force = inn.force(candidate.term, unit)[0]
        rest = force - linear @ np.linalg.lstsq(linear, force, rcond=None)[0]
        sd = float(evidence.regress(scored.all_columns[:1], ~case.training).sd[0])
        detectable = sd * math.sqrt(2.0 * DETECT_NATS) * float(np.std(rest)) / restoring
        seconds = case.whole.seconds * (detectable / 0.02) ** 2
        found.setdefault(candidate.name, Information(candidate.name, float(detectable), float(seconds)))
    return list(found.values())


def _fit(case: Case) -> Fit:
    evidence, held = case.evidence, ~case.training
    columns = [c for scored in case.named for c in scored.columns]
    base, full = evidence.regress([], case.training), evidence.regress(columns, case.training)
    gain = evidence.gain_on(full, columns, base, held)
    samples = float(evidence.samples[held].sum())
    scale = float(np.mean(np.log(1.0 / case.weight[case.weight > 0.0])))
    rest = evidence.rest(base, [], held)
    before = scale + 0.5 * math.log(2.0 * math.pi) + rest / samples
    white = case.innovations.white
    explained = case.explained()
    used = case.innovations.used
    blocks = [(i * BLOCK_S, min((i + 1) * BLOCK_S, case.whole.seconds)) for i in np.flatnonzero(held)]
    return Fit(
        [(round(float(a), 3), round(float(b), 3)) for a, b in blocks],
        before,
        before - gain / samples,
        float(gain),
        float(gain / math.log(2.0)),
        whiteness_p(white, used),
        whiteness_p(explained, used),
    )


def _calibration(case: Case) -> Calibration:
    before: dict[str, float] = {}
    after: dict[str, Estimate] = {}
    fitted = case.base.fitted
    at = 0
    for i, (given, now) in enumerate(zip(case.system.modes, fitted.linear.modes, strict=False), 1):
        before[f"mode.{i}.frequency_hz"] = given.frequency_hz
        before[f"mode.{i}.damping_ratio"] = given.damping_ratio
        after[f"mode.{i}.frequency_hz"] = _estimate(now.frequency_hz, now.frequency_hz * fitted.sd[at], "Hz")
        after[f"mode.{i}.damping_ratio"] = _estimate(now.damping_ratio, now.damping_ratio * fitted.sd[at + 1], "1")
        at += 2 + (i > 1)
    return Calibration(before, after)


def _summary(case: Case, verdict: Verdict, findings: Sequence[Finding], strange: Sequence[str]) -> str:
    after = _calibration(case).after
    mode = after["mode.1.frequency_hz"].value, 100.0 * after["mode.1.damping_ratio"].value
    tuned = f"The mode is at {mode[0]:.4g} Hz with {mode[1]:.3g} % damping."
    if case.base.quantity != case.system.sensor.quantity:
        tuned += f" The recording looks like {case.base.quantity}, not like {case.system.sensor.quantity}."
    match verdict:
        case "none":
            return f"The simulation explains the recording. {tuned}"
        case "parameters":
            return f"The simulation explains the recording once its parameters are corrected. {tuned}"
        case "unknown":
            shown = "; and ".join(strange)
            return f"The recording shows {shown}. No term of the catalogue explains it, so none is named. {tuned}"
    spoken = "; ".join(_PLAIN[f.name] + (f" ({f.sense})" if f.sense else "") for f in findings)
    return f"The simulation lacks {spoken}. {tuned}"
