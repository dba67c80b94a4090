"""Vibrations by name, as the evidence of an interval has them."""

from __future__ import annotations

import math

import numpy as np

from chatter_monitor.kernels.heard import FIELDS, NO_MODE
from chatter_monitor.verdict.evidence import Heard, Place, Vibration


def heard(*vibrations: Vibration) -> Heard:
    """The opposite of asking for each of them."""
    modes = [v.mode for v in vibrations if v.mode is not None]
    nowhere = Place(False, math.nan)
    rows = [
        (
            *v.line,
            NO_MODE if v.mode is None else modes.index(v.mode),
            v.damping_ratio,
            *(v.place or nowhere),
            *(v.teeth or nowhere),
        )
        for v in vibrations
    ]
    return Heard(np.array(rows, float).reshape(-1, FIELDS), np.array(modes, float).reshape(-1, 4))
