"""A machine simulated independently of `chatter_monitor.physics`, for the tests of the discrepancy engine.

Strang splitting: the linear oscillator is propagated exactly, the extra force and the noise kick its velocity.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import signal

OVERSAMPLING = 16
EFFECTS = (
    "none", "hardening", "softening", "quadratic", "clearance", "coulomb", "stribeck", "hysteresis", "v|v|", "x2v",
    "cutting", "delay", "notch", "root", "mathieu", "memory", "one side", "one direction", "far delay",
)  # fmt: skip


@dataclass(frozen=True)
class Machine:
    """A mode with one extra force; the strength is its share of the rms restoring force that nothing linear makes.

    The force may act in a stretch only, or only above an amplitude sqrt(x^2 + (v / w)^2).
    """

    effect: str = "none"
    strength: float = 0.05
    frequency_hz: float = 400.0
    damping_ratio: float = 0.02
    quantity: str = "displacement"
    seconds: float = 20.0
    rate_hz: float = 12800.0
    snr_db: float = 34.0
    delay_s: float = 0.02
    between_s: tuple[float, float] | None = None
    above: float = 0.0


@njit(cache=True)
def _force(effect, c, x, v, lagged, z, w, t):
    if effect == 0:  # none
        return 0.0
    if effect <= 2:  # hardening, softening
        return c * w * w * x**3
    if effect == 3:  # quadratic
        return c * w * w * x**2
    if effect == 4:  # clearance
        return c * w * w * (x - min(max(x, -1.0), 1.0))
    if effect == 5:  # coulomb
        return c * np.sign(v)
    if effect == 6:  # stribeck
        return c * np.sign(v) * (0.3 + np.exp(-((v / (0.5 * w)) ** 2)))
    if effect == 7:  # hysteresis
        return c * w * w * z
    if effect == 8:  # v|v|
        return c * v * abs(v)
    if effect == 9:  # x2v
        return c * x * x * v
    if effect == 10:  # cutting
        return c * (v * v + 0.5 * v**3 / w)
    if effect == 11:  # delay
        return c * w * w * (x - lagged)
    if effect == 12:  # notch
        return c * w * w * x * np.exp(-(((x - 0.8) / 0.2) ** 2))
    if effect == 13:  # root
        return c * np.sign(v) * np.sqrt(abs(v))
    if effect == 14:  # mathieu
        return c * w * w * x * np.cos(0.37 * w * t)
    if effect == 15:  # memory
        return c * w * w * x * z
    if effect == 16:  # dry friction on one side
        return c * np.sign(v) if x > 0.0 else 0.0
    if effect == 17:  # damping in one direction
        return c * w * max(v, 0.0)
    if effect == 18:  # a delay at large displacements
        return c * w * w * lagged if abs(x) > 1.3 else 0.0
    raise ValueError


@njit(cache=True)
def _rate(effect, x, v, z, w):
    if effect == 15:  # the energy of the last tenth of a second
        return (0.5 * (x * x + (v / w) ** 2) - z) / 0.1
    return v - 0.5 * (abs(v) * z + v * abs(z)) / 0.7


@njit(cache=True)
def _run(effect, c, w, zeta, kick, pushes, dt, lag, begin, end, above):
    wd = w * np.sqrt(1.0 - zeta * zeta)
    decay = np.exp(-zeta * w * dt)
    cos, sin = np.cos(wd * dt), np.sin(wd * dt)
    a11 = decay * (cos + zeta * w / wd * sin)
    a12 = decay * sin / wd
    a21 = -decay * w * w / wd * sin
    a22 = decay * (cos - zeta * w / wd * sin)
    n = pushes.size
    xs, vs = np.zeros(n), np.zeros(n)
    acc = np.zeros(n)
    x = v = z = 0.0
    for k in range(n):
        lagged = xs[k - lag] if k >= lag > 0 else 0.0
        t = k * dt
        acts = begin <= t < end and x * x + (v / w) ** 2 >= above * above
        f = _force(effect, c, x, v, lagged, z, w, t) if acts else 0.0
        xs[k], vs[k] = x, v
        half = kick * pushes[k]
        acc[k] = half / dt - f - 2.0 * zeta * w * v - w * w * x
        v += 0.5 * (half - f * dt)
        r = _rate(effect, x, v, z, w)
        x, v = a11 * x + a12 * v, a21 * x + a22 * v
        z += dt * 0.5 * (r + _rate(effect, x, v, z + dt * r, w))
        lagged = xs[k + 1 - lag] if k + 1 >= lag > 0 else 0.0
        v += 0.5 * half
        for _ in range(2):  # the force at the end of the step, implicitly
            f = _force(effect, c, x, v - 0.5 * dt * f if _ else v, lagged, z, w, t + dt)
        f = f if acts else 0.0
        v -= 0.5 * f * dt
    return xs, vs, acc


def states(machine: Machine, c: float, seed: int) -> tuple[NDArray[np.float64], ...]:
    """Displacement, velocity and acceleration at `OVERSAMPLING` times the rate, with that coefficient of the force."""
    rng = np.random.default_rng(seed)
    w = 2.0 * np.pi * machine.frequency_hz
    dt = 1.0 / machine.rate_hz / OVERSAMPLING
    settle = int(8.0 / (machine.damping_ratio * w) * machine.rate_hz) * OVERSAMPLING
    steps = int(machine.seconds * machine.rate_hz) * OVERSAMPLING + settle
    kick = np.sqrt(4.0 * machine.damping_ratio * w**3 * dt)  # displacement of 1 rms
    begin, end = machine.between_s or (-np.inf, np.inf)
    lag = round(machine.delay_s / dt)
    shift = settle * dt
    return tuple(
        a[settle:]
        for a in _run(
            EFFECTS.index(machine.effect), c, w, machine.damping_ratio, kick, rng.standard_normal(steps), dt, lag,
            begin + shift, end + shift, machine.above,
        )
    )  # fmt: skip


def coefficient(machine: Machine) -> float:
    """Coefficient that gives the force its strength, measured along a linear run."""
    w = 2.0 * np.pi * machine.frequency_hz
    short = replace(machine, effect="none", seconds=min(machine.seconds, 8.0))
    x, v, _ = states(short, 0.0, 999)
    dt = 1.0 / machine.rate_hz / OVERSAMPLING
    force = _along(EFFECTS.index(machine.effect), x, v, w, dt, round(machine.delay_s / dt))
    linear = np.column_stack([x, v])
    rest = force - linear @ np.linalg.lstsq(linear, force, rcond=None)[0]
    c = machine.strength * w * w * np.std(x) / np.std(rest)
    return -c if machine.effect == "softening" else c


@njit(cache=True)
def _along(effect, x, v, w, dt, lag):
    force = np.zeros(x.size)
    z = 0.0
    for k in range(x.size):
        lagged = x[k - lag] if k >= lag else 0.0
        force[k] = _force(effect, 1.0, x[k], v[k], lagged, z, w, k * dt)
        z += dt * _rate(effect, x[k], v[k], z, w)
    return force


def record(machine: Machine, seed: int) -> NDArray[np.float64]:
    """What the sensor records, shape (n,): anti-alias filter, decimation, noise."""
    c = 0.0 if machine.effect == "none" else coefficient(machine)
    x, v, a = states(machine, c, seed)
    fine = {"displacement": x, "velocity": v, "acceleration": a, "pressure": a}[machine.quantity]
    taps = signal.firwin(48 * OVERSAMPLING + 1, 0.96 / OVERSAMPLING)
    samples = signal.upfirdn(taps, fine, down=OVERSAMPLING)[24 : 24 + int(machine.seconds * machine.rate_hz)]
    if machine.quantity == "pressure":
        samples = signal.sosfilt(signal.butter(1, 20.0, "highpass", fs=machine.rate_hz, output="sos"), samples)
    noise = np.random.default_rng([seed, 1]).standard_normal(samples.size)
    return np.asarray(samples + np.std(samples) * 10.0 ** (-machine.snr_db / 20.0) * noise)
