"""Figures 7 to 9: damping potential, conditional covariances and equivalent damping of known oscillators."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.energy import identify
from chatter_monitor.energy.identification import Identification
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Excitation, Mode
from chatter_monitor.physics.simulate import simulate
from chatter_monitor.physics.terms import CATALOGUE
from docs.paper.drawing import (
    DOTS,
    ENERGY,
    LINEAR,
    MM2,
    TARGET,
    covariance_curves,
    cubic_fit,
    damping_zones,
    interval,
    legend,
    new_figure,
)
from docs.paper.plate import Plate, Plates

MODE = Mode(400.0, 0.01)
VISCOUS = 2.0 * MODE.damping_ratio * MODE.omega  # h of the linear system, 1/s
INTENSITY = VISCOUS * MODE.omega**2 / np.pi  # 1 um rms
RESIDUAL = Mode(400.0, 0.001)
FRICTION = 0.6 * VISCOUS * MODE.omega  # um/s^2
DURATION_S = 60.0


def plates() -> Plates:
    """A linear system, and one with dry friction."""
    linear = _identified(MachiningSystem((MODE,), excitation=Excitation(intensity=INTENSITY)), seed=7)
    friction = AppliedTerm(CATALOGUE["coulomb_friction"], {"coefficient": FRICTION})
    dry = MachiningSystem((RESIDUAL,), (friction,), Excitation(intensity=INTENSITY))
    yield _linear_potential(linear)
    yield _dry_potential(_identified(dry, seed=8))
    yield _covariance(linear)
    yield _equivalent(linear)


def _identified(system: MachiningSystem, seed: int) -> Identification:
    simulation = simulate(system, DURATION_S, seed, settle_s=1.0)
    return identify(simulation.signal, simulation.sample_rate_hz)


def _dry_target(energy: NDArray[np.float64]) -> NDArray[np.float64]:
    """H(E) of Coulomb friction F sgn(v), h = F <|v|> / <v^2> over a harmonic orbit, with the residual damping."""
    return FRICTION * 4.0 * np.sqrt(2.0 * energy) / np.pi + 2.0 * RESIDUAL.damping_ratio * RESIDUAL.omega * energy


def _linear_potential(result: Identification) -> Plate:
    d = result.damping
    truth = VISCOUS / (np.pi * INTENSITY)
    slope = float(np.polyfit(d.energy, d.potential, 1)[0])
    figure, axes = new_figure()
    axes.plot(MM2 * d.shell_energy, d.shell_potential, "o", ms=4, color=DOTS, label="-ln(p/C), shells of equal energy")
    interval(axes, MM2 * d.energy, d.potential, d.potential_low, d.potential_high, "linear fit, 95 % band")
    axes.plot(MM2 * d.energy, truth * d.energy, "--", color=TARGET, label="target")
    axes.set(xlabel=ENERGY, ylabel="H(E) / (π S₀)", title="Damping potential of a linear system, 1 % damping")
    legend(axes, loc="upper left")
    return Plate(
        "07a",
        "Damping potential, linear system",
        figure,
        "For a linear system the damping potential over S₀ is a straight line; its slope gives h/(π S₀).",
        f"The straight line is what the fit chooses of its own accord (powers of E in h: {_powers(result)}); its slope "
        f"is {100 * (slope / truth - 1.0):+.1f} % off the target.",
        {"slope_error": slope / truth - 1.0},
    )


def _dry_potential(result: Identification) -> Plate:
    d = result.damping
    inside = d.shell_energy <= d.energy[-1]
    level, measured = d.shell_energy[inside], d.shell_potential[inside]
    truth = _dry_target(level) / (np.pi * INTENSITY)
    cubic = cubic_fit(d)
    # the zero of a measured potential lies where there are no samples: compare from the lowest shell on
    rise = float(np.sqrt(np.mean((measured - measured[0] - truth + truth[0]) ** 2)) / np.ptp(truth))
    figure, axes = new_figure()
    axes.plot(MM2 * level, measured, "o", ms=4, color=DOTS, label="-ln(p/C), shells of equal energy")
    axes.plot(MM2 * d.energy, cubic(d.energy), color=LINEAR, lw=1.8, label="cubic polynomial, as in the paper")
    interval(axes, MM2 * d.energy, d.potential, d.potential_low, d.potential_high, "fit with √E, 95 % band")
    axes.plot(MM2 * d.energy, _dry_target(d.energy) / (np.pi * INTENSITY), "--", color=TARGET, label="target")
    axes.set(xlabel=ENERGY, ylabel="H(E) / (π S₀)", title="Damping potential, dry friction: steep at rest")
    legend(axes, loc="lower right")
    residual = 2.0 * RESIDUAL.damping_ratio * RESIDUAL.omega
    truth_h = FRICTION * 2.0 * np.sqrt(2.0 / d.mean_energy) / np.pi + residual  # eq. (12)
    off = float(np.interp(d.mean_energy, d.energy, d.h) / truth_h - 1.0)
    misfit = float(np.sqrt(np.mean((cubic(level) - measured) ** 2)) / np.ptp(measured))
    return Plate(
        "07b",
        "Damping potential, dry friction",
        figure,
        "With dry friction the damping potential is curved, and a cubic polynomial is fitted to it.",
        f"Apart from its zero, which no sample tells, the shells follow the target within {100 * rise:.1f} % of its "
        f"rise; h_eq at the mean energy is {100 * off:+.1f} % off. The cubic polynomial leaves "
        f"{100 * misfit:.1f} % rms, most of it near E = 0, where dry friction rises as √E and no polynomial in E does; "
        f"the package's own fit (powers of E in h: {_powers(result)}) has that term.",
        {"shape_error": rise, "h_error": off, "cubic_misfit": misfit},
    )


def _covariance(result: Identification) -> Plate:
    d = result.damping
    figure, axes = new_figure()
    zones = covariance_curves(axes, d, MM2)
    half = int(np.argmin(d.covariance[zones[-1]][: d.lag_s.size // 2]))
    for lag, name in ((0, "X₁"), (half, "X₂")):
        axes.annotate(
            name,
            (1e3 * d.lag_s[lag], MM2 * d.covariance[zones[-1], lag]),
            xytext=(8, -2),
            textcoords="offset points",
            weight="bold",
        )
        axes.plot(1e3 * d.lag_s[lag] * np.ones(len(zones)), MM2 * d.covariance[zones, lag], ".", color=DOTS, ms=6)
    axes.set_title("Conditional covariance, linear: one period at all energies")
    legend(axes, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    minima = d.lag_s[np.argmin(d.covariance[:, : d.lag_s.size // 2], axis=1)]
    period = 2.0 * float(np.mean(minima))
    # extremes fall on the grid of the lags; zero crossings tell the period finer, once the energy outlasts a period
    crossing = result.period.zone_period_s[result.period.zone_energy > 0.5 * d.mean_energy]
    spread = float(np.ptp(crossing) / np.mean(crossing))
    return Plate(
        "08",
        "Conditional covariance at several energies, linear system",
        figure,
        "Covariance of the velocity, given the energy at the start: larger at higher energy, the same period at all.",
        f"All {d.zone_energy.size} zones swing with one period, {1e3 * period:.2f} ms (2.50 ms simulated); the periods "
        f"between zero crossings differ by {100 * spread:.2f} % among the zones above half of the mean energy.",
        {"period_ms": 1e3 * period, "period_spread": spread},
    )


def _equivalent(result: Identification) -> Plate:
    d = result.damping
    figure, axes = new_figure()
    damping_zones(axes, d, MM2)
    axes.axhline(VISCOUS, ls="--", color=TARGET, label="target, constant")
    axes.plot(MM2 * d.energy, d.h_from_density, "-.", color=LINEAR, label="S₀ times slope of the damping potential")
    axes.set(ylim=(0.0, 2.0 * VISCOUS), title="Equivalent damping of a linear system does not depend on the energy")
    legend(axes, loc="upper left")
    mean = float(np.mean(d.h))
    best, bottom, top = (100.0 * error / VISCOUS for error in (d.zone_h_error.min(), *d.zone_h_error[[0, -1]]))
    return Plate(
        "09",
        "Equivalent damping against energy, linear system",
        figure,
        "The equivalent damping of eq. (14) is constant for a linear system; dots deviate more at higher energy.",
        f"The fit is {100 * (mean / VISCOUS - 1.0):+.1f} % off the target of {VISCOUS:.1f} 1/s. The standard error of "
        f"a zone is {best:.0f} % of h at best and grows to {top:.0f} % at the highest energy, the deviation that the "
        f"paper mentions, and to {bottom:.0f} % at the lowest, where the energy does not outlast a period. With the "
        f"damping potential it gives S₀ within {100 * (d.s0 / INTENSITY - 1.0):+.1f} % of what was simulated.",
        {"h_error": mean / VISCOUS - 1.0, "s0_error": d.s0 / INTENSITY - 1.0},
    )


def _powers(result: Identification) -> str:
    return ", ".join(f"{power / 2:g}" for power in result.damping.powers)
