"""Damping of one mode: potential from the density, equivalent damping from covariances, S0 from both (paper, 3.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.energy import blocks, damping_potential, equivalent_damping, excitation
from chatter_monitor.energy.band import Band
from chatter_monitor.energy.damping_potential import DensityFits, Powers, Shells
from chatter_monitor.energy.kinematics import Motion
from chatter_monitor.energy.potential import Potential
from chatter_monitor.energy.stiffness import ZoneLeftOut
from chatter_monitor.errors import InputError

ROUNDS = 3  # of correcting h_eq by what the model shows; the second changes it by less than a standard error
POINTS = 160  # of the curves
RARE = 0.02  # share of the samples below the lowest energy of the curves, if no zone lies there
COARSE = 8  # shells of the likelihood joined to one point of the damping potential


@dataclass(frozen=True, slots=True, eq=False)
class Damping:
    """Identified damping and excitation, per unit mass. Energies in (unit/s)^2, h in 1/s.

    Attributes
    ----------
    energy : ndarray
        Energies of the curves: from the lowest 2 % of the samples to the highest zone used.
    potential, potential_low, potential_high : ndarray
        H(E) / (pi S0), eq. (13), with pointwise 95 % band of its rise from the lowest point.
    shell_energy, shell_potential : ndarray
        -ln(p / C) of single shells, before any fit.
    powers : tuple of int
        The j of h(E) = sum b_j E^(j/2) with the best BIC: -1 dry friction, 0 viscous, 1 v abs(v), 2 x^2 v.
    h, h_low, h_high : ndarray
        h_eq(E) fitted to the zones, eq. (14), with pointwise 95 % band; model choice included.
    h_from_density : ndarray
        S0 times the slope of the damping potential: the other way to h(E).
    zone_energy, zone_h, zone_h_error : ndarray
        h_eq of each zone, corrected, with its standard error.
    lag_s, covariance : ndarray, shapes (lags,) and (zones, lags)
        R(tau | E) of the velocity for each zone used, over two periods.
    s0, s0_ci95 : float and (float, float)
        Intensity of the white force per unit mass, E[W W] = 2 pi S0 delta, eq. (5).
    damping_ratio, damping_ratio_ci95 : float and (float, float)
        Energy-weighted mean of h / (2 w0): the linear mode that dissipates as much.
    mean_energy : float
        Mean of E.
    independent_samples : float
        What the record is worth in independent samples of the energy.
    disagreement : float
        Mean square of (h_eq - h_from_density) over the zones, in their own bootstrap variance; about 1 if the motion
        is one mode in white noise.
    band_corrected : bool
        False if no damping of one mode explains the decay seen through the band's filter; h is then as measured.
    left_out : tuple of ZoneLeftOut
        Zones that take no part.
    """

    energy: NDArray[np.float64]
    potential: NDArray[np.float64]
    potential_low: NDArray[np.float64]
    potential_high: NDArray[np.float64]
    shell_energy: NDArray[np.float64]
    shell_potential: NDArray[np.float64]
    powers: tuple[int, ...]
    h: NDArray[np.float64]
    h_low: NDArray[np.float64]
    h_high: NDArray[np.float64]
    h_from_density: NDArray[np.float64]
    zone_energy: NDArray[np.float64]
    zone_h: NDArray[np.float64]
    zone_h_error: NDArray[np.float64]
    lag_s: NDArray[np.float64]
    covariance: NDArray[np.float64]
    s0: float
    s0_ci95: tuple[float, float]
    damping_ratio: float
    damping_ratio_ci95: tuple[float, float]
    mean_energy: float
    independent_samples: float
    disagreement: float
    band_corrected: bool
    left_out: tuple[ZoneLeftOut, ...]


def estimate_damping(
    motion: Motion, potential: Potential, band: Band, draws: NDArray[np.float64]
) -> tuple[Damping, excitation.Excitation]:
    """Damping and excitation of a motion in a known potential.

    Parameters
    ----------
    draws : ndarray, shape (replicates, blocks)
        Block weights of the bootstrap.

    Raises
    ------
    InputError
        If the motion is at one amplitude all the time, or no zone of energy holds enough independent segments.
    """
    count = draws.shape[1]
    rows = np.vstack([np.ones(count), draws])
    energy = 0.5 * motion.v**2 + potential.energy(motion.x)  # eq. (8)
    top = float(np.min(potential.energy(np.array(potential.reach))))
    outside = (motion.x < potential.reach[0]) | (motion.x > potential.reach[1])
    energy[outside] = np.maximum(energy[outside], top)  # a polynomial says nothing out there
    block = np.arange(motion.x.size) * count // motion.x.size
    shells = damping_potential.count_shells(energy, block, potential, top)
    if np.count_nonzero(shells.counts.any(axis=0)) < 2:
        raise InputError(
            "the vibration has one amplitude all the time, which shows nothing of its damping",
            remedy="Record one that noise drives.",
        )
    fits = damping_potential.fit_all(shells, rows)
    worth = shells.independent()
    covariance = equivalent_damping.covariances(motion, energy, count, potential, band, top, worth)
    zones = np.flatnonzero(covariance.used)
    if zones.size < 1:
        raise InputError(
            "no zone of energy holds enough independent segments for a damping",
            got=f"a record worth {worth:.1f} independent samples",
            allowed=f"at least {equivalent_damping.FEWEST:g} in a zone",
            remedy="Give a longer recording.",
        )
    level = covariance.energy[zones]
    measured = covariance.measured(rows)
    chosen = fits.chosen if zones.size >= 3 else np.zeros_like(fits.chosen)
    slope_at_zones = _by_model(fits, chosen, level)
    weight = covariance.weight(rows)
    powers = damping_potential.MODELS[chosen[0]]
    unit = shells.mean_energy()
    mean_h = np.sum(np.where(weight > 0.0, weight * measured, 0.0), axis=1) / np.sum(weight, axis=1)
    in_band = equivalent_damping.band_shift(float(mean_h[0]), band, covariance.lags_s())
    corrected = measured + (in_band or 0.0)
    d = excitation.strength(corrected, slope_at_zones, weight)
    for _ in range(ROUNDS):
        curve = equivalent_damping.fit(corrected[:1], weight[:1], powers, level, unit)
        shift = equivalent_damping.diffusion_shift(curve, potential, covariance, float(d[0]), top)
        corrected = measured + (in_band or 0.0) + shift
        d = excitation.strength(corrected, slope_at_zones, weight)
    lowest = min(float(level[0]), float(np.quantile(energy, RARE)))
    grid = np.linspace(np.sqrt(lowest), np.sqrt(level[-1]), POINTS) ** 2
    h = np.empty((rows.shape[0], POINTS))
    for model in np.unique(chosen):
        picked = chosen == model
        powers_drawn = damping_potential.MODELS[model]
        fitted = equivalent_damping.fit(corrected[picked], weight[picked], powers_drawn, level, unit)
        h[picked] = fitted.value(grid)
    well = _by_model(fits, chosen, grid, integral=True)
    factor = blocks.interval_factor(count)
    bottom = int(np.argmin(well[0]))  # where the potential is known best: its zero at E = 0 may be far from any sample
    from_bottom = well - well[:, bottom : bottom + 1]
    wide = {name: factor * np.std(sample[1:], axis=0) for name, sample in (("h", h), ("well", from_bottom), ("d", d))}
    mean_energy = float(np.mean(energy))
    frequency = 2.0 * np.pi / float(potential.period(np.array([mean_energy]))[0])
    lost = np.sum(np.where(weight > 0.0, weight * corrected, 0.0), axis=1)
    ratio = lost / np.sum(weight, axis=1) / (2.0 * frequency)
    ratio_wide = factor * float(np.std(ratio[1:]))
    difference = corrected - d[:, None] * slope_at_zones
    shell_energy, shell_potential = _points(shells, fits, int(chosen[0]))
    result = Damping(
        energy=grid,
        potential=well[0],
        potential_low=well[0] - wide["well"],
        potential_high=well[0] + wide["well"],
        shell_energy=shell_energy,
        shell_potential=shell_potential,
        powers=powers,
        h=h[0],
        h_low=h[0] - wide["h"],
        h_high=h[0] + wide["h"],
        h_from_density=d[0] * _by_model(fits, chosen, grid)[0],
        zone_energy=level,
        zone_h=corrected[0],
        zone_h_error=np.nanstd(corrected[1:], axis=0),
        lag_s=covariance.lag_s[: covariance.shown],
        covariance=covariance.velocity()[zones],
        s0=float(d[0]) / np.pi,
        s0_ci95=(float(d[0] - wide["d"]) / np.pi, float(d[0] + wide["d"]) / np.pi),
        damping_ratio=float(ratio[0]),
        damping_ratio_ci95=(float(ratio[0]) - ratio_wide, float(ratio[0]) + ratio_wide),
        mean_energy=mean_energy,
        independent_samples=worth,
        disagreement=float(np.mean(difference[0] ** 2 / np.nanvar(difference[1:], axis=0))),
        band_corrected=in_band is not None,
        left_out=covariance.left_out,
    )
    return result, excitation.excitation_kind(fits, top)


def _by_model(
    fits: DensityFits, chosen: NDArray[np.int64], energy: NDArray[np.float64], integral: bool = False
) -> NDArray[np.float64]:
    """Slope of the damping potential (or the potential itself) of each row's own model, shape (rows, energies)."""
    values = np.empty((chosen.size, energy.size))
    for model in np.unique(chosen):
        picked = chosen == model
        slope = fits.slopes[model]
        curve = Powers(slope.powers, slope.coefficients[picked], slope.unit)
        values[picked] = curve.integral(energy) if integral else curve.value(energy)
    return values


def _points(shells: Shells, fits: DensityFits, model: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """-ln(p / C) of joined shells, eq. (13); C is the one of the fit, so that points and curve share their zero."""
    counts = shells.counts.sum(axis=0).reshape(-1, COARSE).sum(axis=1)
    area = shells.area.reshape(-1, COARSE).sum(axis=1)
    energy = shells.centre.reshape(-1, COARSE).mean(axis=1)
    slope = fits.slopes[model]
    well = Powers(slope.powers, slope.coefficients[0], slope.unit).integral(shells.centre)
    log_c = -float(np.logaddexp.reduce(np.log(shells.area) - well))
    filled = counts > 0
    density = counts[filled] / (np.sum(counts) * area[filled])
    return energy[filled], log_c - np.log(density)
