"""Kernels that are bound to the types of their arguments."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from chatter_monitor.kernels.binding import bound


class State(NamedTuple):
    """Something that a kernel takes."""

    total: NDArray[np.float64]
    scale: float


@njit
def add(samples, state):
    for t in range(samples.shape[0]):
        state.total[0] += state.scale * samples[t]


def test_what_differs_in_type_has_machine_code_of_its_own() -> None:
    """Arguments of the same types share machine code; another type, layout or permission has its own."""
    state = State(np.zeros(1), 2.0)
    samples = np.arange(6.0)
    frozen = samples.copy()
    frozen.flags.writeable = False
    kinds = [samples, samples.astype(np.float32), samples.astype(np.int64), samples[::2], frozen]
    codes = [bound(add, kind, state) for kind in kinds]
    assert bound(add, np.ones(3), State(np.ones(1), 0.5)) is codes[0]
    for kind, code in zip(kinds, codes, strict=True):
        state.total[0] = 0.0
        code(kind, state)
        assert state.total[0] == 2.0 * kind.sum()
