"""How much of the signal's power each mode of an ARMA model carries."""

import cmath

from numba import njit

from chatter_monitor.kernels.options import OPTIONS

# Poles at or beyond the unit circle have no stationary power; they count as if just inside.
LARGEST_RADIUS = 1.0 - 1e-5


@njit(**OPTIONS)
def modal_shares(p, q, theta, factors, roots, shares):
    """Share of each factor of A in the variance of C/A e, by the residues of its spectrum.

    var(y) / var(e) = sum over the poles mu of C(mu) C(1/mu) / (prod_other (1 - other/mu) prod_all (1 - other mu)).
    Neighbouring modes may have parts of opposite sign; a negative part counts as none, and the shares sum to 1.

    Parameters
    ----------
    p, q : int
        Orders of A (even) and C.
    theta : ndarray, shape (p + q,)
        [c, a].
    factors : ndarray, shape (p / 2, 2)
        z^2 + b z + c of each mode.
    roots : ndarray of complex128, shape (p,)
        Work space.
    shares : ndarray, shape (p / 2,)
        The result; zeros where nothing can be said.
    """
    for m in range(p // 2):
        centre = complex(-0.5 * factors[m, 0], 0.0)
        offset = cmath.sqrt(complex(0.25 * factors[m, 0] * factors[m, 0] - factors[m, 1], 0.0))
        roots[2 * m] = centre + offset
        roots[2 * m + 1] = centre - offset
    for i in range(p):
        if abs(roots[i]) > LARGEST_RADIUS:
            roots[i] *= LARGEST_RADIUS / abs(roots[i])
    total = 0.0
    for m in range(p // 2):
        power = 0.0
        for i in range(2 * m, 2 * m + 2):
            mu = roots[i]
            if mu == 0.0:
                continue
            inside = complex(1.0, 0.0)
            outside = complex(1.0, 0.0)
            inverse = 1.0 / mu
            down = inverse
            up = mu
            for k in range(q):
                inside += theta[k] * down
                outside += theta[k] * up
                down *= inverse
                up *= mu
            denominator = complex(1.0, 0.0)
            for k in range(p):
                denominator *= 1.0 - roots[k] * mu
                if k != i:
                    denominator *= 1.0 - roots[k] * inverse
            if denominator != 0.0:
                power += (inside * outside / denominator).real
        shares[m] = max(power, 0.0)
        total += shares[m]
    if not 0.0 < total < 1e300:
        shares[:] = 0.0
    else:
        for m in range(p // 2):
            shares[m] /= total
