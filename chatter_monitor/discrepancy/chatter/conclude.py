"""From a vibration that excites itself to what is said about it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.chatter.cycle import cycle_of
from chatter_monitor.discrepancy.chatter.growth import (
    BELIEVED_P,
    BEYOND_WRONG_NATS,
    Regeneration,
    Vibration,
    regeneration_of,
    vibration,
)
from chatter_monitor.discrepancy.chatter.limit import Limit, augmented, chip_sd, limit_at, limits_of
from chatter_monitor.discrepancy.findings import IN_WORDS, estimate
from chatter_monitor.discrepancy.report import (
    Alternative,
    Calibration,
    Estimate,
    Finding,
    Fit,
    Located,
    Report,
    SelfExcitation,
    Statistic,
)
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.stability import rightmost_root

ORDER_WIDTH = 2e-3  # relative distance from a multiple of the teeth at which a vibration may be forced
RISEN = 5.0  # times as large as before: it came about in the recording


@dataclass(frozen=True, slots=True, eq=False)
class ChatterDiagnosis:
    """The whole answer.

    Attributes
    ----------
    report : Report
    whole : Recorded
        In units of motion.
    found : Vibration
    made : Regeneration, optional
    model : MachiningSystem
        What to simulate with.
    reached : Limit, optional
        Where such a simulation stays.
    """

    report: Report
    whole: Recorded
    found: Vibration
    made: Regeneration | None
    model: MachiningSystem
    reached: Limit | None = None


def conclude_chatter(
    recording: Recorded, system: MachiningSystem, progress: Callable[[str], None] = lambda _step: None
) -> ChatterDiagnosis | None:
    """Say what makes a recording chatter; None if it does not, or not so that it concerns the mode.

    Parameters
    ----------
    recording : Recorded
    system : MachiningSystem
        The model, which may have regeneration, too little of it.
    progress : callable, optional
        Told the name of every step.
    """
    progress("self-excitation")
    mean = float(np.mean(recording.samples[~recording.missing]))
    samples = np.where(recording.missing, 0.0, (recording.samples - mean) / system.sensor.gain)
    whole = replace(recording, samples=samples)
    found = vibration(whole, system)
    if found is None:
        return None
    rise = regeneration_of(whole, system, found)
    cycle = cycle_of(whole, system, found, rise)
    made = cycle if cycle is not None and cycle.sure else rise
    if made is not None and made.sure:
        progress("augmented model")
        model = augmented(found, made, system)
        if _growth(model) < 0.0:
            return None  # near its limit a stable cut is coherent for long, too; what it lacks is told the ordinary way
        limits = list(limits_of(model))
        reached = limit_at(found.frequency_hz, limits)
        return ChatterDiagnosis(_named(system, found, made, model, limits, reached), whole, found, made, model, reached)
    risen = found.rises_s and float(np.quantile(found.amplitude, 0.95)) > RISEN * found.quiet
    if not risen or _may_be_forced(found, system):
        return None
    return ChatterDiagnosis(_unknown(system, found, made), whole, found, made, system)


def _may_be_forced(found: Vibration, system: MachiningSystem) -> bool:
    if system.spindle is None:
        return False
    order = found.frequency_hz * system.spindle.delay_s
    return abs(order - round(order)) < ORDER_WIDTH * order


def _growth(system: MachiningSystem) -> float:
    root = rightmost_root(system)
    return float(-root.damping_ratio * 2.0 * math.pi * root.frequency_hz)


def _located(found: Vibration, made: Regeneration | None, statistic: Statistic | None) -> Located:
    begin = found.rises_s[0][0] if found.rises_s else 0.0
    end = found.steady_s[1] if found.steady_s else begin
    return Located(
        [(round(begin, 3), round(end, 3))] if end > begin else [],
        [(found.frequency_hz, found.frequency_hz)],
        (found.quiet, found.plateau) if math.isfinite(found.plateau) else None,
        "coherent for longer than the mode remembers: self-excited",
        made.delay_s if made is not None and made.sure else None,
        statistic=statistic,
    )


def _named(
    system: MachiningSystem,
    found: Vibration,
    made: Regeneration,
    model: MachiningSystem,
    limits: list[Limit],
    reached: Limit | None,
) -> Report:
    applied = next(term for term in model.terms if term.term.delayed)
    units = {p.name: p.unit for p in applied.term.parameters}
    sd = {"coefficient": float(made.sd[2])}
    if "chip_thickness" in applied.parameters:
        sd["chip_thickness"] = chip_sd(found, made, model, reached)
    parameters: dict[str, Estimate] = {
        name: estimate(value, sd[name], units[name]) for name, value in applied.parameters.items()
    }
    had = [term.parameters["coefficient"] for term in system.terms if term.term.delayed]
    sense = f"{made.coefficient / had[0]:.2g} times as strong as in the model" if had and had[0] > 0.0 else None
    growth, before = _growth(model), _growth(system)
    beyond = made.gain_nats - made.wrong_nats
    before_s = f"the displacement {1e3 * made.delay_s:.4g} ms before"
    told = (
        f"what disturbs a wave follows {before_s}, by {made.gain_nats:.1f} nats rather than that some waves off"
        if math.isfinite(made.chip)
        else f"while the vibration rises, {before_s} predicts it better by {made.gain_nats:.1f} nats, a wrong delay by "
        f"{made.wrong_nats:.1f} at most"
    )
    why = f"{IN_WORDS[applied.term.name].capitalize()}: {told}; {applied.term.equation}."
    p = float(stats.chi2.sf(2.0 * max(made.gain_nats, 0.0), 2))
    finding = Finding(applied.term.name, sense, parameters, beyond, p, why)
    excitation = SelfExcitation(
        found.frequency_hz,
        found.plateau if reached and math.isfinite(found.plateau) else None,
        reached.frequency_hz if reached else None,
        reached.amplitude if reached else None,
        growth,
        before,
        found.rises_s[0] if found.rises_s else None,
    )
    spoken = IN_WORDS[applied.term.name] + (f" ({sense})" if sense else "")
    summary = (
        f"The recording chatters at {found.frequency_hz:.4g} Hz, the model is stable. It lacks {spoken}. "
        f"With it the vibration grows by {growth:.3g} per second; the model as given loses {-before:.3g}."
        if before < 0.0
        else f"The recording chatters at {found.frequency_hz:.4g} Hz. The model lacks {spoken}."
    )
    mode, given = made.mode, system.modes[found.mode]
    number = found.mode + 1
    calibration = Calibration(
        {f"mode.{number}.frequency_hz": given.frequency_hz, f"mode.{number}.damping_ratio": given.damping_ratio},
        {
            f"mode.{number}.frequency_hz": estimate(mode.frequency_hz, float(made.sd[0]), "Hz"),
            f"mode.{number}.damping_ratio": estimate(mode.damping_ratio, float(made.sd[1]), "1"),
        },
    )
    warnings = [
        "Mode and regeneration are fitted with the model file as prior knowledge (1 % in frequency, 30 % in damping)."
    ]
    if "chip_thickness" in parameters and not math.isfinite(made.chip):
        warnings.append(
            "The chip thickness is the one at which the simulation stays at the amplitude of the recording; "
            "its interval is what mode and coefficient leave open."
        )
    if reached is not None:
        warnings += _other_limits(limits, reached)
    return Report(
        "missing_physics", summary, _located(found, made, Statistic("lag", made.gain_nats, p)), [finding],
        [Alternative("a delay that is none of the spindle's", made.wrong_nats)], [],
        Fit([], None, None, beyond, beyond / math.log(2.0), None, None), calibration, warnings,
        self_excitation=excitation,
    )  # fmt: skip


def _other_limits(limits: list[Limit], reached: Limit) -> list[str]:
    """What there is to say where other noise takes the same cut elsewhere."""
    elsewhere = [limit for limit in limits if not limit.is_at(reached.frequency_hz)]
    if not elsewhere:
        return []
    one = elsewhere[0]
    return [
        f"The simulation can stay elsewhere, too: with other noise {len(elsewhere)} of {len(limits)} runs come to "
        f"another limit, as at {one.frequency_hz:.4g} Hz with {one.amplitude:.3g} u."
    ]


def why_not(system: MachiningSystem, found: Vibration, made: Regeneration | None) -> str:
    """The reason why regeneration is not named."""
    if system.spindle is None:
        return "the model file has no [spindle], so its delay is not known"
    if not found.rises_s:
        return "it is there from the beginning, and a vibration that does not change tells nothing of what made it"
    if made is None:
        return "the delay is shorter than the vibration's period"
    if made.misfit_p <= BELIEVED_P:
        damping = f"{100 * made.mode.damping_ratio:.3g} %"
        return f"the mode would have to be at {made.mode.frequency_hz:.4g} Hz with {damping} damping"
    return (
        f"the right delay explains {made.gain_nats:.1f} nats and a wrong one {made.wrong_nats:.1f}; "
        f"{BEYOND_WRONG_NATS:g} more are needed"
    )


def _unknown(system: MachiningSystem, found: Vibration, made: Regeneration | None) -> Report:
    reason = why_not(system, found, made)
    summary = (
        f"The recording shows a vibration at {found.frequency_hz:.4g} Hz that rises and that noise does not drive. "
        f"Regeneration is not named: {reason}."
    )
    given = system.modes[0]
    before = {"mode.1.frequency_hz": given.frequency_hz, "mode.1.damping_ratio": given.damping_ratio}
    others = [Alternative("regenerative_delay", made.gain_nats - made.wrong_nats)] if made is not None else []
    plateau = found.plateau if math.isfinite(found.plateau) else None
    excitation = SelfExcitation(found.frequency_hz, plateau, None, None, None, _growth(system), found.rises_s[0])
    return Report(
        "unknown", summary, _located(found, made, None), [], others, [], Fit([], None, None, 0.0, 0.0, None, None),
        Calibration(before, {}), self_excitation=excitation,
    )  # fmt: skip
