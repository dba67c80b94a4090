"""From quadratic factors to operational dynamic parameters and their confidence (paper, eq. (24), (25), corrected).

The recursion has to go sample by sample, but turning its poles into frequency, damping and standard deviations does
not: it is done for a tile of samples at once, row by row, in vector instructions. A tile is always evaluated whole, so
how samples fall into tiles cannot change a bit of the result.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.options import OPTIONS

TILE = 64
TAN_EIGHTH = math.sqrt(2.0) - 1.0


class Tile(NamedTuple):
    """Factors and covariances of TILE samples, and what is made of them. The last axis counts samples.

    ``b[modes]``, ``c[modes]``: factors z^2 + b z + c, NaN where there is nothing to evaluate; ``u[p, p]``, ``d[p]``:
    covariance of A's coefficients as U D U' (row j of u holds column j of U). Results: ``omega[modes]`` (radians per
    sample), ``damping[modes]``, ``omega_sd[modes]``, ``damping_sd[modes]``; NaN where the factor has real roots.
    ``by_omega[p]``, ``by_damping[p]`` (gradients) and ``row[12]`` are work space.
    """

    b: np.ndarray
    c: np.ndarray
    u: np.ndarray
    d: np.ndarray
    omega: np.ndarray
    damping: np.ndarray
    omega_sd: np.ndarray
    damping_sd: np.ndarray
    by_omega: np.ndarray
    by_damping: np.ndarray
    row: np.ndarray


def new_tile(p: int) -> Tile:
    """Allocate a tile for A of even degree p."""
    modes = p // 2
    return Tile(
        b=np.full((modes, TILE), np.nan),
        c=np.full((modes, TILE), np.nan),
        u=np.zeros((p, p, TILE)),
        d=np.zeros((p, TILE)),
        omega=np.full((modes, TILE), np.nan),
        damping=np.full((modes, TILE), np.nan),
        omega_sd=np.full((modes, TILE), np.nan),
        damping_sd=np.full((modes, TILE), np.nan),
        by_omega=np.zeros((p, TILE)),
        by_damping=np.zeros((p, TILE)),
        row=np.zeros((12, TILE)),
    )


@njit(forceinline=True, **OPTIONS)
def log_of_square(modulus):
    """ln(modulus^2) by the series of 2 artanh after two square roots: relative 1e-9 for 0.05 < modulus < 20."""
    fourth_root = math.sqrt(math.sqrt(modulus))
    t = (fourth_root - 1.0) / (fourth_root + 1.0)
    s = t * t
    series = 1 / 11 + s * (1 / 13 + s * (1 / 15 + s * (1 / 17 + s * (1 / 19 + s * (1 / 21)))))
    return 16.0 * t * (1.0 + s * (1 / 3 + s * (1 / 5 + s * (1 / 7 + s * (1 / 9 + s * series)))))


@njit(forceinline=True, **OPTIONS)
def arctan_to_one(x):
    """arctan(x) for 0 <= x <= 1 to a relative 1e-9; the series converges once x is brought below tan(pi/8)."""
    steep = x > TAN_EIGHTH
    y = (x - 1.0) / (x + 1.0) if steep else x
    s = -y * y
    series = 1 / 13 + s * (1 / 15 + s * (1 / 17 + s * (1 / 19 + s * (1 / 21))))
    arc = y * (1.0 + s * (1 / 3 + s * (1 / 5 + s * (1 / 7 + s * (1 / 9 + s * (1 / 11 + s * series))))))
    return arc + 0.25 * math.pi if steep else arc


@njit(**OPTIONS)
def evaluate(p, tile):
    """Fill in the results of a whole tile.

    For the upper root mu = re + j im of each factor: ln(mu) = decay + j angle, omega = abs(ln mu) (eq. (25)),
    damping = -decay / omega (eq. (24) with the angle from atan2). Standard deviations by the delta method, with
    d ln(mu) / d a[i] = -mu^(p-2-i) / A'(mu) and A'(mu) = 2 j im (product of the other factors at mu).
    """
    b, c, u, d, omega, damping, omega_sd, damping_sd, by_omega, by_damping, row = tile
    re, im, product_re, product_im, power_re, power_im = row[0], row[1], row[2], row[3], row[4], row[5]
    omega_by_decay, omega_by_angle, damping_by_decay, damping_by_angle = row[6], row[7], row[8], row[9]
    along_omega, along_damping = row[10], row[11]
    for m in range(p // 2):
        for t in range(TILE):
            re[t] = -0.5 * b[m, t]
            im[t] = 0.5 * math.sqrt(4.0 * c[m, t] - b[m, t] * b[m, t])
            product_re[t] = 1.0
            product_im[t] = 0.0
        for t in range(TILE):
            modulus = math.sqrt(c[m, t])
            decay = 0.5 * log_of_square(modulus)
            arc = 2.0 * arctan_to_one(im[t] / (modulus + abs(re[t])))
            angle = arc if re[t] >= 0.0 else math.pi - arc
            size = math.sqrt(decay * decay + angle * angle)
            inverse = 1.0 / size
            omega[m, t] = size
            damping[m, t] = -decay * inverse
            omega_by_decay[t] = decay * inverse
            omega_by_angle[t] = angle * inverse
            cube = inverse * inverse * inverse
            damping_by_decay[t] = -angle * angle * cube
            damping_by_angle[t] = decay * angle * cube
        for k in range(p // 2):
            if k == m:
                continue
            for t in range(TILE):
                other_re = re[t] * re[t] - im[t] * im[t] + b[k, t] * re[t] + c[k, t]
                other_im = (2.0 * re[t] + b[k, t]) * im[t]
                old = product_re[t]
                product_re[t] = old * other_re - product_im[t] * other_im
                product_im[t] = old * other_im + product_im[t] * other_re
        for t in range(TILE):
            # -1 / (A'(mu) mu): the gradient of the last coefficient
            slope_re = -2.0 * im[t] * product_im[t]
            slope_im = 2.0 * im[t] * product_re[t]
            divisor_re = slope_re * re[t] - slope_im * im[t]
            divisor_im = slope_re * im[t] + slope_im * re[t]
            scale = -1.0 / (divisor_re * divisor_re + divisor_im * divisor_im)
            power_re[t] = divisor_re * scale
            power_im[t] = -divisor_im * scale
            omega_sd[m, t] = 0.0
            damping_sd[m, t] = 0.0
        for i in range(p - 1, -1, -1):
            for t in range(TILE):
                by_omega[i, t] = omega_by_decay[t] * power_re[t] + omega_by_angle[t] * power_im[t]
                by_damping[i, t] = damping_by_decay[t] * power_re[t] + damping_by_angle[t] * power_im[t]
                old = power_re[t]
                power_re[t] = old * re[t] - power_im[t] * im[t]
                power_im[t] = old * im[t] + power_im[t] * re[t]
        for j in range(p):
            for t in range(TILE):
                along_omega[t] = by_omega[j, t]
                along_damping[t] = by_damping[j, t]
            for i in range(j):
                for t in range(TILE):
                    along_omega[t] += u[j, i, t] * by_omega[i, t]
                    along_damping[t] += u[j, i, t] * by_damping[i, t]
            for t in range(TILE):
                omega_sd[m, t] += d[j, t] * along_omega[t] * along_omega[t]
                damping_sd[m, t] += d[j, t] * along_damping[t] * along_damping[t]
        for t in range(TILE):
            omega_sd[m, t] = math.sqrt(omega_sd[m, t])
            damping_sd[m, t] = math.sqrt(damping_sd[m, t])
