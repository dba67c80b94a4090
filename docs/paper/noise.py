"""Figure 3: spectrum of the simulated excitation."""

from __future__ import annotations

import numpy as np
from scipy import signal

from chatter_monitor.physics.excitation import random_force
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import Excitation, Mode
from docs.paper.drawing import CLOUD, LINEAR, TARGET, legend, new_figure
from docs.paper.plate import Plate, Plates

STEP_S = 1.0 / 51200.0  # of the integration of a 400 Hz mode recorded at 12.8 kHz
FINE = 32  # points between two pulses that show the linear interpolation
PULSES = 1 << 18
MODE_HZ = 400.0


def plates() -> Plates:
    """Spectrum of linearly interpolated pulses against eq. (6)."""
    system = MachiningSystem((Mode(MODE_HZ, 0.01),), excitation=Excitation(intensity=1.0))
    pulses = random_force(system, STEP_S * np.arange(PULSES), STEP_S, np.random.default_rng(3))
    at = np.arange((PULSES - 1) * FINE) / FINE
    force = np.interp(at, np.arange(PULSES), pulses)
    frequency, density = signal.welch(force, FINE / STEP_S, nperseg=FINE << 10)
    measured = density[1:] / (4.0 * np.pi)  # two-sided, per rad/s
    cycles = frequency[1:] * STEP_S  # omega dt / 2 pi
    theory = np.sinc(cycles) ** 4  # eq. (6) with S0 = 1
    flat = cycles < 0.5
    error = float(np.sqrt(np.mean((measured[flat] / theory[flat] - 1.0) ** 2)))
    bias = float(np.mean(measured[flat] / theory[flat]) - 1.0)
    loss = float(1.0 - np.sinc(MODE_HZ * STEP_S) ** 4)
    figure, axes = new_figure()
    shown = cycles < 2.4
    axes.semilogy(cycles[shown], measured[shown], color=CLOUD, lw=2.0, label="simulated excitation")
    axes.semilogy(cycles[shown], theory[shown], "--", color=TARGET, lw=1.4, label="eq. (6)")
    axes.axvline(MODE_HZ * STEP_S, color=LINEAR, lw=1.8, label="mode at 400 Hz")
    axes.set(
        xlim=(0.0, 2.4),
        ylim=(1e-6, 3.0),
        xlabel="ω Δt / 2π   (1 = one pulse per period)",
        ylabel="S_w(ω) / S₀",
        title="The simulated excitation is white where the machine vibrates",
    )
    legend(axes, loc="upper right")
    yield Plate(
        "03",
        "Spectrum of the simulated excitation",
        figure,
        "The power spectrum of pulses that are interpolated linearly: S₀ at low frequency, falling as the fourth power "
        "of sin(ωΔt/2)/(ωΔt/2), eq. (6).",
        f"{PULSES} pulses follow eq. (6) up to half the pulse rate with a mean difference of {100 * bias:+.2f} % "
        f"(scatter of single lines {100 * error:.0f} %, which is that of the averaged periodogram). At a 400 Hz mode "
        f"and the step that the simulator takes, the excitation lacks {100 * loss:.3f} % of white noise.",
        {"bias": bias, "loss_at_mode": loss},
    )
