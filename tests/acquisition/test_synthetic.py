"""Computed signals."""

from __future__ import annotations

from itertools import islice

import numpy as np

from chatter_monitor.acquisition.synthetic import Synthetic, counter


def test_array_comes_back_in_blocks(hear):
    """The samples of an array come back unchanged, and so do those of a single column."""
    samples = np.random.default_rng(1).standard_normal((1000, 3))
    assert np.array_equal(hear(Synthetic.from_array(samples, 8000, block_samples=64)).samples, samples)
    assert np.array_equal(hear(Synthetic.from_array(samples[:, 0], 8000)).samples, samples[:, :1])


def test_blocks_do_not_alias_the_array():
    """Whoever changes a block does not change the array that it came from."""
    samples = np.zeros((10, 1))
    next(Synthetic.from_array(samples, 8000).blocks()).samples[:] = 1.0
    assert not samples.any()


def test_counter_carries_the_index():
    """Each sample of a counter equals its index, from block to block, without end."""
    blocks = list(islice(Synthetic(counter, 12800, block_samples=7).blocks(), 5))
    assert [block.first_sample for block in blocks] == [0, 7, 14, 21, 28]
    assert np.array_equal(np.concatenate([block.samples for block in blocks])[:, 0], np.arange(35))
