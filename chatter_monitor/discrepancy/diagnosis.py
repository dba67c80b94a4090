"""Simulation against recording: calibrate, locate, name, augment."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy import basis
from chatter_monitor.discrepancy.band import Recorded, within_band
from chatter_monitor.discrepancy.case import SURE, Case, Local
from chatter_monitor.discrepancy.ceiling import Surface, ceiling
from chatter_monitor.discrepancy.columns import gather
from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.faults import (
    Line,
    clipping,
    lines,
    silent,
    slow_drift,
)
from chatter_monitor.discrepancy.innovations import Innovations
from chatter_monitor.discrepancy.linear import Base, calibrate, fit_base
from chatter_monitor.discrepancy.local import acting, find_above, find_local
from chatter_monitor.discrepancy.locate import (
    frequency_map,
    lag_map,
    subspace_map,
)
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.discrepancy.report import Statistic
from chatter_monitor.errors import InputError
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm
from chatter_monitor.physics.terms import CATALOGUE

Vector = NDArray[np.float64]

FEWEST_PERIODS = 300
WORTH_A_LOOK = 1e-2  # chance at which something may hide above an amplitude; what is found there has tests of its own
MOST_CLIPPED = 1e-3  # share of samples beyond which nothing else can be said


def recorded_from(samples: Vector, rate_hz: float, missing: NDArray[np.bool_] | None = None) -> Recorded:
    """A recording with what is missing marked: given, not finite, or silent."""
    absent = ~np.isfinite(samples) | silent(np.nan_to_num(samples), rate_hz)
    if missing is not None:
        absent |= missing
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
        If there is too little to work with.
    """
    clipped, at = clipping(whole.samples)
    if clipped is not None and clipped.samples <= MOST_CLIPPED * whole.samples.size:
        whole = replace(whole, missing=whole.missing | at)
    present = ~whole.missing
    periods = float(present.sum()) / whole.rate_hz * system.modes[0].frequency_hz
    if periods < FEWEST_PERIODS or float(np.std(whole.samples[present])) == 0.0:
        raise InputError(
            "the recording is too short for a diagnosis",
            got=f"{periods:.0f} periods of the first mode",
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
    sensor = system.sensor
    given = Linear(system.modes, sensor.quantity, 1e-3, sensor.low_cut_hz, system.spindle)
    tones: list[Line] = []
    offset_p = 1.0
    if clipped is None or clipped.samples <= MOST_CLIPPED * whole.samples.size:
        recorded, tones, offset_p = _cleaned(recorded, given)
    base = fit_base(recorded, given)
    progress("innovations")
    innovations = Innovations(recorded, *_as_model(base, system))
    case = Case(system, whole, recorded, base, innovations, clipped, tones, offset_p=offset_p)
    if clipped is not None and clipped.samples > MOST_CLIPPED * whole.samples.size:
        case.maps = [frequency_map(base.spectrum, base.fitted)[0]]
        return case
    progress("signatures")
    gather(case)
    progress("names")
    _decide(case)
    return case


def in_band(whole: Recorded, system: MachiningSystem) -> tuple[Recorded, Recorded]:
    """The recording in units of motion, the mean and the gain of the sensor taken out, and its part within the band."""
    mean = float(np.mean(whole.samples[~whole.missing]))
    whole = replace(whole, samples=np.where(whole.missing, 0.0, (whole.samples - mean) / system.sensor.gain))
    return whole, within_band(whole, max(mode.frequency_hz for mode in system.modes))


def _cleaned(recorded: Recorded, given: Linear) -> tuple[Recorded, list[Line], float]:
    """Take out a drifting offset, and tones that stand out of the innovations of a first calibration.

    No mode is to be bent towards them. The p-value is that of the drift.
    """
    fitted = calibrate(recorded, given)
    expected = 0.5 * fitted.lowest_density * recorded.rate_hz
    drift, offset_p = slow_drift(recorded.samples, recorded.missing, expected)
    if offset_p < SURE:
        recorded = replace(recorded, samples=recorded.samples - drift)
    first = Innovations(recorded, fitted.linear)
    tones = lines(np.where(first.used, first.white, 0.0), recorded.rate_hz)
    if not tones:
        return recorded, tones, offset_p
    t = np.arange(recorded.samples.size)
    turns = [2.0 * np.pi * tone.frequency_hz / recorded.rate_hz * t for tone in tones]
    waves = np.column_stack([wave(turn) for turn in turns for wave in (np.cos, np.sin)])
    present = ~recorded.missing
    amplitudes = np.linalg.lstsq(waves[present], recorded.samples[present], rcond=None)[0]
    cleaned = replace(recorded, samples=np.where(present, recorded.samples - waves @ amplitudes, 0.0))
    return cleaned, tones, offset_p


def _as_model(base: Base, system: MachiningSystem) -> tuple[Linear, list[AppliedTerm]]:
    """Linear part and terms of the calibrated base; regeneration that it was found to lack counts as known."""
    linear, terms = base.linear, list(system.terms)
    if linear.delay_s is not None and linear.spindle is not None:
        speed = 60.0 / (linear.spindle.teeth * linear.delay_s)
        linear = replace(linear, spindle=replace(linear.spindle, speed_rpm=speed))
        coefficient = {"coefficient": max(linear.regeneration, 0.0)}
        terms.append(AppliedTerm(CATALOGUE["regenerative_delay"], coefficient))
    return linear, terms


def _decide(case: Case) -> None:
    """Names, the ceiling, and what changes along the recording: that first, so that no name has to stand for it."""
    evidence = case.evidence
    case.maps = _maps(case, evidence)
    case.ceiling = ceiling(evidence, case.columns["surface"], case.training)
    case.named, case.ranking = case.contest.run()
    with case.contest.beside([column for scored in case.named for column in scored.columns]):
        changing = subspace_map("time", evidence, case.columns["time"])
        swelling = subspace_map("amplitude", evidence, case.columns["amplitude"])
    case.local = find_local(case)
    if case.local is None and swelling.p_value < WORTH_A_LOOK:
        case.local = find_above(case)
    if case.local is not None:
        for there in case.local.signatures:
            case.columns.setdefault("local", []).append(
                evidence.join(there, case.innovations.white, case.matrix, case.weight)
            )
            case.matrix = np.vstack([case.matrix, there])
        case.offset_p = _offset_beside(case, case.local)
        evidence.nuisance += case.columns["local"]
    elif changing.p_value < SURE:
        case.drift = changing
        evidence.nuisance += case.columns["time"]
    if case.local is not None or case.drift is not None:
        case.named, case.ranking = case.contest.run()
    with case.contest.beside([column for scored in case.named for column in scored.columns]):
        case.rest = ceiling(evidence, case.columns["surface"], case.training)
        case.rest_maps = _maps(case, evidence)


def _offset_beside(case: Case, local: Local) -> float:
    """p-value of a drifting offset beside a force that moves the mean of the displacement where it acts."""
    inn, candidate = case.innovations, local.candidate
    seen = inn.linear.quantity == "displacement" and local.between_s is not None
    if case.offset_p >= SURE or not seen or candidate is None:
        return case.offset_p
    inside = acting(inn, local.between_s)[0]
    coefficients = case.evidence.regress(case.columns["local"]).coefficients
    forces = inn.forces([(candidate.term, candidate.unit(i)) for i in local.units])[:, 0, inside]
    mean = float(coefficients[: len(local.units)] @ forces.mean(axis=1))
    moved = -mean / inn.observer.omega**2 * inside
    recorded = within_band(case.whole, max(mode.frequency_hz for mode in case.system.modes))
    expected = 0.5 * case.base.fitted.lowest_density * recorded.rate_hz
    return slow_drift(recorded.samples - moved, recorded.missing, expected)[1]


def examine_rest(case: Case, inn: Innovations, fitted: Sequence[Vector]) -> tuple[Surface, list[Statistic]]:
    """Look again for static and for amplitude-dependent forces, in the innovations of an augmented model.

    Parameters
    ----------
    case : Case
    inn : Innovations
        Of the augmented model, about which everything is linear again.
    fitted : sequence of ndarray of float64, shape (n,)
        What a change of each parameter that was fitted adds to the errors.

    Returns
    -------
    Surface
        What any static force would add.
    list of Statistic
        Maps over the phase plane, over displacement and velocity alone, the amplitude, and the energy of the past.
    """
    surface = basis.surface(inn)
    by_both = surface.reshape(basis.BUMPS, basis.BUMPS, -1)
    families = {
        "phase_plane": surface,
        "displacement": by_both.sum(axis=1),
        "velocity": by_both.sum(axis=0),
        "amplitude": basis.by_amplitude(inn),
        "memory": basis.by_memory(inn),
    }
    columns, groups = [*fitted], {}
    for name, family in families.items():
        groups[name] = list(range(len(columns), len(columns) + len(family)))
        columns.extend(family)
    evidence = Evidence(inn.white, columns, case.weight, list(range(len(fitted))), case.evidence.block)
    maps = [subspace_map(name, evidence, index) for name, index in groups.items()]
    return ceiling(evidence, groups["phase_plane"], case.training), maps


def _maps(case: Case, evidence: Evidence) -> list[Statistic]:
    """The maps beside the nuisance columns of the moment."""
    inn, groups = case.innovations, case.columns
    white = case.explained()
    time = Statistic("time", 0.0, 1.0) if case.drift else subspace_map("time", evidence, groups["time"])
    spectrum, _, _ = frequency_map(case.base.spectrum, case.base.fitted)
    lag, _, _ = lag_map(white, inn.used, inn.recorded.rate_hz)
    angle = subspace_map("angle", evidence, groups["angle"])
    swing = case.swing
    if swing is not None and (swing.p_value < angle.p_value or not groups["angle"]):
        angle = Statistic("angle", swing.frequency_hz, min(1.0, 2.0 * swing.p_value))
    return [
        time,
        spectrum,
        subspace_map("phase_plane", evidence, groups["surface"]),
        subspace_map("amplitude", evidence, groups["amplitude"]),
        subspace_map("memory", evidence, groups["memory"]),
        lag,
        angle,
    ]
