"""Figures 10 to 13: a bar turned between chuck and tail, heard by a microphone."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from chatter_monitor.physics.cuts import bar_turning
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Drift, Spindle
from chatter_monitor.physics.simulate import Simulation, simulate
from chatter_monitor.physics.stability import Root, rightmost_root
from docs.paper.drawing import FITTED, SHADE, TARGET, legend, new_figure
from docs.paper.plate import Plate, Plates

DURATION_S = 30.0  # of a pass; 1200 mm at 0.3 mm per revolution would take 142 s at a diameter of 34 mm
CUTTING_SPEED_M_MIN = 180.0
NOMINAL_MM = 34.0  # diameter that `bar_turning` stands for
CUT = 1.35 / 1.9  # depth of cut relative to `bar_turning`: stable at 38 mm
STABLE_MM, UNSTABLE_MM = 38.0, 33.0
_POWERS = {"mode.1.participation": -1, "mode.1.frequency_hz": 1}  # of the diameter, in what drifts along the bar


@dataclass(frozen=True)
class Pass:
    """One pass of the tool along the bar."""

    diameter_mm: float
    simulation: Simulation

    def root(self, share: float) -> Root:
        """Least stable root of the cut after a share of the pass."""
        return rightmost_root(self.simulation.system.at(share * DURATION_S))

    def stretch(self, begin_s: float, end_s: float) -> NDArray[np.float64]:
        """Sound pressure in Pa between two times."""
        rate = self.simulation.sample_rate_hz
        return self.simulation.signal[round(begin_s * rate) : round(end_s * rate)]

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Time of every sample."""
        return np.arange(self.simulation.signal.size) / self.simulation.sample_rate_hz


def bar(diameter_mm: float) -> MachiningSystem:
    """`bar_turning` at another diameter: bending stiffness goes as D^4, mass as D^2, so frequency and 1/g as D."""
    nominal = bar_turning(DURATION_S)
    scale = diameter_mm / NOMINAL_MM
    mode, tool = nominal.modes
    cut = nominal.terms[0]
    coefficient = CUT * cut.parameters["coefficient"] / scale**2  # it is relative to the mode's w^2
    drifts = tuple(
        Drift(
            d.parameter,
            d.time_s,
            tuple(v / scale if d.parameter.endswith("participation") else v * scale for v in d.value),
        )
        for d in nominal.drifts
    )
    return replace(
        nominal,
        modes=(replace(mode, frequency_hz=mode.frequency_hz * scale), tool),
        terms=(AppliedTerm(cut.term, {**cut.parameters, "coefficient": coefficient}),),
        spindle=Spindle(1000.0 * CUTTING_SPEED_M_MIN / (math.pi * diameter_mm)),
        drifts=drifts,
    )


def plates() -> Plates:
    """A stable pass at 38 mm and an unstable one at 33 mm."""
    stable, unstable = (Pass(mm, simulate(bar(mm), DURATION_S, seed=10)) for mm in (STABLE_MM, UNSTABLE_MM))
    middle = 0.5 * DURATION_S
    yield _stretch(
        "10",
        stable,
        middle,
        "Stable machining",
        "Sound pressure of stable machining at D = 38 mm: irregular and small.",
    )
    yield _stretch(
        "11",
        unstable,
        middle,
        "Unstable machining, chatter",
        "Sound pressure of unstable machining: a large and nearly steady oscillation.",
    )
    yield _whole(unstable)
    yield _spectra(stable, unstable)


def _crest(pressure: NDArray[np.float64]) -> float:
    return float(np.max(np.abs(pressure)) / np.std(pressure))


def _stretch(name: str, shown: Pass, middle: float, title: str, paper: str) -> Plate:
    figure, (whole, detail) = new_figure(2, 1, height=5.0)
    pressure = shown.stretch(middle - 1.0, middle + 1.0)
    time = middle - 1.0 + np.arange(pressure.size) / shown.simulation.sample_rate_hz
    whole.plot(time, pressure, color=FITTED, lw=0.4)
    whole.set(xlim=(time[0], time[-1]), xlabel="time, s", ylabel="sound pressure, Pa")
    whole.set_title(f"{title}, D = {shown.diameter_mm:.0f} mm, middle of the bar")
    near = abs(time - middle) < 0.02
    detail.plot(1e3 * (time[near] - middle), pressure[near], color=FITTED, lw=1.2)
    detail.set(xlim=(-20.0, 20.0), xlabel=f"time from {middle:g} s, ms", ylabel="sound pressure, Pa")
    root = shown.root(0.5)
    return Plate(
        name,
        title,
        figure,
        paper,
        f"Simulated at 12.8 kHz through a microphone, D = {shown.diameter_mm:.0f} mm: {np.std(pressure):.3f} Pa rms, "
        f"highest peak {_crest(pressure):.1f} times the rms. The least stable root of the cut has a damping ratio of "
        f"{100 * root.damping_ratio:+.2f} % at {root.frequency_hz:.0f} Hz.",
        {"rms_pa": float(np.std(pressure)), "damping_ratio": float(root.damping_ratio)},
    )


def _whole(shown: Pass) -> Plate:
    """Draw the whole pass with the stretch in which the tool leaves the cut."""
    leaving = shown.time_s[shown.simulation.out_of_cut]
    begin, end = float(leaving[0]), float(leaving[-1])
    ends = [shown.root(share).damping_ratio for share in (0.05, 0.95)]
    figure, axes = new_figure(height=3.8)
    axes.axvspan(begin, end, color=SHADE, alpha=0.25, lw=0.0, label="tool leaves the cut: developed chatter")
    axes.plot(shown.time_s, shown.simulation.signal, color=FITTED, lw=0.3)
    axes.set(
        xlim=(0.0, DURATION_S),
        xlabel="time, s   (tail → middle → chuck)",
        ylabel="sound pressure, Pa",
        title=f"Chatter in the middle of the bar, D = {shown.diameter_mm:.0f} mm, and recovery",
    )
    legend(axes, loc="lower right")
    quiet, loud = np.std(shown.stretch(0.0, 3.0)), np.std(shown.stretch(0.45 * DURATION_S, 0.55 * DURATION_S))
    return Plate(
        "12",
        "Into chatter in the middle of the bar, and out again",
        figure,
        "Below 34 mm heavy vibration sets on as the tool nears the middle of the bar; towards the chuck the system "
        "recovers its stability.",
        f"At {shown.diameter_mm:.0f} mm the sound rises from {quiet:.3f} to {loud:.2f} Pa rms; the tool leaves the cut "
        f"from {begin:.1f} s to {end:.1f} s of {DURATION_S:.0f} s, with damping ratios of {100 * ends[0]:+.2f} % and "
        f"{100 * ends[1]:+.2f} % at the ends. The pass is shortened from 142 s; 38 mm is stable with the same cut "
        "because the stiffness of the bar goes as D⁴.",
        {"begin_s": begin, "end_s": end, "rise": float(loud / quiet)},
    )


def _spectra(stable: Pass, unstable: Pass) -> Plate:
    figure, axes = new_figure()
    densities = []
    for shown, colour, name in ((unstable, TARGET, "unstable"), (stable, FITTED, "stable")):
        rate = shown.simulation.sample_rate_hz
        frequency, density = signal.welch(shown.stretch(0.45 * DURATION_S, 0.55 * DURATION_S), rate, nperseg=1 << 13)
        axes.semilogy(frequency, density, color=colour, lw=1.0, label=f"{name}, D = {shown.diameter_mm:.0f} mm")
        densities.append(density)
    peaks = [float(frequency[np.argmax(density)]) for density in densities]
    for harmonic in (1, 2, 3):
        near = abs(frequency - harmonic * peaks[0]) < 5.0
        axes.annotate(
            f"{harmonic * peaks[0]:.0f} Hz",
            (harmonic * peaks[0], densities[0][near].max()),
            xytext=(6, -4),
            textcoords="offset points",
            fontsize="small",
            color=TARGET,
        )
    axes.set(
        xlim=(0.0, 2000.0),
        xlabel="frequency, Hz",
        ylabel="PSD of the sound pressure, Pa²/Hz",
        title="Chatter is one line and its harmonics; the stable cut is broad",
    )
    legend(axes, loc="upper right")
    rise = 10.0 * math.log10(densities[0].max() / densities[1].max())
    return Plate(
        "13",
        "Stable and unstable signals in the frequency domain",
        figure,
        "The spectrum of the unstable signal is dominated by a narrow peak; that of the stable one is low and broad.",
        f"The chatter peak at {peaks[0]:.0f} Hz stands {rise:.0f} dB above the highest line of the stable cut, at "
        f"{peaks[1]:.0f} Hz, and has harmonics because the tool leaves the cut. The spectra of the paper's own bar are "
        "not public, so frequencies cannot be compared.",
        {"peak_hz": peaks[0], "rise_db": rise},
    )
