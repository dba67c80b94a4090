"""Figures of an identification, in the manner of the paper's figures 4-9 and 14-18."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.energy.identification import Identification

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MEASURED, FITTED, REFERENCE = "#7a9cc6", "#b0303a", "#3f7d4e"
CURVES = 6  # conditional covariances drawn


def save_all(result: Identification, directory: Path) -> list[Path]:
    """Write every figure as PNG into `directory`, which is made if need be.

    Returns
    -------
    list of Path
        The files, the summary last.
    """
    directory.mkdir(parents=True, exist_ok=True)
    panels = {
        "potential": draw_potential,
        "stiffness": draw_stiffness,
        "damping_potential": draw_damping_potential,
        "conditional_covariance": draw_covariance,
        "equivalent_damping": draw_equivalent_damping,
        "natural_period": draw_period,
    }
    files = []
    for name, draw in panels.items():
        figure = _figure(7.0, 4.6)
        draw(figure.subplots(), result)
        files.append(_save(figure, directory / f"{name}.png"))
    figure = _figure(15.0, 9.0)
    for axes, draw in zip(figure.subplots(2, 3).flat, panels.values(), strict=True):
        draw(axes, result)
    figure.suptitle(_headline(result))
    files.append(_save(figure, directory / "summary.png"))
    return files


def draw_potential(axes: Axes, result: Identification) -> None:
    """U(x): pairs, zones, fit with its band, and the linear reference (figures 4-6, 14, 15)."""
    s = result.stiffness
    axes.plot(s.pair_x, s.pair_energy, ".", color=MEASURED, markersize=1.5, alpha=0.4, label="pairs (x, v²/2)")
    axes.plot(s.x, 0.5 * s.k1 * (s.x - s.potential.equilibrium()) ** 2, "--", color=REFERENCE, label="linear, k₁x²/2")
    _band(axes, s.x, s.u, s.u_low, s.u_high, "U(x), 95 % band")
    axes.errorbar(s.zone_x, s.zone_energy, 1.96 * s.zone_error, fmt="k.", markersize=5, label="zones of equal energy")
    axes.set(xlabel="x", ylabel="U(x), per unit mass", title="Potential")
    axes.legend(fontsize="small")


def draw_stiffness(axes: Axes, result: Identification) -> None:
    """Tangent stiffness k(x) with its band."""
    s = result.stiffness
    _band(axes, s.x, s.k, s.k_low, s.k_high, "k(x), 95 % band")
    axes.axhline(s.k1, ls="--", color=REFERENCE, label="k₁")
    axes.set(xlabel="x", ylabel="k(x), 1/s²", title="Stiffness")
    axes.legend(fontsize="small")


def draw_damping_potential(axes: Axes, result: Identification) -> None:
    """Damping potential from single shells and its fit, eq. (13) (figures 7, 16)."""
    d = result.damping
    axes.plot(d.shell_energy / d.mean_energy, d.shell_potential, ".", color=MEASURED, label="-ln(p/C) of shells")
    _band(axes, d.energy / d.mean_energy, d.potential, d.potential_low, d.potential_high, "fit, 95 % band")
    axes.set(xlabel="E / mean E", ylabel="H(E) / (π S₀)", title=f"Damping potential: {result.excitation.kind}")
    axes.legend(fontsize="small")


def draw_covariance(axes: Axes, result: Identification) -> None:
    """Conditional covariance of the velocity at several energies, eq. (15) (figures 8, 17)."""
    d = result.damping
    for zone in np.unique(np.linspace(0, d.zone_energy.size - 1, CURVES).astype(np.int64)):
        label = f"E = {d.zone_energy[zone] / d.mean_energy:.2g} mean E"
        axes.plot(d.lag_s * 1e3, d.covariance[zone], lw=1.0, label=label)
    axes.set(xlabel="lag, ms", ylabel="R(τ | E) of the velocity", title="Conditional covariance")
    axes.legend(fontsize="small")


def draw_equivalent_damping(axes: Axes, result: Identification) -> None:
    """Equivalent damping of the zones, its fit, and what the density says, eq. (14) (figures 9, 18)."""
    d = result.damping
    level = d.zone_energy / d.mean_energy
    axes.errorbar(level, d.zone_h, 1.96 * d.zone_h_error, fmt="k.", label="zones, 95 %")
    _band(axes, d.energy / d.mean_energy, d.h, d.h_low, d.h_high, "fit, 95 % band")
    axes.plot(d.energy / d.mean_energy, d.h_from_density, ":", color=REFERENCE, label="from the damping potential")
    axes.axhline(0.0, color="0.5", lw=0.8)
    reach = np.concatenate([d.h, d.zone_h[np.isfinite(d.zone_h)], [0.0]])
    margin = 0.3 * float(np.ptp(reach))
    axes.set_ylim(float(reach.min()) - margin, float(reach.max()) + margin)
    axes.set(xlabel="E / mean E", ylabel="h(E), 1/s", title="Equivalent damping")
    axes.legend(fontsize="small")


def draw_period(axes: Axes, result: Identification) -> None:
    """Natural period from the potential and from the zero crossings."""
    p, mean = result.period, result.damping.mean_energy
    axes.errorbar(
        p.zone_energy / mean, p.zone_period_s * 1e3, 1.96e3 * p.zone_error_s, fmt="k.", label="crossings, 95 %"
    )
    axes.plot(p.energy / mean, p.period_s * 1e3, color=FITTED, label="from U(x)")
    axes.set(xlabel="E / mean E", ylabel="T(E), ms", title="Natural period")
    axes.legend(fontsize="small")


def _band(
    axes: Axes,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    label: str,
) -> None:
    axes.fill_between(x, low, high, color=FITTED, alpha=0.25, lw=0.0)
    axes.plot(x, y, color=FITTED, label=label)


def _headline(result: Identification) -> str:
    frequency = np.sqrt(result.stiffness.k1) / (2.0 * np.pi)
    low, high = (100.0 * ratio for ratio in result.damping.damping_ratio_ci95)
    return (
        f"{frequency:.1f} Hz, damping {100.0 * result.damping.damping_ratio:.3g} % ({low:.3g} to {high:.3g} %), "
        f"S₀ = {result.damping.s0:.3g}, {result.excitation.kind.replace('_', '-')} "
        f"({100.0 * result.excitation.confidence:.0f} %)"
    )


def _figure(width: float, height: float) -> Figure:
    """A figure of its own, without the global state of pyplot."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def _save(figure: Figure, path: Path) -> Path:
    figure.savefig(path, dpi=110)
    return path
