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
