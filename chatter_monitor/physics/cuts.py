"""Three cuts as machining systems: stable turning, a slender bar that chatters in the middle, a forced milling cut.

Displacement is in mm. They make the recordings in ``replay_data``.
"""

from __future__ import annotations

import math

import numpy as np

from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Drift, Excitation, Mode, Sensor, Spindle
from chatter_monitor.physics.terms import CATALOGUE


def stable_turning() -> MachiningSystem:
    """Turning at 15 % of the stability limit that holds at every speed, 2 zeta (1 + zeta)."""
    mode = Mode(frequency_hz=412.0, damping_ratio=0.021)
    limit = 2.0 * mode.damping_ratio * (1.0 + mode.damping_ratio)
    cut = AppliedTerm(CATALOGUE["loss_of_contact"], {"coefficient": 0.15 * limit, "chip_thickness": 0.2})
    return MachiningSystem(
        modes=(mode,),
        terms=(cut,),
        excitation=Excitation(intensity=_intensity(mode, rms_mm=0.003)),
        spindle=Spindle(speed_rpm=2400.0),
        sensor=Sensor("pressure", gain=2e-6, noise_rms=0.003, hum_amplitude=0.001),
    )


def bar_turning(duration_s: float = 20.0) -> MachiningSystem:
    """Longitudinal turning of a slender bar between tail and chuck, as in fig. 12 of the paper.

    The bar gives way most in the middle: its mode takes part in the motion at the tool as sin(pi position), and the
    tool's own mode at 1450 Hz keeps the ends from being rigid. The frequency sags a little where the support is far.
    """
    bar = Mode(frequency_hz=322.0, damping_ratio=0.016)
    tool = Mode(frequency_hz=1450.0, damping_ratio=0.035, participation=0.6)
    limit = 2.0 * bar.damping_ratio * (1.0 + bar.damping_ratio)
    position = np.linspace(0.1, 0.9, 41)
    time_s = tuple(np.linspace(0.0, duration_s, position.size).tolist())
    shape = np.sin(math.pi * position)
    return MachiningSystem(
        modes=(bar, tool),
        terms=(AppliedTerm(CATALOGUE["loss_of_contact"], {"coefficient": 1.9 * limit, "chip_thickness": 0.15}),),
        excitation=Excitation("coloured", intensity=_intensity(bar, rms_mm=0.002), corner_hz=2500.0),
        spindle=Spindle(speed_rpm=1685.0),  # 180 m/min on 34 mm
        sensor=Sensor("pressure", gain=8e-7, noise_rms=0.0015, hum_amplitude=0.0005),
        drifts=(
            Drift("mode.1.participation", time_s, tuple(shape.tolist())),
            Drift("mode.1.frequency_hz", time_s, tuple((bar.frequency_hz - 9.0 * shape).tolist())),
        ),
    )


def forced_milling() -> MachiningSystem:
    """Face milling with six teeth whose sixth harmonic, 993.6 Hz, nearly meets a mode; stable by a wide margin."""
    spindle_mode = Mode(frequency_hz=990.0, damping_ratio=0.03)
    teeth = 6
    limit = 2.0 * spindle_mode.damping_ratio * (1.0 + spindle_mode.damping_ratio)
    phases = np.random.default_rng(6).uniform(-math.pi, math.pi, 14)
    strength = 3e5  # mm/s^2, the tooth passing force per unit mass
    orders = [teeth * k for k in range(1, 13)]
    forces = [(order, strength / (order / teeth) ** 1.2, phases[i]) for i, order in enumerate(orders)]
    forces += [(1, 0.15 * strength, phases[12]), (2, 0.05 * strength, phases[13])]  # run-out of the cutter
    terms = [AppliedTerm(CATALOGUE["loss_of_contact"], {"coefficient": 0.35 * limit, "chip_thickness": 0.1})]
    terms += [
        AppliedTerm(CATALOGUE["periodic_forcing"], {"coefficient": a, "order": order, "phase_rad": float(phase)})
        for order, a, phase in forces
    ]
    return MachiningSystem(
        modes=(spindle_mode,),
        terms=tuple(terms),
        excitation=Excitation("coloured", intensity=_intensity(spindle_mode, rms_mm=0.0008), corner_hz=3000.0),
        spindle=Spindle(speed_rpm=1656.0, teeth=teeth),
        sensor=Sensor("pressure", gain=5e-7, noise_rms=0.003, hum_amplitude=0.001),
    )


def _intensity(mode: Mode, rms_mm: float) -> float:
    """S_0 for which the mode alone moves by the given rms, var(x) = pi S_0 / (2 zeta w^3)."""
    return 2.0 * mode.damping_ratio * mode.omega**3 * rms_mm**2 / math.pi
