"""Factors of A followed through the samples of two recursions that go side by side."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from chatter_monitor.kernels import poles
from chatter_monitor.kernels.lanes import as_lanes
from chatter_monitor.kernels.odp import TILE
from chatter_monitor.kernels.options import EXACT

LANES = 2
TALL = TILE // LANES
SAMPLES = 6 * TALL
Array = NDArray[np.float64]


@njit(**{**EXACT, "cache": False})
def _follow(p, size, numbers, stretch, factors, search):
    """Some samples of both recursions."""
    poles.follow(p, LANES, size, poles.parts(p, as_lanes(numbers, LANES)), numbers, stretch, factors, search)


def moving(p: int) -> Array:
    """Factors, shape (samples, lanes, p / 2, 2), whose poles wander; the first ones of lane 1 leap in the end."""
    t = np.linspace(0.0, 1.0, SAMPLES)[:, None, None]
    mode = np.arange(p // 2)
    angle = 0.3 + 0.6 * mode + 0.1 * np.sin(9.0 * t + mode + np.arange(LANES)[:, None])
    angle[4 * TALL + 3 :, 1, 0] += 0.2
    radius = 0.97 - 0.02 * mode + 0.01 * t
    return np.stack(np.broadcast_arrays(-2.0 * radius * np.cos(angle), radius**2), axis=-1)


def multiplied(factors: Array) -> Array:
    """Coefficients of A, shape (samples, lanes, p), from its factors."""
    product = np.ones((*factors.shape[:2], 1))
    for m in range(factors.shape[2]):
        b, c = factors[..., m, :1], factors[..., m, 1:]
        padded = np.pad(product, ((0, 0), (0, 0), (0, 2)))
        product = padded + b * np.roll(padded, 1, axis=-1) + c * np.roll(padded, 2, axis=-1)
    return product[..., 1:]


def followed(p: int, coefficients: Array, asked: NDArray[np.int64], pieces: list[int]) -> Array:
    """Factors at every sample, asked for in pieces of so many; none goes beyond a stretch."""
    numbers = np.zeros((poles.rows(p), LANES))
    for lane in range(LANES):
        state = numbers[:, lane].copy()
        poles.begin(p, state)
        numbers[:, lane] = state
    stretch, search, found = poles.new_stretch(p), poles.new_search(p), np.zeros(p * TILE)
    result = []
    begin = 0
    for size in pieces:
        rows = slice(begin, begin + size)
        stretch.asked[:] = poles.NOTHING
        stretch.asked[: size * LANES] = asked[rows].ravel()
        for i in range(p):
            stretch.coefficients[i * TILE : i * TILE + size * LANES] = coefficients[rows, :, i].ravel()
        _follow(p, size, numbers, stretch, found, search)
        places = found.reshape(p, TALL, LANES)[:, :size]
        result.append(places.transpose(1, 2, 0).reshape(size, LANES, p // 2, 2).copy())
        begin += size
    return np.concatenate(result)


@pytest.mark.parametrize("p", [2, 4, 6])
def test_each_mode_keeps_its_factor(p: int) -> None:
    """Wandering and leaping poles are found at every sample, each in its slot, ordered by frequency as they begin."""
    truth = moving(p)
    asked = np.full((SAMPLES, LANES), poles.NEAR)
    np.testing.assert_allclose(followed(p, multiplied(truth), asked, [TALL] * 6), truth, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("p", [4, 6])
def test_pieces_change_no_bit(p: int) -> None:
    """However a stretch is cut, with samples that teach nothing and a new beginning within it: the same bits."""
    rng = np.random.default_rng(2)
    coefficients = multiplied(moving(p)) + 1e-3 * rng.standard_normal((SAMPLES, LANES, p))
    asked = np.full((SAMPLES, LANES), poles.NEAR)
    asked[:3], asked[TALL + 2 : TALL + 5, 0], asked[2 * TALL + 3, 1] = poles.NOTHING, poles.NOTHING, poles.AFRESH
    whole = followed(p, coefficients, asked, [TALL] * 6)
    for pieces in ([1] * TALL, [3, TALL - 3], [TALL - 1, 1], [2, 2, TALL - 4]):
        np.testing.assert_array_equal(followed(p, coefficients, asked, pieces * 6), whole)


def test_slots_that_have_changed_places_are_put_right() -> None:
    """Between two samples one pole goes to where the other was, and that one leaves: each stays in the nearest slot."""
    truth = np.empty((2 * TALL, LANES, 2, 2))
    truth[:, :, 0], truth[:, :, 1] = (-1.6, 0.9), (-1.2, 0.9)
    truth[TALL:, :, 0], truth[TALL:, :, 1] = (-1.25, 0.9), (-0.2, 0.9)
    asked = np.full((2 * TALL, LANES), poles.NEAR)
    found = followed(4, multiplied(truth), asked, [TALL] * 2)
    np.testing.assert_allclose(np.sort(found[..., 0], axis=-1), np.sort(truth[..., 0], axis=-1), atol=1e-8)
    moved = np.abs(found[TALL] - found[TALL - 1]).sum(axis=(1, 2))
    crossed = np.abs(found[TALL][:, ::-1] - found[TALL - 1]).sum(axis=(1, 2))
    assert (moved <= crossed).all()
