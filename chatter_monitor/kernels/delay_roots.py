"""Limit and least damped root of one mode with a regenerative delay (equation in `regeneration`)."""

import cmath
import math

from numba import njit

from chatter_monitor.kernels.options import OPTIONS, WITHIN

_STEPS = 60
_CONVERGED = 1e-12
_ROUNDS = 4  # of the fixed point before Newton's method
# Roots outside this range of frequency, relative to the mode's, are far in the left half plane.
_LOWEST, _HIGHEST = 0.6, 1.7


@njit(**WITHIN)
def critical_coefficient(omega, zeta, tau):
    """Least kappa > 0 at which the cut with this delay loses its stability; inf if there is none.

    On the limit s = i r omega solves D = 0, hence kappa = [(1 - r^2)^2 + 4 zeta^2 r^2] / [2 (r^2 - 1)], and the phase
    r omega tau + 2 atan[(r^2 - 1) / (2 zeta r)] is a whole number of turns (Stepan 1989; Insperger and Stepan,
    Semi-Discretization for Time-Delay Systems, 2011, section 2.2). The coefficient is least at r^2 = 1 + 2 zeta and
    grows to both sides, the phase grows with r: only the two solutions next to that place count.
    """
    delay = omega * tau
    best = math.sqrt(1.0 + 2.0 * zeta)
    turns = math.floor((delay * best + 2.0 * math.atan(1.0 / best)) / (2.0 * math.pi))
    least = math.inf
    for number in range(turns, turns + 2):
        low, high = 1.0, best
        if number > turns:
            low, high = best, max(best, 2.0 * math.pi * number / delay)
        elif not 2.0 * math.pi * number > delay:
            continue  # the solution has r <= 1, where no positive kappa belongs to it
        r = _on_the_limit(delay, zeta, number, low, high)
        if r * r > 1.0:
            least = min(least, _coefficient(r, zeta))
    return least


@njit(**WITHIN)
def opposite_critical_coefficient(omega, zeta, tau):
    """Greatest kappa < 0 at which the cut loses its stability, of a mode that moves out of the chip; always finite.

    As `critical_coefficient`, with r < 1. What is lost least easily is at r^2 = 1 - 2 zeta.
    """
    delay = omega * tau
    best = math.sqrt(1.0 - 2.0 * zeta)
    turns = math.floor((delay * best - 2.0 * math.atan(1.0 / best)) / (2.0 * math.pi))
    greatest = -math.inf
    for number in range(turns, turns + 2):
        low, high = 0.0, best
        if number > turns:
            low, high = best, 1.0
            if not 2.0 * math.pi * number < delay:
                continue  # r >= 1
        r = _on_the_limit(delay, zeta, number, low, high)
        if r * r < 1.0:
            greatest = max(greatest, _coefficient(r, zeta))
    return greatest


@njit(**WITHIN)
def _on_the_limit(delay, zeta, number, low, high):
    """Frequency over the mode's, between two, at which the phase is so many turns: Newton's method in the bracket."""
    r = 0.5 * (low + high)
    for _ in range(_STEPS):
        square = r * r - 1.0
        phase = r * delay + 2.0 * math.atan2(square, 2.0 * zeta * r) - 2.0 * math.pi * number
        if phase > 0.0:
            high = r
        else:
            low = r
        rate = delay + 4.0 * zeta * (r * r + 1.0) / (square * square + 4.0 * zeta * zeta * r * r)
        following = r - phase / rate
        if not low < following < high:
            following = 0.5 * (low + high)
        change = abs(following - r)
        r = following
        if change < _CONVERGED:
            break
    return r


@njit(**WITHIN)
def _coefficient(r, zeta):
    """Kappa on the limit, at this frequency over the mode's."""
    square = r * r - 1.0
    return (square * square + 4.0 * zeta * zeta * r * r) / (2.0 * square)


@njit(**WITHIN)
def _dynamic_stiffness(p, zeta, kappa, delay):
    """D and its derivative at s = p omega."""
    wave = kappa * cmath.exp(-p * delay)
    return p * p + 2.0 * zeta * p + 1.0 + kappa - wave, 2.0 * p + 2.0 * zeta + delay * wave


@njit(**WITHIN)
def polish_root(p, zeta, kappa, delay):
    """Newton's method on D from a guess p; returns the root over omega, and whether it converged."""
    for _ in range(_STEPS):
        value, slope = _dynamic_stiffness(p, zeta, kappa, delay)
        if slope == 0.0:
            return p, False
        step = value / slope
        if abs(step) > 0.1:
            step *= 0.1 / abs(step)
        p -= step
        if abs(step) < _CONVERGED:
            return p, True
    return p, False


@njit(**OPTIONS)
def rightmost_root(omega, zeta, kappa, tau):
    """Characteristic root over omega with the largest real part, among those with a frequency near the mode's.

    Every wave number of the delay has a root: exp(-s tau) = 1 + (p^2 + 2 zeta p + 1) / kappa, p = s / omega, solved for
    the exponent gives a guess for each, and Newton's method does the rest. The mode's own root is one more guess.
    """
    delay = omega * tau
    own = complex(-zeta, math.sqrt(max(1.0 + kappa - zeta * zeta, 0.0)))
    rightmost, converged = polish_root(own, zeta, kappa, delay)
    if not converged:
        rightmost = complex(-math.inf, 0.0)
    if kappa == 0.0:
        return rightmost
    first = math.floor(_LOWEST * delay / (2.0 * math.pi))
    last = math.ceil(_HIGHEST * delay / (2.0 * math.pi))
    for number in range(first, last + 1):
        p = complex(0.0, 2.0 * math.pi * max(number, 0.25) / delay)
        for _ in range(_ROUNDS):
            p = (complex(0.0, 2.0 * math.pi * number) - cmath.log(1.0 + (p * p + 2.0 * zeta * p + 1.0) / kappa)) / delay
        p, converged = polish_root(p, zeta, kappa, delay)
        if converged and p.imag > 0.0 and p.real > rightmost.real:
            rightmost = p
    return rightmost


@njit(**WITHIN)
def ratio_and_damping(physical, near):
    """Kappa over its critical value, and damping ratio of the root next to one over omega.

    ``physical`` are the logarithm of omega, that of zeta, kappa, and the logarithm of tau.
    """
    omega, zeta, kappa, tau = math.exp(physical[0]), math.exp(physical[1]), physical[2], math.exp(physical[3])
    root, _ = polish_root(near, zeta, kappa, omega * tau)
    return kappa / critical_coefficient(omega, zeta, tau), -root.real / abs(root)


@njit(**OPTIONS)
def sensitivity(physical, near, step, gradients):
    """Gradients of `ratio_and_damping` by each of its parameters, by central differences of so large a step.

    ``gradients`` has the shape (2, 4); ``physical`` is changed and left as it was.
    """
    for i in range(physical.shape[0]):
        here = physical[i]
        physical[i] = here + step
        above = ratio_and_damping(physical, near)
        physical[i] = here - step
        below = ratio_and_damping(physical, near)
        physical[i] = here
        gradients[0, i] = (above[0] - below[0]) / (2.0 * step)
        gradients[1, i] = (above[1] - below[1]) / (2.0 * step)
