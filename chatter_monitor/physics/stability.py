"""Characteristic roots of the linearised cut: damping and frequency of the machine while it is cutting.

At rest the terms act as a spring k, a damper c and a delayed spring l on the tool, so with the structure's
receptance G(s) = sum g_i^2 / (s^2 + 2 zeta_i w_i s + w_i^2) = Q(s) / P(s) the characteristic equation is

    D(s) = P(s) + Q(s) [k + c s + l exp(-s tau)] = 0.

All roots near the imaginary axis come from the eigenvalues of a Chebyshev collocation of the delay operator (Breda,
Maset, Vermiglio 2005; Trefethen's differentiation matrix), each polished by Newton's method on D itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.terms import Force

_PROBE = 1e-12  # displacement at which slopes are taken: within every gap and before every kink
_NEWTON_STEPS = 30
_CONVERGED = 1e-9  # relative
_TRUST = 0.02  # how far, relative, Newton's method may go from where it started
_RENEWAL = 100  # times between two collocations when roots are followed
_DEEPEST = 15.0  # roots that decay by more than exp(-15) from one tooth to the next are of no interest


class LinearForce(NamedTuple):
    """Slopes of all terms at rest: force = stiffness x + damping x' + lag x(t - tau)."""

    stiffness: float
    damping: float
    lag: float


class Root(NamedTuple):
    """A characteristic root as operational parameters, eqs. (24), (25) with the signs of a decaying motion."""

    frequency_hz: float
    damping_ratio: float
    stable: bool


def linear_force(system: MachiningSystem) -> LinearForce:
    """Slopes of the terms at rest. Friction with a jump at zero velocity has none and is left out."""
    w = system.modes[0].omega
    stiffness = damping = lag = 0.0
    for term, p in ((applied.term, applied.values) for applied in system.terms if applied.term.smooth):
        stiffness += _slope(term.force, 0, w, p)
        damping += _slope(term.force, 1, w, p)
        lag += _slope(term.force, 2, w, p)
        if term.memory_rate is not None:
            stiffness += _slope(term.force, 3, w, p) * _slope(term.memory_rate, 1, w, p)  # z' = r v, hence z = r x
    return LinearForce(stiffness, damping, lag)


def _slope(function: Force, argument: int, w: float, p: Sequence[float]) -> float:
    """Derivative of a term at rest by the first, second ... of x, v, lagged, memory."""

    def at(value: float) -> float:
        x, v, lagged, memory = (value if i == argument else 0.0 for i in range(4))
        return function(x, v, lagged, 0.0, w, memory, p)

    return (at(_PROBE) - at(-_PROBE)) / (2.0 * _PROBE)


def characteristic_roots(system: MachiningSystem, near: NDArray[np.complex128] | None = None) -> NDArray[np.complex128]:
    """Characteristic roots of the linearised system in the upper half plane, rightmost first.

    Parameters
    ----------
    system : MachiningSystem
        Parameters that drift are taken at their nominal values; freeze them with `MachiningSystem.at` first.
    near : ndarray of complex128, optional
        Roots of a system that differs little; saves the eigenvalue problem.

    Returns
    -------
    ndarray of complex128
        In 1/s. Those that the collocation resolves and Newton's method confirms; for a delayed system the chain goes
        on to the left without end.
    """
    force = linear_force(system)
    delay_s = system.spindle.delay_s if system.spindle and force.lag != 0.0 else 0.0
    fastest = max(mode.omega for mode in system.modes)
    guesses = near
    if guesses is None:
        guesses = np.linalg.eigvals(_collocation(system, force, delay_s)).astype(np.complex128)
        # the collocation is good for the slow and lightly damped ones
        left = -_DEEPEST / delay_s if delay_s else -np.inf
        guesses = guesses[(guesses.imag >= -1e-9 * fastest) & (abs(guesses) < 3.0 * fastest) & (guesses.real > left)]
    roots = _polish(guesses, system, force, delay_s)
    roots = roots[np.argsort(-roots.real)]
    apart = [i for i, root in enumerate(roots) if not np.any(abs(roots[:i] - root) < 1e-6 * fastest)]
    return roots[apart]


def rightmost_root(system: MachiningSystem) -> Root:
    """Frequency and damping ratio of the least stable characteristic root at nominal parameters."""
    return _as_root(characteristic_roots(system)[0])


def rightmost_roots_along(system: MachiningSystem, time_s: Sequence[float]) -> tuple[Root, ...]:
    """Least stable root at each of many times, parameters frozen there.

    The whole set of roots is followed from one time to the next by Newton's method and renewed by collocation now
    and then, so that none that comes in from the left is missed, and whenever one was lost.
    """
    path: list[Root] = []
    roots = np.zeros(0, dtype=np.complex128)
    for i, when in enumerate(time_s):
        frozen, known = system.at(when), roots.size
        if i % _RENEWAL:
            roots = characteristic_roots(frozen, roots)
        if i % _RENEWAL == 0 or roots.size < known:
            roots = characteristic_roots(frozen)
        path.append(_as_root(roots[0]))
    return tuple(path)


def _as_root(root: complex) -> Root:
    return Root(abs(root) / (2.0 * math.pi), -root.real / abs(root), bool(root.real < 0.0))


def _collocation(system: MachiningSystem, force: LinearForce, delay_s: float) -> NDArray[np.float64]:
    """Matrix whose eigenvalues approach the characteristic roots.

    The state is q, q' and the tool's past displacement at Chebyshev points of [-tau, 0); the past moves by d/dt =
    d/dtheta, and its end at theta = 0 is the present displacement sum g_i q_i.
    """
    m = len(system.modes)
    g = np.array([mode.participation for mode in system.modes])
    w = np.array([mode.omega for mode in system.modes])
    zeta = np.array([mode.damping_ratio for mode in system.modes])
    points = 0 if delay_s == 0.0 else 24 + math.ceil(0.75 * w.max() * delay_s)
    matrix = np.zeros((2 * m + points, 2 * m + points))
    matrix[:m, m : 2 * m] = np.eye(m)
    matrix[m : 2 * m, :m] = -np.diag(w**2) - force.stiffness * np.outer(g, g)
    matrix[m : 2 * m, m : 2 * m] = -np.diag(2.0 * zeta * w) - force.damping * np.outer(g, g)
    if points:
        matrix[m : 2 * m, -1] = -force.lag * g
        past = 2.0 / delay_s * _chebyshev_derivative(points)[1:]
        matrix[2 * m :, :m] = np.outer(past[:, 0], g)
        matrix[2 * m :, 2 * m :] = past[:, 1:]
    return matrix


def _chebyshev_derivative(n: int) -> NDArray[np.float64]:
    """Differentiation matrix on cos(pi j / n), j = 0..n (Trefethen, Spectral Methods in MATLAB, 2000, program 6)."""
    j = np.arange(n + 1)
    points = np.cos(np.pi * j / n)
    weight = np.where((j == 0) | (j == n), 2.0, 1.0) * (-1.0) ** j
    matrix = np.outer(weight, 1.0 / weight) / (points[:, None] - points[None, :] + np.eye(n + 1))
    return matrix - np.diag(matrix.sum(axis=1))


def _polish(
    roots: NDArray[np.complex128], system: MachiningSystem, force: LinearForce, delay_s: float
) -> NDArray[np.complex128]:
    """Newton's method on D(s); what does not converge near its start is left out."""
    factors = [Polynomial([mode.omega**2, 2.0 * mode.damping_ratio * mode.omega, 1.0]) for mode in system.modes]
    P = math.prod(factors, start=Polynomial([1.0]))
    Q = Polynomial([0.0])
    for i, mode in enumerate(system.modes):
        Q += mode.participation**2 * math.prod(factors[:i] + factors[i + 1 :], start=Polynomial([1.0]))
    dP, dQ = P.deriv(), Q.deriv()
    s, step, scale = roots, np.zeros_like(roots), abs(roots)
    for _ in range(_NEWTON_STEPS):
        wave = force.lag * np.exp(-s * delay_s)
        F, dF = force.stiffness + force.damping * s + wave, force.damping - delay_s * wave
        step = (P(s) + Q(s) * F) / (dP(s) + dQ(s) * F + Q(s) * dF)
        s = np.where(abs(s - step - roots) < _TRUST * scale, s - step, roots)
        if np.all(abs(step) < _CONVERGED * scale):
            break
    return s[abs(step) < _CONVERGED * scale]
