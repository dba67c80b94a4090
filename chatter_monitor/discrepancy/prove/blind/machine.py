"""From an effect and its strength to a motion: the random force, the settling, and the amplitude that is asked for."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from chatter_monitor.discrepancy.prove.blind import laws
from chatter_monitor.discrepancy.prove.blind.chain import RATE_HZ
from chatter_monitor.discrepancy.prove.blind.motion import FINITE, Hidden, march, noise_factor

Array = NDArray[np.float64]

_TRIAL_S = 8.0  # length of the runs that look for the amplitude
_TRIALS = 8
_CLOSE = 0.05  # relative distance to the strength asked for that ends the search
_FARTHEST = 9.0  # rms displacements: beyond, the motion has left the well
_LOUDEST = 2.5  # over the linear motion: beyond, the cut is at its limit of stability


@dataclass(frozen=True)
class Machine:
    """The linear part and its random force; the linear motion is 1 u rms.

    Attributes
    ----------
    frequency_hz, damping_ratio : float
        The mode.
    second : tuple of float, optional
        Frequency, damping ratio and weight of another mode that the same force drives.
    corner_hz : float, optional
        The force passes a second-order low-pass of this corner; white otherwise.
    impacts_per_s, impact_share : float
        Rate of impacts, and their share of the intensity.
    swell_hz, swell_depth : float
        Modulation of the force.
    """

    frequency_hz: float
    damping_ratio: float
    second: tuple[float, float, float] | None = None
    corner_hz: float | None = None
    impacts_per_s: float = 0.0
    impact_share: float = 0.0
    swell_hz: float = 0.0
    swell_depth: float = 0.0

    @property
    def w(self) -> float:
        """Angular frequency of the mode."""
        return 2.0 * math.pi * self.frequency_hz

    @property
    def intensity(self) -> float:
        """Variance per second of the white force; the displacement of the mode has variance 1."""
        return 4.0 * self.damping_ratio * self.w**3

    @property
    def oversampling(self) -> int:
        """Steps per sample: 145 per period of the mode or more."""
        return 8 if self.frequency_hz < 700.0 else 16


@dataclass(frozen=True)
class Motion:
    """A motion at the fine rate, and the hidden force at the samples of the recording."""

    x: Array
    v: Array
    force: Array
    oversampling: int
    strength: float
    rms_x: float
    rms_v: float


class Escaped(Exception):
    """The motion grew without bound or left the potential well."""


def move(machine: Machine, hidden: Hidden, seconds: float, seed: list[int], oversampling: int) -> Motion:
    """Run the machine with what is hidden in it; the same seed and oversampling give the same random force.

    Raises
    ------
    Escaped
        When the motion is not that of a machine any more.
    """
    step_s = 1.0 / (RATE_HZ * oversampling)
    settling = math.ceil(8.0 / (machine.damping_ratio * machine.w) * RATE_HZ) * oversampling
    n = settling + round(seconds * RATE_HZ) * oversampling
    start_s = -settling * step_s
    modes = [(machine.w, machine.damping_ratio)]
    if machine.second:
        modes.append((2.0 * math.pi * machine.second[0], machine.second[1]))
    increments, drive = _force(machine, modes, n, step_s, start_s, np.random.default_rng(seed))
    x, v, force = np.zeros(n), np.zeros(n), np.zeros(n)
    status = march(hidden, machine.damping_ratio, step_s, increments[:, :2].copy(), drive, start_s, x, v, force)
    if status != FINITE:
        raise Escaped
    x, v, force = x[settling:], v[settling:], force[settling:]
    time_s = np.arange(0, x.size, oversampling, dtype=np.float64) * step_s
    own = strength(hidden, x[::oversampling], v[::oversampling], force[::oversampling], time_s)
    rms_x, rms_v = float(x.std()), float(v.std())
    if hidden.law != laws.NONE and (np.abs(x).max() > _FARTHEST * rms_x or rms_x > _LOUDEST):
        raise Escaped
    if machine.second:
        other = Hidden(laws.NONE, np.zeros(1), modes[1][0])
        x2, v2 = np.zeros(n), np.zeros(n)
        march(other, modes[1][1], step_s, increments[:, 2:].copy(), drive, start_s, x2, v2, np.zeros(n))
        x, v = x + machine.second[2] * x2[settling:], v + machine.second[2] * v2[settling:]
    return Motion(x, v, force[::oversampling], oversampling, own, rms_x, rms_v)


def _force(
    machine: Machine,
    modes: list[tuple[float, float]],
    n: int,
    step_s: float,
    start_s: float,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Increments of the states of all modes by the white force, and the smooth force where it is coloured."""
    if machine.corner_hz:
        nyquist = 0.5 / step_s
        b, a = signal.bessel(2, machine.corner_hz / nyquist, norm="mag")
        level = abs(signal.freqz(b, a, [machine.frequency_hz], fs=2.0 * nyquist)[1][0])
        white = rng.standard_normal(n) * math.sqrt(machine.intensity / step_s) / level
        return np.zeros((n, 2 * len(modes))), np.asarray(signal.lfilter(b, a, white))
    factor = noise_factor(modes, step_s) * math.sqrt(machine.intensity * (1.0 - machine.impact_share))
    increments = rng.standard_normal((n, factor.shape[0])) @ factor.T
    if machine.swell_depth:
        swell = 1.0 + machine.swell_depth * np.cos(
            2.0 * math.pi * machine.swell_hz * (start_s + np.arange(n) * step_s) + rng.uniform(0.0, 6.28)
        )
        increments *= (swell / math.sqrt(1.0 + 0.5 * machine.swell_depth**2))[:, None]
    if machine.impact_share:
        struck = np.flatnonzero(rng.random(n) < machine.impacts_per_s * step_s)
        size = math.sqrt(machine.intensity * machine.impact_share / machine.impacts_per_s)
        increments[struck, 1::2] += size * rng.standard_normal(struck.size)[:, None]
    return increments, np.zeros(0)


def strength(hidden: Hidden, x: Array, v: Array, force: Array, time_s: Array) -> float:
    """Share of the rms restoring force that no linear spring, damper and constant can imitate, where the force acts."""
    acts = (time_s >= hidden.from_s) & (time_s < hidden.until_s) & (x**2 + (v / hidden.w) ** 2 >= hidden.above**2)
    if hidden.law == laws.NONE or acts.sum() < 100:
        return 0.0
    linear = np.column_stack([x, v / hidden.w, np.ones_like(x)])[acts]
    fitted = linear @ np.linalg.lstsq(linear, force[acts], rcond=None)[0]
    return float(np.std(force[acts] - fitted) / (hidden.w**2 * np.std(x[acts])))


def with_strength(
    machine: Machine, hidden: Hidden, units: str, wanted: float, sign: float, above: float, seed: list[int]
) -> Hidden:
    """Amplitude that gives a force its strength, with the shapes in units of the motion that results.

    Parameters
    ----------
    machine : Machine
        What it is hidden in.
    hidden : Hidden
        Law, window and shapes; `p[1:]` in the `units` given, a letter each: x or v for the rms of the motion.
    units : str
        Of the shapes.
    wanted, sign : float
        Strength, and sign of the amplitude.
    above : float
        Amplitude above which the force acts, in rms displacements.
    seed : list of int
        Of the random force of the trials.

    Raises
    ------
    Escaped
        When the machine does not bear it.
    """
    relative, coarse = hidden.p.copy(), machine.oversampling // 2
    amplitude, rms_x, rms_v = 1e-9, 1.0, machine.w
    found = hidden
    for trial in range(_TRIALS):
        scale = [{"x": rms_x, "v": rms_v}.get(unit, 1.0) for unit in units]
        p = np.array([sign * amplitude, *(relative[1:] * np.array(scale))])
        found = hidden._replace(p=p, above=above * rms_x)
        # The window is in seconds of the recording, which the trials are too short for: they run with it open.
        motion = move(machine, found._replace(from_s=-math.inf, until_s=math.inf), _TRIAL_S, seed, coarse)
        ratio = wanted / motion.strength
        if abs(ratio - 1.0) < _CLOSE:
            break
        # Friction takes the motion down as it grows, so its strength grows faster than its amplitude: short steps.
        amplitude *= ratio if trial == 0 else min(max(ratio**0.6, 0.5), 2.0)
        rms_x, rms_v = motion.rms_x, motion.rms_v
    return found
