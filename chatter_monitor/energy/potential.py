"""The potential U(x) as a polynomial, and what follows from it: stiffness, turning points, natural period, action."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import NDArray

NODES = 64


@dataclass(frozen=True, slots=True, eq=False)
class Potential:
    """U(x) = sum of a_i x^i per unit mass, zero at its minimum, which lies near x = 0.

    Attributes
    ----------
    coefficients : ndarray
        a_0, a_1, a_2, ... in units of velocity squared over displacement to the i.
    reach : (float, float)
        Displacements between which U was measured; nothing is read off outside.
    """

    coefficients: NDArray[np.float64]
    reach: tuple[float, float]

    def energy(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """U(x), eq. (9)."""
        return np.asarray(polynomial.polyval(x, self.coefficients))

    def force(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Restoring force per unit mass u(x) = U'(x), from eq. (9)."""
        return np.asarray(polynomial.polyval(x, polynomial.polyder(self.coefficients)))

    def stiffness(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Tangent stiffness per unit mass k(x) = u'(x), 1/s^2."""
        return np.asarray(polynomial.polyval(x, polynomial.polyder(self.coefficients, 2)))

    def equilibrium(self) -> float:
        """Displacement at which the force vanishes, near zero."""
        first = polynomial.polyder(self.coefficients)
        second = polynomial.polyder(first)
        x = 0.0
        for _ in range(10):
            step = float(polynomial.polyval(x, first) / polynomial.polyval(x, second))
            x -= step
            if abs(step) <= 1e-14 * (self.reach[1] - self.reach[0]):
                break
        return x

    def turning_points(self, energy: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Displacements on both sides where U = E: inverse interpolation on the reach, then Newton's steps."""
        centre = self.equilibrium()
        sides = []
        for end in self.reach:
            grid = centre + (1.2 * end - centre) * np.linspace(0.0, 1.0, 400)
            level = np.maximum.accumulate(self.energy(grid))
            x = np.interp(energy, level, grid)
            for _ in range(3):
                force = self.force(x)
                steep = np.abs(force) > 1e-9 * np.max(np.abs(force))
                x = x - np.where(steep, (self.energy(x) - energy) / np.where(steep, force, 1.0), 0.0)
            sides.append(x)
        return sides[0], sides[1]

    def _orbit(
        self, energy: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Half-widths b, nodes c + b sin(theta) and 2 (E - U) / (b cos(theta))^2 there.

        The quotient is smooth up to the turning points, which takes the singularity out of the integrals; the midpoint
        rule over theta then converges exponentially.
        """
        left, right = self.turning_points(energy)
        centre = 0.5 * (left + right)
        half = 0.5 * (right - left)
        theta = np.asarray((np.arange(NODES, dtype=np.float64) + 0.5) * (np.pi / NODES) - 0.5 * np.pi)
        x = centre[:, None] + half[:, None] * np.sin(theta)
        quotient = np.empty_like(x)
        for row, (e, a, b) in enumerate(zip(energy, left, right, strict=True)):
            # E - U(x) = (x - left)(right - x) q(x): exact division, no cancellation near the ends.
            difference = -self.coefficients.copy()
            difference[0] += e
            q, _ = polynomial.polydiv(difference, np.array([-a * b, a + b, -1.0]))
            quotient[row] = 2.0 * polynomial.polyval(x[row], q)
        return half, theta, quotient

    def period(self, energy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Natural period T(E) in s: T = closed integral of dx / sqrt(2 (E - U))."""
        _, _, quotient = self._orbit(energy)
        return np.asarray(2.0 * np.pi / NODES * np.sum(1.0 / np.sqrt(quotient), axis=1))

    def action(self, energy: NDArray[np.float64]) -> NDArray[np.float64]:
        """Area A(E) of the (x, v) plane within energy E; dA/dE = T(E), and A/T is the mean of v^2 over a period."""
        half, theta, quotient = self._orbit(energy)
        integrand = np.sqrt(quotient) * np.cos(theta) ** 2
        return np.asarray(2.0 * np.pi / NODES * half**2 * np.sum(integrand, axis=1))
