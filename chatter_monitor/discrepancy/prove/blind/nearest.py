"""How much of a hidden force no other law of the catalogue could stand for, were the motion itself known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy.prove.blind import laws
from chatter_monitor.discrepancy.prove.blind.motion import Hidden

Array = NDArray[np.float64]

_EVERY = 4  # sample that is looked at
# Laws that need no memory, over displacement and velocity in their rms. One with more numbers is no rival to another
# that it contains: Stribeck friction may stand for dry friction, but nobody has to choose it.
_RIVALS: dict[int, tuple[Callable[[Array, Array], list[Array]], ...]] = {
    laws.CUBE: (lambda x, v: [x**3],),  # noqa: ARG005 - all take both
    laws.SQUARE: (lambda x, v: [x**2],),  # noqa: ARG005
    laws.GAP: tuple(
        lambda x, v, gap=gap: [x - np.clip(x, -gap, gap)]  # type: ignore[misc]  # noqa: ARG005
        for gap in (0.3, 0.6, 0.8, 1.0, 1.3, 1.6, 2.0)
    ),
    laws.DRY: (lambda x, v: [np.sign(v)],),  # noqa: ARG005
    laws.STRIBECK: tuple(
        lambda x, v, width=width: [np.sign(v), np.sign(v) * np.exp(-((v / width) ** 2))]  # type: ignore[misc]  # noqa: ARG005
        for width in (0.1, 0.2, 0.35, 0.5, 0.75, 1.1)
    ),
    laws.DRAG: (lambda x, v: [v * np.abs(v)],),  # noqa: ARG005
    laws.ENERGY: (lambda x, v: [x * x * v],),
    laws.CUTTING: (lambda x, v: [v**2, v**3],),  # noqa: ARG005
}


def beyond_nearest(hidden: Hidden, x: Array, v: Array, force: Array) -> float:
    """Share of what nothing linear imitates of a force that the nearest other law does not, either.

    Parameters
    ----------
    hidden : Hidden
    x, v, force : ndarray of float64, shape (n,)
        Along the motion.

    Returns
    -------
    float
        From 0, for a force that is another law, to 1.
    """
    x, v, force = (each[::_EVERY] for each in (x, v, force))
    x, v = x / np.std(x), v / np.std(v)
    linear = [np.ones_like(x), x, v]
    unlike = _left(linear, force)
    shares = [
        _left([*linear, *rival(x, v)], force) / unlike
        for law, rivals in _RIVALS.items()
        for rival in rivals
        if law != hidden.law and not (law == laws.STRIBECK and hidden.law == laws.DRY)
    ]
    return min(1.0, *shares)


def _left(columns: list[Array], force: Array) -> float:
    """Mean square that a regression leaves."""
    matrix = np.column_stack(columns)
    return float(np.mean((force - matrix @ np.linalg.lstsq(matrix, force, rcond=None)[0]) ** 2))
