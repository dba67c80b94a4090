"""A small simulator of one oscillator in white noise, independent of `chatter_monitor.physics`, and its known truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.signal import resample_poly


@dataclass(frozen=True)
class Oscillator:
    """x'' + (viscous + van_der_pol x^2) v + coulomb sgn(v) + quadratic v abs(v) + k1 x + k2 x^2 + k3 x^3 = W."""

    frequency_hz: float = 400.0
    viscous: float = 0.0
    coulomb: float = 0.0
    quadratic: float = 0.0
    van_der_pol: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    intensity: float = 1.0  # S0, E[W W] = 2 pi S0 delta
    regeneration: float = 0.0  # kappa of kappa w^2 (x - x(t - delay))
    delay_s: float = 0.01
    contact: float = np.inf  # largest chip thickness variation that keeps the tool in the cut

    @property
    def k1(self) -> float:
        """Linear stiffness per unit mass, 1/s^2."""
        return float((2.0 * np.pi * self.frequency_hz) ** 2)


@njit(cache=True)
def _integrate(par, noise_sd, dt, steps, keep, skip, x0, seed):  # type: ignore[no-untyped-def]
    k1, k2, k3, viscous, coulomb, quadratic, vdp, regeneration, delay_s, contact = par
    np.random.seed(seed)  # noqa: NPY002 - numba's own generator
    lag = round(delay_s / dt)
    history = np.zeros(lag + 1)
    out = np.empty((3, (steps - skip) // keep))
    x = x0
    v = 0.0
    a = np.zeros(4)
    vs = np.zeros(4)
    kept = 0
    for t in range(steps):
        w = noise_sd * np.random.standard_normal()  # noqa: NPY002
        chip = 0.0
        for stage in range(4):
            fraction = 0.0 if stage == 0 else (0.5 if stage < 3 else 1.0)
            before = 0 if stage == 0 else stage - 1
            xs = x + fraction * dt * vs[before] if stage else x
            ys = v + fraction * dt * a[before] if stage else v
            if regeneration != 0.0:
                past = history[t % (lag + 1)] * (1.0 - fraction) + history[(t + 1) % (lag + 1)] * fraction
                chip = min(max(xs - past, -contact), contact)
            force = (viscous + vdp * xs * xs) * ys + coulomb * np.sign(ys) + quadratic * ys * abs(ys)
            force += k1 * xs + k2 * xs * xs + k3 * xs * xs * xs + regeneration * k1 * chip
            vs[stage] = ys
            a[stage] = w - force
        history[t % (lag + 1)] = x
        if t >= skip and (t - skip) % keep == 0 and kept < out.shape[1]:
            out[0, kept] = x
            out[1, kept] = v
            out[2, kept] = a[0]
            kept += 1
        x += dt / 6.0 * (vs[0] + 2.0 * vs[1] + 2.0 * vs[2] + vs[3])
        v += dt / 6.0 * (a[0] + 2.0 * a[1] + 2.0 * a[2] + a[3])
    return out[:, :kept]


def simulate(
    oscillator: Oscillator,
    seconds: float,
    seed: int,
    rate_hz: float = 12800.0,
    settle_s: float = 1.0,
    oversampling: int = 8,
    start: float = 0.0,
    quantity: str = "displacement",
) -> NDArray[np.float64]:
    """What a sensor of `quantity` records at `rate_hz`, after `settle_s` seconds from the displacement `start`."""
    dt = 1.0 / (rate_hz * oversampling)
    o = oscillator
    par = (o.k1, o.k2, o.k3, o.viscous, o.coulomb, o.quadratic, o.van_der_pol, o.regeneration, o.delay_s, o.contact)
    skip = round(settle_s / dt)
    steps = skip + round(seconds / dt)
    noise_sd = np.sqrt(2.0 * np.pi * o.intensity / dt)  # eq. (5), one value held over each step
    # Acceleration feeds the white force straight through: keep every step and decimate behind an anti-alias filter.
    white = quantity == "acceleration"
    rows = _integrate(par, noise_sd, dt, steps, 1 if white else oversampling, skip, start, seed)
    recorded = rows[["displacement", "velocity", "acceleration"].index(quantity)]
    return np.asarray(resample_poly(recorded, 1, oversampling) if white else recorded)


def damping(oscillator: Oscillator, energy: NDArray[np.float64]) -> NDArray[np.float64]:
    """h(E) of a linear spring: mean of force times velocity over a period, by the mean of v^2."""
    amplitude = np.sqrt(2.0 * energy)  # of the velocity
    o = oscillator
    return np.asarray(
        o.viscous
        + o.coulomb * 4.0 / (np.pi * amplitude)
        + o.quadratic * 8.0 / (3.0 * np.pi) * amplitude
        + o.van_der_pol * amplitude**2 / (4.0 * o.k1)
    )


def energy_quantiles(oscillator: Oscillator, shares: list[float]) -> NDArray[np.float64]:
    """Energies below which the given shares of the time are spent, from eq. (11) with a constant period."""
    scale = np.pi * oscillator.intensity
    top = scale / damping(oscillator, np.array([scale / max(oscillator.viscous, 1.0)]))[0]
    amplitude = np.linspace(0.0, 1.0, 20001)[1:] * np.sqrt(20.0 * top)
    energy = amplitude**2
    well = np.cumsum(damping(oscillator, energy) * np.gradient(energy)) / scale
    share = np.cumsum(np.exp(-(well - well.min())) * np.gradient(energy))
    return np.asarray(np.interp(shares, share / share[-1], energy))


W0 = 2.0 * np.pi * 400.0


def noise_driven(damping_ratio: float, k3: float = 0.0, frequency_hz: float = 400.0) -> Oscillator:
    """A linear or cubic mode with a standard deviation of about 1."""
    w = 2.0 * np.pi * frequency_hz
    h = 2.0 * damping_ratio * w
    return Oscillator(frequency_hz=frequency_hz, viscous=h, intensity=h * w * w / np.pi, k3=k3 * w * w)


def dry(damping_ratio: float = 0.01) -> Oscillator:
    """Dry friction that dissipates like `damping_ratio` at a displacement amplitude of 1."""
    h = 2.0 * damping_ratio * W0
    return Oscillator(coulomb=h * W0 * np.pi / 4.0, intensity=h * W0**2 / np.pi)


def turbulent(damping_ratio: float = 0.01) -> Oscillator:
    """Damping by v abs(v) that dissipates like `damping_ratio` at a displacement amplitude of 1.2."""
    h = 2.0 * damping_ratio * W0
    return Oscillator(quadratic=h * 3.0 * np.pi / (8.0 * W0 * 1.2), intensity=h * W0**2 / np.pi)


def excitation_case(kind: str, seed: int) -> NDArray[np.float64]:
    """Five seconds at 12.8 kHz of a random mode, noise-driven or self-excited, as a noisy sensor records it.

    100-1400 Hz, 0.4-4 % damping, 15-40 dB. ``noise_driven`` springs are softening to hardening; ``negative_damping``
    has a damping potential 4 to 60 pi S0 deep; ``regenerative`` cuts 1.5 to 3 times deeper than the limit at the worst
    spindle speed, limited by loss of contact.
    """
    rng = np.random.default_rng(seed)
    frequency = float(np.exp(rng.uniform(np.log(100.0), np.log(1400.0))))
    ratio = float(np.exp(rng.uniform(np.log(0.004), np.log(0.04))))
    noise_db = rng.uniform(15.0, 40.0)
    w = 2.0 * np.pi * frequency
    h = 2.0 * ratio * w
    if kind == "noise_driven":
        o = noise_driven(ratio, k3=rng.uniform(-0.01, 0.04), frequency_hz=frequency)
        start = 0.0
    elif kind == "negative_damping":
        depth = float(np.exp(rng.uniform(np.log(4.0), np.log(60.0))))
        # Limit cycle of amplitude 1, E = w^2 / 2; its potential is h E / 2 deep.
        o = Oscillator(
            frequency_hz=frequency,
            viscous=-h,
            van_der_pol=4.0 * h,
            intensity=h * w * w / 4.0 / depth / np.pi,
            k3=rng.uniform(-0.02, 0.1) * w * w,
        )
        start = 1.0
    else:
        limit = 2.0 * ratio * (1.0 + ratio)
        o = Oscillator(
            frequency_hz=frequency,
            viscous=h,
            intensity=h * (w * rng.uniform(0.05, 0.3)) ** 2 / np.pi,
            regeneration=rng.uniform(1.5, 3.0) * limit,
            delay_s=(int(rng.integers(2, 9)) + 0.75) / frequency,
            contact=1.0,
        )
        start = 0.5
    signal = simulate(o, 5.0, seed, settle_s=min(12.0 / (ratio * w), 4.0), start=start)
    noise = np.std(signal) * 10.0 ** (-noise_db / 20.0) * rng.standard_normal(signal.size)
    return np.asarray(signal + noise)
