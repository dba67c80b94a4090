"""The report of a recording that chatters."""

from __future__ import annotations

import numpy as np
from scipy import signal as dsp

from chatter_monitor.discrepancy.chatter.conclude import ChatterDiagnosis
from chatter_monitor.reports.diagnosis.document import document
from chatter_monitor.reports.diagnosis.drawing import AUGMENTED, RECORDED, figure_of, titled

_SHOWN = 12  # periods
_RESOLVED_S = 0.5


def page_chatter(diagnosis: ChatterDiagnosis, name: str) -> str:
    """HTML page with everything inside."""
    return document(diagnosis.report, name, [_picture(diagnosis)])


def _picture(diagnosis: ChatterDiagnosis) -> str:
    """Amplitude over time, spectrum and waveform where it stays, of recording and augmented simulation."""
    figure, (left, middle, right) = figure_of(1)
    found, rate = diagnosis.found, diagnosis.whole.rate_hz
    t = np.arange(found.amplitude.size) / rate
    left.semilogy(t[::16], found.amplitude[::16], color=RECORDED, lw=0.8, label="recording")
    excitation = diagnosis.report.self_excitation
    if found.rises_s and excitation is not None and excitation.growth_per_s is not None:
        begin, end = found.rises_s[0]
        line = np.linspace(begin, end, 2)
        top = float(np.interp(end, t, found.amplitude))
        left.semilogy(
            line,
            top * np.exp(excitation.growth_per_s * (line - end)),
            color=AUGMENTED,
            lw=2,
            label="growth of the augmented model",
        )
    left.set(xlabel="time, s", ylabel="amplitude, u", title="amplitude at the vibration")
    left.legend(fontsize="small")
    begin_s, end_s = found.steady_s or (0.5 * t[-1], t[-1])
    steady = diagnosis.whole.samples[int(begin_s * rate) : int(end_s * rate)]
    runs = [(steady, rate, RECORDED, "recording")]
    if diagnosis.reached is not None:
        run = diagnosis.reached.run
        signal = run.signal / diagnosis.model.sensor.gain
        runs.append((signal[int(0.7 * signal.size) :], run.sample_rate_hz, AUGMENTED, "augmented simulation"))
    for signal, rate_hz, color, label in runs:
        frequency, density = dsp.welch(signal, rate_hz, nperseg=min(round(_RESOLVED_S * rate_hz), signal.size))
        shown = frequency < 4.0 * found.frequency_hz
        middle.plot(frequency[shown], 10.0 * np.log10(density[shown] + 1e-300), color=color, lw=0.8, label=label)
        part = signal[signal.size // 2 :][: int(_SHOWN * rate_hz / found.frequency_hz)]
        right.plot(1e3 * np.arange(part.size) / rate_hz, part, color=color, lw=0.9, label=label)
    middle.set(xlabel="Hz", ylabel="dB", title="spectrum where it stays")
    middle.legend(fontsize="small")
    right.set(xlabel="ms", ylabel=diagnosis.model.sensor.quantity, title="some periods of it")
    return titled(figure, "Rise and limit")
