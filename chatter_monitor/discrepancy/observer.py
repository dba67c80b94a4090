"""The steady Kalman filter of the linear part of a machine, from its physical parameters."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from chatter_monitor.kernels.observer import NODES, Observer
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Mode, Quantity, Spindle

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Complexes = NDArray[np.complexfloating]

LEAST_NOISE = 1e-9
FORGETS = 0.9995  # share of an error that may be left a sample later


@dataclass(frozen=True, slots=True)
class Linear:
    """A linear machine in white noise, seen through a noisy sensor.

    Attributes
    ----------
    modes : tuple of Mode
    quantity : str
        What the sensor measures.
    noise : float
        Variance of the sensor's noise over that of the signal.
    low_cut_hz : float
        High-pass of a microphone, for "pressure".
    spindle : Spindle, optional
    corner_hz : float, optional
        Of a second-order low-pass of the force.
    delay_s, regeneration : float, optional
        Delay and coefficient of a delayed spring on the tool, relative to the first mode's w^2.
    """

    modes: tuple[Mode, ...]
    quantity: Quantity
    noise: float
    low_cut_hz: float = 20.0
    spindle: Spindle | None = None
    corner_hz: float | None = None
    delay_s: float | None = None
    regeneration: float = 0.0

    @classmethod
    def of(cls, system: MachiningSystem, regeneration: AppliedTerm | None = None) -> Linear:
        """The linear part of a model, with the regeneration that it has; the noise is where a fit begins."""
        sensor, spindle = system.sensor, system.spindle
        linear = cls(system.modes, sensor.quantity, 1e-3, sensor.low_cut_hz, spindle)
        if regeneration is None or spindle is None:
            return linear
        return replace(linear, delay_s=spindle.delay_s, regeneration=regeneration.parameters["coefficient"])

    def receptance(self, frequency_hz: Vector) -> Complexes:
        """Displacement for a force at each frequency, without regeneration."""
        s = 2j * np.pi * frequency_hz
        receptance = np.zeros_like(s)
        for mode in self.modes:
            receptance += mode.participation**2 / (s**2 + 2.0 * mode.damping_ratio * mode.omega * s + mode.omega**2)
        return receptance

    def sensed(self, frequency_hz: Vector) -> Complexes:
        """What the sensor measures for a displacement at each frequency."""
        s = 2j * np.pi * frequency_hz
        measured: Complexes = s ** {"displacement": 0, "velocity": 1, "acceleration": 2, "pressure": 2}[self.quantity]
        return measured * s / (s + 2.0 * np.pi * self.low_cut_hz) if self.quantity == "pressure" else measured

    def retuned(self, mode: Mode) -> Linear:
        """With another first mode, force and sensor as they are.

        `noise` is relative to a motion whose variance goes with the reciprocal of the damping ratio.
        """
        noise = self.noise * mode.damping_ratio / self.modes[0].damping_ratio
        return replace(self, modes=(mode, *self.modes[1:]), noise=noise)

    def beside(self, spring: float, damper: float) -> Linear:
        """With a spring and a damper more, per unit mass; negative ones are those that it had in place of a term."""
        if spring == damper == 0.0:
            return self
        mode = self.modes[0]
        omega = math.sqrt(max(mode.omega**2 + spring, 0.25 * mode.omega**2))
        ratio = max((2.0 * mode.damping_ratio * mode.omega + damper) / (2.0 * omega), 0.1 * mode.damping_ratio)
        return self.retuned(replace(mode, frequency_hz=omega / (2.0 * math.pi), damping_ratio=ratio))


def observer(linear: Linear, rate_hz: float, knows_forces: bool = False) -> Observer:
    """Steady Kalman filter of a linear machine at a sample rate.

    The covariance that is left to the state, which averages the forces, is in units of the driving noise: its size
    follows from the recording, see `sized`.

    Parameters
    ----------
    linear : Linear
    rate_hz : float
    knows_forces : bool
        Forces that it knows are averaged over what the tool does beyond the band, too.

    Raises
    ------
    numpy.linalg.LinAlgError
        If no steady filter exists.
    """
    A, force, H, D, tool = _continuous(linear)
    step_s = 1.0 / rate_hz
    phi, begin, end = _hold(A, force, step_s)
    # White noise that is sampled folds its whole spectrum into the band, a recording does not: it has been filtered.
    # Displacement falls off fast enough for that not to matter. For the others the force is a random number per
    # sample, which keeps the zeros of their response at 0 Hz: held for a velocity; joined by straight lines, with a
    # state of its own, for what feels the force itself.
    felt, intensity = float(tool[1] @ force), step_s  # by the tool; of white noise that is as strong, in units of Q
    match linear.quantity:
        case "displacement":
            Q, intensity = _noise(A, force, step_s), 1.0
        case "velocity":
            Q = np.outer(begin + end, begin + end)
        case "acceleration" | "pressure":
            size = linear.modes[0].omega ** 2  # of the force's states, so that all states are of one order
            weights = unbent(linear.modes[0].omega * step_s)
            now, *before = (begin * w + end * later for w, later in pairwise([*weights, 0.0]))
            # Beside the machine's states: the random force of the last sample, then all force of those before it.
            lags = len(before)
            phi = np.block(
                [[phi, size * np.column_stack([now, *before])], [np.zeros((1 + lags, force.size + 1 + lags))]]
            )
            phi[-lags:, -1 - lags : -1] = np.eye(lags)
            unit = np.concatenate([size * end, [1.0], np.zeros(lags)])
            Q, intensity = np.outer(unit, unit), size**2 * step_s
            H, tool = np.pad(np.append(H, size * D), (0, lags)), np.pad(tool, ((0, 0), (0, 1 + lags)))
            begin = np.pad(np.append(now, [0.0, 1.0 / size]), (0, lags - 1))
            end = np.pad(end, (0, 1 + lags))
    variance = float(H @ linalg.solve_discrete_lyapunov(phi, Q) @ H)
    Q, intensity = Q / variance, intensity / variance
    ahead, S, K = _steady(phi, Q, H, max(linear.noise, LEAST_NOISE))
    after = ahead - np.outer(K, K) * S
    on_the_way: list[Matrix] = [after] * (2 * len(NODES))  # a sensor that feels the force needs none of them
    if D == 0.0:
        on_the_way = _along_step(A, force, H, step_s, after, intensity, S)
    tools = [tool @ covariance @ tool.T for covariance in (*on_the_way, after, ahead)]
    if knows_forces:
        beyond = intensity * felt**2 * _beyond_band(step_s)
        tools = [covariance + beyond for covariance in tools]
    spread = np.array([_root(covariance / S) for covariance in tools])
    back = tool @ after @ phi.T @ H / S
    spindle = linear.spindle
    delay = spindle.delay_s * rate_hz if spindle else 0.0
    turn = spindle.omega * step_s if spindle else 0.0
    omega = linear.modes[0].omega
    return Observer(phi, begin, end, K, H, D, tool, spread, back, step_s, omega, delay, turn)


def sized(steady: Observer, error_sd: float) -> Observer:
    """The observer with the spread of the state that belongs to prediction errors of that standard deviation."""
    return steady._replace(spread=steady.spread * error_sd)


def _steady(phi: Matrix, Q: Matrix, H: Matrix, noise: float) -> tuple[Matrix, float, Matrix]:
    """Covariance before a sample is seen, variance of its error, and gain.

    With hardly any noise the filter of a sensor that does not see 0 Hz forgets nothing; it then gets the least noise
    with which it does.
    """
    while True:
        try:
            ahead = linalg.solve_discrete_are(phi.T, H[:, None], Q, np.array([[noise]]))
        except ValueError:  # too ill-conditioned, as two modes of one frequency are with hardly any noise
            if noise > 1.0:
                raise
            noise *= 4.0
            continue
        S = float(H @ ahead @ H + noise)
        K = ahead @ H / S
        closed = phi - np.outer(phi @ K, H)
        if np.max(np.abs(np.linalg.eigvals(closed))) < FORGETS or noise > 1.0:
            return ahead, S, K
        noise *= 4.0


def _continuous(linear: Linear) -> tuple[Matrix, Matrix, Matrix, float, Matrix]:
    """A, force input, H, D and the tool's rows; velocities are in units of the first mode's w x."""
    modes, w0 = linear.modes, linear.modes[0].omega
    m = len(modes)
    size = 2 * m + (linear.quantity == "pressure")
    A, force, tool = np.zeros((size, size)), np.zeros(size), np.zeros((2, size))
    for i, mode in enumerate(modes):
        g = mode.participation
        A[i, m + i] = w0
        A[m + i, i] = -(mode.omega**2) / w0
        A[m + i, m + i] = -2.0 * mode.damping_ratio * mode.omega
        force[m + i] = -g / w0
        tool[0, i], tool[1, m + i] = g, g * w0
    acceleration, felt = tool[1] @ A, float(tool[1] @ force)
    match linear.quantity:
        case "displacement":
            return A, force, tool[0], 0.0, tool
        case "velocity":
            return A, force, tool[1], 0.0, tool
        case "acceleration":
            return A, force, acceleration, felt, tool
        case "pressure":
            cut = 2.0 * np.pi * linear.low_cut_hz
            A[-1] = cut * acceleration / w0**2
            A[-1, -1] -= cut
            force[-1] = cut * felt / w0**2
            return A, force, acceleration - w0**2 * np.eye(size)[-1], felt, tool


def _hold(A: Matrix, force: Matrix, step_s: float) -> tuple[Matrix, Matrix, Matrix]:
    """Transition, and the answer to a force that changes linearly over the step, by its ends."""
    n = A.shape[0]
    big = np.zeros((n + 2, n + 2))
    big[:n, :n] = A * step_s
    big[:n, n] = force * step_s
    big[n, n + 1] = 1.0
    exponential = linalg.expm(big)
    constant, ramp = exponential[:n, n], exponential[:n, n + 1]
    return exponential[:n, :n].copy(), constant - ramp, ramp.copy()


def unbent(turn: float) -> Vector:
    """Weights of a force at a sample and at the three before; straight lines then join what they add up to.

    Straight lines through the samples of a vibration have a share sinc(turn / 2)^2 of its amplitude (1.7 % are lost at
    14 samples a period). The weights give back what the mode's frequency loses, without any phase, and leave a constant
    force as it is. That of the newest sample stays 1: see docs/decisions/0066-straight-lines-lose-amplitude.md.

    Parameters
    ----------
    turn : float
        Angle of the mode's vibration per sample, rad.

    Returns
    -------
    ndarray of float64, shape (4,)
    """
    lags = np.arange(1.0, 4.0)
    lost = float(np.sinc(0.5 * turn / np.pi)) ** 2
    given_back = np.linalg.solve([np.ones(3), np.cos(turn * lags), np.sin(turn * lags)], [0.0, 1.0 / lost - 1.0, 0.0])
    return np.append(1.0, given_back)


def _noise(A: Matrix, force: Matrix, step_s: float) -> Matrix:
    """Covariance of what white noise adds over a step (Van Loan 1978)."""
    n = A.shape[0]
    big = np.zeros((2 * n, 2 * n))
    big[:n, :n] = -A * step_s
    big[:n, n:] = np.outer(force, force) * step_s
    big[n:, n:] = A.T * step_s
    exponential = linalg.expm(big)
    Q = exponential[n:, n:].T @ exponential[:n, n:]
    return np.asarray(0.5 * (Q + Q.T))


def _along_step(
    A: Matrix, force: Matrix, H: Matrix, step_s: float, after: Matrix, intensity: float, S: float
) -> list[Matrix]:
    """Covariance of the state at the nodes of a step, before the sample at its end is seen, and then after.

    White noise of that intensity drives it; S is the variance of that sample's prediction error.
    """
    before, seen = [], []
    for s in NODES:
        begun, left = linalg.expm(A * s * step_s), linalg.expm(A * (1.0 - s) * step_s)
        P = begun @ after @ begun.T + intensity * _noise(A, force, s * step_s)
        told = P @ left.T @ H
        before.append(P)
        seen.append(P - np.outer(told, told) / S)
    return before + seen


def _beyond_band(step_s: float) -> Matrix:
    """Covariance of displacement and velocity at frequencies that sampling at that step leaves out, for a unit mass.

    What white noise of unit intensity moves there: densities 1 / w^4 and 1 / w^2 above the edge, which no sample tells.
    """
    edge = math.pi / step_s
    return np.diag([1.0 / (3.0 * math.pi * edge**3), 1.0 / (math.pi * edge)])


def _root(P: Matrix) -> Matrix:
    """Square root of the covariance of displacement and velocity; its first column holds all of the velocity."""
    a = np.sqrt(max(P[1, 1], 0.0))
    b = P[0, 1] / a if a > 0.0 else 0.0
    return np.array([[b, np.sqrt(max(P[0, 0] - b * b, 0.0))], [a, 0.0]])
