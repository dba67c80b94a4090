"""The recording and the simulations that run on their own, drawn over each other."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp

from chatter_monitor.discrepancy.case import Case
from chatter_monitor.energy.identification import Identification
from chatter_monitor.reports.diagnosis.by_energy import draw_damping, draw_frequency, draw_stiffness
from chatter_monitor.reports.diagnosis.drawing import AUGMENTED, BASE, RECORDED, figure_of, titled

Vector = NDArray[np.float64]

AMPLITUDE_CLASSES = 12
_COLOURS = {"recording": RECORDED, "base": BASE, "augmented": AUGMENTED}


def comparison(case: Case, runs: Mapping[str, Vector]) -> str:
    """Spectrum, amplitudes, and how the frequency of the first mode goes with its amplitude: its stiffness."""
    figure, (left, middle, right) = figure_of(1)
    rate = case.whole.rate_hz
    top = 0.5 * case.recorded.rate_hz
    for name, run in runs.items():
        color = _COLOURS[name]
        f, density = dsp.welch(run, rate, nperseg=4096)
        left.plot(f[f < top], 10.0 * np.log10(density[f < top]), color=color, lw=0.9, label=name)
        amplitude = np.abs(dsp.hilbert(run[: 1 << int(np.log2(run.size))])) / np.std(run)
        middle.hist(amplitude, 80, range=(0, 4.5), density=True, histtype="step", color=color, label=name)
        right.plot(*backbone(run, rate, case.innovations.linear.modes[0].frequency_hz), color=color, lw=0.9)
    left.set(xlabel="Hz", ylabel="dB", title="spectrum")
    middle.set(xlabel="amplitude / rms", title="amplitudes", yscale="log", ylim=(1e-4, None))
    right.set(xlabel="amplitude / rms", ylabel="Hz", title="frequency of the first mode")
    left.legend(fontsize="small")
    return titled(figure, "Recording and simulations")


def by_energy(found: Mapping[str, Identification]) -> str:
    """Stiffness, frequency and damping of the strongest mode, each identified from one of the runs alone."""
    figure, (left, middle, right) = figure_of(1)
    for name, result in found.items():
        color = _COLOURS[name]
        draw_stiffness(left, result, color, name)
        draw_frequency(middle, result, color)
        draw_damping(right, result, color)
    left.set(xlabel="x / rms", ylabel="%", title="stiffness, of that at rest")
    middle.set(xlabel="energy / mean", ylabel="Hz", title="frequency")
    right.set(xlabel="energy / mean", ylabel="%", title="equivalent damping ratio", ylim=(0.0, None))
    left.legend(fontsize="small")
    return titled(figure, "Stiffness and damping by energy")


def backbone(run: Vector, rate_hz: float, mode_hz: float) -> tuple[Vector, Vector]:
    """Amplitude over its rms, and the median frequency, of what vibrates near a mode, in equally long classes.

    A spring that hardens raises the frequency with the amplitude, one that softens lowers it; without one it is level.

    Parameters
    ----------
    run : ndarray, shape (n,)
        Samples.
    rate_hz, mode_hz : float
        Their rate, and the frequency of the mode.

    Returns
    -------
    amplitude, hertz : ndarray, shape (AMPLITUDE_CLASSES,)
    """
    near = dsp.butter(2, (0.8 * mode_hz, min(1.2 * mode_hz, 0.49 * rate_hz)), "bandpass", fs=rate_hz, output="sos")
    vibration = dsp.hilbert(dsp.sosfilt(near, run)[: 1 << int(np.log2(run.size))])
    amplitude = np.abs(vibration[1:])
    hertz = rate_hz / (2.0 * np.pi) * np.angle(vibration[1:] * vibration[:-1].conj())
    classes = np.array_split(np.argsort(amplitude), AMPLITUDE_CLASSES)
    rms = np.sqrt(0.5 * np.mean(amplitude**2))
    return (
        np.array([np.median(amplitude[c]) for c in classes]) / rms,
        np.array([np.median(hertz[c]) for c in classes]),
    )
