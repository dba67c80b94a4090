"""Vibrations by name, as the evidence of an interval has them."""

from __future__ import annotations

import math

import numpy as np

from chatter_monitor.kernels.heard import FIELDS, NO_MODE
from chatter_monitor.records import Flag
from chatter_monitor.tracking.margin import Margin
from chatter_monitor.tracking.orders import Orders
from chatter_monitor.tracking.spectrum import Line
from chatter_monitor.verdict.evidence import Evidence, Heard, Place, Vibration


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


def interval(*frequencies_hz: float, rising: bool = True) -> Evidence:
    """An interval of lines that rise, or stay as they are, each coherent and with nine tenths of the power."""
    behaviour = (0.7, 60.0, 2.3, 3.0, 3.0) if rising else (0.02, 0.0, 0.0, 0.0, 0.0)
    vibrations = heard(*(Vibration(Line(hertz, 0.9, 35.0, *behaviour, 0.99), None) for hertz in frequencies_hz))
    orders = Orders(0, None, None, None, 0.0)
    return Evidence(
        None, vibrations, orders, Margin(), cutting=True, held=False, starting=False, rms=1.0, flags=Flag.NONE
    )
