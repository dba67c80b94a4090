"""Lines of a short-time spectrum against their naive twins."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.kernels import lines
from tests import naive

HOPS, BINS, LOWEST = 80, 65, 2


def ring(seed: int, missing: tuple[int, ...] = ()):
    """Random transforms, oldest first, which of them are valid; and the same as a ring with its head."""
    rng = np.random.default_rng(seed)
    ordered = rng.standard_normal((HOPS, BINS)) + 1j * rng.standard_normal((HOPS, BINS))
    valid = np.ones(HOPS, bool)
    valid[list(missing)] = False
    head = HOPS + int(rng.integers(HOPS))
    return ordered, valid, (np.roll(ordered, head, axis=0).T.copy(), np.roll(valid, head), head)


def describe(transforms, power, b):
    out = np.full(lines.MEASURES, np.nan)
    lines.describe(*transforms, power, float(np.sum(power[LOWEST:])), b, np.zeros(HOPS), out)
    return out


def stand_out(power):
    result = np.full(BINS, np.nan)
    lines.stand_out(power, LOWEST, np.zeros(BINS + 1), result)
    return result


@pytest.mark.parametrize("missing", [(), (79,), (76, 78)])
def test_recent_power_is_the_mean_of_the_valid_hops(missing):
    """Power of each bin is the mean over those of the newest four hops that hold samples."""
    ordered, valid, transforms = ring(1, missing)
    power = np.zeros(BINS)
    assert lines.recent_power(*transforms, 4, power) == 4 - len(missing)
    np.testing.assert_allclose(power, (abs(ordered[-4:][valid[-4:]]) ** 2).mean(axis=0))


def test_no_power_without_samples():
    """Four hops without samples have no power, and say so."""
    power = np.ones(BINS)
    assert lines.recent_power(*ring(1, (76, 77, 78, 79))[2], 4, power) == 0
    assert not power.any()


def test_prominence_is_that_of_the_twin():
    """Every bin, those at both ends of the band included, stands out as the plain definition says."""
    power = np.random.default_rng(2).exponential(size=BINS)
    power[30] *= 1000
    np.testing.assert_allclose(stand_out(power), naive.prominence(power, LOWEST), atol=1e-12)


def test_prominence_does_not_depend_on_the_gain():
    """A louder signal has the same prominence."""
    power = np.random.default_rng(3).exponential(size=BINS)
    np.testing.assert_allclose(stand_out(1e9 * power), stand_out(power), atol=1e-9)


def test_most_prominent_are_maxima_a_lobe_apart():
    """Peaks come in order of their height; what is within the lobe of a higher one, or no maximum, is none."""
    heights = np.zeros(BINS)
    heights[[10, 12, 30, 31, 50]] = 5.0, 4.0, 9.0, 8.5, 1.0
    peaks = np.zeros(5, np.int64)
    count = lines.most_prominent(heights, LOWEST, peaks)
    assert peaks[: min(count, 3)].tolist() == [30, 10, 50]


@pytest.mark.parametrize("missing", [(), tuple(range(20, 33)), (0, 79)])
@pytest.mark.parametrize("b", [2, 33, 63])
def test_measures_are_those_of_the_twins(missing, b):
    """Share, variation, growth and coherence of a line are as defined plainly, with hops missing or not."""
    ordered, valid, transforms = ring(4, missing)
    power = np.random.default_rng(5).exponential(size=BINS)
    out = describe(transforms, power, b)
    known = ordered[valid, b]
    assert out[lines.SHARE] == pytest.approx(min(power[max(b - 3, 0) : b + 4].sum() / power[LOWEST:].sum(), 1.0))
    assert out[lines.VARIATION] == pytest.approx(naive.variation(known[-HOPS // 2 :]))
    assert out[lines.GROWTH] == pytest.approx(naive.growth(known[-lines.GROWTH_HOPS :]))
    lags = range(lines.LAG, lines.LONGEST_LAG + 1)
    assert out[lines.COHERENCE] == pytest.approx(max(naive.coherence(ordered[:, b], valid, lag) for lag in lags))


@pytest.mark.parametrize("missing", [(), tuple(range(50, 63)), (0, 79)])
def test_variation_beside_the_level_is_that_of_the_twin(missing):
    """Each hop counts in units of the level of its frame, hops missing or not, the newest frame being anywhere."""
    ordered, valid, (spectra, known, head) = ring(11, missing)
    levels = np.random.default_rng(12).normal(size=30)
    beside = lines.variation_beside(spectra[7], known, head, np.roll(levels, 43), 43, np.zeros(HOPS))
    half = HOPS // 2
    gains = np.exp(-0.5 * np.repeat(levels, lines.FRAME_HOPS)[-half:])
    assert beside == pytest.approx(naive.variation((gains * ordered[-half:, 7])[valid[-half:]]))


def test_too_few_hops_tell_the_share_only():
    """Before there are as many hops as growth is fitted to, nothing but the share is told; in silence nothing."""
    _, _, transforms = ring(6, (0, 1, *range(lines.GROWTH_HOPS + 1, HOPS)))
    out = describe(transforms, np.ones(BINS), 20)
    assert out[lines.SHARE] == pytest.approx(7 / (BINS - LOWEST))
    rest = [lines.VARIATION, lines.GROWTH, lines.COHERENCE]
    assert not out[rest].any()
    assert not describe(ring(6)[2], np.zeros(BINS), 20)[[lines.SHARE, *rest]].any()


@pytest.mark.parametrize(("head", "frames"), [(9, 5), (9, 9), (30, 7), (30, 12), (30, 40), (2, 12)])
@pytest.mark.parametrize(("idle", "since"), [(0.0, 99), (0.5, 99), (0.5, 4)])
@pytest.mark.parametrize("spread", [0.0, 6.0])
def test_rise_is_that_of_the_twin(head, frames, spread, idle, since):
    """Rise is taken over as many frames as asked for, as have been, and as are kept, but for silent and idle ones."""
    rows, b = 12, 20
    rng = np.random.default_rng(7)
    history, loudness = rng.standard_normal((head, BINS)), spread * rng.standard_normal(head)
    in_the_cut = np.append(rng.random(head - 1) > idle, True)
    kept, levels, cutting = np.zeros((BINS, rows)), np.zeros(rows), np.zeros(rows, bool)
    for index, relief in enumerate(history):
        kept[:, index % rows] = relief
        levels[index % rows], cutting[index % rows] = loudness[index], in_the_cut[index]
    last = slice(-min(frames, rows), None)
    expected = naive.rise(history[last], loudness[last], in_the_cut[last], since, b)
    assert lines.rise(kept, levels, cutting, since, head, frames, b, np.zeros(rows)) == pytest.approx(expected)


def test_the_first_frame_has_not_risen():
    """There is nothing to have risen from."""
    assert lines.rise(np.ones((BINS, 12)), np.ones(12), np.ones(12, bool), np.inf, 1, 12, 20, np.zeros(12)) == 0.0


@pytest.mark.parametrize("head", [40, 57, 90])
@pytest.mark.parametrize("since", [1, 6, 30])
def test_news_is_that_of_the_twin(head, since):
    """What is new in a cut is so against the cuts before and the last air, once enough of both has been heard."""
    rows, b = 57, 20
    rng = np.random.default_rng(head + since)
    history = rng.standard_normal((head, BINS))
    in_the_cut = rng.random(head) > 0.5
    in_the_cut[-since:] = True
    kept, cutting = np.zeros((BINS, rows)), np.zeros(rows, bool)
    for index, relief in enumerate(history):
        kept[:, index % rows], cutting[index % rows] = relief, in_the_cut[index]
    expected = naive.news(history[-rows:], in_the_cut[-rows:], since, b, lines.HEARD)
    assert lines.news(kept, cutting, float(since), head, rows, b, np.zeros(rows)) == pytest.approx(expected)
    in_the_air = cutting.copy()
    in_the_air[(head - 1) % rows] = False
    assert lines.news(kept, in_the_air, float(since), head, rows, b, np.zeros(rows)) == 0.0
    assert lines.news(kept, cutting, np.inf, head, rows, b, np.zeros(rows)) == 0.0


def test_nothing_rises_out_of_the_cut():
    """While nothing is cut no line has risen, however loud it is against the cut before."""
    loud = np.ones((BINS, 12))
    loud[:, 11] = 9.0
    cutting = np.ones(12, bool)
    cutting[11] = False
    assert lines.rise(loud, np.ones(12), cutting, np.inf, 12, 12, 20, np.zeros(12)) == 0.0
