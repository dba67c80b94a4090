"""From quadratic factors to operational dynamic parameters and their confidence (paper, eq. (24), (25), corrected).

The recursion has to go sample by sample, but turning its poles into frequency, damping and standard deviations does
not: it is done for a tile of samples at once, in vector instructions. A tile is always evaluated whole, so how samples
fall into tiles cannot change a bit of the result.

A tile is one array with a row of `TILE` samples for each quantity, at places that the compiler knows, and the loop over
its samples neither branches nor calls: only then does it see that samples do not depend on each other.
"""

import math

import numpy as np
from numba import njit

from chatter_monitor.kernels.options import OPTIONS

TILE = 16  # a whole number of vectors, and little is evaluated in vain where few samples come at a time
TAN_EIGHTH = math.sqrt(2.0) - 1.0
SQRT2 = math.sqrt(2.0)

# Where the rows of the results begin, and where they end
OMEGA, DAMPING, OMEGA_SD, DAMPING_SD, RESULTS = (TILE * i for i in range(5))


@njit(inline="always", **OPTIONS)
def factor_row(mode):
    """Where the row of b begins in the factor z^2 + b z + c of a mode, NaN where there is nothing; c is in the next."""
    return RESULTS + 2 * mode * TILE


@njit(inline="always", **OPTIONS)
def covariance_row(p, j):
    """Where the rows of column j begin in the covariance U D U' of A's coefficients: U above the diagonal, then D."""
    return RESULTS + (p + j * (j + 1) // 2) * TILE


@njit(inline="always", **OPTIONS)
def _work_row(p):
    """Where the work space begins: the factors again, the mode's own first, and two gradients."""
    return covariance_row(p, p)


def new_tile(p: int) -> np.ndarray:
    """Allocate a tile for A of even degree p."""
    return np.zeros(RESULTS + (p + p * (p + 1) // 2 + 3 * p) * TILE)


@njit(inline="always", **OPTIONS)
def _doubled(x, logarithm, factor):
    """Multiply x by a factor where it stays below sqrt(2); with the logarithm of what it is then too large by."""
    small = x * factor < SQRT2
    return x * factor if small else x, logarithm - math.log(factor) if small else logarithm


@njit(inline="always", **OPTIONS)
def _halved(x, logarithm, factor):
    """Divide x by a factor where it stays above 1 / sqrt(2)."""
    large = x > factor / SQRT2
    return x / factor if large else x, logarithm + math.log(factor) if large else logarithm


@njit(inline="always", **OPTIONS)
def log(x):
    """ln(x) to a relative 1e-10 for 3e-5 < x < 90: doubled and halved to near 1, then a series of 2 artanh."""
    logarithm = 0.0
    x, logarithm = _doubled(x, logarithm, 256.0)
    x, logarithm = _doubled(x, logarithm, 16.0)
    x, logarithm = _doubled(x, logarithm, 4.0)
    x, logarithm = _doubled(x, logarithm, 2.0)
    x, logarithm = _halved(x, logarithm, 8.0)
    x, logarithm = _halved(x, logarithm, 4.0)
    x, logarithm = _halved(x, logarithm, 2.0)
    t = (x - 1.0) / (x + 1.0)
    s = t * t
    return logarithm + 2.0 * t * (1.0 + s * (1 / 3 + s * (1 / 5 + s * (1 / 7 + s * (1 / 9 + s * (1 / 11))))))


@njit(inline="always", **OPTIONS)
def angle_above(re, im):
    """Angle of re + j im, im >= 0, to a relative 1e-9: turned by 45 or 90 degrees to within 22.5, then a series."""
    side = abs(re)
    flat = im < TAN_EIGHTH * side
    steep = TAN_EIGHTH * im > side
    above = im if flat else (-side if steep else im - side)
    along = side if flat else (im if steep else im + side)
    turned = 0.0 if flat else (0.5 * math.pi if steep else 0.25 * math.pi)
    y = above / along
    s = -y * y
    series = 1 / 13 + s * (1 / 15 + s * (1 / 17 + s * (1 / 19 + s * (1 / 21))))
    arc = turned + y * (1.0 + s * (1 / 3 + s * (1 / 5 + s * (1 / 7 + s * (1 / 9 + s * (1 / 11 + s * series))))))
    return arc if re >= 0.0 else math.pi - arc


@njit(inline="always", **OPTIONS)
def evaluate(p, mode, tile):
    """Fill in the results of a mode for a whole tile, NaN where its factor has real roots.

    For the upper root mu = re + j im of its factor: ln(mu) = decay + j angle, omega = abs(ln mu) (eq. (25), radians per
    sample), damping = -decay / omega (eq. (24) with the angle from atan2). Standard deviations by the delta method,
    with d ln(mu) / d a[i] = -mu^(p-2-i) / A'(mu) and A'(mu) = 2 j im (product of the other factors at mu).
    """
    own = _work_row(p)
    by_omega, by_damping = own + p * TILE, own + 2 * p * TILE
    for k in range(p // 2):
        place = own if k == mode else own + 2 * (k + (k < mode)) * TILE
        for t in range(2 * TILE):
            tile[place + t] = tile[factor_row(k) + t]
    for t in range(TILE):
        b, c = tile[own + t], tile[own + TILE + t]
        re = -0.5 * b
        im = 0.5 * math.sqrt(4.0 * c - b * b)
        decay = 0.5 * log(c)
        angle = angle_above(re, im)
        omega = math.sqrt(decay * decay + angle * angle)
        inverse = 1.0 / omega
        tile[OMEGA + t] = omega
        tile[DAMPING + t] = -decay * inverse
        omega_by_decay = decay * inverse
        omega_by_angle = angle * inverse
        cube = inverse * inverse * inverse
        damping_by_decay = -angle * angle * cube
        damping_by_angle = decay * angle * cube
        product_re, product_im = 1.0, 0.0
        for k in range(1, p // 2):
            other_re = re * re - im * im + tile[own + 2 * k * TILE + t] * re + tile[own + (2 * k + 1) * TILE + t]
            other_im = (2.0 * re + tile[own + 2 * k * TILE + t]) * im
            product_re, product_im = (
                product_re * other_re - product_im * other_im,
                product_re * other_im + product_im * other_re,
            )
        # -1 / (A'(mu) mu): the gradient of the last coefficient
        slope_re = -2.0 * im * product_im
        slope_im = 2.0 * im * product_re
        divisor_re = slope_re * re - slope_im * im
        divisor_im = slope_re * im + slope_im * re
        scale = -1.0 / (divisor_re * divisor_re + divisor_im * divisor_im)
        power_re = divisor_re * scale
        power_im = -divisor_im * scale
        for i in range(p - 1, -1, -1):
            tile[by_omega + i * TILE + t] = omega_by_decay * power_re + omega_by_angle * power_im
            tile[by_damping + i * TILE + t] = damping_by_decay * power_re + damping_by_angle * power_im
            power_re, power_im = power_re * re - power_im * im, power_re * im + power_im * re
        omega_variance = 0.0
        damping_variance = 0.0
        for j in range(p):
            along_omega = tile[by_omega + j * TILE + t]
            along_damping = tile[by_damping + j * TILE + t]
            column = covariance_row(p, j)
            for i in range(j):
                along_omega += tile[column + i * TILE + t] * tile[by_omega + i * TILE + t]
                along_damping += tile[column + i * TILE + t] * tile[by_damping + i * TILE + t]
            omega_variance += tile[column + j * TILE + t] * along_omega * along_omega
            damping_variance += tile[column + j * TILE + t] * along_damping * along_damping
        tile[OMEGA_SD + t] = math.sqrt(omega_variance)
        tile[DAMPING_SD + t] = math.sqrt(damping_variance)
