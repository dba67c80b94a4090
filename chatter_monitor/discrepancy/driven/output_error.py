"""A model driven by the measured force, fitted to the recording by its output error: nothing corrects it on the way."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from scipy import signal as dsp

from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.case import BLOCK_S
from chatter_monitor.errors import InputError
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Excitation, Mode
from chatter_monitor.physics.simulate import simulate

Vector = NDArray[np.float64]

LONGEST_RUN_S = 60.0
_STEPS = 5  # Gauss-Newton
_UPSAMPLING = 4  # of the force: it is no straight line between its samples
_SETTLES = 8.0  # time constants of the mode, before which a free run does not count
_DERIVATIVE_STEP = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class FreeRun:
    """A model that was driven by the measured force and fitted to the recording.

    Attributes
    ----------
    system : MachiningSystem
    error : float
        Rms difference on held-out stretches over the rms of the recording there.
    """

    system: MachiningSystem
    error: float


def free_run(model: MachiningSystem, force: Recorded, displacement: Recorded, mass: float) -> FreeRun | None:
    """Drive a model by the measured force and fit it to the recording (output error, Gauss-Newton).

    Training stretches alone are fitted; the error is that on the held-out ones. The offset of the force is fitted, too.

    Parameters
    ----------
    model : MachiningSystem
        Where to begin.
    force, displacement : Recorded
    mass : float
        Input per unit of acceleration to begin with.

    Returns
    -------
    FreeRun or None
        None if it grows without bound.
    """
    count = min(force.samples.size, round(LONGEST_RUN_S * force.rate_hz))
    rate = force.rate_hz
    push = np.asarray(dsp.resample_poly(np.where(force.missing, 0.0, force.samples)[:count], _UPSAMPLING, 1))
    y = displacement.samples[:count]
    mode = model.modes[0]
    settles = round(_SETTLES / max(mode.damping_ratio * mode.omega, 1e-9) * rate)
    counts = ~displacement.missing[:count] & (np.arange(count) >= min(settles, count // 4))
    training = (np.arange(count) // max(1, round(BLOCK_S * rate))) % 2 == 0
    moving = [(i, p.name) for i, a in enumerate(model.terms) for p in a.term.parameters if a.parameters.get(p.name)]

    def built(at: Vector) -> MachiningSystem:
        terms = [AppliedTerm(a.term, dict(a.parameters)) for a in model.terms]
        values = [dict(a.parameters) for a in terms]
        for (i, name), factor in zip(moving, at[4:], strict=True):
            values[i][name] = values[i][name] * float(factor)
        fitted = Mode(mode.frequency_hz * float(at[0]), mode.damping_ratio * float(at[1]))
        terms = [AppliedTerm(a.term, v) for a, v in zip(terms, values, strict=True)]
        return replace(model, modes=(fitted,), terms=tuple(terms), excitation=Excitation("measured"))

    def run(at: Vector) -> Vector:
        pushed = float(at[2]) / mass * push + float(at[3]) * float(np.std(push)) / mass
        moved = simulate(built(at), count / rate, 0, rate * _UPSAMPLING, force=pushed).displacement[::_UPSAMPLING]
        return np.asarray(moved - np.mean(moved[counts]))

    mean = float(np.mean(y[counts]))
    start = np.array([1.0, 1.0, 1.0, 0.0, *[1.0] * len(moving)])
    use = counts & training

    def misfit(at: Vector) -> Vector:
        return np.asarray((run(at) - y + mean)[use])

    try:
        found = optimize.least_squares(misfit, start, diff_step=np.full(start.size, _DERIVATIVE_STEP), max_nfev=_STEPS)
        error = (run(found.x) - y + mean)[counts & ~training]
    except InputError:
        return None
    system = replace(built(found.x), excitation=replace(model.excitation, kind="white_noise"))
    return FreeRun(system, float(np.std(error) / np.std(y[counts & ~training])))
