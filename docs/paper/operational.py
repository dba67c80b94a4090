"""Figures 14 to 18: stiffness and damping of a turning cut, stable and near chatter."""

from __future__ import annotations

import numpy as np

from chatter_monitor.energy import identify
from chatter_monitor.energy.identification import Identification
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Excitation, Mode, Sensor, Spindle
from chatter_monitor.physics.simulate import simulate
from chatter_monitor.physics.stability import rightmost_root
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
    potential_cloud,
)
from docs.paper.plate import Plate, Plates

BAR = Mode(322.0, 0.016)
LIMIT = 2.0 * BAR.damping_ratio * (1.0 + BAR.damping_ratio)  # of the process stiffness, the same at any speed
CHIP_UM = 150.0
NOISE_UM = 30.0  # rms that the mode alone would have
SOFT, HARD = -20e-6, 4e-6  # 1/um^2: a joint loaded tangentially, and one loaded normally
STABLE_CUT, UNSTABLE_CUT = 0.5, 1.5  # process stiffness over `LIMIT`
GAIN = 1e-9  # Pa per um/s^2
DURATION_S = 60.0


def cut(strength: float, cubic: float, noise_um: float = NOISE_UM) -> MachiningSystem:
    """Turning with one mode, loss of contact and a joint, heard by a microphone; displacement in um."""
    intensity = 2.0 * BAR.damping_ratio * BAR.omega**3 * noise_um**2 / np.pi
    terms = [AppliedTerm(CATALOGUE["loss_of_contact"], {"coefficient": strength * LIMIT, "chip_thickness": CHIP_UM})]
    if cubic:
        terms.append(AppliedTerm(CATALOGUE["cubic_stiffness"], {"coefficient": cubic}))
    sensor = Sensor("pressure", gain=GAIN, noise_rms=5e-4)
    return MachiningSystem((BAR,), tuple(terms), Excitation(intensity=intensity), Spindle(1685.0), sensor)


def plates() -> Plates:
    """A stable cut with a softening joint and an unstable one with a hardening joint."""
    unstable = cut(UNSTABLE_CUT, HARD)
    near_chatter = _identified(unstable, seed=15)
    plain = _identified(cut(UNSTABLE_CUT, 0.0), seed=15)
    yield _stable(_identified(cut(STABLE_CUT, SOFT), seed=14))
    yield _hard(near_chatter, plain, float(rightmost_root(unstable).damping_ratio))
    yield _damping_potential(near_chatter, _cycle_energy(cut(UNSTABLE_CUT, HARD, noise_um=0.01)))
    yield _covariance(near_chatter)
    yield _equivalent(near_chatter)


def _identified(system: MachiningSystem, seed: int) -> Identification:
    """From the microphone's signal over its gain, which is the acceleration above 20 Hz."""
    simulation = simulate(system, DURATION_S, seed, settle_s=2.0)
    return identify(simulation.signal / GAIN, simulation.sample_rate_hz, "acceleration")


def _cycle_energy(quiet: MachiningSystem) -> float:
    """Energy of the limit cycle that the same cut settles at without noise to speak of."""
    simulation = simulate(quiet, 4.0, seed=16, settle_s=20.0)
    return float(0.5 * np.max(simulation.velocity**2))


def _largest(result: Identification) -> float:
    """Amplitude in um near the largest one measured."""
    return 0.95 * min(abs(end) for end in result.stiffness.potential.reach)


def _departure(result: Identification) -> float:
    """Identified U over that of the linear system with the same k1, less one, at the largest amplitude."""
    s = result.stiffness
    x = _largest(result)
    linear = 0.5 * s.k1 * x**2
    mean = 0.5 * (s.potential.energy(np.array(x)) + s.potential.energy(np.array(-x)))
    return float(mean / linear - 1.0)


def _cubic_share(result: Identification) -> tuple[float, float, float]:
    """Cubic coefficient k3 / k1 with its 95 % interval, 1/um^2."""
    s = result.stiffness
    return s.k3 / s.k1, s.k3_ci95[0] / s.k1, s.k3_ci95[1] / s.k1


def _stable(result: Identification) -> Plate:
    k3, low, high = _cubic_share(result)
    figure, axes = new_figure()
    potential_cloud(axes, result, None, MM2)
    axes.set_title("Stable cut: soft characteristic")
    legend(axes, loc="upper left")
    return Plate(
        "14",
        "Potential of a stable cut",
        figure,
        "U(x) of the stable process bends below the linear system at its natural frequency: a soft characteristic.",
        f"At {_largest(result):.0f} µm U(x) is {100 * _departure(result):+.1f} % off the linear one. The softening is "
        f"put in: a joint loaded tangentially (section 1.1.1), cubic_stiffness of {SOFT * 1e6:.0f} per mm²; found from "
        f"the microphone: {k3 * 1e6:.1f} ({low * 1e6:.1f} to {high * 1e6:.1f}).",
        {"departure": _departure(result), "k3_per_mm2": k3 * 1e6},
    )


def _hard(result: Identification, plain: Identification, damping_ratio: float) -> Plate:
    k3, low, high = _cubic_share(result)
    figure, axes = new_figure()
    potential_cloud(axes, result, None, MM2)
    axes.set_title("Cut entering chatter: hard characteristic")
    legend(axes, loc="upper left")
    return Plate(
        "15",
        "Potential of an unstable cut",
        figure,
        "U(x) of the system entering chatter bends above the linear one: a hard characteristic, which the paper calls "
        "characteristic of self-excited vibration.",
        f"At {_largest(result):.0f} µm U(x) is {100 * _departure(result):+.1f} % off the linear one; the linearised "
        f"cut has a damping ratio of {100 * damping_ratio:+.2f} %. **Not reproduced: the same machine turning from "
        "soft to hard.** The hardening is put in as well, as a joint loaded normally, cubic_stiffness of "
        f"{HARD * 1e6:+.0f} per mm², which alone gives {50 * HARD * _largest(result) ** 2:+.1f} % there; found "
        f"{k3 * 1e6:.1f} ({low * 1e6:.1f} to {high * 1e6:.1f}). The difference is not resolved: the regenerative force "
        "acts as a spring too, whose phase changes with the frequency and so with the energy. Regeneration and loss of "
        f"contact without the joint give {100 * _departure(plain):+.1f} %: self-excitation by itself does not harden "
        "this cut.",
        {"departure": _departure(result), "departure_without_joint": _departure(plain), "k3_per_mm2": k3 * 1e6},
    )


def _damping_potential(result: Identification, cycle: float) -> Plate:
    d = result.damping
    cubic = cubic_fit(d)
    lowest = result.excitation.cycle_energy
    figure, axes = new_figure()
    axes.plot(MM2 * d.shell_energy, d.shell_potential, "o", ms=4, color=DOTS, label="-ln(p/C), shells of equal energy")
    axes.plot(MM2 * d.energy, cubic(d.energy), color=LINEAR, lw=1.8, label="cubic polynomial, as in the paper")
    interval(axes, MM2 * d.energy, d.potential, d.potential_low, d.potential_high, "maximum likelihood, 95 % band")
    axes.axvline(MM2 * cycle, ls="--", color=TARGET, label="limit cycle without noise")
    axes.set(xlabel=ENERGY, ylabel="H(E) / (π S₀)", title="Unstable cut: damping potential, lowest away from rest")
    legend(axes, loc="upper right")
    inside = np.linspace(0.0, d.energy[-1], 400)
    of_cubic = float(inside[np.argmin(cubic(inside))])
    return Plate(
        "16",
        "Damping potential of an unstable cut",
        figure,
        "The damping potential of the unstable system is strongly nonlinear; a cubic polynomial is fitted.",
        f"It falls from E = 0 to its minimum at {MM2 * lowest:,.0f} (mm/s)², {lowest / d.mean_energy:.2f} times the "
        f"mean energy (cubic polynomial: {MM2 * of_cubic:,.0f}); without noise the same cut settles at "
        f"{MM2 * cycle:,.0f} (mm/s)². Verdict of the package: {result.excitation.kind.replace('_', '-')}, probability "
        f"{result.excitation.confidence:.2f}.",
        {
            "minimum_over_mean": lowest / d.mean_energy,
            "cubic_minimum_over_mean": of_cubic / d.mean_energy,
            "minimum_over_cycle": lowest / cycle,
        },
    )


def _covariance(result: Identification) -> Plate:
    d, period = result.damping, result.period
    figure, axes = new_figure()
    covariance_curves(axes, d, MM2)
    axes.set_title("Conditional covariance, unstable: higher energy, shorter period")
    legend(axes, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    change = float(period.period_s[-1] / period.period_s[0] - 1.0)
    measured = float(period.zone_period_s[-1] / period.zone_period_s[0] - 1.0)
    return Plate(
        "17",
        "Conditional covariance at several energies, unstable cut",
        figure,
        "As the stiffness is nonlinear, the natural period depends on the energy.",
        f"From rest to the highest energy the period of the identified U(x) changes by {100 * change:+.1f} %, from "
        f"{1e3 * period.period_s[0]:.2f} to {1e3 * period.period_s[-1]:.2f} ms; from the lowest to the highest "
        f"zone with enough zero crossings, by {100 * measured:+.1f} %.",
        {"period_change": change, "period_change_of_crossings": measured},
    )


def _equivalent(result: Identification) -> Plate:
    d, period = result.damping, result.period
    figure, (axes, below) = new_figure(2, 1, height=6.0, sharex=True, height_ratios=(3, 2))
    damping_zones(axes, d, MM2)
    axes.plot(MM2 * d.energy, d.h_from_density, "-.", color=LINEAR, label="S₀ times slope of the damping potential")
    axes.axhline(0.0, color="0.4", lw=0.9)
    steady = np.concatenate([d.zone_h[2:], d.h[d.energy > d.zone_energy[2]]])
    axes.set(
        ylim=(steady.min() - 25.0, steady.max() + 25.0),
        xlabel="",
        title="Unstable cut: negative damping at small, positive at large energy",
    )
    legend(axes, loc="lower right")
    below.errorbar(
        MM2 * period.zone_energy, 1e3 * period.zone_period_s, 1.96e3 * period.zone_error_s, fmt="o", ms=4, color=DOTS,
        elinewidth=0.9, label="between zero crossings, 95 %",
    )  # fmt: skip
    below.plot(MM2 * period.energy, 1e3 * period.period_s, color=TARGET, lw=1.8, label="from U(x)")
    below.set(xlabel=ENERGY, ylabel="natural period T(E), ms")
    legend(below, loc="upper right")
    crossing = float(np.interp(0.0, d.h, d.energy))
    return Plate(
        "18",
        "Equivalent damping of an unstable cut, with T(E)",
        figure,
        "Equivalent damping from eq. (14) with the period of each energy, fitted by a polynomial.",
        f"h_eq is negative at small energy and crosses zero at {MM2 * crossing:,.0f} (mm/s)²; the minimum of the "
        f"damping potential lies at {MM2 * result.excitation.cycle_energy:,.0f}. The two ways to h(E) differ by a mean "
        f"square of {d.disagreement:.1f} in their own variance, where 1 is expected for one mode in white noise and "
        "the package warns above 4: with its delay the cut has more than one root, so eqs. (13) and (14) hold roughly.",
        {"zero_over_mean": crossing / d.mean_energy, "disagreement": d.disagreement},
    )
