"""What was found, as findings of the report: names, senses, parameters, and plain words for them."""

from __future__ import annotations

from collections.abc import Sequence

from chatter_monitor.discrepancy.case import Case, Local
from chatter_monitor.discrepancy.evidence import Regressed
from chatter_monitor.discrepancy.faults import Clipping
from chatter_monitor.discrepancy.linear import Omission, at_multiple
from chatter_monitor.discrepancy.name import Scored
from chatter_monitor.discrepancy.report import Estimate, Finding
from chatter_monitor.discrepancy.tones import Tone

_MAINS_HZ = (50.0, 60.0)
SENSES = {
    "cubic_stiffness": ("hardening", "softening"),
    "quadratic_stiffness": ("stiffer outwards", "stiffer inwards"),
    "energy_damping": ("grows with amplitude", "falls with amplitude"),
}
IN_WORDS = {
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


def plain(name: str, sense: str | None, parameters: dict[str, Estimate], nats: float, p: float) -> Finding:
    """A finding that is its own explanation."""
    return Finding(name, sense, parameters, float(nats), float(p), f"The recording shows {IN_WORDS[name]}.")


def of_clipping(clipped: Clipping) -> Finding:
    """The sensor's end as a finding."""
    level = clipped.level
    parameters = {"clip_level": Estimate(level, (level, level), "output")}
    return plain("clipping", None, parameters, clipped.samples, 0.0)


def estimate(value: float, sd: float, unit: str) -> Estimate:
    """A value with its normal 95 % interval."""
    return Estimate(float(value), (float(value - 1.96 * sd), float(value + 1.96 * sd)), unit)


def is_harmonic(case: Case, omission: Omission) -> bool:
    """Whether a second mode is a harmonic that a named force makes of the first."""
    if not case.named or not at_multiple(omission, case.base.fitted):
        return False
    return case.named[0].evidence_nats > omission.gain_nats


def of_omission(case: Case, name: str) -> Finding:
    """A linear omission of the base, by its name."""
    omission = next(o for o in case.base.omissions if o.name == name)
    units = {"frequency_hz": "Hz", "corner_hz": "Hz"}
    parameters = {k: estimate(*pair, units.get(k, "1")) for k, pair in omission.parameters.items()}
    return plain(name, None, parameters, omission.gain_nats, omission.p_value)


def of_tone(case: Case, tone: Tone) -> Finding | None:
    """A line as mains hum, which does not wander, or as a force of the spindle; None if it is neither."""
    width = 1.5 / case.recorded.seconds
    for mains in _MAINS_HZ if tone.phase is None else ():
        order = round(tone.frequency_hz / mains)
        if 1 <= order <= 12 and abs(tone.frequency_hz - order * mains) < max(width, 2e-3 * order * mains):
            parameters = {"hum_hz": estimate(tone.frequency_hz, 0.3 * width, "Hz")}
            return plain("mains_hum", None, parameters, tone.gain_nats, tone.p_value)
    spindle = case.system.spindle
    if spindle is not None:
        multiple = tone.frequency_hz / (spindle.speed_rpm / 60.0)
        if round(multiple) >= 1 and abs(multiple - round(multiple)) < min(0.04 * multiple, 0.15):
            parameters = {"order": estimate(multiple, 0.3 * width / (spindle.speed_rpm / 60.0), "1")}
            return plain("periodic_forcing", None, parameters, tone.gain_nats, tone.p_value)
    return None


def tones_of(case: Case) -> tuple[list[Finding], list[float]]:
    """Lines that are mains hum or a force of the spindle; frequencies of the others, and of their multiples."""
    found = [(tone.frequency_hz, of_tone(case, tone)) for tone in case.tones]
    foreign = [frequency for frequency, finding in found if finding is None]
    width = 1.5 / case.recorded.seconds

    def harmonic(frequency: float) -> bool:
        orders = [(round(frequency / base), base) for base in foreign]
        return any(order > 1 and abs(frequency - order * base) < width for order, base in orders)

    findings = [finding for frequency, finding in found if finding is not None and not harmonic(frequency)]
    return findings, sorted(f for f, finding in found if finding is None or harmonic(f))


def strongest(tones: Sequence[Finding]) -> list[Finding]:
    """One finding for all lines of a kind, the strongest."""
    best: dict[str, Finding] = {}
    for tone in tones:
        if tone.name not in best or tone.evidence_nats > best[tone.name].evidence_nats:
            best[tone.name] = tone
    return list(best.values())


def of_term(scored: Scored, parameters: dict[str, tuple[float, float]]) -> Finding:
    """A named term with its fitted parameters (value, standard deviation)."""
    term = scored.candidate.term
    units = {p.name: p.unit for p in term.parameters}
    estimates = {name: estimate(*pair, units[name]) for name, pair in parameters.items()}
    sense = None
    if term.name in SENSES:
        sense = SENSES[term.name][0 if parameters["coefficient"][0] > 0.0 else 1]
    why = (
        f"{IN_WORDS[term.name].capitalize()}: explains held-out stretches better by {scored.held_out_nats:.1f} nats "
        f"(p = {scored.p_value:.1g}); {term.equation}."
    )
    return Finding(term.name, sense, estimates, float(scored.evidence_nats), float(scored.p_value), why)


def of_local(local: Local, fit: Regressed, fitted: dict[str, tuple[float, float]] | None = None) -> Finding:
    """A term that acts in a part of the recording, or above an amplitude; by the regression, or fitted fully."""
    term = local.candidate.term if local.candidate else None
    known = {p.name: p.unit for p in term.parameters} if term else {}
    names = list(known)
    both = zip(local.units, fit.coefficients, fit.sd, strict=False)
    found = fitted or {names[i]: (value, sd) for i, value, sd in both}
    parameters = {name: estimate(*pair, known[name]) for name, pair in found.items()}
    name = local.as_likely[0].name
    sense = None
    if name in SENSES:
        sense = SENSES[name][0 if fit.coefficients[0] > 0.0 else 1]
    why = f"{IN_WORDS[name].capitalize()}, {local.where} only."
    return Finding(name, sense, parameters, local.as_likely[0].evidence_nats, local.p_value, why)
