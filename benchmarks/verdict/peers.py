"""Detectors from the literature, as a score for every interval; the higher, the more it looks like chatter.

Each hears what the monitor hears and is told the same nominal speed. Levels mean nothing without a reference, and the
gain of every cut is another one: those that need one get the level of the first second of cutting, which a user would
have to measure on a cut known to be good.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from benchmarks.verdict.cut import INTERVAL_S, INTERVAL_SAMPLES, RATE_HZ, Cut

Floats = NDArray[np.float64]
Peer = Callable[[Cut], Floats]

REFERENCE_S = 1.0
REVOLUTIONS = 16  # whose once-per-revolution samples are compared
SPECTRUM_S = 0.4  # resolves 5 Hz with a Hann window
ORDER_TOLERANCE = 0.03  # as far off as a nominal speed is
ENTROPY_S, ENTROPY_ORDER, ENTROPY_DELAY = 0.2, 4, 2


def once_per_revolution(cut: Cut) -> Floats:
    """Variance of samples taken once per revolution, over the reference power.

    Zero for vibration synchronous with the spindle, that of the signal for chatter (Schmitz, Davies, Medicus and Snyder
    2001, "Improving high-speed machining material removal rates by rapid dynamic analysis", CIRP Annals 50).
    """
    period = 60.0 / cut.nominal_rpm * RATE_HZ
    ends = INTERVAL_SAMPLES * np.arange(1, len(cut.truth) + 1)
    at = ends[:, np.newaxis] - 1 - period * np.arange(REVOLUTIONS)
    # the variance of one sample a turn depends on where in the turn it is taken: the mean over eight places
    places = at[..., np.newaxis] - period * np.arange(8) / 8.0
    values = np.interp(places, np.arange(cut.samples.size), cut.samples)
    return np.asarray(values.var(axis=1).mean(axis=1) / _reference_power(cut))


def rms_threshold(cut: Cut) -> Floats:
    """Power over the reference power."""
    return np.asarray(_powers(cut) / _reference_power(cut))


def spectrum_off_orders(cut: Cut) -> Floats:
    """Share of the strongest line that is at no harmonic of the teeth in the power of the last 0.4 s.

    After Delio, Tlusty and Smith (1992), "Use of audio signals for chatter detection and control", J. Eng. Ind. 114.
    """
    power, f = _spectra(cut)
    tooth_hz = cut.nominal_rpm * cut.teeth / 60.0
    harmonic = np.maximum(np.round(f / tooth_hz), 1.0)
    distance_hz = np.abs(f - harmonic * tooth_hz)
    allowed_hz = np.minimum(ORDER_TOLERANCE * f + 2.0 / SPECTRUM_S, 0.25 * tooth_hz)
    line = power[:, :-2] + power[:, 1:-1] + power[:, 2:]
    off = (distance_hz > allowed_hz)[1:-1] & (f[1:-1] > 100.0)
    return np.asarray(np.where(off, line, 0.0).max(axis=1) / np.maximum(power.sum(axis=1), 1e-300))


def permutation_entropy(cut: Cut) -> Floats:
    """One less the normalised entropy of ordinal patterns in the last 0.2 s: order in the signal.

    Bandt and Pompe (2002), Phys. Rev. Lett. 88, 174102; for chatter Nair, Krishnamurthy, Grinberg and Shapiro (2010),
    "Permutation entropy based chatter detection".
    """
    patterns = sliding_window_view(cut.samples, ENTROPY_ORDER * ENTROPY_DELAY - 1)[:, ::ENTROPY_DELAY]
    code = np.argsort(patterns, axis=1) @ (ENTROPY_ORDER ** np.arange(ENTROPY_ORDER))
    _, code = np.unique(code, return_inverse=True)
    kinds = int(code.max()) + 1
    padded = np.concatenate((np.zeros(cut.samples.size - code.size, code.dtype), code))
    counts = np.stack([np.bincount(part, minlength=kinds) for part in padded.reshape(-1, INTERVAL_SAMPLES)])
    size = round(ENTROPY_S / INTERVAL_S)
    recent = np.stack([counts[max(0, i - size + 1) : i + 1].sum(axis=0) for i in range(len(counts))])
    p = recent / recent.sum(axis=1, keepdims=True)
    entropy = -np.sum(np.where(p > 0, p * np.log(np.maximum(p, 1e-300)), 0.0), axis=1)
    return np.asarray(1.0 - entropy / math.log(math.factorial(ENTROPY_ORDER)))


PEERS: dict[str, Peer] = {
    "once-per-revolution variance": once_per_revolution,
    "RMS threshold": rms_threshold,
    "spectral line off the orders": spectrum_off_orders,
    "permutation entropy": permutation_entropy,
}


def _powers(cut: Cut) -> Floats:
    return np.asarray(np.mean(cut.samples.reshape(-1, INTERVAL_SAMPLES) ** 2, axis=1))


def _reference_power(cut: Cut) -> float:
    cutting = np.flatnonzero(cut.truth.kappa > 0)
    first = cutting[: round(REFERENCE_S / INTERVAL_S)]
    return float(np.median(_powers(cut)[first]))


def _spectra(cut: Cut) -> tuple[Floats, Floats]:
    """Power spectra of the 0.4 s up to the end of each interval, and their frequencies."""
    size = round(SPECTRUM_S * RATE_HZ)
    padded = np.concatenate((np.zeros(size - INTERVAL_SAMPLES), cut.samples))
    frames = sliding_window_view(padded, size)[::INTERVAL_SAMPLES] * np.hanning(size)
    return np.asarray(np.abs(np.fft.rfft(frames, axis=1)) ** 2), np.asarray(np.fft.rfftfreq(size, 1.0 / RATE_HZ))
