"""Figures 4 to 6: stiffness of the linear-cubic oscillator from zero crossings and extremes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.energy import identify
from chatter_monitor.energy.band import choose_band
from chatter_monitor.energy.identification import Identification
from chatter_monitor.energy.kinematics import motion
from chatter_monitor.energy.stiffness import ZONES, half_cycles
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Mode
from chatter_monitor.physics.simulate import Simulation, simulate
from chatter_monitor.physics.terms import CATALOGUE
from docs.paper.drawing import CLOUD, DOTS, FITTED, MM2, SHADE, TARGET, legend, new_figure, potential_cloud
from docs.paper.plate import Plate, Plates

MODE_HZ = 400.0
CUBIC = 0.1  # 1/um^2: the cubic force reaches a tenth of the linear one at 1 um
DURATION_S = 60.0
SHARE = 0.95  # of the samples, whose energies make the range over which U(x) is judged


@dataclass(frozen=True)
class Case:
    """A simulated linear-cubic oscillator and what was identified from its displacement (in um)."""

    ratio: float
    simulation: Simulation
    result: Identification

    @property
    def omega(self) -> float:
        """Natural angular frequency at small amplitude."""
        return self.simulation.system.modes[0].omega

    def target(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Potential that was simulated, eq. (9)."""
        return self.omega**2 * (0.5 * x**2 + 0.25 * CUBIC * x**4)

    def reach(self) -> float:
        """Displacement at the energy below which `SHARE` of the samples lie."""
        energy = 0.5 * self.simulation.velocity**2 + self.target(self.simulation.displacement)
        x = np.linspace(0.0, 8.0, 4000)
        return float(np.interp(np.quantile(energy, SHARE), self.target(x), x))

    def error(self) -> float:
        """Largest relative error of the identified U(x) on both sides within `reach`."""
        x = np.linspace(0.05, 1.0, 100) * self.reach()
        found = self.result.stiffness.potential
        return max(float(np.max(np.abs(found.energy(side * x) / self.target(x) - 1.0))) for side in (-1.0, 1.0))

    def scatter(self) -> float:
        """Standard deviation of v^2/2 - U(x) of the samples over their mean energy."""
        s = self.result.stiffness
        return float(np.std(s.pair_energy - self.target(s.pair_x)) / np.mean(s.pair_energy))


def case(ratio: float, seed: int) -> Case:
    """Simulate and identify at one damping ratio; without the cubic force the displacement would be 1 um rms."""
    cubic = AppliedTerm(CATALOGUE["cubic_stiffness"], {"coefficient": CUBIC})
    simulation = simulate(MachiningSystem((Mode(MODE_HZ, ratio),), (cubic,)), DURATION_S, seed, settle_s=2.0)
    return Case(ratio, simulation, identify(simulation.signal, simulation.sample_rate_hz))


def plates() -> Plates:
    """Clouds at 0.1 % and 1 % damping, and the zones of the second."""
    light, heavy = case(0.001, seed=4), case(0.01, seed=5)
    yield _cloud(
        "04",
        light,
        "Samples (½v², x²) of a linear-cubic system with 0.1 % damping lie on the target U(x), far from the "
        "equivalent linear system.",
        f"The samples scatter by {100 * light.scatter():.1f} % of the mean energy.",
    )
    yield _cloud(
        "05",
        heavy,
        "With 1 % damping the scatter about the target grows, because the energy changes more from one quarter period "
        "to the next.",
        f"The scatter grows from {100 * light.scatter():.1f} % to {100 * heavy.scatter():.1f} % of the mean energy.",
    )
    yield _zones(heavy)


def _cloud(name: str, shown: Case, paper: str, first: str) -> Plate:
    s = shown.result.stiffness
    figure, axes = new_figure()
    potential_cloud(axes, shown.result, shown.target, MM2)
    axes.set_title(f"Linear-cubic stiffness, {100 * shown.ratio:g} % damping: kinetic and potential energy")
    legend(axes, loc="upper left")
    k1, k3 = shown.omega**2, CUBIC * shown.omega**2
    low, high = (value / k3 for value in s.k3_ci95)
    here = (
        f"{first} The identified U(x) is within {100 * shown.error():.2f} % of the target up to the energy that holds "
        f"95 % of the samples. k₁ is {100 * (s.k1 / k1 - 1.0):+.2f} % off, k₃ {100 * (s.k3 / k3 - 1.0):+.1f} %; the "
        f"95 % interval of k₃ is {low:.3f} to {high:.3f} times the target."
    )
    numbers = {
        "potential_error": shown.error(),
        "scatter": shown.scatter(),
        "k1_error": s.k1 / k1 - 1.0,
        "k3_error": s.k3 / k3 - 1.0,
    }
    return Plate(name, f"U(x) of a linear-cubic system, {100 * shown.ratio:g} % damping", figure, paper, here, numbers)


def _zones(shown: Case) -> Plate:
    """Draw the zones of equal energy as the last iteration cuts them, with their means."""
    s, simulation = shown.result.stiffness, shown.simulation
    band = choose_band(simulation.signal, simulation.sample_rate_hz, "displacement")
    cycles = half_cycles(motion(simulation.signal, simulation.sample_rate_hz, "displacement", band))
    kinetic = 0.5 * np.concatenate([cycles.crossing_velocity[:-1], cycles.crossing_velocity[1:]]) ** 2
    extreme = np.tile(cycles.extreme, 2)
    amplitude = np.sqrt(0.5 * (kinetic + s.potential.energy(extreme)))
    zone = (amplitude / amplitude.max() * (ZONES - 1e-9)).astype(np.int64)
    figure, axes = new_figure()
    for parity, colour in ((0, CLOUD), (1, SHADE)):
        inside = np.flatnonzero(zone % 2 == parity)[::6]
        axes.plot(extreme[inside] ** 2, MM2 * kinetic[inside], ".", color=colour, ms=1.8, alpha=0.6)
    x = np.linspace(0.0, 1.25 * float(s.zone_x.max()), 300)
    for edge in 2.0 * (np.arange(1, ZONES + 1) / ZONES * amplitude.max()) ** 2:
        kinetic_edge = edge - s.potential.energy(x)
        axes.plot(x[kinetic_edge > 0.0] ** 2, MM2 * kinetic_edge[kinetic_edge > 0.0], color="0.7", lw=0.6)
    axes.plot(x**2, MM2 * shown.target(x), color=TARGET, lw=2.0, label="target U(x)")
    axes.plot(x**2, MM2 * s.potential.energy(x), ":", color=FITTED, lw=2.2, label="polynomial fit")
    axes.plot(s.zone_x**2, MM2 * s.zone_energy, "o", color=DOTS, ms=5, label="mean of a zone of equal energy")
    top = 1.15 * float(s.zone_x.max()) ** 2
    axes.set(
        xlim=(0.0, top),
        ylim=(0.0, MM2 * 1.3 * float(s.zone_energy.max())),
        xlabel="x², µm²",
        ylabel="v²/2 and U(x) per unit mass, (mm/s)²",
        title="Samples sorted into zones of equal energy, 1 % damping",
    )
    legend(axes, loc="upper left")
    off = MM2 * (s.zone_energy - shown.target(s.zone_x))
    common = np.abs(s.zone_x) <= shown.reach()
    rare = float(np.sqrt(np.mean(off[~common] ** 2)))
    usual = float(np.sqrt(np.mean(off[common] ** 2)))
    left_out = sum(left.samples for left in s.left_out)
    return Plate(
        "06",
        "Zones of equal energy",
        figure,
        "The plane is divided into zones of equal energy, first along the linear potential; the mean of each zone is "
        "an estimate of U(x), and it deviates more at high energy, where there are few samples.",
        f"{off.size} zone means deviate from the target by {usual:.2f} (mm/s)² rms where 95 % of the samples are and "
        f"by {rare:.2f} (mm/s)² beyond, up to a U(x) of {MM2 * s.zone_energy.max():.0f} (mm/s)². {len(s.left_out)} "
        f"zones with {100 * left_out / kinetic.size:.1f} % of the samples, at both ends, were left out. Zones are cut "
        "by the sum of both energies, v²/2 + U(x): cut by one of them alone, the mean of the other would be drawn "
        "towards the average energy.",
        {"zone_error": usual, "zone_error_rare": rare},
    )
