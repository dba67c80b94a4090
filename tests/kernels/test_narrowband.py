"""How the amplitude of a line behaves, against naive twins."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.kernels.narrowband import (
    FRAME_HOPS,
    GROWTH_HOPS,
    LAG,
    LONGEST_LAG,
    PARTS,
    beat,
    behaviour,
    put_in_order,
    variation_beside,
)
from tests import naive
from tests.kernels.rings import HOPS, ring


def line_of(amplitudes, valid, head):
    line = np.full((PARTS, HOPS), np.nan)
    put_in_order(amplitudes, valid, head, line)
    return line


@pytest.mark.parametrize("missing", [(), tuple(range(20, 33)), (0, 79)])
@pytest.mark.parametrize("b", [2, 33, 63])
def test_behaviour_is_that_of_the_twins(missing, b):
    """Variation, growth and coherence of a line are as defined plainly, with hops missing or not."""
    ordered, valid, (spectra, ring_valid, head) = ring(4, missing)
    variation, growth, coherence = behaviour(line_of(spectra[b], ring_valid, head), np.zeros(HOPS))
    known = ordered[valid, b]
    assert variation == pytest.approx(naive.variation(known[-HOPS // 2 :]))
    assert growth == pytest.approx(naive.growth(known[-GROWTH_HOPS:]))
    lags = range(LAG, LONGEST_LAG + 1)
    assert coherence == pytest.approx(max(naive.coherence(ordered[:, b], valid, lag) for lag in lags))


@pytest.mark.parametrize("missing", [(), tuple(range(50, 63)), (0, 79)])
def test_variation_beside_the_level_is_that_of_the_twin(missing):
    """Each hop counts in units of the level of its frame, hops missing or not, the newest frame being anywhere."""
    ordered, valid, (spectra, known, head) = ring(11, missing)
    levels = np.random.default_rng(12).normal(size=30)
    beside = variation_beside(line_of(spectra[7], known, head), np.roll(levels, 43), 43, np.zeros(HOPS))
    half = HOPS // 2
    gains = np.exp(-0.5 * np.repeat(levels, FRAME_HOPS)[-half:])
    assert beside == pytest.approx(naive.variation((gains * ordered[-half:, 7])[valid[-half:]]))


def test_too_few_hops_tell_nothing():
    """Before there are as many hops as growth is fitted to, nothing is told; of silence neither."""
    spectra, valid, head = ring(6, (0, 1, *range(GROWTH_HOPS + 1, HOPS)))[2]
    assert behaviour(line_of(spectra[20], valid, head), np.zeros(HOPS)) == (0.0, 0.0, 0.0)
    silence = line_of(np.zeros(HOPS, complex), np.ones(HOPS, bool), head)
    assert behaviour(silence, np.zeros(HOPS)) == pytest.approx((0, 0, 0))


@pytest.mark.parametrize("missing", [(), (70, 79)])
def test_the_phase_tells_how_far_a_line_is_from_its_bin(missing):
    """What turns by 0.3 of a circle in a hop is as much of a circle's bins away; to and fro tells nothing."""
    head = 43
    valid = ~np.isin(np.arange(HOPS), missing)
    turning = np.exp(2j * np.pi * 0.3 * np.arange(HOPS))
    line = line_of(np.roll(turning, head), np.roll(valid, head), head)
    assert beat(line, 3.2, 9.0) == pytest.approx(0.3 * 3.2)
    jumping = np.exp(0.5j * np.pi * np.arange(HOPS) ** 2)
    assert beat(line_of(np.roll(jumping, head), np.roll(valid, head), head), 3.2, 9.0) == 9.0
