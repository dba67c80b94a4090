"""The stability lobe diagram: how stiff the cut may be at which spindle speed, and speeds to go to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.errors import InputError
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import Spindle
from chatter_monitor.physics.stability import linear_force, rightmost_root
from chatter_monitor.records import Advice

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_POINTS_PER_BANDWIDTH = 40  # of the frequency grid, over the half-power bandwidth of the least damped mode


class Lobe(NamedTuple):
    """One lobe of the diagram: on the curve the cut vibrates steadily, above it chatter grows.

    Attributes
    ----------
    number : int
        Full waves between one tooth and the next.
    speed_rpm, coefficient, frequency_hz : ndarray of float64, shape (n,)
        Spindle speed, process stiffness over w^2 (the coefficient of the delay terms) and chatter frequency along it.
    """

    number: int
    speed_rpm: NDArray[np.float64]
    coefficient: NDArray[np.float64]
    frequency_hz: NDArray[np.float64]


class Recommendation(NamedTuple):
    """Spindle speeds to go to, fastest first, and the same in words."""

    speeds: tuple[Advice, ...]
    text: str


def stability_lobes(system: MachiningSystem, numbers: Sequence[int]) -> list[Lobe]:
    """Lobes of the diagram, whatever delay term the system has itself.

    On the limit s = i omega solves the characteristic equation, so that the coefficient is
    -1 / (2 w^2 Re G(i omega)), which is b_lim = -1 / (2 K_f min Re G) at its least, and the phase of the wave left by
    the tooth before gives the speed (Tlusty; Altintas, Manufacturing Automation, 2000).

    Parameters
    ----------
    system : MachiningSystem
        Modes, number of teeth (one without a spindle) and terms other than the delay.
    numbers : sequence of int
        Which lobes; several with the same number when more than one mode can chatter.
    """
    omega, coefficient, phase = _limit_curve(system)
    ends = np.flatnonzero(np.isfinite(coefficient[1:]) != np.isfinite(coefficient[:-1])) + 1
    pieces = [piece for piece in np.split(np.arange(omega.size), ends) if np.isfinite(coefficient[piece[0]])]
    teeth = system.spindle.teeth if system.spindle else 1
    return [
        Lobe(
            number,
            60.0 * omega[piece] / (teeth * (2.0 * math.pi * number + phase[piece])),
            coefficient[piece],
            omega[piece] / (2.0 * math.pi),
        )
        for number in numbers
        for piece in pieces
    ]


def stability_limit(system: MachiningSystem, speed_rpm: NDArray[np.float64]) -> NDArray[np.float64]:
    """Largest stable coefficient of the delay term at each spindle speed: the lower envelope of all lobes."""
    omega, coefficient, phase = _limit_curve(system)
    teeth = system.spindle.teeth if system.spindle else 1
    limit = np.full(speed_rpm.shape, np.inf)
    for i, speed in enumerate(speed_rpm.tolist()):
        waves = (omega * 60.0 / (teeth * speed) - phase) / (2.0 * math.pi)
        whole = np.floor(waves)
        before = np.flatnonzero(whole[1:] != whole[:-1])
        crossing = np.maximum(whole[before], whole[before + 1])
        share = (crossing - waves[before]) / (waves[before + 1] - waves[before])
        # 1 / coefficient is smooth through the ends of the lobes, where the coefficient has a pole
        least = np.max((1.0 - share) / coefficient[before] + share / coefficient[before + 1], initial=0.0)
        limit[i] = 1.0 / least if least > 0.0 else np.inf
    return limit


def recommended_speeds(
    chatter_frequency_hz: float,
    teeth: int,
    lowest_rpm: float,
    highest_rpm: float,
    system: MachiningSystem | None = None,
) -> Recommendation:
    """Spindle speeds at which a harmonic of the tooth passing meets the chatter frequency: between the lobes.

    Parameters
    ----------
    chatter_frequency_hz : float
        As measured.
    teeth : int
        Of the tool.
    lowest_rpm, highest_rpm : float
        What the spindle can do.
    system : MachiningSystem, optional
        The cut, if its model is known; speeds at which it is not stable are left out.

    Raises
    ------
    InputError
        When the frequency, the teeth or the range make no sense.
    """
    if not (chatter_frequency_hz > 0.0 and teeth >= 1 and 0.0 < lowest_rpm <= highest_rpm):
        raise InputError(
            "no spindle speed can be recommended",
            got=(chatter_frequency_hz, teeth, lowest_rpm, highest_rpm),
            allowed="frequency > 0, teeth >= 1, 0 < lowest <= highest speed",
        )
    tooth_rpm = 60.0 * chatter_frequency_hz / teeth
    waves = range(max(1, math.ceil(tooth_rpm / highest_rpm - 1e-9)), math.floor(tooth_rpm / lowest_rpm + 1e-9) + 1)
    candidates = [Advice(spindle_rpm=tooth_rpm / k, lobe=k) for k in waves]
    reach = f"between {lowest_rpm:.0f} and {highest_rpm:.0f} rpm"
    if not candidates:
        return Recommendation((), f"no lobe lies {reach}")
    if system is None:
        kept = candidates
    else:
        kept = [advice for advice in candidates if _is_stable(system, Spindle(advice.spindle_rpm, teeth))]
    if not kept:
        return Recommendation((), f"none is stable {reach}: reduce the depth of cut")
    return Recommendation(tuple(kept), ", ".join(f"{advice.spindle_rpm:.0f} rpm" for advice in kept))


def plot_lobes(system: MachiningSystem, speed_rpm: NDArray[np.float64]) -> Figure:
    """Stability lobe diagram over the given speeds, with the system's own working point if it has one."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 4.5), layout="constrained")
    axes = figure.subplots()
    limit = stability_limit(system, speed_rpm)
    axes.plot(speed_rpm, limit, color="black")
    top = 4.0 * float(limit.min(initial=1.0))
    axes.fill_between(speed_rpm, limit, top, where=limit < top, color="tab:red", alpha=0.2, label="chatter")
    if system.spindle and system.delayed:
        coefficient = -linear_force(system).lag / system.modes[0].omega ** 2
        axes.plot(system.spindle.speed_rpm, coefficient, "o", color="tab:blue", label="this cut")
    axes.set(xlabel="spindle speed, rpm", ylabel="process stiffness over modal stiffness", ylim=(0.0, top))
    axes.legend(loc="upper left")
    return figure


def _limit_curve(
    system: MachiningSystem,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies in rad/s, coefficient at which each can persist (inf for none), phase of the wave in 0 to 2 pi."""
    w1 = system.modes[0].omega
    narrowest = min(2.0 * abs(mode.damping_ratio) * mode.omega for mode in system.modes)
    highest = 3.0 * max(mode.omega for mode in system.modes)
    count = min(1_000_000, math.ceil(highest / narrowest * _POINTS_PER_BANDWIDTH))
    omega = highest * (1.0 + np.arange(count)) / count
    s = 1j * omega
    dynamic_compliance = np.zeros_like(s)
    for mode in system.modes:
        dynamic_compliance += mode.participation**2 / (s**2 + 2.0 * mode.damping_ratio * mode.omega * s + mode.omega**2)
    force = linear_force(system)
    # the delay term gives lag = -coefficient w^2 and as much stiffness; only what else there is belongs to the machine
    G = 1.0 / (1.0 / dynamic_compliance + force.stiffness + force.lag + force.damping * s)
    with np.errstate(divide="ignore"):
        coefficient = np.where(G.real < 0.0, -1.0 / (2.0 * w1**2 * G.real), np.inf)
    # exp(-i omega tau) = 1 + 1 / (coefficient w^2 G) = -conj(G) / G
    phase = 2.0 * math.pi - np.mod(np.angle(-np.conj(G) / G), 2.0 * math.pi)
    return omega, coefficient, phase


def _is_stable(system: MachiningSystem, spindle: Spindle) -> bool:
    return rightmost_root(MachiningSystem(system.modes, system.terms, system.excitation, spindle, system.sensor)).stable
