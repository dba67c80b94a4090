"""Weights of the logistic regression in `kernels.kinds`; made by ``python -m benchmarks.verdict.train``."""

from __future__ import annotations

from typing import NamedTuple


class Weights(NamedTuple):
    """One weight for each measure of a line, and what is added."""

    per_measure: tuple[float, ...]
    offset: float


GROWTH = Weights((0.0, 0.719, 1.143, 0.049, 0.0, 3.871, 2.154, 0.0, -0.524), -5.488)
CALM = Weights((1.694, -0.097, 1.439, -9.504, 1.053, -0.551, -0.15, 0.57, 0.243), -2.688)
