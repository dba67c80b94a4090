"""Simulated recordings of a machining system, with the truth about them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from chatter_monitor.errors import InputError
from chatter_monitor.kernels.oscillator import OK, integrate
from chatter_monitor.physics.excitation import random_force
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.sensor import sense
from chatter_monitor.physics.truth import Truth, truth_of

STEPS_PER_PERIOD = 40  # of the fastest mode: relative frequency error 5e-6 and false damping 7e-7 from Runge-Kutta
LEAST_OVERSAMPLING = 4  # keeps eq. (6) within 0.5 dB of white up to half the output rate
_REACH = 32  # of the anti-alias filter, in output samples: flat to 0.45, 90 dB down from 0.55 of the output rate


@dataclass(frozen=True)
class Simulation:
    """A simulated recording.

    Attributes
    ----------
    system : MachiningSystem
        What was simulated.
    seed : int
        Of every random number in it.
    sample_rate_hz : float
        Of the arrays.
    signal : ndarray of float64, shape (n,)
        What the sensor delivers.
    displacement, velocity : ndarray of float64, shape (n,)
        Motion of the tool in u and u/s, band-limited like the signal.
    out_of_cut : ndarray of bool, shape (n,)
        Whether the tool has left the cut.
    """

    system: MachiningSystem
    seed: int
    sample_rate_hz: float
    signal: NDArray[np.float64]
    displacement: NDArray[np.float64]
    velocity: NDArray[np.float64]
    out_of_cut: NDArray[np.bool_]

    @cached_property
    def truth(self) -> Truth:
        """Characteristic roots along the recording and the stretches of chatter; computed at first use."""
        return truth_of(self.system, self.out_of_cut, self.sample_rate_hz, self.seed)


def simulate(
    system: MachiningSystem,
    duration_s: float,
    seed: int,
    sample_rate_hz: float = 12800.0,
    *,
    settle_s: float = 0.0,
    force: NDArray[np.float64] | None = None,
) -> Simulation:
    """Simulate a machining system from rest.

    Parameters
    ----------
    system : MachiningSystem
        Model with everything that drifts.
    duration_s : float
        Length of the recording. It is held in memory at the integration rate, about 3 MB a second.
    seed : int
        The same seed gives the same recording.
    sample_rate_hz : float
        Rate of the recording. The integration step is a whole fraction of it, set by the fastest mode.
    settle_s : float
        How long to run before the recording starts, with the parameters of its first sample.
    force : ndarray of float64, shape (n,), optional
        Measured force per unit mass in u/s^2 at the samples of the recording, for excitation "measured";
        interpolated linearly.

    Returns
    -------
    Simulation

    Raises
    ------
    InputError
        When the motion grows without bound, when the delay is too short for the step, or when `force` does not fit.
    """
    oversampling = max(LEAST_OVERSAMPLING, math.ceil(STEPS_PER_PERIOD * _fastest_hz(system) / sample_rate_hz))
    step_s = 1.0 / (sample_rate_hz * oversampling)
    samples, settling = round(duration_s * sample_rate_hz), round(settle_s * sample_rate_hz)
    if samples < 1:
        raise InputError("the simulation is too short", got=duration_s, allowed="at least one sample")
    steps, start = (settling + samples + _REACH) * oversampling, settling * oversampling
    rng = np.random.default_rng(seed)
    time_s = np.arange(-start, steps - start + 1, dtype=np.float64) * step_s
    drive = _drive(system, time_s, step_s, rng, force, samples, sample_rate_hz)
    history = _history(system, time_s, step_s)
    x, v, a = np.zeros(steps), np.zeros(steps), np.zeros(steps)
    surface = np.zeros((2, history + steps if history else 0))
    status = integrate(system.oscillator(start * step_s), drive, step_s, history, surface, x, v, a)
    if status != OK:
        raise InputError(
            f"the simulated vibration grows without bound and left the range of numbers at {time_s[status]:.3f} s",
            remedy="Limit it by loss_of_contact or energy_damping, or make the cut stable.",
        )
    recorded = slice(settling, settling + samples)
    displacement, velocity, acceleration = (_decimate(fine, oversampling)[recorded] for fine in (x, v, a))
    output = sense(system.sensor, displacement, velocity, acceleration, sample_rate_hz, rng)
    left = surface[0, history:] < x if history else np.zeros(steps, dtype=bool)
    out_of_cut = left[::oversampling][recorded]
    return Simulation(system, seed, sample_rate_hz, output, displacement, velocity, out_of_cut)


def _drive(
    system: MachiningSystem,
    time_s: NDArray[np.float64],
    step_s: float,
    rng: np.random.Generator,
    force: NDArray[np.float64] | None,
    samples: int,
    sample_rate_hz: float,
) -> NDArray[np.float64]:
    """W at the integration steps."""
    if system.excitation.kind != "measured":
        if force is not None:
            raise InputError("a measured force was given", got=system.excitation.kind, allowed='kind = "measured"')
        return random_force(system, time_s, step_s, rng)
    if force is None:
        raise InputError('excitation is "measured", but no force was given', remedy="Give the recording of the force.")
    if force.shape != (samples,):
        raise InputError("the measured force does not fit the recording", got=force.shape, allowed=f"{(samples,)}")
    return np.interp(time_s * sample_rate_hz, np.arange(samples), force, left=0.0)


def _decimate(fine: NDArray[np.float64], factor: int) -> NDArray[np.float64]:
    """Every so many-th sample after a linear-phase low-pass that delays nothing."""
    taps = signal.firwin(2 * _REACH * factor + 1, 1.0 / factor, window=("kaiser", 9.0))
    return np.asarray(signal.upfirdn(taps, fine, down=factor)[_REACH:], dtype=np.float64)


def _fastest_hz(system: MachiningSystem) -> float:
    """Highest frequency that the integration has to follow: of the modes and of the periodic forces."""
    frequencies = [mode.frequency_hz for mode in system.modes]
    frequencies += [max(d.value) for d in system.drifts if d.parameter.endswith(".frequency_hz")]
    if system.spindle:
        speeds = [system.spindle.speed_rpm]
        speeds += [max(d.value) for d in system.drifts if d.parameter == "spindle.speed_rpm"]
        orders = [a.values[i] for a in system.terms for i, p in enumerate(a.term.parameters) if p.name == "order"]
        frequencies += [order * max(speeds) / 60.0 for order in orders]
    return max(frequencies)


def _history(system: MachiningSystem, time_s: NDArray[np.float64], step_s: float) -> int:
    """Steps of the past that the delay reaches back; none without a delay."""
    if not system.delayed or system.spindle is None:
        return 0
    speed_rpm = system.drifting("spindle.speed_rpm", time_s, system.spindle.speed_rpm)
    delays = 60.0 / (system.spindle.teeth * speed_rpm) / step_s
    if delays.min() < 2.0:
        raise InputError("the teeth follow each other too fast for the integration step", got=system.spindle)
    return int(np.ceil(delays.max())) + 2
