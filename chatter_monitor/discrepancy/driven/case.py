"""A machine whose force was recorded beside its displacement: what the force balance says that a model lacks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy import basis
from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.candidates import Candidate, candidates
from chatter_monitor.discrepancy.ceiling import ceiling
from chatter_monitor.discrepancy.driven.balance import LINEAR, Balance, BalanceEvidence, balance, evidence_of
from chatter_monitor.discrepancy.locate import subspace_map
from chatter_monitor.discrepancy.name import Contest, Scored
from chatter_monitor.discrepancy.report import Statistic
from chatter_monitor.errors import InputError
from chatter_monitor.physics.model import MachiningSystem

Vector = NDArray[np.float64]

FURTHER_SHARE = 0.02  # of the first term's held-out gain, that a further one has to bring: no real balance closes fully


@dataclass(eq=False)
class DrivenCase:
    """Force and motion beside a model, and everything that was found on the way.

    Attributes
    ----------
    system : MachiningSystem
        The base model as given.
    displacement, force : Recorded
    balance : Balance
    columns : ndarray of float64, shape (c, count)
        Within the band: the linear part, forces of the candidates, bumps over the phase plane, terms of the model.
    evidence : BalanceEvidence
        Of the same columns.
    taken : ndarray of float64, shape (4,)
        Coefficients of the linear part that the evidence does without.
    surface : list of int
        Columns of the bumps.
    contest : Contest
    named, ranking : list of Scored
    ceiling_nats, rest_nats : float
        Held-out gain of any static force, beside the linear part and beside what is named.
    before, after : Statistic
        Tests for any static force, likewise.
    """

    system: MachiningSystem
    displacement: Recorded
    force: Recorded
    balance: Balance
    columns: NDArray[np.float64]
    evidence: BalanceEvidence
    taken: Vector
    surface: list[int]
    contest: Contest
    named: list[Scored] = field(init=False)
    ranking: list[Scored] = field(init=False)
    ceiling_nats: float = field(init=False)
    rest_nats: float = field(init=False)
    before: Statistic = field(init=False)
    after: Statistic = field(init=False)

    def __post_init__(self) -> None:
        evidence, training = self.evidence, self.contest.training
        found, self.ranking = self.contest.run()
        self.named = [each for each in found if each.held_out_nats >= FURTHER_SHARE * found[0].held_out_nats]
        self.ceiling_nats = ceiling(evidence, self.surface, training).held_out_nats
        self.before = subspace_map("phase_plane", evidence, self.surface)
        with self.contest.beside(self.chosen):
            self.rest_nats = ceiling(evidence, self.surface, training).held_out_nats
            self.after = subspace_map("phase_plane_after", evidence, self.surface)

    @property
    def chosen(self) -> list[int]:
        """Columns of what is named."""
        return [column for scored in self.named for column in scored.columns]

    @property
    def gain_nats(self) -> float:
        """Held-out gain of what is named."""
        return sum(each.held_out_nats for each in self.named)

    @property
    def held_out(self) -> NDArray[np.bool_]:
        """Samples of the balance in held-out blocks, shape (count,)."""
        block = np.minimum(np.arange(self.balance.used.size) // self.evidence.block, self.evidence.blocks - 1)
        return np.asarray(~self.contest.training[block] & self.balance.used)

    @cached_property
    def coefficients(self) -> dict[int, tuple[float, float]]:
        """Of the linear part and of what is named, by column, with their standard deviations."""
        fit = self.evidence.regress(self.chosen)
        nuisance = self.evidence.nuisance
        with self.contest.instead([]) as evidence:
            sd = evidence.regress([*nuisance, *self.chosen]).sd
        values = fit.all_coefficients.copy()
        values[: len(LINEAR)] += self.taken
        return {
            column: (float(value), float(spread))
            for column, value, spread in zip([*nuisance, *self.chosen], values, sd, strict=True)
        }

    def linear(self, named: bool = True) -> Vector:
        """Mass, damping, stiffness and offset, beside what is named or alone; shape (4,)."""
        fit = self.evidence.regress(self.chosen if named else [])
        return np.asarray(fit.all_coefficients[: len(LINEAR)] + self.taken)

    def explained(self, named: bool) -> Vector:
        """The force as the training blocks would have it, with or without what is named; shape (count,)."""
        chosen = self.chosen if named else []
        coefficients = self.evidence.regress(chosen, self.contest.training).all_coefficients.copy()
        coefficients[: len(LINEAR)] += self.taken
        return np.asarray(coefficients @ self.columns[[*self.evidence.nuisance, *chosen]])

    def residual(self, named: bool) -> float:
        """Rms of what is left of the force on held-out blocks, over its rms there."""
        force, held = self.balance.force, self.held_out
        return float(np.linalg.norm((force - self.explained(named))[held]) / np.linalg.norm(force[held]))


def examine_driven(
    recording: Recorded,
    force: Recorded,
    system: MachiningSystem,
    progress: Callable[[str], None] = lambda _step: None,
) -> DrivenCase:
    """Compare force and motion with a model.

    Parameters
    ----------
    recording, force : Recorded
        Sample by sample at one rate.
    system : MachiningSystem
        The base model, one mode; its sensor measures the displacement.
    progress : callable, optional
        Told the name of every step.

    Raises
    ------
    InputError
        If the two do not belong together, or the sensor measures something else.
    """
    if system.sensor.quantity != "displacement" or len(system.modes) > 1:
        raise InputError(
            "a measured force can be balanced with one mode seen by its displacement only",
            got=f"{len(system.modes)} modes, {system.sensor.quantity}",
            remedy="Integrate the recording, or leave out --input.",
        )
    present = ~recording.missing
    moved = (recording.samples - np.mean(recording.samples[present])) / system.sensor.gain
    displacement = replace(recording, samples=np.where(present, moved, 0.0))
    progress("force balance")
    found = balance(force, displacement)
    known = [applied.term.name for applied in system.terms]
    tried = candidates(*basis.scales(found.motion), None, known)
    columns, entries = _columns(found, tried)
    bumps = found.surface()
    columns += [*bumps, *(found.of_term(applied.term, applied.values) for applied in system.terms)]
    evidence, taken = evidence_of(found, columns)
    last = len(LINEAR) + len(columns)
    evidence.nuisance += range(last - len(known), last)
    surface = list(range(last - len(known) - len(bumps), last - len(known)))
    progress("names")
    everything = np.array([*found.linear, *columns])
    contest = Contest(evidence, entries)
    return DrivenCase(system, displacement, force, found, everything, evidence, taken, surface, contest)


def _columns(found: Balance, tried: Sequence[Candidate]) -> tuple[list[Vector], list[tuple[Candidate, list[int]]]]:
    """Forces of the candidates; what several share is worked out once."""
    size = basis.scales(found.motion)
    at: dict[tuple[float, ...], int] = {}
    columns: list[Vector] = []
    entries = []
    for candidate in tried:
        for i in candidate.linear:
            if candidate.acts(i, size) not in at:
                at[candidate.acts(i, size)] = len(LINEAR) + len(columns)
                columns.append(found.of_term(candidate.term, candidate.unit(i)))
        entries.append((candidate, [at[candidate.acts(i, size)] for i in candidate.linear]))
    return columns, entries
