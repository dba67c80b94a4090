"""Damping potential H(E) / (pi S0) from the probability density along shells of equal energy, eq. (11)-(13).

The samples are counted in shells between energies, and p(x, v) is the share of a shell divided by its area in the
(x, v) plane, which is the action between its energies: exact for any U, without a Jacobian T(E) to be divided out and
without the bias of a kernel at E = 0. The smooth curve is the density itself in exponential form,

    p(x, v) = C exp(-sum theta_j E^(1 + j/2)),

fitted by maximum likelihood. The powers have names: j = -1 is dry friction, 0 viscous damping, 1 damping by v abs(v),
2 by x^2 v, and their derivatives are the h(E) of eq. (12).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from chatter_monitor.energy.potential import Potential

FINE = 160  # shells of the likelihood, of equal width in amplitude
MOST_STEPS = 50
ROUNDING = 1e-11
RIDGE = 1e-9  # of the Newton steps, for records that know one energy only
# Combinations of powers j, the simplest first; BIC decides.
MODELS: tuple[tuple[int, ...], ...] = (
    (0,), (-1, 0), (0, 1), (0, 2), (-1,), (1,), (-1, 1), (-1, 0, 1), (-1, 0, 2), (0, 1, 2), (0, 2, 4),
)  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Powers:
    """A function sum of c_j (E / unit)^(j/2) over the powers j.

    Attributes
    ----------
    powers : tuple of int
        The j.
    coefficients : ndarray, shape (..., len(powers))
        The c_j; leading axes are replicates.
    unit : float
        Energy that makes E dimensionless.
    """

    powers: tuple[int, ...]
    coefficients: NDArray[np.float64]
    unit: float

    def value(self, energy: NDArray[np.float64]) -> NDArray[np.float64]:
        """The function at `energy`, shape (..., energies)."""
        return np.asarray(self.coefficients @ design(self.powers, energy / self.unit))

    def integral(self, energy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Its integral from 0 to `energy`, eq. (12)."""
        rise = 1.0 + 0.5 * np.array(self.powers)
        raised = design(tuple(j + 2 for j in self.powers), energy / self.unit)
        return np.asarray((self.coefficients * self.unit / rise) @ raised)


def design(powers: tuple[int, ...], ratio: NDArray[np.float64]) -> NDArray[np.float64]:
    """(E / unit)^(j/2), one row for each power."""
    return np.asarray(np.asarray(ratio)[None, :] ** (0.5 * np.array(powers)[:, None]))


@dataclass(frozen=True, slots=True, eq=False)
class Shells:
    """Samples counted by block and shell of energy.

    Attributes
    ----------
    edges : ndarray, shape (shells + 1,)
        Energies between the shells.
    area : ndarray, shape (shells,)
        Area of each shell in the (x, v) plane.
    counts : ndarray, shape (blocks, shells)
        Samples in each.
    """

    edges: NDArray[np.float64]
    area: NDArray[np.float64]
    counts: NDArray[np.float64]

    @property
    def centre(self) -> NDArray[np.float64]:
        """Energy in the middle of each shell's amplitudes."""
        return np.asarray((0.5 * (np.sqrt(self.edges[:-1]) + np.sqrt(self.edges[1:]))) ** 2)

    def mean_energy(self) -> float:
        """Mean energy of all samples."""
        total = self.counts.sum(axis=0)
        return float(np.sum(total * self.centre) / np.sum(total))

    def independent(self) -> float:
        """How many independent samples the record is worth: spread of the blocks' mean energies against a draw's."""
        inside = self.counts.sum(axis=1)
        mean = self.mean_energy()
        deviation = self.counts @ self.centre - mean * inside
        variance = float(np.sum(self.counts.sum(axis=0) * (self.centre - mean) ** 2) / np.sum(inside))
        of_mean = float(np.sum(deviation**2)) / float(np.sum(inside)) ** 2 * inside.size / (inside.size - 1)
        return max(float(variance / of_mean), 2.0)


def count_shells(energy: NDArray[np.float64], block: NDArray[np.int64], potential: Potential, top: float) -> Shells:
    """Sort samples of energy below `top` into shells of equal width in amplitude."""
    edges = top * np.linspace(0.0, 1.0, FINE + 1) ** 2
    inside = energy < top
    shell = (np.sqrt(energy[inside] / top) * FINE).astype(np.int64)
    blocks = int(block[-1]) + 1
    counts = np.bincount(block[inside] * FINE + shell, minlength=blocks * FINE).reshape(blocks, FINE)
    return Shells(edges, np.diff(potential.action(edges)), counts.astype(np.float64))


def fit_density(
    shells: Shells, powers: tuple[int, ...], weights: NDArray[np.float64]
) -> tuple[Powers, NDArray[np.float64]]:
    """Maximum likelihood of p(x, v) = C exp(-H/(pi S0)), eq. (11), with H' made of `powers`.

    Parameters
    ----------
    weights : ndarray, shape (rows, blocks)
        One row for each fit: ones for the record itself, bootstrap draws.

    Returns
    -------
    Powers
        h(E) / (pi S0), the derivative of the damping potential, one row of coefficients for each fit.
    ndarray, shape (rows,)
        Mean log-likelihood of a sample.
    """
    unit = shells.mean_energy()
    share = weights @ shells.counts
    share /= share.sum(axis=1, keepdims=True)
    rise = 1.0 + 0.5 * np.array(powers)
    statistics = design(tuple(j + 2 for j in powers), shells.centre / unit) / rise[:, None]
    observed = share @ statistics.T
    size = len(powers)
    products = (statistics[:, None, :] * statistics[None, :, :]).reshape(size * size, -1).T
    log_area = np.log(shells.area)

    def log_norm(theta: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        exponent = log_area - theta @ statistics
        norm = special.logsumexp(exponent, axis=1)
        return np.exp(exponent - norm[:, None]), -np.sum(observed * theta, axis=1) - norm

    theta = np.zeros((weights.shape[0], size))
    expected, level = log_norm(theta)
    for _ in range(MOST_STEPS):  # Newton on a concave function, halving steps that overshoot
        mean = expected @ statistics.T
        spread = (expected @ products).reshape(-1, size, size) - mean[:, :, None] * mean[:, None, :]
        ridge = RIDGE * (np.trace(spread, axis1=1, axis2=2) + RIDGE)
        step = np.linalg.solve(spread + ridge[:, None, None] * np.eye(size), (mean - observed)[:, :, None])[:, :, 0]
        for _ in range(30):
            expected, reached = log_norm(theta + step)
            overshot = reached < level - ROUNDING
            if not overshot.any():
                break
            step[overshot] *= 0.5
        theta += step
        gained, level = float(np.max(reached - level)), reached
        if gained < ROUNDING:
            break
    return Powers(powers, theta / unit, unit), level


@dataclass(frozen=True, slots=True, eq=False)
class DensityFits:
    """Every model of `MODELS` fitted to the record and to its bootstrap replicates.

    Attributes
    ----------
    slopes : tuple of Powers
        h(E) / (pi S0) for each model, one row of coefficients for each set of block weights.
    chosen : ndarray of int, shape (rows,)
        Model with the lowest BIC in each row.
    probability : ndarray, shape (models, rows)
        Weight of each model, exp(-BIC / 2) normalised.
    """

    slopes: tuple[Powers, ...]
    chosen: NDArray[np.int64]
    probability: NDArray[np.float64]


def fit_all(shells: Shells, weights: NDArray[np.float64]) -> DensityFits:
    """Fit all models; BIC counts independent samples instead of samples."""
    worth = shells.independent()
    fits = [fit_density(shells, powers, weights) for powers in MODELS]
    bic = np.array([len(m) * np.log(worth) - 2.0 * worth * level for m, (_, level) in zip(MODELS, fits, strict=True)])
    odds = np.exp(-0.5 * (bic - bic.min(axis=0)))
    return DensityFits(tuple(slope for slope, _ in fits), np.argmin(bic, axis=0), odds / odds.sum(axis=0))
