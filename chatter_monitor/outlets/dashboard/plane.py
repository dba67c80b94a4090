"""Axes for two-dimensional views, which rerun has none for: frequency by octaves upwards, labelled lines."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike, NDArray

LOWEST_HZ, HIGHEST_HZ = 50.0, 6400.0
TICKS_HZ = (100, 200, 500, 1000, 2000, 5000)
AXIS = (120, 120, 120)
TEXT = (190, 190, 190)


def height(frequency_hz: ArrayLike, total: float) -> NDArray[np.float64]:
    """Vertical coordinate of a frequency: 0 at the top, which is `HIGHEST_HZ`, and `total` at `LOWEST_HZ`."""
    octaves = np.log2(HIGHEST_HZ / np.maximum(np.asarray(frequency_hz, np.float64), 1.0))
    return np.asarray(total * octaves / np.log2(HIGHEST_HZ / LOWEST_HZ))


def axes(left: float, right: float, total: float, along: Mapping[float, str]) -> tuple[rr.LineStrips2D, rr.Points2D]:
    """Frame, ticks and labels of a plot with frequency upwards.

    Parameters
    ----------
    left, right, total : float
        Edges and height of the plot.
    along : mapping of float to str
        Where to write what below it.
    """
    tick = 0.01 * (right - left)
    up = {float(height(hz, total)): f"{hz} Hz" if hz < 1000 else f"{hz // 1000} kHz" for hz in TICKS_HZ}
    frame = [[[left, 0.0], [left, total], [right, total]]]
    ticks = [[[left - tick, y], [left, y]] for y in up] + [[[x, total], [x, total + tick]] for x in along]
    # a label hangs below its point
    places = [[left - 4.0 * tick, y - 3.0 * tick] for y in up] + [[x, total + 0.5 * tick] for x in along]
    return (
        rr.LineStrips2D([*frame, *ticks], colors=[AXIS], radii=rr.Radius.ui_points(0.5)),
        rr.Points2D(
            places,
            labels=[*up.values(), *along.values()],
            colors=[TEXT],
            radii=rr.Radius.ui_points(0.0),
            show_labels=True,
        ),
    )
