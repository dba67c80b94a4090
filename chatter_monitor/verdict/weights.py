"""Weights of the logistic regression in `kernels.kinds`; made by ``python -m benchmarks.verdict.train``."""

from __future__ import annotations

from typing import NamedTuple


class Weights(NamedTuple):
    """One weight for each measure of a line, and what is added."""

    per_measure: tuple[float, ...]
    offset: float


GROWTH = Weights((0.149, 0.749, 0.264, 0.975, -0.299, 0.0, 0.0, 2.514, 0.0, 0.0, 0.0), -5.381)
CALM = Weights((1.456, -0.071, 1.288, -0.057, -10.542, 0.619, -0.724, 0.047, 0.248, -0.165, 0.333), -1.065)
