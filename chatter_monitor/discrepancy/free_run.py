"""Simulations that run on their own, and how far they are from the recording."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp
from scipy import stats

from chatter_monitor.discrepancy.case import Case
from chatter_monitor.discrepancy.report import FreeRun, Report
from chatter_monitor.errors import InputError
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.simulate import simulate

Vector = NDArray[np.float64]

RUN_S = 10.0  # longest, unless said otherwise
SEED = 1


def free_run(case: Case, system: MachiningSystem, seed: int = SEED, longest_s: float = RUN_S) -> Vector | None:
    """A simulation at the recording's rate, as long as that at most, shape (n,); None if there can be none."""
    if system.excitation.kind == "measured":
        return None
    slowest = min(mode.damping_ratio * mode.omega for mode in system.modes)
    seconds, rate_hz = min(case.whole.seconds, longest_s), case.whole.rate_hz
    try:
        run = simulate(system, seconds, seed, rate_hz, settle_s=min(10.0 / slowest, 2.0))
    except InputError:
        return None  # it grows without bound, which the report shows as missing
    return (run.signal - float(np.mean(run.signal))) / system.sensor.gain


def with_runs(case: Case, report: Report, runs: Mapping[str, Vector]) -> Report:
    """The report with what comparing the runs "recording", "base" and "augmented" adds; the last one may be missing."""
    if "base" not in runs:
        return report
    rate, recorded = case.whole.rate_hz, runs["recording"]
    top = 0.42 * case.recorded.rate_hz
    after = runs.get("augmented", runs["base"])
    distance = [psd_distance_db(recorded, run, rate, top) for run in (runs["base"], after)]
    amplitude = [_amplitude_distance(recorded, run) for run in (runs["base"], after)]
    three = (recorded, runs["base"], after)
    rms = [float(np.std(each)) for each in three]
    kurtosis = [float(stats.kurtosis(each)) + 3.0 for each in three]
    free = FreeRun((rms[0], rms[1], rms[2]), (kurtosis[0], kurtosis[1], kurtosis[2]), amplitude[0], amplitude[1])
    fit = msgspec.structs.replace(
        report.fit, psd_distance_db_before=distance[0], psd_distance_db_after=distance[1], free_run=free
    )
    return msgspec.structs.replace(report, fit=fit)


def psd_distance_db(a: Vector, b: Vector, rate_hz: float, top_hz: float) -> float:
    """Rms difference of two spectra in dB up to a frequency, from Welch's method with 2048 samples."""
    f, one = dsp.welch(a, rate_hz, nperseg=2048)
    _, other = dsp.welch(b, rate_hz, nperseg=2048)
    inside = (f > 0.01 * top_hz) & (f < top_hz)
    return float(np.sqrt(np.mean((10.0 * np.log10(one[inside] / other[inside])) ** 2)))


def _amplitude_distance(a: Vector, b: Vector) -> float:
    """Largest difference of the distribution functions of the amplitudes, each relative to its rms."""
    one, other = (np.abs(dsp.hilbert(each[: 1 << int(np.log2(each.size))])) / np.std(each) for each in (a, b))
    return float(stats.ks_2samp(one[::8], other[::8]).statistic)
