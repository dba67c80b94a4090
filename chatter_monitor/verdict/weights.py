"""Weights of the logistic regression in `kernels.kinds`; made by ``python -m benchmarks.verdict.train``."""

from __future__ import annotations

from typing import NamedTuple


class Weights(NamedTuple):
    """One weight for each measure of a line, and what is added."""

    per_measure: tuple[float, ...]
    offset: float


GROWTH = Weights((0.115, 0.592, 0.387, 1.279, -1.154, 0.0, 0.241, 3.419, 0.0, 0.0, 0.0), -6.320)
CALM = Weights((1.514, -0.023, 1.401, 0.431, -9.255, 0.703, -0.227, -0.354, 0.458, 0.051, 0.249), -3.378)
