"""Weights of the logistic regression in `verdict.kinds`; made by ``python -m benchmarks.verdict.train``."""

from __future__ import annotations

from typing import NamedTuple


class Weights(NamedTuple):
    """One weight for each measure of a line, and what is added."""

    per_measure: tuple[float, ...]
    offset: float


GROWTH = Weights((0.109, 0.665, 0.986, -0.724, 0.0, 3.76, 2.279, 0.0, -0.103), -4.573)
CALM = Weights((1.343, -0.126, 1.425, -8.846, 1.331, -0.725, -0.376, 0.454, 0.193), -2.511)
