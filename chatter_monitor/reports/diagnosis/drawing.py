"""What the pictures of a diagnosis have in common."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.reports.page import bitmap

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RECORDED, BASE, AUGMENTED = "#4a6fa5", "#9a9a9a", "#b0303a"
_TICKS = 5  # of an axis, at most, and one


def figure_of(rows: int) -> tuple[Figure, NDArray[np.object_]]:
    """Rows of three axes with fixed margins: a layout engine would take longer than all of the drawing."""
    from matplotlib.figure import Figure

    height = 4.1 * rows
    figure = Figure(figsize=(14.0, height))
    margins = {"left": 0.05, "right": 0.985, "bottom": 0.55 / height, "top": 1.0 - 0.4 / height}
    axes = figure.subplots(rows, 3, gridspec_kw=margins | {"wspace": 0.22, "hspace": 0.3})
    return figure, np.asarray(axes).ravel()


def titled(figure: Figure, title: str) -> str:
    """The picture under a heading, as HTML.

    Titles and labels stand where they are put, and there are few ticks, none of them small: to look for their places
    and to draw more would take longer than all the rest.
    """
    from matplotlib.ticker import MaxNLocator

    for axes in figure.axes:
        axes.set_title(axes.get_title(), y=1.0)
        axes.minorticks_off()
        axes.xaxis.set_label_coords(0.5, -0.1)
        for axis in (axes.xaxis, axes.yaxis):
            if isinstance(locator := axis.get_major_locator(), MaxNLocator):
                locator.set_params(nbins=_TICKS)
    return f"<h2>{title}</h2>{bitmap(figure, title, dpi=80)}"
