"""Equivalent damping h_eq(E) from covariances conditional on the energy at the start of a segment, eq. (14)-(15).

What eq. (14) measures. Let z = v + i w with w = sign(x) sqrt(2 U(x)), a circle of radius sqrt(2 E). Given the state at
the start, the noise that follows is independent of it, so the conditional covariance of z is the mean of the *future*
motion: the decay of the mean, exp(-h tau / 2) for a linear system at every energy, although the energy itself relaxes
towards its stationary mean. Three things stand between it and h(E), each dealt with here:

* Lag zero is not the limit of small lags. Noise of the sensor adds to it, and the band takes away the motion that has
  not yet been filtered by the mode. So the ratio is taken between the extremes half a period and one and a half
  periods later (later still in a narrow band). All harmonics have the same phase at both, so c(E) = 1 in eq. (14).
* The modulus of the complex covariance is used, which needs no search for the extremes and has half the variance.
* While the covariance decays, the energy diffuses to where h and the period are different. `decay` computes what a
  system with given h(E), T(E) and S0 would show, and h is corrected until that agrees with what is measured.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded

from chatter_monitor.energy.band import Band
from chatter_monitor.energy.damping_potential import Powers, design
from chatter_monitor.energy.kinematics import Motion, gain
from chatter_monitor.energy.potential import Potential
from chatter_monitor.energy.stiffness import ZoneLeftOut
from chatter_monitor.kernels import energy as kernel

ZONES = (4, 20)  # of equal width in amplitude, up to the highest energy: at least, at most
PER_ZONE = 3.0  # independent samples of the record for each zone
STRIDE = 4  # samples between starts: an eighth of a period
FEWEST = 1.0  # independent starts a zone needs
NEAR_EDGE = 0.35  # earliest lag times the distance from the mode to the nearer edge of the band
CELLS = 60  # of amplitude in the decay model
RIDGE = 1e-9  # of the fit, for replicates that know too few zones
STEPS = 50  # of time between its lags


@dataclass(frozen=True, slots=True, eq=False)
class Covariances:
    """Conditional covariances summed by block and zone.

    Attributes
    ----------
    lag_s : ndarray, shape (lags,)
        Lags: every sample of the first two periods, then those that the decay is read at.
    shown : int
        Lags within the first two periods.
    energy : ndarray, shape (zones,)
        Mean energy of the starts of each zone.
    sums : ndarray, shape (blocks, zones, 3, lags)
        Sums of v v', w w' and v w' - w v'.
    counts : ndarray, shape (blocks, zones)
        Segments.
    first, last : ndarray of int, shape (zones,)
        Which of the lags the decay of each zone is read between.
    used : ndarray of bool, shape (zones,)
        Zones that take part.
    left_out : tuple of ZoneLeftOut
        The others, and why.
    """

    lag_s: NDArray[np.float64]
    shown: int
    energy: NDArray[np.float64]
    sums: NDArray[np.float64]
    counts: NDArray[np.float64]
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    used: NDArray[np.bool_]
    left_out: tuple[ZoneLeftOut, ...]

    def velocity(self) -> NDArray[np.float64]:
        """R(tau | E) of the velocity over the first two periods, eq. (15), shape (zones, lags shown)."""
        total = self.sums[:, :, 0, : self.shown].sum(axis=0)
        return np.asarray(total / np.maximum(self.counts.sum(axis=0), 1.0)[:, None])

    def measured(self, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """h_eq of eq. (14) for every row of block weights, shape (rows, zones used); NaN in a row without segments."""
        zones = np.flatnonzero(self.used)
        modulus = []
        for lag in (self.first[zones], self.last[zones]):
            picked = self.sums[:, zones, :, lag].transpose(1, 0, 2)  # advanced indexing put the zones first
            total = np.einsum("rb,bzc->rzc", weights, picked)
            modulus.append(np.hypot(total[:, :, 0] + total[:, :, 1], total[:, :, 2]))
        elapsed = self.lag_s[self.last[zones]] - self.lag_s[self.first[zones]]
        ratio = np.divide(modulus[0], modulus[1], out=np.full_like(modulus[0], np.nan), where=modulus[1] > 0.0)
        return np.asarray(2.0 / elapsed * np.log(ratio))

    def lags_s(self) -> tuple[float, float]:
        """The two lags compared, mean over the zones used."""
        return float(self.lag_s[self.first[self.used]].mean()), float(self.lag_s[self.last[self.used]].mean())

    def weight(self, weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """Inverse variance of `measured` up to a factor: the noise of h goes as pi S0 / (E n) for n segments."""
        return np.asarray((weights @ self.counts)[:, self.used] * self.energy[self.used])


def covariances(
    motion: Motion, energy: NDArray[np.float64], blocks: int, potential: Potential, band: Band, top: float, worth: float
) -> Covariances:
    """Covariances conditional on the energy, up to two periods (later in a narrow band).

    Parameters
    ----------
    energy : ndarray
        Energy of each sample of `motion`.
    top : float
        Energy up to which the potential is known.
    worth : float
        Independent samples in the record.
    """
    zones = int(np.clip(worth / PER_ZONE, *ZONES))
    centre = potential.equilibrium()
    w = np.sign(motion.x - centre) * np.sqrt(np.maximum(2.0 * energy - motion.v**2, 0.0))
    zone = np.where(energy < top, (np.sqrt(np.minimum(energy, top) / top) * zones).astype(np.int64), -1)
    zone[zone == zones] = -1
    inside = zone >= 0
    samples = np.bincount(zone[inside], minlength=zones)
    mean = np.bincount(zone[inside], energy[inside], zones) / np.maximum(samples, 1)
    empty = top * ((np.arange(zones) + 0.5) / zones) ** 2
    mean = np.where(samples > 0, mean, empty)
    period = potential.period(mean) * motion.rate_hz
    distance = min(band.high_hz - band.peak_hz, band.peak_hz - band.low_hz) / motion.rate_hz
    halves = 0.5 + np.ceil(np.maximum(NEAR_EDGE / (distance * period) - 0.5, 0.0))
    first = np.round(halves * period).astype(np.int64)
    last = np.round((halves + 1.0) * period).astype(np.int64)
    shown = np.arange(int(2.0 * period.max()))
    lags = np.unique(np.concatenate([shown, first, last]))
    edges = np.linspace(0, motion.x.size - lags[-1], blocks + 1).astype(np.int64)
    sums = np.zeros((blocks, zones, 3, lags.size))
    counts = np.zeros((blocks, zones), dtype=np.int64)
    kernel.conditional_covariance(w, motion.v, zone, edges, STRIDE, lags, sums, counts)
    share = counts.sum(axis=0) / max(counts.sum(), 1)
    used = share * worth >= FEWEST
    left_out = tuple(
        ZoneLeftOut(float(mean[z]), int(samples[z]), "too few independent segments")
        for z in np.flatnonzero(~used & (samples > 0))
    )
    beyond = energy >= top
    if beyond.any():
        reason = "beyond the zones of the potential"
        left_out += (ZoneLeftOut(float(energy[beyond].mean()), int(np.sum(beyond)), reason),)
    return Covariances(
        lag_s=lags / motion.rate_hz,
        shown=shown.size,
        energy=mean,
        sums=sums,
        counts=counts.astype(np.float64),
        first=np.searchsorted(lags, first),
        last=np.searchsorted(lags, last),
        used=used,
        left_out=left_out,
    )


def decay(
    damping: NDArray[np.float64],
    angular: NDArray[np.float64],
    step: float,
    strength: float,
    lags_s: tuple[float, float],
) -> NDArray[np.float64]:
    """The h that eq. (14) would show at each amplitude for a system with known damping.

    With E = s^2 the mean of z given the start is sqrt(2) s m(s, tau), where m obeys the backward equation of the
    averaged motion, D = pi S0,

        dm/dtau = D/4 m'' + (3 D / (4 s) - h s / 2) m' - (h/2 + i omega) m,   m(s, 0) = 1.

    Parameters
    ----------
    damping, angular : ndarray, shape (cells,)
        h in 1/s and natural angular frequency in rad/s at s = (i + 1/2) step.
    strength : float
        D = pi S0.
    lags_s : (float, float)
        The two lags compared.
    """
    cells = damping.size
    s = (np.arange(cells) + 0.5) * step
    diffusion = 0.25 * strength / step**2
    advection = (0.75 * strength / s - 0.5 * damping * s) / (2.0 * step)
    off_resonance = 1j * (angular - angular.mean())  # the modulus does not see the common rotation
    bands = np.zeros((3, cells), dtype=np.complex128)  # upper, main and lower diagonal of the generator
    bands[0, 1:] = (diffusion + advection)[:-1]
    bands[1] = -0.5 * damping - 2.0 * diffusion - off_resonance
    bands[2, :-1] = (diffusion - advection)[1:]
    bands[1, 0] += diffusion - advection[0]  # both ends reflect
    bands[1, -1] += diffusion + advection[-1]
    m = np.ones(cells, dtype=np.complex128)
    early = _advance(bands, m, lags_s[0])
    late = _advance(bands, early, lags_s[1] - lags_s[0])
    return np.asarray(2.0 / (lags_s[1] - lags_s[0]) * np.log(np.abs(early) / np.abs(late)))


def _advance(bands: NDArray[np.complex128], m: NDArray[np.complex128], seconds: float) -> NDArray[np.complex128]:
    """Crank-Nicolson steps of dm/dtau = L m with a tridiagonal L."""
    half = 0.5 * seconds / STEPS
    implicit = -half * bands
    implicit[1] += 1.0
    for _ in range(STEPS):
        pushed = m + half * bands[1] * m
        pushed[:-1] += half * bands[0, 1:] * m[1:]
        pushed[1:] += half * bands[2, :-1] * m[:-1]
        m = solve_banded((1, 1), implicit, pushed)
    return m


def shown_in_band(damping: float, band: Band, lags_s: tuple[float, float]) -> float:
    """The h that eq. (14) would show for a linear mode of known h in white noise, seen through the band's filter.

    The covariance of z is exp(-h tau / 2 + i w0 tau) 2 pi S0 / h less what the filter takes away, an integral over
    the smooth wings of the resonance.
    """
    w0 = 2.0 * np.pi * band.peak_hz
    f = np.linspace(0.0, 20.0 * band.peak_hz, 8001)
    w = 2.0 * np.pi * f
    lost = 2.0 * (1.0 - gain(f, band) ** 2) / ((w0**2 - w**2) ** 2 + (damping * w) ** 2)
    modulus = []
    for lag in lags_s:
        whole = 2.0 * np.pi / damping * np.exp((-0.5 * damping + 1j * w0) * lag)
        outside = lost * ((w**2 + w0**2) * np.cos(w * lag) + 2j * w * w0 * np.sin(w * lag))
        modulus.append(abs(whole - np.trapezoid(outside, w)))
    return float(2.0 / (lags_s[1] - lags_s[0]) * np.log(modulus[0] / modulus[1]))


def band_shift(shown: float, band: Band, lags_s: tuple[float, float]) -> float | None:
    """What to add to a measured mean h for the band's filter, or None where the band is too narrow to tell."""
    damping = 2.0 * np.pi * band.peak_hz * np.logspace(-5.0, 0.0, 61)
    seen = np.array([shown_in_band(h, band, lags_s) for h in damping])
    rising = np.flatnonzero(np.diff(seen) <= 0.0)
    last = int(rising[0]) if rising.size else damping.size - 1
    if not seen[0] <= shown <= seen[last]:
        return None
    return float(np.interp(shown, seen[: last + 1], damping[: last + 1])) - shown


def diffusion_shift(
    damping: Powers, potential: Potential, covariance: Covariances, strength: float, top: float
) -> NDArray[np.float64]:
    """What to add to h at the zones used because the energy diffuses, for a given h(E) and D = pi S0.

    At most half of h: where it is more, near E = 0, the energy does not last from lag to lag and nothing helps.
    """
    step = np.sqrt(top) / CELLS
    level = ((np.arange(CELLS) + 0.5) * step) ** 2
    h = damping.value(level).reshape(-1)
    angular = 2.0 * np.pi / potential.period(level)
    shift = h - decay(h, angular, float(step), max(strength, 0.0), covariance.lags_s())
    return np.asarray(np.interp(covariance.energy[covariance.used], level, np.clip(shift, -0.5 * abs(h), 0.5 * abs(h))))


def fit(
    h: NDArray[np.float64],
    weight: NDArray[np.float64],
    powers: tuple[int, ...],
    energy: NDArray[np.float64],
    unit: float,
) -> Powers:
    """Weighted least squares of powers of E through h at the zones' energies, one fit for each row."""
    basis = design(powers, energy / unit)
    normal = np.einsum("rz,iz,jz->rij", weight, basis, basis)
    normal += RIDGE * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(len(powers))
    right = np.einsum("rz,iz->ri", np.where(weight > 0.0, weight * h, 0.0), basis)
    return Powers(powers, np.linalg.solve(normal, right[:, :, None])[:, :, 0], unit)
