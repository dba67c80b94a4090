"""What drives the vibration: the intensity S0 of the random force, and whether the vibration feeds itself.

A self-excited vibration has negative damping at small amplitude, so its damping potential falls from E = 0 to a minimum
at the limit cycle, and p(x, v) is a crater; noise-driven vibration is most likely at rest (eq. (11)-(13)).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.energy.damping_potential import DensityFits, Powers

Kind = Literal["noise_driven", "self_excited"]
RIM = 0.02  # the crater's rim lies above this share of the highest energy; below, a shell holds no samples to speak of


@dataclass(frozen=True, slots=True)
class Excitation:
    """Kind of excitation.

    Attributes
    ----------
    kind : str
        ``noise_driven`` or ``self_excited``.
    confidence : float
        Probability of `kind`, 0.5 to 1: weights of the fitted densities that agree.
    cycle_energy : float
        Energy at the minimum of the damping potential, 0 when noise-driven.
    """

    kind: Kind
    confidence: float
    cycle_energy: float


def lowest(slope: Powers, row: int, top: float) -> float:
    """Energy between 0 and `top` at which the damping potential is lowest."""
    energy = top * np.linspace(0.0, 1.0, 401)[1:] ** 2
    level = Powers(slope.powers, slope.coefficients[row], slope.unit).integral(energy)
    at = int(np.argmin(level))
    return float(energy[at]) if level[at] < 0.0 and energy[at] > RIM * top else 0.0


def excitation_kind(fits: DensityFits, top: float) -> Excitation:
    """Tell self-excited from noise-driven vibration by all densities that fit, each with its probability.

    Parameters
    ----------
    fits : DensityFits
        Row 0 is the record.
    top : float
        Highest energy fitted.
    """
    cycle = np.array([lowest(slope, 0, top) for slope in fits.slopes])
    probability = float(np.sum(fits.probability[cycle > 0.0, 0]))
    if probability > 0.5:
        likeliest = int(np.argmax(np.where(cycle > 0.0, fits.probability[:, 0], 0.0)))
        return Excitation("self_excited", probability, float(cycle[likeliest]))
    return Excitation("noise_driven", 1.0 - probability, 0.0)


def strength(
    measured: NDArray[np.float64], slope: NDArray[np.float64], weight: NDArray[np.float64]
) -> NDArray[np.float64]:
    """D = pi S0 from h_eq(E) and the slope h(E) / (pi S0) of the damping potential at the same energies.

    Both are blurred by the same chance, the time that the record spends at each energy. Weighted by that time and by
    the mean of v^2 there, the numerator is the power lost and the denominator is 1 up to the zones left out: the
    balance <h v^2> = pi S0, which holds far better than either factor is known.

    Parameters
    ----------
    measured, slope : ndarray, shape (rows, zones)
        h_eq and h / (pi S0).
    weight : ndarray, shape (rows, zones)
        Segments times energy; 0 where there is none.
    """
    lost = np.sum(np.where(weight > 0.0, measured * weight, 0.0), axis=1)
    return np.asarray(lost / np.sum(slope * weight, axis=1))
