"""Colours, lines and marks that all figures share (Okabe and Ito's palette, safe for the colour-blind)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from chatter_monitor.energy.damping import Damping
from chatter_monitor.energy.identification import Identification

CLOUD, TARGET, LINEAR, FITTED, DOTS, SHADE = "#56B4E9", "#D55E00", "#009E73", "#0072B2", "#000000", "#E69F00"
DPI = 100
MM2 = 1e-6  # from (um/s)^2 to (mm/s)^2
ENERGY = "energy E per unit mass, (mm/s)²"


def new_figure(rows: int = 1, columns: int = 1, width: float = 7.2, height: float = 4.6, **options: Any) -> Any:
    """Return a figure outside of pyplot's global state, and its axes (one, or an array of them)."""
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, **options)
    for each in np.atleast_1d(axes).flat:
        each.grid(color="0.9", lw=0.6)
        each.set_axisbelow(True)
    return figure, axes


def legend(axes: Axes, **options: Any) -> None:
    """Draw a legend whose marks can be seen however small they are in the drawing."""
    drawn = axes.legend(fontsize="small", framealpha=0.9, **options)
    for line in drawn.get_lines():
        if line.get_linestyle() == "None":
            line.set_markersize(max(line.get_markersize(), 5.0))
            line.set_alpha(1.0)


def interval(axes: Axes, x: NDArray[Any], y: NDArray[Any], low: NDArray[Any], high: NDArray[Any], label: str) -> None:
    """Draw an estimate with its 95 % band."""
    axes.fill_between(x, low, high, color=FITTED, alpha=0.2, lw=0.0)
    axes.plot(x, y, color=FITTED, lw=1.8, label=label)


def energy_colours(count: int) -> list[Any]:
    """Colours from low to high energy."""
    return [colormaps["viridis"](share) for share in np.linspace(0.0, 0.92, count)]


def covariance_curves(axes: Axes, damping: Damping, unit: float, curves: int = 6) -> list[int]:
    """Draw R(tau | E) of the velocity at some energies, eq. (15); returns the zones drawn."""
    zones = np.unique(np.linspace(0, damping.zone_energy.size - 1, curves).astype(np.int64)).tolist()
    for zone, colour in zip(zones, energy_colours(len(zones)), strict=True):
        level = unit * damping.zone_energy[zone]
        label = f"E = {level:,.0f} (mm/s)²" if level >= 100.0 else f"E = {level:.3g} (mm/s)²"
        axes.plot(1e3 * damping.lag_s, unit * damping.covariance[zone], color=colour, lw=1.5, label=label)
    axes.axhline(0.0, color="0.6", lw=0.8)
    axes.set(xlabel="lag τ, ms", ylabel="R(τ | E) of the velocity, (mm/s)²")
    return zones


def damping_zones(axes: Axes, damping: Damping, unit: float) -> None:
    """Draw h_eq of the zones with their intervals, and the fit with its band, eq. (14)."""
    axes.errorbar(
        unit * damping.zone_energy,
        damping.zone_h,
        1.96 * damping.zone_h_error,
        fmt="o",
        ms=4,
        color=DOTS,
        elinewidth=0.9,
        label="zones of energy, 95 %",
    )
    interval(axes, unit * damping.energy, damping.h, damping.h_low, damping.h_high, "fit, 95 % band")
    axes.set(xlabel=ENERGY, ylabel="equivalent damping h_eq, 1/s")


def cubic_fit(damping: Damping) -> Polynomial:
    """Cubic polynomial through the damping potential of the shells where it is known well, as the paper fits it."""
    inside = (damping.shell_energy >= damping.energy[0]) & (damping.shell_energy <= damping.energy[-1])
    return Polynomial.fit(damping.shell_energy[inside], damping.shell_potential[inside], 3)


def potential_cloud(
    axes: Axes, result: Identification, energy: Callable[[NDArray[Any]], NDArray[Any]] | None, unit: float
) -> None:
    """Draw samples (v^2/2, x^2), zones, the identified U(x), the target if known and the equivalent linear line."""
    s = result.stiffness
    axes.plot(s.pair_x**2, unit * s.pair_energy, ".", color=CLOUD, ms=2.0, alpha=0.5, label="samples (x², v²/2)")
    top = 1.05 * float(s.zone_x.max())
    x = np.linspace(0.0, top, 200)
    axes.plot(x**2, unit * 0.5 * s.k1 * x**2, "--", color=LINEAR, lw=1.8, label="equivalent linear system")
    if energy is not None:
        axes.plot(x**2, unit * energy(x), color=TARGET, lw=2.4, label="target U(x)")
    inside = (s.x >= 0.0) & (s.x <= top)
    axes.plot(s.x[inside] ** 2, unit * s.u[inside], ":", color=DOTS, lw=1.8, label="identified U(x)")
    axes.set(xlim=(0.0, top**2), ylim=(0.0, None), xlabel="x², µm²", ylabel="v²/2 and U(x) per unit mass, (mm/s)²")
