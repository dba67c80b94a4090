"""The band of one mode, chosen from the spectrum of the recording.

The band has to be wide: every part of the motion that is cut away is energy missing from the balance. A mode driven
by white noise leaves a share of about (4 zeta / pi) (f0 / f) of its kinetic energy above a frequency f > f0, and the
same share of its potential energy below f0^2 / f. So the band is symmetric about f0 on a logarithmic scale, which
leaves the balance of the two even; it reaches from f0/8 to 8 f0 (the fifth harmonic included)
and gives way only to what is not the mode: the noise floor where it adds up, or another peak.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp

from chatter_monitor.errors import InputError

Quantity = Literal["displacement", "velocity", "acceleration"]
# How many times the signal is the time derivative of the displacement.
DERIVATIVES: dict[Quantity, int] = {"displacement": 0, "velocity": 1, "acceleration": 2}

WIDEST = 8.0  # band from f0 / WIDEST to f0 * WIDEST where nothing else stands in the way
FLOOR_MARGIN = 3.0  # the band ends where the spectrum comes this near to a noise floor beyond the budget
BUDGET = 0.005  # share of the kinetic energy that noise, or another peak, may add up to: up to there wider is better
NARROWEST = 4  # half-width of the band in lines of the spectrum
VALLEY = 10.0  # another peak that rises by this factor out of its valley is not this mode
OWN_WIDTH = 0.15  # relative distance from f0 within which a peak is the mode itself at another energy
HARMONIC_WIDTH = 0.1  # relative distance from 2 f0, 3 f0, ... within which a peak belongs to the mode
MINOR = 0.02  # share of the kinetic energy that makes another peak worth a warning


@dataclass(frozen=True, slots=True)
class Band:
    """Where the mode is.

    Attributes
    ----------
    peak_hz, low_hz, high_hz : float
        Highest peak of the spectrum (of the velocity, for a displacement), and the edges of the band kept.
    noise_share : float
        Share of the kinetic energy within the band that the noise floor would make up.
    other_peaks_hz : tuple of float
        Further modes or lines with at least 2 % of the kinetic energy, outside the band.
    """

    peak_hz: float
    low_hz: float
    high_hz: float
    noise_share: float
    other_peaks_hz: tuple[float, ...]


def choose_band(
    signal: NDArray[np.float64], rate_hz: float, quantity: Quantity, limits_hz: tuple[float, float] | None = None
) -> Band:
    """Find the strongest mode and the band that holds it and nothing else.

    Parameters
    ----------
    signal : ndarray, shape (n,)
        Displacement, velocity or acceleration.
    limits_hz : (float, float), optional
        Edges given by the user: the peak is looked for between them and they are kept as they are.

    Raises
    ------
    InputError
        If `limits_hz` holds no frequency of the spectrum, or no peak.
    """
    length = 1 << max(8, min(14, int(np.log2(max(signal.size // 16, 1)))))
    frequency, density = dsp.welch(signal, rate_hz, nperseg=min(length, signal.size))
    to_velocity = (2.0 * np.pi * np.maximum(frequency, frequency[1])) ** (2 * (1 - DERIVATIVES[quantity]))
    velocity = density * to_velocity
    low, high = limits_hz or (4.0 * frequency[1], 0.48 * rate_hz)
    inside = (frequency >= low) & (frequency <= high)
    if not inside.any():
        raise InputError("the band holds no frequency", got=limits_hz, allowed=f"0 to {rate_hz / 2:g} Hz, low < high")
    # Never integrated: drift and hum of an accelerometer would outgrow the mode.
    searched = velocity if quantity == "displacement" else density
    peak = int(np.flatnonzero(inside)[np.argmax(searched[inside])])
    peak_hz = _refined(frequency, velocity, peak)
    if limits_hz is not None and peak in (np.flatnonzero(inside)[0], np.flatnonzero(inside)[-1]):
        raise InputError(
            "the strongest line sits on the edge of the band",
            got=f"{peak_hz:.4g} Hz in {low:g}-{high:g} Hz",
            remedy="Give a band with the mode in its middle.",
        )
    # The lowest part of the spectrum, wherever it is: an acceleration's own floor above the mode is the white force.
    audible = (frequency > peak_hz / WIDEST) & (frequency < max(0.4 * rate_hz, peak_hz))
    floor = float(np.percentile(dsp.medfilt(density, 5)[audible], 2))
    if limits_hz is None:
        low = frequency[_edge(frequency, density, to_velocity, peak, -1, peak_hz, floor)]
        high = frequency[_edge(frequency, density, to_velocity, peak, +1, peak_hz, floor)]
        ratio = max(min(high / peak_hz, peak_hz / low), 1.0 + NARROWEST * frequency[1] / peak_hz)
        low, high = peak_hz / ratio, peak_hz * ratio
        inside = (frequency >= low) & (frequency <= high)
    noise = floor * float(np.sum(to_velocity[inside])) / float(np.sum(velocity[inside]))
    others = _other_peaks(frequency, velocity, inside, peak_hz)
    return Band(peak_hz, float(low), float(high), min(noise, 1.0), others)


def _refined(frequency: NDArray[np.float64], density: NDArray[np.float64], peak: int) -> float:
    """Frequency of a spectral peak from its centre of gravity over three lines."""
    near = slice(max(peak - 1, 0), peak + 2)
    return float(np.sum(frequency[near] * density[near]) / np.sum(density[near]))


def _edge(
    frequency: NDArray[np.float64],
    density: NDArray[np.float64],
    to_velocity: NDArray[np.float64],
    peak: int,
    step: int,
    peak_hz: float,
    floor: float,
) -> int:
    """Walk from the peak outwards until the noise floor or the valley before another peak."""
    smooth = dsp.medfilt(density, 5)
    near = np.abs(frequency - peak_hz) < 0.25 * peak_hz
    budget = BUDGET * float(np.sum(density[near] * to_velocity[near]))
    valley = peak
    noise = risen = 0.0
    last = frequency.size - 2 if step > 0 else 1
    for i in range(peak + step, last, step):
        if not peak_hz / WIDEST <= frequency[i] <= peak_hz * WIDEST:
            return i - step
        if abs(frequency[i] - peak_hz) <= 3 * frequency[1]:  # the main lobe of the window
            continue
        noise += floor * to_velocity[i]
        if noise > budget and smooth[i] < FLOOR_MARGIN * floor:
            return i
        if smooth[i] < smooth[valley]:
            valley = i
            risen = 0.0
        order = frequency[i] / peak_hz
        own = abs(order - 1.0) < OWN_WIDTH or (order > 1.5 and abs(order - round(order)) < HARMONIC_WIDTH * order)
        if not own and density[i] > VALLEY * smooth[valley]:
            risen += density[i] * to_velocity[i]
            if risen > budget:
                return valley
    return last


def _other_peaks(
    frequency: NDArray[np.float64], velocity: NDArray[np.float64], inside: NDArray[np.bool_], peak_hz: float
) -> tuple[float, ...]:
    total = float(np.sum(velocity[inside]))
    rest = np.where(inside, 0.0, velocity)
    peaks, _ = dsp.find_peaks(rest, height=0.0, distance=max(3, int(0.1 * peak_hz / frequency[1])))
    return tuple(
        float(frequency[i])
        for i in peaks
        if frequency[i] > 3 * frequency[1] and float(np.sum(rest[max(i - 2, 0) : i + 3])) > MINOR * total
    )
