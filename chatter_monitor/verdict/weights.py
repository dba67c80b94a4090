"""Weights of the logistic regression in `kernels.kinds`; made by ``python -m benchmarks.verdict.train``."""

from __future__ import annotations

from typing import NamedTuple


class Weights(NamedTuple):
    """One weight for each measure of a line, and what is added."""

    per_measure: tuple[float, ...]
    offset: float


GROWTH = Weights((0.0, 0.525, 0.44, 1.046, -1.687, 0.0, 0.093, 3.152, 0.0, 0.0, 0.0), -5.447)
CALM = Weights((1.419, -0.046, 1.409, 0.344, -9.485, 0.752, -0.355, -0.579, 0.594, 0.051, 0.266), -2.939)
