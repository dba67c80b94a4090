"""Weights of the logistic regression in `verdict.kinds`; made by ``python -m benchmarks.verdict.train``."""

from __future__ import annotations

from typing import NamedTuple


class Weights(NamedTuple):
    """One weight for each measure of a line, and what is added."""

    per_measure: tuple[float, ...]
    offset: float


GROWTH = Weights((0.517, 0.236, 0.246, 3.191, 0.0, 2.174, 3.152, 1.547, -2.968), -11.793)
CALM = Weights((1.15, -0.026, 1.489, -9.731, -0.737, 0.506, 2.807, -0.933, 0.599), -2.312)
