"""The ceiling: what any static force, a smooth surface over displacement and velocity, explains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy.evidence import Evidence

_RIDGES = np.geomspace(1e-3, 1e4, 15)


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A force surface.

    Attributes
    ----------
    coefficients, sd : ndarray of float64, shape (bumps,)
        Of the bumps, fitted to all blocks, and their standard deviations.
    held_out_nats : float
        Gain on held-out blocks with the coefficients of the training blocks, over the nuisance columns alone.
    """

    coefficients: NDArray[np.float64]
    sd: NDArray[np.float64]
    held_out_nats: float


def ceiling(evidence: Evidence, columns: Sequence[int], training: NDArray[np.bool_]) -> Surface:
    """Fit the surface with a ridge that is chosen on training blocks alone, two folds of them."""
    order = np.cumsum(training) % 2 == 0
    folds = [training & order, training & ~order]

    def cross_validated(ridge: float) -> float:
        return sum(
            _gain(evidence, columns, _coefficients(evidence, columns, fold, ridge)[0], fold, other)
            for fold, other in (folds, folds[::-1])
        )

    ridge = float(max(_RIDGES, key=cross_validated))
    trained, _ = _coefficients(evidence, columns, training, ridge)
    held = _gain(evidence, columns, trained, training, ~training)
    solution, sd = _coefficients(evidence, columns, evidence.everything, ridge)
    return Surface(solution[len(evidence.nuisance) :], sd[len(evidence.nuisance) :], held)


def _coefficients(
    evidence: Evidence, columns: Sequence[int], blocks: NDArray[np.bool_], ridge: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    total = evidence.over(blocks)
    index = [i + 1 for i in (*evidence.nuisance, *columns)]
    k = len(evidence.nuisance)
    normal = total[np.ix_(index, index)]
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    # One scale for all bumps: rare ones are held back, not blown up.
    size[k:] = np.sqrt(np.mean(size[k:] ** 2))
    scaled = normal / np.outer(size, size)
    penalty = np.concatenate([np.full(k, 1e-9), np.full(len(columns), ridge / float(total[0, 0]) * len(columns))])
    inverse = np.linalg.inv(scaled + np.diag(penalty))
    solution = inverse @ (total[index, 0] / size) / size
    return solution, np.sqrt(np.maximum(np.diag(inverse), 0.0)) / size


def _gain(
    evidence: Evidence, columns: Sequence[int], coefficients: NDArray[np.float64], fitted: NDArray[np.bool_],
    blocks: NDArray[np.bool_],
) -> float:  # fmt: skip
    total = evidence.over(blocks)
    base = evidence.regress([], fitted).all_coefficients

    def rest(solution: NDArray[np.float64], index: list[int]) -> float:
        normal = total[np.ix_(index, index)]
        return 0.5 * float(total[0, 0] - 2.0 * solution @ total[index, 0] + solution @ normal @ solution)

    nuisance = [i + 1 for i in evidence.nuisance]
    return rest(base, nuisance) - rest(coefficients, [*nuisance, *(i + 1 for i in columns)])
