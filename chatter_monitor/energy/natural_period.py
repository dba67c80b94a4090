"""Natural period T(E): from the potential by quadrature, and straight from the zero crossings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.energy.potential import Potential
from chatter_monitor.energy.stiffness import HalfCycles

ZONES = 24
FEWEST = 30  # periods that a zone needs


@dataclass(frozen=True, slots=True, eq=False)
class NaturalPeriod:
    """Period against energy.

    Attributes
    ----------
    energy, period_s : ndarray
        T(E) of the fitted potential, over its reach.
    zone_energy, zone_period_s, zone_error_s : ndarray
        Mean time from one upward zero crossing to the next, with its standard error, by zones of equal energy.
    """

    energy: NDArray[np.float64]
    period_s: NDArray[np.float64]
    zone_energy: NDArray[np.float64]
    zone_period_s: NDArray[np.float64]
    zone_error_s: NDArray[np.float64]


def natural_period(cycles: HalfCycles, potential: Potential) -> NaturalPeriod:
    """Both periods of a motion in its fitted potential.

    The energy of a period is the mean over its two extremes and its three crossings (the outer ones count half), so
    that a change of energy within the period favours neither end.
    """
    at_rest = float(potential.energy(np.array(0.0)))
    kinetic = 0.5 * cycles.crossing_velocity**2 + at_rest
    at_extreme = potential.energy(cycles.extreme)
    half = 0.5 * (0.5 * (kinetic[:-1] + kinetic[1:]) + at_extreme)
    energy = 0.5 * (half[:-1] + half[1:])
    period = cycles.crossing_s[2:] - cycles.crossing_s[:-2]
    top = float(np.min(potential.energy(np.array(potential.reach))))
    zone = np.minimum((np.sqrt(np.maximum(energy, 0.0) / top) * ZONES).astype(np.int64), ZONES)
    count = np.bincount(zone, minlength=ZONES + 1)[:ZONES]
    used = count >= FEWEST
    filled = np.maximum(count, 1)
    mean = np.bincount(zone, period, ZONES + 1)[:ZONES] / filled
    square = np.bincount(zone, period**2, ZONES + 1)[:ZONES] / filled
    error = np.sqrt(np.maximum(square - mean**2, 0.0) / filled)
    level = np.bincount(zone, energy, ZONES + 1)[:ZONES] / filled
    grid = top * np.linspace(0.01, 1.0, 60)
    return NaturalPeriod(grid, potential.period(grid), level[used], mean[used], error[used])
