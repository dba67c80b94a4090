"""Tones in a recording: found, and taken out, so that no mode is bent towards them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft, ndimage
from scipy import signal as dsp

from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.faults import SIGNIFICANT
from chatter_monitor.discrepancy.linear import calibrate
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.physics.parts import Spindle

Vector = NDArray[np.float64]

MOST = 12
FIRST, NEAR, AROUND = 3, 3, 40  # ordinates: the first that counts; that a tone fills, on either side; beside it
# Of a tone whose frequency wanders: how far (relative, and at least); over how long its speed is averaged; how fast its
# phase and its amplitude change.
WIDE, LEAST_WIDE_HZ, SMOOTHING_S, PHASE_HZ, AMPLITUDE_HZ = 0.015, 8.0, 0.1, 4.0, 0.5
FOLLOWED = 5  # of the loudest, until one of them is a tone
SEGMENT_S, BESIDE_HZ, STANDS_OUT = 1.0, 15.0, 5.0  # of the spectrum in which it is looked for
STEADIER = 5.0  # standard deviations by which its power is steadier than that of noise
NARROW = 20.0  # its power over what is as wide beside it
KNOWN = 0.9  # share of what an amplitude is told by that has to be there


@dataclass(frozen=True, slots=True, eq=False)
class Tone:
    """A sinusoid that stands out.

    Attributes
    ----------
    frequency_hz, p_value, gain_nats : float
    phase : ndarray of float64, shape (n,), optional
        Along the recording, rad, if the frequency wanders.
    """

    frequency_hz: float
    p_value: float
    gain_nats: float
    phase: Vector | None = None

    def waves(self, recorded: Recorded) -> tuple[Vector, Vector]:
        """Cosine and sine of it."""
        turn = 2.0 * np.pi * self.frequency_hz / recorded.rate_hz
        phase = turn * np.arange(recorded.samples.size) if self.phase is None else self.phase
        return np.cos(phase), np.sin(phase)

    def price_nats(self, seconds: float) -> float:
        """What noise gains by numbers that follow its phase and amplitude, and half as much again."""
        return 0.0 if self.phase is None else 1.5 * seconds * (PHASE_HZ + 2.0 * AMPLITUDE_HZ)


def tones_of(white: Vector, rate_hz: float, most: int = MOST) -> list[Tone]:
    """Tones that stand out of white errors, strongest first.

    A periodogram ordinate of white noise is exponentially distributed; a tone puts its power into two or three of
    them, where a resonance fills many.
    """
    found: list[Tone] = []
    rest = white / np.std(white)
    n = rest.size
    t = np.arange(n)
    for _ in range(most):
        power = np.abs(np.fft.rfft(rest)) ** 2 / n
        peak = FIRST + int(np.argmax(power[FIRST:-2]))
        below, above = power[max(peak - AROUND, 1) : peak - NEAR], power[peak + NEAR + 1 : peak + AROUND]
        local = float(np.median(np.concatenate([below, above]))) / math.log(2.0)
        p = _chance(float(power[peak]) / max(local, 1.0), n)
        if p > SIGNIFICANT:
            break
        # The frequency between two ordinates that takes most of the power.
        a, b, c = (float(np.sqrt(power[peak + i])) for i in (-1, 0, 1))
        shift = (c if c > a else -a) / (b + max(a, c))
        best = max(
            np.linspace(peak + shift - 0.1, peak + shift + 0.1, 21),
            key=lambda at: abs(np.exp(-2j * np.pi * at / n * t) @ rest),
        )
        wave = 2.0 / n * (np.exp(-2j * np.pi * best / n * t) @ rest)
        before = float(rest @ rest)
        rest = rest - (wave * np.exp(2j * np.pi * best / n * t)).real
        found.append(Tone(float(best * rate_hz / n), p, 0.5 * (before - float(rest @ rest))))
    return found


def loud_tones(recorded: Recorded, given: Linear) -> list[Tone]:
    """Tones so loud that a calibration takes them for a mode, strongest first.

    What stands out of a recording itself may be a tone or a sharp resonance. It is a tone if the machine calibrated
    to the rest explains that, and the tone, better than it explains the whole.
    """
    found: list[Tone] = []
    rest, loss = recorded, calibrate(recorded, given).nll
    while len(found) < MOST and (tone := _loudest(rest, given)) is not None:
        without = _less(recorded, [*found, tone])
        left = calibrate(without, given).nll
        gain = loss - left - tone.price_nats(recorded.seconds)
        if (p := _chance(gain, recorded.samples.size)) > SIGNIFICANT:
            break
        found.append(replace(tone, p_value=p, gain_nats=gain))
        rest, loss = without, left
        if given.spindle is not None and tone.phase is not None:
            found += _orders(rest, found[-1], given.spindle)
            rest = _less(recorded, found)
            loss = calibrate(rest, given).nll
    return found


def _loudest(recorded: Recorded, given: Linear) -> Tone | None:
    """What stands out most of a recording: a tone of one frequency if that takes all of it, else one that wanders."""
    steady = next(iter(tones_of(recorded.samples, recorded.rate_hz, most=1)), None)
    if steady is not None and _takes_all(recorded, steady):
        return steady
    loudest = sorted(_crests(recorded), key=lambda crest: -crest[1])[:FOLLOWED]
    followed = (_wandering(recorded, frequency_hz, given) for frequency_hz, _ in loudest)
    tone = next((tone for tone in followed if tone is not None), None)
    if tone is None:
        return steady
    # Where the machine is louder than the tone, the latter has not been tried as one of one frequency.
    even = _even(recorded, tone)
    return even if _takes_all(recorded, even) else tone


def _takes_all(recorded: Recorded, tone: Tone) -> bool:
    """Whether nothing stands out any more where a tone was taken out."""
    left = _crests(_less(recorded, [tone]))
    return all(abs(frequency_hz - tone.frequency_hz) > 2.0 / SEGMENT_S for frequency_hz, _ in left)


def _even(recorded: Recorded, tone: Tone) -> Tone:
    """A tone of one frequency in place of one whose phase was followed: that of the straight line through the phase."""
    if tone.phase is None:
        raise ValueError("the tone has not been followed")
    slope = float(np.polynomial.Polynomial.fit(np.arange(tone.phase.size), tone.phase, 1).convert().coef[1])
    return replace(tone, frequency_hz=slope * recorded.rate_hz / (2.0 * np.pi), phase=None)


def _crests(recorded: Recorded) -> list[tuple[float, float]]:
    """Frequencies at which a spectrum of `SEGMENT_S` stands out of its surroundings, and how much."""
    rate = recorded.rate_hz
    frequency, density = dsp.welch(recorded.samples, rate, nperseg=min(round(SEGMENT_S * rate), recorded.samples.size))
    ratio = density / ndimage.median_filter(density, 2 * round(BESIDE_HZ * SEGMENT_S) + 1)
    inner = slice(FIRST, -FIRST)
    peaks = (ratio == ndimage.maximum_filter1d(ratio, 5)) & (ratio > STANDS_OUT)
    return [
        (float(f), float(r)) for f, r in zip(frequency[inner][peaks[inner]], ratio[inner][peaks[inner]], strict=True)
    ]


def _wandering(recorded: Recorded, frequency_hz: float, given: Linear) -> Tone | None:
    """A tone near a frequency, its phase followed; None if that is none.

    A tone is narrow once its phase is followed, and steady. What noise drives may seem to be narrow, but its power has
    an exponential distribution: the mean square over the square of the mean is 2, of n independent values with a
    standard deviation of 2 / sqrt(n). There are as many as the narrowest mode forgets in the recording.
    """
    reach = max(WIDE * frequency_hz, LEAST_WIDE_HZ)
    if given.spindle is not None:
        reach = min(reach, 0.45 * given.spindle.speed_rpm / 60.0)
    t = np.arange(recorded.samples.size, dtype=np.float64)
    phase: Vector = 2.0 * np.pi * frequency_hz / recorded.rate_hz * t
    z = _slow(recorded, phase, reach)
    size = recorded.rate_hz * SMOOTHING_S
    narrowest = min(reach, *(mode.damping_ratio * mode.frequency_hz for mode in given.modes))
    independent = math.pi * narrowest * recorded.seconds
    if float(np.mean(np.abs(z) ** 4) / np.mean(np.abs(z) ** 2) ** 2) > 2.0 - STEADIER * 2.0 / math.sqrt(independent):
        return None
    power = ndimage.gaussian_filter1d(np.abs(z[:-1]) ** 2, size) + np.finfo(np.float64).tiny
    speed = ndimage.gaussian_filter1d(np.imag(np.conj(z[:-1]) * z[1:]), size) / power
    phase[1:] += np.cumsum(speed)
    phase = _followed(recorded, phase)
    if _narrowness(recorded, phase) < NARROW:
        return None
    return Tone(float(phase[-1]) / (2.0 * np.pi * (t.size - 1)) * recorded.rate_hz, 1.0, 0.0, phase)


def _narrowness(recorded: Recorded, phase: Vector) -> float:
    """Power along a phase over what is as wide beside it."""
    wave, around = (
        float(np.mean(np.abs(_slow(recorded, phase, width)) ** 2)) for width in (AMPLITUDE_HZ, 4.0 * AMPLITUDE_HZ)
    )
    return 3.0 * wave / max(around - wave, 1e-9 * wave)


def _orders(recorded: Recorded, tone: Tone, spindle: Spindle) -> list[Tone]:
    """Other orders of the spindle, once one is followed; which it is may be one off, for a stated speed is."""
    if tone.phase is None:
        raise ValueError("the tone has not been followed")
    nominal = round(tone.frequency_hz / spindle.speed_rpm * 60.0)
    crests = _crests(recorded)
    best: list[Tone] = []
    for order in range(max(nominal - 1, 1), nominal + 2):
        rotation_hz = tone.frequency_hz / order
        others = {round(frequency_hz / rotation_hz): frequency_hz for frequency_hz, _ in crests}
        found = []
        for other, frequency_hz in others.items():
            if other in (0, order) or abs(other * rotation_hz - frequency_hz) > 2.0 / SEGMENT_S:
                continue
            phase: Vector = tone.phase * (other / order)
            if _narrowness(recorded, phase) > NARROW:
                found.append(replace(tone, frequency_hz=other * rotation_hz, phase=_followed(recorded, phase)))
        best = max(best, found, key=len)
    return best


def _followed(recorded: Recorded, phase: Vector) -> Vector:
    """A phase with what is left of it in the recording."""
    return np.asarray(phase + np.unwrap(np.angle(_slow(recorded, phase, PHASE_HZ))))


def without_tones(recorded: Recorded, tones: Sequence[Tone]) -> Recorded:
    """A recording less what is in it at these frequencies, or along these phases.

    Near the ends, and beside what is missing, an amplitude that changes is not known: what is there is missing as well.
    """
    missing = recorded.missing
    if any(tone.phase is not None for tone in tones):
        missing = missing | (_low_pass(~missing, recorded.rate_hz, AMPLITUDE_HZ).real < KNOWN)
    rest = _less(recorded, tones)
    return replace(rest, samples=np.where(missing, 0.0, rest.samples), missing=missing)


def _less(recorded: Recorded, tones: Sequence[Tone]) -> Recorded:
    rest = recorded
    for tone in tones:
        if tone.phase is not None:
            wave = np.real(_slow(rest, tone.phase, AMPLITUDE_HZ) * np.exp(1j * tone.phase))
            rest = replace(rest, samples=rest.samples - wave)
    samples = rest.samples
    if waves := [wave for tone in tones if tone.phase is None for wave in tone.waves(recorded)]:
        columns, present = np.column_stack(waves), ~recorded.missing
        samples = samples - columns @ np.linalg.lstsq(columns[present], samples[present], rcond=None)[0]
    return replace(recorded, samples=np.where(recorded.missing, 0.0, samples))


def _slow(recorded: Recorded, phase: Vector, width_hz: float) -> NDArray[np.complex128]:
    """Complex amplitude of what is within some Hz of a wave whose phase is given, over what is missing."""
    present = ~recorded.missing
    wave = np.where(present, 2.0 * recorded.samples * np.exp(-1j * phase), 0.0)
    share = np.real(_low_pass(present, recorded.rate_hz, width_hz))
    return np.asarray(_low_pass(wave, recorded.rate_hz, width_hz) / np.maximum(share, 0.1))


def _low_pass(values: NDArray[Any], rate_hz: float, width_hz: float) -> NDArray[np.complex128]:
    """What is slow in values that are 0 before and after."""
    n = fft.next_fast_len(values.size + round(rate_hz / width_hz))
    away = np.abs(fft.fftfreq(n, 1.0 / rate_hz)) / width_hz
    window = np.where(away < 1.5, np.cos(0.5 * np.pi * np.clip(away - 0.5, 0.0, 1.0)) ** 2, 0.0)
    return np.asarray(fft.ifft(fft.fft(values.astype(np.complex128), n) * window)[: values.size])


def _chance(gain: float, samples: int) -> float:
    """How often noise at one of all frequencies gains that much, nats."""
    return min(1.0, samples / 2 * math.exp(-min(max(gain, 0.0), 700.0)))
