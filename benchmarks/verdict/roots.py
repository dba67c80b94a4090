"""Characteristic roots of the cutting process: the truth that the benchmark scores against.

Averaged coefficients: 1 + kappa w1^2 (1 - exp(-s tau)) G(s) = 0, G(s) = sum g_i / (s^2 + 2 zeta_i w_i s + w_i^2).
Its rightmost root is found by Newton's method from many starts on the imaginary axis.

Where the teeth modulate the process stiffness, alpha(t) = sum A_k exp(i k W t) with W = 2 pi / tau, the exponents are
those of the multi-frequency solution (Hill's infinite determinant; Budak and Altintas 1998; Merdol and Altintas 2004)

    det[I + kappa w1^2 (1 - exp(-s tau)) diag(G(s + i k W)) toeplitz(A)] = 0,

followed from the averaged roots while the modulation is turned up.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.linalg import toeplitz
from scipy.optimize import brentq

from benchmarks.verdict.cutting import Mode

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

# Roots of the averaged equation that are followed into the modulated one: the rightmost may change places.
FOLLOWED = 3
# Tooth harmonics either side that take part in the determinant at most.
MOST_HARMONICS = 6
NEWTON_STEPS = 5


def rightmost_root(
    modes: tuple[Mode, ...], kappa: Floats, tau_s: Floats, harmonics: Complexes | None = None
) -> Complexes:
    """Root with the largest real part for each pair of process stiffness and delay.

    Parameters
    ----------
    modes : tuple of Mode
        The structure.
    kappa, tau_s : ndarray, shape (n,)
        Dimensionless process stiffness (of the first mode's) and delay in seconds.
    harmonics : ndarray of complex or None, shape (m,)
        A_0 = 1, A_1, ... of the modulation over one tooth period; None for a constant process stiffness.

    Returns
    -------
    ndarray of complex, shape (n,)
        s in rad/s with a positive imaginary part.
    """
    table = np.array([(m.omega, m.damping_ratio, m.compliance) for m in modes])
    kappa = np.maximum(kappa, 1e-9)  # the root of the structure alone, without dividing by zero at its pole
    roots = np.empty((kappa.size, FOLLOWED), complex)
    _averaged_roots(table, np.ascontiguousarray(kappa), np.ascontiguousarray(tau_s), roots)
    if harmonics is not None and np.max(np.abs(harmonics[1:])) > 0.01:
        for strength in (0.5, 1.0):
            scaled = np.concatenate((harmonics[:1], strength * harmonics[1:]))
            roots = _modulated_roots(table, kappa, tau_s, scaled, roots)
    return np.asarray(roots[np.arange(kappa.size), np.argmax(roots.real, axis=1)])


def damping_ratio(root: Complexes) -> Floats:
    """Damping ratio -Re(s)/abs(s)."""
    return -root.real / np.abs(root)


def critical_kappa(modes: tuple[Mode, ...], tau_s: float, harmonics: Complexes | None = None) -> float:
    """Smallest process stiffness at which the rightmost root reaches the imaginary axis.

    The averaged equation gives the first guess in closed form: on the axis kappa w1^2 = -1 / (2 Re G(i w)) where the
    phase of the delay fits; the zero of the rightmost root's real part is then bracketed and found.
    """
    guess = _averaged_limit(modes, tau_s)

    def growth(kappa: float) -> float:
        return float(rightmost_root(modes, np.array([kappa]), np.array([tau_s]), harmonics)[0].real)

    high = guess
    while growth(high) <= 0.0:
        high *= 1.2
    return float(brentq(growth, 0.0, high, rtol=1e-4))


def _averaged_limit(modes: tuple[Mode, ...], tau_s: float) -> float:
    highest = 1.5 * max(m.omega for m in modes)
    w = np.linspace(0.02 * min(m.omega for m in modes), highest, 50_000)
    g = np.zeros(w.size, complex)
    for m in modes:
        g += m.compliance / (m.omega**2 - w**2 + 2j * m.damping_ratio * m.omega * w)
    # on the axis 1 - exp(-i w tau) = -1 / (K G) has real part 1/2 |.|^2: K = -1/(2 Re G), tan(w tau / 2) = -Re G / Im G
    mismatch = np.angle(np.exp(1j * (w * tau_s - math.pi - 2.0 * np.angle(g))))
    crossing = (np.abs(np.diff(mismatch)) < 1.0) & (np.sign(mismatch[1:]) != np.sign(mismatch[:-1]))
    at = np.flatnonzero(crossing & (g.real[:-1] < 0))
    limits = -1.0 / (2.0 * g.real[at])
    return float(np.min(limits)) / modes[0].omega ** 2 if limits.size else 100.0


@njit(cache=True, error_model="numpy")
def _averaged_roots(table, kappa, tau_s, roots):  # type: ignore[no-untyped-def]
    modes = table.shape[0]
    for n in range(kappa.size):
        stiffness, tau = kappa[n] * table[0, 0] ** 2, tau_s[n]
        for slot in range(roots.shape[1]):
            roots[n, slot] = complex(-1e9, 1.0)
        for m in range(modes):
            # roots lie a spindle (tooth) frequency apart: starts at half that around the mode, more would be far left
            spacing = min(math.pi / tau, 0.05 * table[m, 0])
            spacing = max(spacing, 0.004 * table[m, 0])
            for step in range(-15, 31):
                w0 = table[m, 0] + step * spacing
                if w0 < 0.3 * table[m, 0]:
                    continue
                s = complex(0.0, w0)
                moved = 1.0
                for _ in range(40):
                    g = complex(0.0, 0.0)
                    slope = complex(0.0, 0.0)
                    for i in range(modes):
                        w, zeta, share = table[i, 0], table[i, 1], table[i, 2]
                        d = s * s + 2.0 * zeta * w * s + w * w
                        g += share / d
                        slope -= share * (2.0 * s + 2.0 * zeta * w) / (d * d)
                    e = np.exp(-s * tau)
                    # Newton on 1/G + K (1 - e): no poles near the modes
                    f = 1.0 / g + stiffness * (1.0 - e)
                    df = -slope / (g * g) + stiffness * tau * e
                    ds = f / df
                    limit = 0.05 * table[m, 0]
                    if abs(ds) > limit:
                        ds *= limit / abs(ds)
                    s -= ds
                    moved = abs(ds) / abs(s)
                    if moved < 1e-11 or s.real < -table[m, 0]:
                        break
                if moved > 1e-9 or s.imag <= 0.0 or s.real < -table[m, 0]:
                    continue
                known = False
                for slot in range(roots.shape[1]):
                    if abs(s - roots[n, slot]) < 1e-6 * abs(s):
                        known = True
                if known:
                    continue
                worst = 0
                for slot in range(1, roots.shape[1]):
                    if roots[n, slot].real < roots[n, worst].real:
                        worst = slot
                if s.real > roots[n, worst].real:
                    roots[n, worst] = s


def _modulated_roots(table: Floats, kappa: Floats, tau_s: Floats, harmonics: Complexes, roots: Complexes) -> Complexes:
    """Newton's method on the logarithm of Hill's determinant, all roots at once; a root that gets lost stays put."""
    reach = int(min(MOST_HARMONICS, math.ceil(2.0 * table[:, 0].max() * tau_s.max() / (2.0 * math.pi)) + 1))
    order = np.arange(-reach, reach + 1)
    column = np.zeros(2 * reach + 1, complex)
    column[: min(harmonics.size, column.size)] = harmonics[: column.size]
    coupling = toeplitz(column, column.conj())
    stiffness = (kappa * table[0, 0] ** 2)[:, np.newaxis]
    tau = tau_s[:, np.newaxis]
    shift = 2j * math.pi * order / tau_s[:, np.newaxis, np.newaxis]

    def determinant(s: Complexes) -> Complexes:
        sk = s[..., np.newaxis] + shift
        g = sum(share / (sk * sk + 2.0 * zeta * w * sk + w * w) for w, zeta, share in table)
        gain = (stiffness * (1.0 - np.exp(-s * tau)))[..., np.newaxis] * g
        matrix: Complexes = np.eye(order.size) + gain[..., np.newaxis] * coupling
        found: Complexes = np.linalg.det(matrix)
        return found

    s = roots.copy()
    s[s.real < -1e8] = -1.0 + 1j
    for _ in range(NEWTON_STEPS):
        small = 1e-6 * np.abs(s)
        value = determinant(s)
        slope = (determinant(s + small) - value) / small
        step = value / np.where(slope == 0, 1.0, slope)
        limit = 0.01 * np.abs(s)
        s = s - step * np.minimum(1.0, limit / np.maximum(np.abs(step), 1e-30))
    lost = (np.abs(step) > 1e-6 * np.abs(s)) | (np.abs(s - roots) > 0.1 * np.abs(roots)) | (roots.real < -1e8)
    return np.where(lost, roots, s)
