"""Logarithm and angle as vector instructions have them, against the C library's."""

import math

import numpy as np
from numba import njit

from chatter_monitor.kernels import odp


@njit
def logarithm(x):
    return odp.log(x)


@njit
def angle(re, im):
    return odp.angle_above(re, im)


def test_logarithm_is_exact_enough_wherever_poles_are():
    """From 3e-5 to 90, moduli of 0.006 to 9.5, and close to 1, where damping is small: relative error below 1e-10."""
    x = np.concatenate([np.geomspace(3e-5, 90.0, 5000), 1.0 + np.geomspace(1e-9, 1e-2, 100)])
    found = np.array([logarithm(value) for value in x])
    np.testing.assert_allclose(found, np.log(x), rtol=1e-10)


def test_angle_is_exact_enough_all_around():
    """From 0 to 180 degrees, whatever the modulus: relative error below 1e-9."""
    truth = np.concatenate([np.geomspace(1e-9, 1e-2, 100), np.linspace(0.01, math.pi, 5000)])
    for modulus in (1e-3, 1.0, 30.0):
        found = [angle(modulus * math.cos(phi), modulus * math.sin(phi)) for phi in truth]
        np.testing.assert_allclose(found, truth, rtol=1e-9)
