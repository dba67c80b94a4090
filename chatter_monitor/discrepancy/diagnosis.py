"""Simulation against recording: calibrate, locate, name, augment."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy.band import FADE_S, Recorded, within_band, without
from chatter_monitor.discrepancy.case import SURE, Case
from chatter_monitor.discrepancy.ceiling import ceiling
from chatter_monitor.discrepancy.columns import gather
from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.faults import clipping, silent, slow_drift
from chatter_monitor.discrepancy.in_part.amplitude import LEFT_SHARE, find_above
from chatter_monitor.discrepancy.in_part.stretch import find_local
from chatter_monitor.discrepancy.innovations import Innovations
from chatter_monitor.discrepancy.known import corrected, linearised
from chatter_monitor.discrepancy.linear import Base, calibrate, fit_base
from chatter_monitor.discrepancy.locate import (
    frequency_map,
    lag_map,
    subspace_map,
)
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.discrepancy.report import Statistic
from chatter_monitor.discrepancy.spectrum import SpectralFit
from chatter_monitor.discrepancy.tones import Tone, loud_tones, tones_of, without_tones
from chatter_monitor.errors import InputError
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm
from chatter_monitor.physics.terms import CATALOGUE

Vector = NDArray[np.float64]

FEWEST_PERIODS = 300
WORTH_A_LOOK = 1e-2  # chance at which something may hide above an amplitude; what is found there has tests of its own
MOST_CLIPPED = 1e-3  # share of samples beyond which nothing else can be said


def recorded_from(samples: Vector, rate_hz: float, missing: NDArray[np.bool_] | None = None) -> Recorded:
    """A recording with what is missing marked: given, not finite, or silent; `InputError` if nothing vibrates in it."""
    absent = ~np.isfinite(samples) | silent(np.nan_to_num(samples), rate_hz)
    if missing is not None:
        absent |= missing
    present = samples[~absent]
    if present.size == 0 or np.ptp(present) == 0.0:
        raise InputError(
            "nothing vibrates in the recording",
            got=f"{absent.sum()} of {absent.size} samples missing or silent"
            + ", the others equal" * bool(present.size),
            remedy="Check the sensor, its cable and the channel.",
        )
    return Recorded(np.where(absent, 0.0, samples), absent, rate_hz)


def examine(whole: Recorded, system: MachiningSystem, progress: Callable[[str], None] = lambda _step: None) -> Case:
    """Do everything but the augmented model.

    Parameters
    ----------
    whole : Recorded
        The recording.
    system : MachiningSystem
        The base model.
    progress : callable, optional
        Told the name of every step.

    Raises
    ------
    InputError
        If there is too little to work with, or the model drifts.
    """
    if system.drifts:
        raise InputError(
            "a model that drifts cannot be held against a recording",
            got=", ".join(drift.parameter for drift in system.drifts),
            remedy="Leave out [[drift]], and look at stretches in which it changes little (--between).",
        )
    clipped, at = clipping(whole.samples)
    if clipped is not None and clipped.samples <= MOST_CLIPPED * whole.samples.size:
        whole = replace(whole, missing=whole.missing | at)
    present = ~whole.missing
    periods = float(present.sum()) / whole.rate_hz * system.modes[0].frequency_hz
    if periods < FEWEST_PERIODS:
        raise InputError(
            "too little of the recording can be used for a diagnosis",
            got=f"{periods:.0f} periods of the first mode, {np.mean(~present):.0%} of the samples missing or silent",
            allowed=f"at least {FEWEST_PERIODS}",
            remedy="Record for longer.",
        )
    highest = max(mode.frequency_hz for mode in system.modes)
    if highest > 0.45 * whole.rate_hz:
        raise InputError(
            "the recording does not reach the model's modes",
            got=f"{whole.rate_hz:g} Hz",
            allowed=f"> {highest / 0.45:g} Hz",
        )
    progress("band")
    whole, recorded = in_band(whole, system)
    progress("calibration")
    given = _given(system)
    if clipped is not None and clipped.samples > MOST_CLIPPED * whole.samples.size:
        base = fit_base(recorded, given)
        case = Case(system, whole, recorded, base, Innovations(recorded, *_as_model(base, system)), clipped)
        case.maps = [frequency_map(base.spectrum, base.fitted)[0]]
        return case
    cleaned, tones, offset_p = _cleaned(recorded, given)

    def with_signatures(model: MachiningSystem, uncorrected: MachiningSystem | None = None) -> Case:
        base = _calibrated(cleaned, model)
        progress("innovations")
        innovations = Innovations(cleaned, *_as_model(base, model))
        progress("signatures")
        case = Case(
            model, whole, cleaned, base, innovations, clipped, tones, offset_p=offset_p, uncorrected=uncorrected
        )
        gather(case)
        return case

    case = with_signatures(system)
    if (better := corrected(case)) is not None:
        case = with_signatures(better, system)
    progress("names")
    _look(case)
    if case.local is not None and case.local.between_s is not None:
        case = _asked_again(case, recorded, case.local.between_s)
    _decide(case)
    return case


def in_band(whole: Recorded, system: MachiningSystem) -> tuple[Recorded, Recorded]:
    """The recording in units of motion, the mean and the gain of the sensor taken out, and its part within the band."""
    mean = float(np.mean(whole.samples[~whole.missing]))
    whole = replace(whole, samples=np.where(whole.missing, 0.0, (whole.samples - mean) / system.sensor.gain))
    return whole, within_band(whole, max(mode.frequency_hz for mode in system.modes))


def _given(system: MachiningSystem) -> Linear:
    return Linear.of(system, next((applied for applied in system.terms if applied.term.delayed), None))


def _calibrated(recorded: Recorded, system: MachiningSystem) -> Base:
    """The linear base, fitted beside the forces of the model."""
    given = _given(system)
    if all(applied.term.delayed for applied in system.terms):  # a spectrum shows these as what they are
        return fit_base(recorded, given)
    beside, known = linearised(recorded, calibrate(recorded, given).linear, system.terms, system.modes[0].omega)
    return fit_base(beside, given, known)


def _cleaned(recorded: Recorded, given: Linear) -> tuple[Recorded, list[Tone], float]:
    """Take out a drifting offset, and tones: loud ones, and those that stand out of the innovations without them.

    No mode is to be bent towards them. The p-value is that of the drift.
    """
    loud = loud_tones(recorded, given)
    fitted = calibrate(without_tones(recorded, loud), given)
    recorded, offset_p = _without_drift(recorded, np.ones(recorded.samples.size), fitted)
    first = Innovations(without_tones(recorded, loud), fitted.linear)
    tones = [*loud, *tones_of(np.where(first.used, first.white, 0.0), recorded.rate_hz)]
    return without_tones(recorded, tones), tones, offset_p


def _without_drift(recorded: Recorded, weight: Vector, fitted: SpectralFit) -> tuple[Recorded, float]:
    """Take out a drifting offset, if the samples show one, each counted with a weight; and its p-value."""
    expected = 0.5 * fitted.lowest_density * recorded.rate_hz
    drift, p = slow_drift(recorded.samples, np.where(recorded.missing, 0.0, weight), expected)
    if p >= SURE:
        return recorded, p
    return replace(recorded, samples=np.where(recorded.missing, 0.0, recorded.samples - drift)), p


def offset_beside(case: Case, inn: Innovations, named: Sequence[AppliedTerm]) -> float:
    """p-value of a drifting offset beside named forces, as a model with them sees the motion.

    A force that differs between the sides moves the mean of the displacement, the more the louder the motion is.
    """
    if case.offset_p >= SURE or inn.linear.quantity != "displacement":
        return case.offset_p
    force = np.sum([inn.force(applied.term, applied.values)[0] for applied in named], axis=0)
    recorded = within_band(case.whole, max(mode.frequency_hz for mode in case.system.modes))
    still = replace(recorded, samples=recorded.samples + force / inn.observer.omega**2)
    return _without_drift(still, np.ones(still.samples.size), case.base.fitted)[1]


def _asked_again(case: Case, recorded: Recorded, between_s: tuple[float, float]) -> Case:
    """The case once more, with machine and sensor as they are where an effect in a stretch is not.

    Such an effect feigns much in what is estimated of the whole recording: another frequency and damping, two modes, a
    coloured force, a sensor of another quantity, an offset that drifts. What the rest of the recording does not show of
    it does not count. Where too little is left besides, the case stays as it is.
    """
    at = np.arange(recorded.samples.size) / recorded.rate_hz
    away_s = np.maximum(between_s[0] - at, at - between_s[1])
    weight = np.sin(0.5 * np.pi * np.clip(away_s / FADE_S, 0.0, 1.0)) ** 2
    cleaned, offset_p = _without_drift(recorded, weight, case.base.fitted)
    cleaned = without_tones(cleaned, case.tones)
    rest = without(cleaned, between_s)
    if rest is None:
        return case
    base = _calibrated(rest, case.system)
    model = _as_model(base, case.system)
    innovations = Innovations(cleaned, *model, Innovations(rest, *model).taps)
    again = Case(
        case.system, case.whole, cleaned, base, innovations, case.clipped, case.tones, None, offset_p, between_s,
        case.uncorrected,
    )  # fmt: skip
    gather(again)
    _look(again)
    return case if again.local is None else again


def _as_model(base: Base, system: MachiningSystem) -> tuple[Linear, list[AppliedTerm]]:
    """Linear part and terms of the calibrated base; regeneration that it was found to lack counts as known."""
    linear, terms = base.linear, list(system.terms)
    if linear.delay_s is not None and linear.spindle is not None:
        speed = 60.0 / (linear.spindle.teeth * linear.delay_s)
        linear = replace(linear, spindle=replace(linear.spindle, speed_rpm=speed))
        coefficient = {"coefficient": max(linear.regeneration, 0.0)}
        if not system.delayed:
            terms.append(AppliedTerm(CATALOGUE["regenerative_delay"], coefficient))
        terms = [replace(a, parameters={**a.parameters, **coefficient}) if a.term.delayed else a for a in terms]
    return linear, terms


def _look(case: Case) -> None:
    """What changes along the recording, or acts in a part of it: that first, so that no name has to stand for it."""
    evidence = case.evidence
    case.named, case.ranking = case.contest.run()
    case.local = find_local(case)
    if case.local is None:
        with case.contest.beside([column for scored in case.named for column in scored.columns]):
            swelling = subspace_map("amplitude", evidence, case.columns["amplitude"])
        if swelling.p_value < WORTH_A_LOOK:
            case.local = find_above(case)


def _decide(case: Case) -> None:
    """Names and the ceiling, beside what acts in a part of the recording."""
    evidence = case.evidence
    case.maps = _maps(case, evidence)
    case.ceiling = ceiling(evidence, case.columns["surface"], case.training)
    if case.local is not None:
        for there in case.local.signatures:
            case.columns.setdefault("local", []).append(
                evidence.join(there, case.innovations.white, case.matrix, case.weight)
            )
            case.matrix = np.vstack([case.matrix, there])
        evidence.nuisance += case.columns["local"]
    else:
        with case.contest.beside([column for scored in case.named for column in scored.columns]):
            changing = subspace_map("time", evidence, case.columns["time"])
        if changing.p_value < SURE:
            case.drift = changing
            evidence.nuisance += case.columns["time"]
    if case.local is not None or case.drift is not None:
        case.named, case.ranking = case.contest.run()
    if case.local is not None and case.local.threshold is not None:
        least = LEFT_SHARE * case.local.as_likely[0].evidence_nats
        case.named = case.named if case.named and case.named[0].evidence_nats > least else []
    with case.contest.beside([column for scored in case.named for column in scored.columns]):
        case.rest_maps = _recurring(case, evidence)


def _maps(case: Case, evidence: Evidence) -> list[Statistic]:
    """The maps beside the nuisance columns of the moment."""
    groups = case.columns
    time = Statistic("time", 0.0, 1.0) if case.drift else subspace_map("time", evidence, groups["time"])
    spectrum, _, _ = frequency_map(case.base.spectrum, case.base.fitted)
    return [
        time,
        spectrum,
        subspace_map("phase_plane", evidence, groups["surface"]),
        subspace_map("amplitude", evidence, groups["amplitude"]),
        subspace_map("memory", evidence, groups["memory"]),
        *_recurring(case, evidence),
    ]


def _recurring(case: Case, evidence: Evidence) -> list[Statistic]:
    """Maps over the lag and the spindle angle beside the nuisance columns of the moment."""
    inn, columns, swing = case.innovations, case.columns["angle"], case.swing
    lag, _, _ = lag_map(case.explained(), inn.used, inn.recorded.rate_hz)
    angle = subspace_map("angle", evidence, columns)
    if swing is not None and not columns:
        angle = Statistic("angle", swing.frequency_hz, swing.p_value)
    elif swing is not None:  # the smaller of two that know nothing of each other
        likeliest = min(swing.p_value, angle.p_value)
        value = swing.frequency_hz if swing.p_value < angle.p_value else angle.value
        angle = Statistic("angle", value, -math.expm1(2.0 * math.log1p(-min(likeliest, 1.0 - 1e-12))))
    return [lag, angle]
