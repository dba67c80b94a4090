"""Naming what a base model lacks: candidates against each other, on samples that they were not fitted to.

The recording is cut into blocks; every second one is held out. A candidate leads by its gain on the training blocks
less a price for every parameter, and counts when the held-out blocks confirm it. Names are told apart by all blocks.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from chatter_monitor.discrepancy.candidates import Candidate
from chatter_monitor.discrepancy.evidence import Evidence, Regressed

PRICE_NATS = 3.0  # of a parameter
HELD_OUT_P = 1e-4
LEAST_HELD_OUT_NATS = 4.0
SURE_NATS = -math.log(HELD_OUT_P)
MOST_TERMS = 3


@dataclass(frozen=True, slots=True, eq=False)
class Scored:
    """A candidate with its evidence.

    Attributes
    ----------
    candidate : Candidate
    all_columns, columns : list of int
        Of its coefficients, and those of them that are not at their bound.
    fit : Regressed
        On all blocks.
    evidence_nats : float
        Gain on all blocks less the price of the parameters.
    held_out_nats : float
        Gain on the held-out blocks with the coefficients of the training blocks.
    p_value : float
        Of the held-out blocks.
    """

    candidate: Candidate
    all_columns: list[int]
    columns: list[int]
    fit: Regressed
    evidence_nats: float
    held_out_nats: float
    p_value: float


Entry = tuple[float, Candidate, list[int], list[int]]


class Contest:
    """All candidates before one recording.

    Parameters
    ----------
    evidence : Evidence
    entries : sequence of (Candidate, list of int)
        Candidates and the columns of their coefficients.
    seen : collection of str
        Names of a force that was found already, with a parameter more: all blocks together may confirm those.
    together : bool
        All blocks together may confirm any name that comes first.
    """

    def __init__(
        self,
        evidence: Evidence,
        entries: Sequence[tuple[Candidate, list[int]]],
        seen: Collection[str] = (),
        together: bool = False,
    ) -> None:
        self.evidence, self.entries, self.seen, self.together = evidence, list(entries), seen, together
        self.training = np.arange(evidence.blocks) % 2 == 0

    def best(self, given: Sequence[int], blocks: NDArray[np.bool_]) -> dict[str, Entry]:
        """Best shape of every name, with its gain less its price, beside columns that are given."""
        found: dict[str, Entry] = {}
        with self.beside(given) as evidence:
            for candidate, columns in self.entries:
                left, fit = evidence.bounded(columns, candidate.lower, PRICE_NATS, blocks)
                score = fit.gain - PRICE_NATS * (len(left) + candidate.shapes) if left else 0.0
                if candidate.name not in found or score > found[candidate.name][0]:
                    found[candidate.name] = (score, candidate, columns, left)
        return found

    def score(self, entry: Entry, given: Sequence[int]) -> Scored:
        """Evidence of one candidate."""
        _, candidate, all_columns, columns = entry
        with self.beside(given) as evidence:
            fit = evidence.regress(columns)
            trained = evidence.regress(columns, self.training)
            base = evidence.regress([], self.training)
            held = evidence.gain_on(trained, columns, base, ~self.training)
            p = evidence.p_value(columns, ~self.training) if columns else 1.0
        price = PRICE_NATS * (len(columns) + candidate.shapes)
        return Scored(candidate, all_columns, columns, fit, fit.gain - price, held, p)

    def run(self, most: int = MOST_TERMS) -> tuple[list[Scored], list[Scored]]:
        """Forward selection of at most so many terms.

        Returns
        -------
        list of Scored
            What is named.
        list of Scored
            For the first that is tried: best shape of every name, most evidence first.
        """
        named: list[Scored] = []
        given: list[int] = []
        ranking: list[Scored] = []
        while len(named) < most:
            taken = {each.candidate.name for each in named}
            leaders = {k: v for k, v in self.best(given, self.training).items() if k not in taken and v[3]}
            everything = {
                k: v for k, v in self.best(given, self.evidence.everything).items() if k not in taken and v[3]
            }
            scored = [self.score(entry, given) for entry in everything.values()]
            scored.sort(key=lambda each: -each.evidence_nats)
            ranking = ranking or scored
            if not leaders or not scored:
                break
            leader = self.score(max(leaders.values(), key=lambda each: each[0]), given)
            confirmed = leader.p_value <= HELD_OUT_P and leader.held_out_nats >= LEAST_HELD_OUT_NATS
            if scored[0].candidate.name in self.seen:
                confirmed |= scored[0].evidence_nats > SURE_NATS
            if self.together and not named:  # half of the recording may lead to a wrong name, and not confirm that
                confirmed |= scored[0].evidence_nats > SURE_NATS and scored[0].held_out_nats >= LEAST_HELD_OUT_NATS
            if scored[0].evidence_nats <= 0 or not confirmed:
                break
            named.append(scored[0])
            given.extend(scored[0].columns)
        return named, ranking

    def beside(self, given: Sequence[int]) -> AbstractContextManager[Evidence]:
        """The evidence with more columns among the nuisance, for the time of a `with`."""
        return self.instead([*self.evidence.nuisance, *given])

    def without(self, columns: Collection[int]) -> AbstractContextManager[Evidence]:
        """The evidence with columns taken out of the nuisance, so that they can be asked about, likewise."""
        return self.instead([column for column in self.evidence.nuisance if column not in columns])

    @contextmanager
    def instead(self, nuisance: Sequence[int]) -> Iterator[Evidence]:
        """The evidence with other nuisance columns, for the time of a `with`."""
        before = self.evidence.nuisance
        self.evidence.nuisance = list(nuisance)
        try:
            yield self.evidence
        finally:
            self.evidence.nuisance = before


def subspace_p(
    evidence: Evidence, columns: Sequence[int], blocks: NDArray[np.bool_] | None = None
) -> tuple[float, float, int]:
    """Test whether many columns together explain anything: statistic, p-value, degrees of freedom.

    Only directions that the recording determines count: those whose share of the products is not negligible once the
    nuisance columns are taken out.
    """
    if not columns:
        return 0.0, 1.0, 0
    right, normal, _ = within(evidence, columns, blocks)
    values, vectors = np.linalg.eigh(normal)
    kept = values > 1e-4 * values[-1]
    statistic = float(np.sum((vectors[:, kept].T @ right) ** 2 / values[kept]))
    freedom = int(kept.sum())
    return statistic, float(stats.chi2.sf(statistic, freedom)), freedom


def within(
    evidence: Evidence, columns: Sequence[int], blocks: NDArray[np.bool_] | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Normal equations of columns once the nuisance columns are taken out: right side, matrix, and sizes.

    Both are in units of the columns' sizes, the roots of their products with themselves before that.
    """
    total = evidence.over(evidence.everything if blocks is None else blocks)
    nuisance = [i + 1 for i in evidence.nuisance]
    index = [i + 1 for i in columns]
    normal = total[np.ix_(nuisance, nuisance)] + 1e-9 * np.diag(np.diag(total)[nuisance])
    projection = np.linalg.solve(normal, total[np.ix_(nuisance, [0, *index])])
    right = total[index, 0] - total[np.ix_(index, nuisance)] @ projection[:, 0]
    rest = total[np.ix_(index, index)] - total[np.ix_(index, nuisance)] @ projection[:, 1:]
    size = np.sqrt(np.maximum(np.diag(total)[index], 1e-300))
    return right / size, rest / np.outer(size, size), size
