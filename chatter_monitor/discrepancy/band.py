"""The band in which a recording is compared with a model: wide enough for the modes, and full up to its edge.

Whitening weighs every part of the band by the logarithm of its spectrum, so a part that nothing excites (above an
anti-alias filter, beyond the end of a band-limited input) would be paid out to whatever is tried. The band therefore
ends where the spectrum drops off a cliff, or where it holds a few times the modes.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp

SAMPLES_PER_PERIOD = 14.0
CLIFF_DB = 6.0  # drop within CLIFF_WIDTH that no machine makes away from its modes
CLIFF_WIDTH = 0.06  # relative
FADE_S = 0.5  # of the joint where a stretch is left out
LEAST_LEFT = 0.25  # of the recording, for a machine without a stretch
_NEAREST = 1.7  # cliffs are looked for beyond so many times the fastest mode
_LARGEST_UP = 3
_FINEST_RATIO = 10_000  # denominator
_REACH = 16  # of the low-pass, in samples of the lower rate


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """A recording, or its part within the band.

    Attributes
    ----------
    samples : ndarray of float64, shape (n,)
    missing : ndarray of bool, shape (n,)
        Samples that are lost, clipped or silent.
    rate_hz : float
    """

    samples: NDArray[np.float64]
    missing: NDArray[np.bool_]
    rate_hz: float

    @property
    def seconds(self) -> float:
        """Length."""
        return self.samples.size / self.rate_hz


def within_band(recorded: Recorded, highest_mode_hz: float) -> Recorded:
    """Resample so that the band ends where it should.

    Parameters
    ----------
    recorded : Recorded
    highest_mode_hz : float
        Natural frequency of the fastest mode.

    Returns
    -------
    Recorded
        Sample k is the signal at k / rate_hz; the same recording if its band is right.
    """
    edge_hz = min(0.5 * SAMPLES_PER_PERIOD * highest_mode_hz, cliff_hz(recorded, highest_mode_hz))
    ratio = Fraction(1)
    if edge_hz < 0.48 * recorded.rate_hz:
        exact = 2.0 * edge_hz / recorded.rate_hz
        ratio = max(Fraction(up, int(np.ceil(up / exact - 1e-9))) for up in range(1, _LARGEST_UP + 1))
    return at_rate(recorded, recorded.rate_hz * float(ratio))


def at_rate(recorded: Recorded, rate_hz: float) -> Recorded:
    """Resample to a rate that is a fraction of the recording's; the same recording if it has that rate."""
    ratio = Fraction(rate_hz / recorded.rate_hz).limit_denominator(_FINEST_RATIO)
    if ratio == 1:
        return recorded
    up, down = ratio.numerator, ratio.denominator
    samples = np.where(recorded.missing, 0.0, recorded.samples)
    # The low-pass is 6 dB down at the new edge: what lies around it folds back, and the band stays full.
    taps = dsp.firwin(2 * _REACH * down + 1, 1.0 / down, window=("kaiser", 6.0))
    resampled = np.asarray(dsp.upfirdn(up * taps, samples, up, down))[_REACH:][: -(-samples.size * up // down)]
    missing = np.zeros(resampled.size, dtype=bool)
    if recorded.missing.any():
        reach = round(_REACH / float(ratio))
        touched = np.convolve(recorded.missing, np.ones(2 * reach + 1), "same") > 0.5
        missing = touched[np.minimum((np.arange(resampled.size) / float(ratio)).astype(np.int64), touched.size - 1)]
    missing[:_REACH] = missing[-_REACH:] = True  # there the low-pass saw beyond the ends
    return Recorded(resampled, missing, recorded.rate_hz * float(ratio))


def without(recorded: Recorded, between_s: tuple[float, float]) -> Recorded | None:
    """A recording without a stretch of it, the ends faded into each other; None if too little is left.

    Both ends are parts of one stationary vibration and know nothing of each other: faded with weights whose squares add
    up to one, the joint has its variance and its spectrum, where a hole with edges would leak into all frequencies.
    """
    n, rate_hz = recorded.samples.size, recorded.rate_hz
    begin, end = (min(max(round(at * rate_hz), 0), n) for at in between_s)
    fade = round(FADE_S * rate_hz)
    parts = [part for part in (slice(0, begin), slice(end, n)) if part.stop - part.start > 2 * fade]
    if sum(part.stop - part.start for part in parts) < LEAST_LEFT * n:
        return None
    samples = [recorded.samples[part] for part in parts]
    missing = [recorded.missing[part] for part in parts]
    if len(parts) == 1:
        return Recorded(samples[0], missing[0], rate_hz)
    turn = 0.5 * np.pi * (np.arange(fade) + 0.5) / fade
    joint = np.cos(turn) * samples[0][-fade:] + np.sin(turn) * samples[1][:fade]
    gone = missing[0][-fade:] | missing[1][:fade]
    return Recorded(
        np.concatenate([samples[0][:-fade], np.where(gone, 0.0, joint), samples[1][fade:]]),
        np.concatenate([missing[0][:-fade], gone, missing[1][fade:]]),
        rate_hz,
    )


def cliff_hz(recorded: Recorded, highest_mode_hz: float) -> float:
    """Frequency above the modes at which the spectrum falls off a cliff; half the sample rate if it does not."""
    nyquist = 0.5 * recorded.rate_hz
    samples = recorded.samples[~recorded.missing]
    length = min(samples.size // 8, 8192)
    if length < 256 or _NEAREST * highest_mode_hz > 0.9 * nyquist:
        return nyquist
    frequency, density = dsp.welch(samples, recorded.rate_hz, nperseg=length)
    # A mode itself falls by 12 dB an octave at most; with that taken out, the spectrum of a machine rises or is level.
    decibel = 10.0 * np.log10(np.maximum(density, 1e-300)) + 40.0 * np.log10(np.maximum(frequency, frequency[1]))
    for centre in np.geomspace(_NEAREST * highest_mode_hz, nyquist / (1.0 + CLIFF_WIDTH), 200):
        below = (frequency > centre * (1.0 - CLIFF_WIDTH)) & (frequency < centre)
        above = (frequency > centre) & (frequency < centre * (1.0 + CLIFF_WIDTH))
        if np.median(decibel[below]) - np.median(decibel[above]) > CLIFF_DB:
            return float(centre * (1.0 - 0.5 * CLIFF_WIDTH))
    return nyquist
