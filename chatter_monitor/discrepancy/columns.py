"""All columns of a case's regression: nuisance, candidate forces, and forces of no name."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy import basis
from chatter_monitor.discrepancy.candidates import Candidate, candidates
from chatter_monitor.discrepancy.case import Case
from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.faults import Restlessness, restlessness
from chatter_monitor.discrepancy.innovations import Innovations
from chatter_monitor.discrepancy.locate import modulation
from chatter_monitor.discrepancy.name import Contest
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import Mode
from chatter_monitor.physics.terms import Term

Vector = NDArray[np.float64]

_NOISIER = 0.1  # by which the sensor's noise is varied


def gather(case: Case) -> None:
    """All columns, and their products."""
    inn, recorded = case.innovations, case.recorded
    columns: list[Vector] = []
    groups: dict[str, list[int]] = {}

    def add(name: str, new: Iterable[Vector]) -> list[int]:
        new = list(new)
        index = list(range(len(columns), len(columns) + len(new)))
        columns.extend(new)
        groups.setdefault(name, []).extend(index)
        return index

    motion = inn.motion
    case.columns["retuning"] = add("nuisance", basis.retuning(inn))
    if len(inn.linear.modes) > 1:
        case.columns["modes"] = add("nuisance", _retuned(inn))
    case.columns["known"] = add("nuisance", inn.of_terms([unit for _, _, unit in known_units(case.system)]))
    if inn.linear.delay_s is not None:
        case.columns["lagged"] = add("nuisance", inn.respond([motion.lagged]))
    unrest = case.unrest = restlessness(inn.white, case.telling, recorded.rate_hz)
    if unrest.kind == "nonstationary_excitation":
        add("nuisance", [_swelling_noise(inn, unrest)])
    for tone in case.tones:
        add("nuisance", tone.waves(recorded))
    sd_x, sd_v = basis.scales(motion)
    present = [applied.term.name for applied in case.system.terms]
    tried = candidates(sd_x, sd_v, inn.linear.spindle, present, inn.linear.delay_s is not None)
    entries = _entries(inn, tried, add)
    regenerates = any(omission.name == "regenerative_delay" for omission in case.base.omissions)
    seen = {each.name for each in tried if regenerates and each.term.chip_thickness}
    add("surface", basis.surface(inn))
    add("amplitude", basis.by_amplitude(inn))
    add("memory", basis.by_memory(inn))
    add("time", basis.along_time(inn))
    add("angle", basis.along_angle(inn))
    weight = case.weight
    matrix = np.array(columns)
    case.evidence = Evidence(inn.white, matrix, weight, groups["nuisance"], case.block)
    case.columns |= groups
    case.swing = modulation(inn, weight, matrix[0])
    case.contest, case.matrix = Contest(case.evidence, entries, seen, together=True), matrix


def gather_machine(case: Case) -> None:
    """Columns of the machine alone: all that a full fit needs where nothing is looked for."""
    case.matrix = basis.retuning(case.innovations)
    nuisance = case.columns["retuning"] = list(range(len(case.matrix)))
    case.evidence = Evidence(case.innovations.white, case.matrix, case.weight, nuisance, case.block)


def known_units(system: MachiningSystem) -> list[tuple[int, str, tuple[Term, tuple[float, ...]]]]:
    """Forces of a model's terms for one unit of each coefficient: number of the term, name of the coefficient, force.

    Regeneration is none of them: its coefficient is fitted to the spectrum.
    """
    return [
        (number, name, (applied.term, unit))
        for number, applied in enumerate(system.terms)
        if not applied.term.delayed
        for name, unit in applied.units.items()
    ]


def _entries(
    inn: Innovations, tried: Sequence[Candidate], add: Callable[[str, Iterable[Vector]], list[int]]
) -> list[tuple[Candidate, list[int]]]:
    """Candidates with the columns of their coefficients; forces that several candidates share are worked out once."""
    size = basis.scales(inn.motion)
    forces: dict[tuple[float, ...], tuple[Term, tuple[float, ...]]] = {}
    for candidate in tried:
        for i in candidate.linear:
            forces.setdefault(candidate.acts(i, size), (candidate.term, candidate.unit(i)))
    signatures = inn.of_terms([*forces.values()])
    leaving = [i for i, (term, _) in enumerate(forces.values()) if term.chip_thickness]
    if leaving and inn.linear.delay_s is None:  # then they have to explain more than a delay does
        (lagged,) = inn.respond([inn.motion.lagged])
        signatures[leaving] -= np.outer(signatures[leaving] @ lagged / (lagged @ lagged), lagged)
    at = dict(zip(forces, add("terms", signatures), strict=True))
    return [(candidate, [at[candidate.acts(i, size)] for i in candidate.linear]) for candidate in tried]


def beside(case: Case, inn: Innovations, fitted: Sequence[Vector], first: Candidate) -> Contest:
    """All other candidates before the errors of a model that has the first one, about which all is linear again.

    Parameters
    ----------
    case : Case
    inn : Innovations
        Of the augmented model.
    fitted : sequence of ndarray of float64, shape (n,)
        What a change of each of its parameters adds to the errors.
    first : Candidate
    """
    columns = [*fitted]

    def add(_name: str, new: Iterable[Vector]) -> list[int]:
        begin = len(columns)
        columns.extend(new)
        return list(range(begin, len(columns)))

    others = [candidate for candidate, _ in case.contest.entries if candidate.name != first.name]
    entries = _entries(inn, others, add)
    evidence = Evidence(inn.white, columns, case.weight, range(len(fitted)), case.evidence.block)
    return Contest(evidence, entries)


def _retuned(inn: Innovations) -> list[Vector]:
    """What a change of each mode's frequency, damping and participation adds to the errors, by differences."""
    found = []
    for i, mode in enumerate(inn.linear.modes):
        for name, step in (
            ("frequency_hz", 0.02 * mode.damping_ratio),
            ("damping_ratio", 0.02),
            ("participation", 0.02),
        ):
            if name == "participation" and i == 0:
                continue
            both = [replace(mode, **{name: getattr(mode, name) * (1.0 + change)}) for change in (step, -step)]
            plus, minus = (
                Innovations(
                    inn.recorded, replace(inn.linear, modes=_with(inn.linear.modes, i, each)), inn.terms, inn.taps
                )
                for each in both
            )
            found.append(plus.white - minus.white)
    return found


def _swelling_noise(inn: Innovations, unrest: Restlessness) -> Vector:
    """What the sensor's noise adds to the errors by being more of the motion where the force is weak, less elsewhere.

    The steady filter takes it for the same share throughout. What it believes too much or too little as the force
    swells and fades looks like dry friction, or like a spring and a damper that follow the energy.
    """
    noisier = replace(inn.linear, noise=(1.0 + _NOISIER) * inn.linear.noise)
    changed = Innovations(inn.recorded, noisier, inn.terms, inn.taps).white - inn.white
    weakness = unrest.scale**-2
    return np.asarray(changed * (weakness / np.mean(weakness[weakness > 0.0]) - 1.0))


def _with(modes: tuple[Mode, ...], i: int, mode: Mode) -> tuple[Mode, ...]:
    return (*modes[:i], mode, *modes[i + 1 :])
