"""Potential and stiffness from kinetic energies at zero crossings and displacements at extremes (paper, 3.1).

Between a zero crossing, where the energy is v^2/2, and the neighbouring extreme, where it is U(x), a quarter period
passes and the energy wanders. Sorting the pairs by either of the two would regress the other one towards the mean. The
motion is statistically the same backwards in time, so in the long run the two energies of a pair are exchangeable, and
pairs sorted by the *sum* of both have equal means of v^2/2 and U(x) in every zone, whatever the damping. The sum needs
U itself: the iteration starts from the linear U and repeats until the zones stand still. The mean of every power of x
is kept for each zone, so that the width of a zone does not bend the fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

from chatter_monitor.energy import blocks
from chatter_monitor.energy.kinematics import Motion
from chatter_monitor.energy.potential import Potential
from chatter_monitor.errors import InputError
from chatter_monitor.kernels import energy as kernel

ZONES = 24  # on each side of zero, of equal width in amplitude
FEWEST = 30  # pairs that a zone needs
WIDEST_SCATTER = 0.7  # standard deviation of a pair's difference relative to its energy; beyond, half cycles get lost
ITERATIONS = 8
# The two energies of a pair differ by chance gained within a quarter period: blocks need not span the memory of the
# energy, and must be many, because few of them reach the high energies that decide k3.
PER_BLOCK = 20  # half cycles
BLOCKS = (8, 500)
# Powers of x that U may be made of, the linear-cubic model first; BIC decides. Without a range of energies: linear.
LINEAR: tuple[int, ...] = (2,)
MODELS: tuple[tuple[int, ...], ...] = ((2, 4), (2, 4, 6), (1, 2, 3, 4), (1, 2, 3, 4, 6), (1, 2, 3, 4, 5, 6))
POWERS = 6


@dataclass(frozen=True, slots=True, eq=False)
class HalfCycles:
    """Zero crossings and the extremes between them.

    Attributes
    ----------
    crossing_s, crossing_velocity : ndarray, shape (h + 1,)
        Instants of the zero crossings and velocities there.
    extreme : ndarray, shape (h,)
        Displacement farthest from zero between crossing i and i + 1.
    """

    crossing_s: NDArray[np.float64]
    crossing_velocity: NDArray[np.float64]
    extreme: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ZoneLeftOut:
    """A zone that does not take part in a fit, and why."""

    energy: float
    samples: int
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class Stiffness:
    """Identified potential and stiffness, all per unit mass.

    Attributes
    ----------
    potential : Potential
        Fitted polynomial U(x).
    k1, k3 : float
        Tangent stiffness at equilibrium (1/s^2) and cubic coefficient (1/s^2 per squared displacement).
    k1_ci95, k3_ci95 : (float, float)
        95 % intervals.
    powers : tuple of int
        Powers of x in the fit, chosen by BIC.
    zone_x, zone_energy, zone_error : ndarray
        Mean extreme, mean kinetic energy (= estimate of U there) and its standard error, for each zone used.
    pair_x, pair_energy : ndarray
        Some of the pairs themselves, for plots.
    x, u, u_low, u_high, k, k_low, k_high : ndarray
        U(x) and k(x) on a grid with their pointwise 95 % bands.
    left_out : tuple of ZoneLeftOut
        Zones with too few pairs, or with an energy that does not last a quarter period.
    """

    potential: Potential
    k1: float
    k3: float
    k1_ci95: tuple[float, float]
    k3_ci95: tuple[float, float]
    powers: tuple[int, ...]
    zone_x: NDArray[np.float64]
    zone_energy: NDArray[np.float64]
    zone_error: NDArray[np.float64]
    pair_x: NDArray[np.float64]
    pair_energy: NDArray[np.float64]
    x: NDArray[np.float64]
    u: NDArray[np.float64]
    u_low: NDArray[np.float64]
    u_high: NDArray[np.float64]
    k: NDArray[np.float64]
    k_low: NDArray[np.float64]
    k_high: NDArray[np.float64]
    left_out: tuple[ZoneLeftOut, ...]


def half_cycles(motion: Motion) -> HalfCycles:
    """Zero crossings and extremes of a motion."""
    room = motion.x.size
    crossing, velocity, extreme = np.empty(room), np.empty(room), np.empty(room)
    count = kernel.half_cycles(motion.x, motion.v, crossing, velocity, extreme)
    return HalfCycles(crossing[: count + 1] / motion.rate_hz, velocity[: count + 1].copy(), extreme[:count].copy())


def estimate_stiffness(cycles: HalfCycles, replicates: int, seed: int) -> Stiffness:
    """Fit U(x) to the pairs of all half cycles.

    Parameters
    ----------
    cycles : HalfCycles
        At least a few hundred.
    replicates, seed : int
        Of the block bootstrap.

    Raises
    ------
    InputError
        If no zone holds enough pairs.
    """
    length = float(np.max(np.abs(cycles.extreme)))
    kinetic = 0.5 * np.concatenate([cycles.crossing_velocity[:-1], cycles.crossing_velocity[1:]]) ** 2
    extreme = np.tile(cycles.extreme, 2) / length
    unit = float(np.mean(kinetic))
    kinetic /= unit
    powers = extreme[:, None] ** np.arange(1, POWERS + 1)
    half_cycle = np.arange(cycles.extreme.size)
    count = int(np.clip(half_cycle.size // PER_BLOCK, *BLOCKS))
    block = np.tile(half_cycle * count // half_cycle.size, 2)
    coefficients = np.zeros(POWERS)
    coefficients[1] = float(np.sum(kinetic * powers[:, 1]) / np.sum(powers[:, 1] ** 2))  # the linear start
    model: tuple[int, ...] = MODELS[0]
    for iteration in range(ITERATIONS):
        table = _ZoneTable(kinetic, powers, coefficients, block)
        if iteration < ITERATIONS // 2:  # the model is chosen once the zones are roughly right, then kept
            model = table.best_model()
        coefficients = table.fit(model)
    spread = table.bootstrap(model, blocks.weights(count, replicates, seed))
    return _assemble(table, model, coefficients, spread, length, unit)


class _ZoneTable:
    """Sums of the pairs by block and zone, in scaled units; the zones are cut by the current U."""

    def __init__(
        self,
        kinetic: NDArray[np.float64],
        powers: NDArray[np.float64],
        coefficients: NDArray[np.float64],
        block: NDArray[np.int64],
    ) -> None:
        difference = kinetic - powers @ coefficients
        level = np.sqrt(np.maximum(0.5 * (2.0 * kinetic - difference), 0.0))  # amplitude of the pair's mean energy
        top = float(np.max(level)) * (1.0 + 1e-12)
        zone = (level / top * ZONES).astype(np.int64) + ZONES * (powers[:, 0] > 0.0)
        self.zones = 2 * ZONES
        self.blocks = int(block.max()) + 1
        cell = block * self.zones + zone
        shape = (self.blocks, self.zones)
        columns = [np.ones_like(kinetic), kinetic, difference**2, *powers.T]
        sums = [np.bincount(cell, column, self.blocks * self.zones).reshape(shape) for column in columns]
        self.sums = np.stack(sums, axis=2)
        total = self.sums.sum(axis=0)
        self.counts = total[:, 0]
        filled = np.maximum(self.counts, 1.0)
        self.energy = total[:, 1] / filled
        self.powers = total[:, 3:] / filled[:, None]
        self.sd = np.sqrt(total[:, 2] / filled)
        self.scattered = self.sd > WIDEST_SCATTER * self.energy
        self.used = (self.counts >= FEWEST) & ~self.scattered
        self.error = self.sd / np.sqrt(filled)
        self.pairs = (powers[:, 0], kinetic)

    def fit(self, model: tuple[int, ...]) -> NDArray[np.float64]:
        """Coefficients of all powers, weighted least squares over the zones used."""
        columns = np.array(model) - 1
        design = self.powers[self.used][:, columns] / self.error[self.used, None]
        solution = np.linalg.lstsq(design, self.energy[self.used] / self.error[self.used], rcond=None)[0]
        coefficients = np.zeros(POWERS)
        coefficients[columns] = solution
        return coefficients

    def _is_well(self, coefficients: NDArray[np.float64]) -> bool:
        """Whether the force points back to the middle at all displacements of the zones used."""
        x = np.linspace(*self.reach(), 101)
        force = polynomial.polyval(x, coefficients * np.arange(1, POWERS + 1))
        turns = np.flatnonzero(np.diff(np.sign(force)))
        return turns.size == 1 and bool(force[-1] > 0.0)

    def reach(self) -> tuple[float, float]:
        """Mean displacements of the outermost zones used."""
        x = self.powers[self.used, 0]
        return float(x.min()), float(x.max())

    def best_model(self) -> tuple[int, ...]:
        """Powers with the lowest BIC among those that the zones can carry."""
        zones = int(np.sum(self.used))
        if zones == 0:
            raise InputError(
                "no zone of energy holds enough half cycles to fit a potential",
                got=int(self.counts.sum()) // 2,
                allowed=f"at least {FEWEST} pairs of zero crossing and extreme with the same energy",
                remedy="Give a longer recording, or the band of the mode.",
            )
        possible = [model for model in MODELS if len(model) < zones and self._is_well(self.fit(model))] or [LINEAR]

        def score(model: tuple[int, ...]) -> float:
            misfit = (self.energy - self.powers @ self.fit(model))[self.used] / self.error[self.used]
            return float(np.sum(misfit**2)) + len(model) * float(np.log(np.sum(self.counts[self.used])))

        return min(possible, key=score)

    def bootstrap(self, model: tuple[int, ...], draws: NDArray[np.float64]) -> NDArray[np.float64]:
        """Coefficients refitted to every row of block weights, shape (replicates, powers)."""
        sums = np.tensordot(draws, self.sums[:, self.used], axes=1)
        filled = np.maximum(sums[:, :, :1], 1.0)
        columns = np.array(model) - 1
        weight = sums[:, :, 0] / self.sd[self.used] ** 2
        design = sums[:, :, 3:][:, :, columns] / filled
        normal = np.einsum("rz,rzi,rzj->rij", weight, design, design)
        right = np.einsum("rz,rzi,rz->ri", weight, design, sums[:, :, 1] / filled[:, :, 0])
        coefficients = np.zeros((draws.shape[0], POWERS))
        coefficients[:, columns] = np.linalg.solve(normal, right[:, :, None])[:, :, 0]
        return coefficients


def _assemble(
    table: _ZoneTable,
    model: tuple[int, ...],
    coefficients: NDArray[np.float64],
    spread: NDArray[np.float64],
    length: float,
    unit: float,
) -> Stiffness:
    """Undo the scaling and read off curves and intervals."""
    scale = unit / length ** np.arange(POWERS + 1)
    best = np.concatenate([[0.0], coefficients]) * scale
    left, right = table.reach()
    potential = Potential(best, (left * length, right * length))
    centre = potential.equilibrium()
    best[0] = -float(potential.energy(np.array(centre)))
    grid = np.linspace(*potential.reach, 101)
    factor = blocks.interval_factor(table.blocks)
    replicates = np.concatenate([np.zeros((spread.shape[0], 1)), spread], axis=1) * scale
    centres = centre - _rows(replicates, 1, centre) / _rows(replicates, 2, centre)  # one Newton step from the estimate
    u, k = potential.energy(grid), potential.stiffness(grid)
    u_wide = factor * np.std(_rows(replicates, 0, grid) - _rows(replicates, 0, centres), axis=0)
    k_wide = factor * np.std(_rows(replicates, 2, grid), axis=0)
    k1 = float(potential.stiffness(np.array(centre)))
    k3 = float(_rows(best[None], 4, centre)[0, 0]) / 6.0
    k1_wide = factor * float(np.std(_rows(replicates, 2, centres)))
    k3_wide = factor * float(np.std(_rows(replicates, 4, centres))) / 6.0
    thinned = slice(None, None, max(1, table.pairs[0].size // 4000))
    return Stiffness(
        potential=potential,
        k1=k1,
        k3=k3,
        k1_ci95=(k1 - k1_wide, k1 + k1_wide),
        k3_ci95=(k3 - k3_wide, k3 + k3_wide),
        powers=model,
        zone_x=table.powers[table.used, 0] * length,
        zone_energy=table.energy[table.used] * unit,
        zone_error=table.error[table.used] * unit,
        pair_x=table.pairs[0][thinned] * length,
        pair_energy=table.pairs[1][thinned] * unit,
        x=grid,
        u=u,
        u_low=u - u_wide,
        u_high=u + u_wide,
        k=k,
        k_low=k - k_wide,
        k_high=k + k_wide,
        left_out=tuple(
            ZoneLeftOut(
                float(table.energy[z] * unit),
                int(table.counts[z]),
                "energy changes too much within a quarter period" if table.scattered[z] else "too few half cycles",
            )
            for z in np.flatnonzero(~table.used & (table.counts > 0))
        ),
    )


def _rows(coefficients: NDArray[np.float64], order: int, x: float | NDArray[np.float64]) -> NDArray[np.float64]:
    """Derivative of `order` of the polynomial in each row, at x of shape (n,) for all rows or (rows, 1), one each."""
    derivative = polynomial.polyder(coefficients.T, order).T
    powers = np.atleast_1d(x)[..., None] ** np.arange(derivative.shape[1])
    return np.asarray(np.sum(derivative[:, None, :] * powers, axis=2))
