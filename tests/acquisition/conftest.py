"""What the tests of the sources share."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from chatter_monitor.acquisition.source import Source


class Heard(NamedTuple):
    """Everything that a source yielded, sample by sample, so that the cuts between blocks no longer show."""

    index: NDArray[np.int64]  # (n,)
    samples: NDArray[np.float64]  # (n, channels)
    flags: NDArray[np.uint8]  # (n, channels), the loss before a block not included
    lost: int


def _hear(source: Source) -> Heard:
    index, samples, flags, lost, expected = [], [], [], 0, 0
    for block in source.blocks():
        assert block.first_sample == expected + block.lost, "the index must jump by exactly what is lost"
        assert block.sample_rate_hz == source.sample_rate_hz
        assert block.samples.dtype == np.float64
        assert block.samples.flags.c_contiguous
        n = len(block.samples)
        expected = block.first_sample + n
        lost += block.lost
        index.append(np.arange(block.first_sample, expected))
        samples.append(block.samples)
        flags.append(np.tile(np.array(block.flags or (0,) * source.channels, dtype=np.uint8), (n, 1)))
    if not index:
        return Heard(np.empty(0, np.int64), np.empty((0, source.channels)), np.empty((0, source.channels), np.uint8), 0)
    return Heard(np.concatenate(index), np.concatenate(samples), np.concatenate(flags), lost)


@pytest.fixture
def hear() -> Callable[[Source], Heard]:
    """Listen to a source until it ends."""
    return _hear
