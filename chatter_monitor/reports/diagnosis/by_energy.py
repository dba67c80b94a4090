"""Stiffness and damping of recording and simulations by energy, each identified alone (`chatter_monitor.energy`)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy.side_by_side import each
from chatter_monitor.energy.band import Quantity
from chatter_monitor.energy.identification import Identification, identify
from chatter_monitor.errors import InputError
from chatter_monitor.physics.parts import Quantity as Sensed

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Vector = NDArray[np.float64]

REPLICATES = 40  # of the bootstrap; the bands are for the eye


def identified(
    runs: Mapping[str, Vector], rate_hz: float, sensed: Sensed, known: Mapping[str, Identification] | None = None
) -> dict[str, Identification]:
    """The strongest mode of the recording, in each of the runs.

    Parameters
    ----------
    runs : mapping of ndarray, shape (n,)
        The first is the recording, whose band is looked at in all of them.
    rate_hz, sensed
        Their rate, and what they measure; the model's pressure is proportional to the acceleration.
    known : mapping, optional
        What was returned before for the recording and some of the runs.

    Returns
    -------
    dict
        Without those that cannot be identified; empty if the recording cannot.
    """
    quantity = "acceleration" if sensed == "pressure" else sensed
    first, *others = runs
    recording = _identified(runs[first], rate_hz, quantity, None) if known is None else known.get(first)
    if recording is None:
        return {}
    found = {first: recording} if known is None else dict(known)
    band_hz = recording.band.low_hz, recording.band.high_hz
    new = [name for name in others if name not in found]
    results = each(lambda name: _identified(runs[name], rate_hz, quantity, band_hz), new)
    return found | {name: result for name, result in zip(new, results, strict=True) if result is not None}


def _identified(
    run: Vector, rate_hz: float, quantity: Quantity, band_hz: tuple[float, float] | None
) -> Identification | None:
    try:
        return identify(run, rate_hz, quantity, band_hz=band_hz, replicates=REPLICATES)
    except InputError:
        return None


def draw_stiffness(axes: Axes, result: Identification, color: str, name: str) -> None:
    """Tangent stiffness over the displacement, in its value at rest."""
    s = result.stiffness
    rms = float(np.sqrt(result.damping.mean_energy / s.k1))
    axes.plot(s.x / rms, 100.0 * s.k / s.k1, color=color, lw=0.9, label=name)
    axes.fill_between(s.x / rms, 100.0 * s.k_low / s.k1, 100.0 * s.k_high / s.k1, color=color, alpha=0.15, lw=0.0)


def draw_frequency(axes: Axes, result: Identification, color: str) -> None:
    """Frequency of the free vibration over its energy, in the potential that was identified."""
    period = result.period
    axes.plot(period.energy / result.damping.mean_energy, 1.0 / period.period_s, color=color, lw=0.9)


def draw_damping(axes: Axes, result: Identification, color: str) -> None:
    """Equivalent damping ratio over the energy, with its 95 % band."""
    d, half = result.damping, 50.0 / np.sqrt(result.stiffness.k1)
    axes.plot(d.energy / d.mean_energy, half * d.h, color=color, lw=0.9)
    axes.fill_between(d.energy / d.mean_energy, half * d.h_low, half * d.h_high, color=color, alpha=0.15, lw=0.0)
