"""A force that follows the displacement of a while before, whatever the delay.

Regeneration is looked for in the spectrum, at the spindle's delay. Here nothing is supposed of the delay: a delayed
spring at every lag, one that acts all along and others that act at small or at large displacements only, is a filter
matched to the errors that a model leaves. A delay that depends on the displacement shows as two, each in a part of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from chatter_monitor.discrepancy.basis import scales
from chatter_monitor.discrepancy.innovations import Innovations
from chatter_monitor.discrepancy.locate import LAGS_S
from chatter_monitor.discrepancy.whitening import ORDER

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

# Displacements at which a delayed spring is looked for, over the rms.
PARTS = {"": (0.0, np.inf), "at small displacements": (0.0, 0.5), "at large displacements": (1.5, np.inf)}
_PERIODS = 3.0  # of the first mode, that a delay has to exceed: a shorter one is much like a spring and a damper
_SIZED_AT = 4  # lags at which the size of a signature is worked out
_FORGOTTEN = 4  # times the filter's memory, until an answer has died away


@dataclass(frozen=True, slots=True)
class Echo:
    """The delayed spring that explains most of what a model leaves.

    Attributes
    ----------
    lag_s : float
    part : str
        Displacements at which it acts, in words; "" for all.
    gain_nats : float
        Of a delayed spring and damper with that delay.
    p_value : float
        How often chance does as well at any of all delays and parts.
    """

    lag_s: float
    part: str
    gain_nats: float
    p_value: float

    def __str__(self) -> str:
        where = f" {self.part}" if self.part else ""
        return f"the displacement {1e3 * self.lag_s:.3g} ms before{where}"


def find_echo(inn: Innovations, left: Vector, weight: Vector) -> Echo:
    """Look for a delayed spring in what a model leaves.

    With e the errors and s(L) the signature of a spring at lag L, over the standard deviation of the errors, e . s(L)
    swings with L as the displacement does, and that of a damper follows it by a quarter of a period. The sum of their
    squares over twice the mean square is the gain of both: the square of an envelope, which under chance is an
    exponential variable. How often it exceeds a level at any lag follows from its up-crossings (Rice 1945, Bell System
    Technical Journal 24, section 3.7).

    Parameters
    ----------
    inn : Innovations
        Of the model.
    left : ndarray of float64, shape (n,)
        Whitened errors without what any of its parameters explains.
    weight : ndarray of float64, shape (n,)
        Reciprocal of their standard deviation; 0 for samples not to be used.
    """
    motion, rate_hz = inn.motion, inn.recorded.rate_hz
    n = left.size
    first = max(ORDER + 5, math.ceil(_PERIODS * rate_hz / inn.linear.modes[0].frequency_hz))
    lags = np.arange(first, min(int(LAGS_S * rate_hz), n // 10))
    if lags.size < 2:
        return Echo(0.0, "", 0.0, 1.0)
    sd_x, sd_v = scales(motion)
    x, v = motion.x - np.mean(motion.x[0]), (motion.v - np.mean(motion.v[0])) * (sd_x / sd_v)
    within = [(np.abs(x) >= low * sd_x) & (np.abs(x) < high * sd_x) for low, high in PARTS.values()]
    answers = inn.impulse_answers(_FORGOTTEN * inn.memory() + ORDER)
    size = fft.next_fast_len(n + max(answers.shape[1], int(lags[-1]) + 1), real=True)
    errors = fft.rfft(left * weight**2, size)
    # What each force, known or predicted, would explain if it were 1 at one sample.
    known, predicted = fft.irfft(errors * np.conj(fft.rfft(answers, size)), size)[:, :n]
    past = np.conj(fft.rfft(np.stack([x[0], v[0]]), size))
    best = Echo(0.0, "", 0.0, 1.0)
    for part, there, squares in zip(PARTS, within, _squares(inn, x, within, lags, weight), strict=True):
        if squares == 0.0:  # never there
            continue
        explained = known * there[0]
        explained[1:] += predicted[1:] * there[1][:-1]
        spring, damper = fft.irfft(fft.rfft(explained, size) * past, size)[:, lags]
        wave = spring + 1j * damper
        gains = np.abs(wave) ** 2 / (2.0 * squares)
        at = int(np.argmax(gains))
        gain = float(gains[at])
        exceeded = math.exp(-gain) * (1.0 + _width(wave) * lags.size * math.sqrt(gain / math.pi))
        p = -math.expm1(-len(PARTS) * exceeded)
        if (p, -gain) < (best.p_value, -best.gain_nats):
            best = Echo(float(lags[at]) / rate_hz, part, gain, p)
    return best


def _width(wave: NDArray[np.complex128]) -> float:
    """Rms width of the spectrum of a narrow-band signal about its mean frequency, rad per sample."""
    turn = np.vdot(wave[:-1], wave[1:])
    turn /= abs(turn)
    return float(np.linalg.norm(wave[1:] - turn * wave[:-1]) / np.linalg.norm(wave[:-1]))


def _squares(
    inn: Innovations, x: Matrix, within: list[NDArray[np.bool_]], lags: NDArray[np.int64], weight: Vector
) -> Vector:
    """Sum of squares of the weighted signature of a delayed spring in each part, the mean over some lags."""
    springs = []
    for lag in lags[np.linspace(0.3 * lags.size, lags.size - 1, _SIZED_AT).astype(int)]:
        spring = np.zeros_like(x)
        spring[0, lag:] = x[0, :-lag]
        spring[1, lag - 1 :] = x[0, : 1 - lag]
        springs.append(spring)
    signatures = inn.respond(springs, within) * weight
    return np.asarray(np.sum(signatures.reshape(_SIZED_AT, len(within), -1) ** 2, axis=2).mean(axis=0))
