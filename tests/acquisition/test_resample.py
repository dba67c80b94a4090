"""Conversion to the tracker's rate."""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import cycle, pairwise

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from chatter_monitor.acquisition.resample import Resampled
from chatter_monitor.acquisition.source import Source
from chatter_monitor.acquisition.synthetic import Synthetic
from chatter_monitor.records import Block, Flag

RATES = [8000, 11_025, 16_000, 22_050, 25_600, 44_100, 48_000, 51_200, 96_000, 192_000, 12_799.5, 44_101]
TARGET = 12_800.0


class Given(Source):
    """A source of blocks made beforehand, such as ones with gaps and flags."""

    def __init__(self, blocks: list[Block]) -> None:
        self.sample_rate_hz = blocks[0].sample_rate_hz
        self.channels = blocks[0].samples.shape[1]
        self.length = None
        self.closed = False
        self._blocks = blocks

    def blocks(self):
        return iter(self._blocks)

    def close(self):
        self.closed = True


def cut(samples, rate, sizes, *, lost=(), flagged=()):
    """Blocks of the given sizes, again and again, without the index range `lost`, flagged over `flagged`."""
    edges, position = {0, len(samples), *lost, *flagged}, 0
    for size in cycle(sizes):
        position += size
        if position >= len(samples):
            break
        edges.add(position)
    blocks, expected, edges = [], 0, sorted(edges)
    for start, end in pairwise(edges):
        if lost and lost[0] <= start < lost[1]:
            continue
        flags = ()
        if flagged and flagged[0] <= start < flagged[1]:
            flags = (Flag.NONE, Flag.CLIPPED)
        blocks.append(Block(start, samples[start:end], rate, start - expected, flags))
        expected = end
    return Given(blocks)


@pytest.mark.parametrize("rate", RATES)
def test_output_sample_k_is_the_signal_at_its_time(hear, rate):
    """Sines keep their phase on the file's clock to less than 1e-5 of a sample, and their amplitude to 0.01 dB."""
    n = int(1.5 * rate)
    frequency_hz = np.array([441.0, 0.41 * min(rate, TARGET)])
    signal = Synthetic(
        lambda index: np.sin(2 * np.pi * frequency_hz * index[:, np.newaxis] / rate), rate, channels=2, length=n
    )
    heard = hear(Resampled(signal))
    inner = slice(500, -500)
    time_s = heard.index[inner, np.newaxis] / TARGET
    window = np.blackman(len(time_s))[:, np.newaxis]
    sine = 2j * (window * heard.samples[inner] * np.exp(-2j * np.pi * frequency_hz * time_s)).sum(axis=0) / window.sum()
    shift_samples = np.angle(sine) / (2 * np.pi * frequency_hz) * TARGET
    assert np.abs(shift_samples).max() < 1e-5
    assert np.abs(20 * np.log10(np.abs(sine))).max() < 0.01


@pytest.mark.parametrize("rate", RATES)
def test_an_impulse_stays_in_its_place(hear, rate):
    """The centre of a short pulse's response lies at the time of the pulse, and its sum keeps the area."""
    n, place = int(rate), int(0.37 * rate)
    samples = np.exp(-(((np.arange(n)[:, np.newaxis] - place) / rate / 0.2e-3) ** 2))
    heard = hear(Resampled(Synthetic.from_array(samples, rate, block_samples=1000)))
    response = heard.samples[:, 0]
    assert abs((response**2) @ heard.index / (response @ response) - place * TARGET / rate) < 0.01
    assert response.sum() * rate / TARGET == pytest.approx(samples.sum(), rel=1e-5)


@settings(
    max_examples=150, derandomize=True, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    rate=st.sampled_from(RATES),
    n=st.integers(100, 3000),
    sizes=st.lists(st.integers(1, 1500), min_size=2, max_size=5),
    spans=st.lists(st.integers(0, 3000), min_size=4, max_size=4),
    lossy=st.booleans(),
)
def test_the_cut_of_the_input_changes_nothing(hear, rate, n, sizes, spans, lossy):
    """Samples, indices, flags and loss are bit-identical for any block sizes, gaps and flags included."""
    samples = np.random.default_rng(n).standard_normal((n, 2))
    lost = sorted(min(s, n - 50) for s in spans[:2]) if lossy else ()
    flagged = sorted(min(s, n) for s in spans[2:])
    pieces = hear(Resampled(cut(samples, rate, sizes, lost=lost, flagged=flagged)))
    whole = hear(Resampled(cut(samples, rate, [n], lost=lost, flagged=flagged)))
    for one, other in zip(pieces, whole, strict=True):
        assert np.array_equal(one, other)
    assert len(whole.index) + whole.lost == math.floor(n * Fraction(TARGET) / Fraction(rate) + Fraction(1, 2))


@pytest.mark.parametrize("rate", RATES)
def test_the_length_is_known_beforehand(hear, rate):
    """A source of n samples makes n times the ratio of the rates, rounded, and says so."""
    for n in (1, 777, 5000, 5001):
        source = Resampled(Synthetic.from_array(np.ones((n, 1)), rate))
        assert source.length == math.floor(n * TARGET / rate + 0.5)
        assert len(hear(source).index) == source.length


@pytest.mark.parametrize("rate", [8000, 44_100, 192_000])
def test_flags_reach_whatever_the_flagged_samples_touch(hear, rate):
    """Output that changes when the flagged samples change is flagged, on their channel, and little else is."""
    n, first, end = int(rate), int(0.4 * rate), int(0.41 * rate)
    samples = np.random.default_rng(5).uniform(-1, 1, (n, 2))
    changed = samples.copy()
    changed[first:end] = np.random.default_rng(6).uniform(-1, 1, (end - first, 2))
    heard = hear(Resampled(cut(samples, rate, [1024], flagged=(first, end))))
    touched = np.abs(heard.samples - hear(Resampled(cut(changed, rate, [1024]))).samples) > 1e-9
    flagged = heard.flags == Flag.CLIPPED
    assert touched[:, 1].sum() > 100
    assert not (touched[:, 1] & ~flagged[:, 1]).any()
    assert flagged[:, 1].sum() < touched[:, 1].sum() + 150 * max(1.0, TARGET / rate)
    assert not flagged[:, 0].any()


def test_flags_reach_exactly_as_far_as_documented(hear):
    """Wherever a flag goes up, what soxr (160) and the half-band filter (31) reach before it is flagged as well."""
    rate, channels = 48_000, 64
    goes_up = 4000 + 50 * np.arange(channels)
    blocks = []
    for start in range(0, 12_000, 10):
        flags = tuple(Flag.CLIPPED if start >= place else Flag.NONE for place in goes_up)
        blocks.append(Block(start, np.zeros((10, channels)), rate, flags=flags))
    flagged = hear(Resampled(Given(blocks))).flags == Flag.CLIPPED
    first = np.ceil((goes_up - (160 + 31) * rate / (2 * TARGET)) * TARGET / rate).astype(int)
    assert np.array_equal(flagged, np.arange(len(flagged))[:, np.newaxis] >= first)


@pytest.mark.parametrize("rate", RATES)
def test_a_gap_keeps_the_clock(hear, rate):
    """After a gap the samples still stand at their own times, and those that fall into it are lost."""
    n, first, end = int(2 * rate), int(0.5 * rate) + 1, int(1.2 * rate) + 2
    sine = np.sin(2 * np.pi * 441.0 * np.arange(n) / rate)[:, np.newaxis]
    heard = hear(Resampled(cut(sine, rate, [4096], lost=(first, end))))
    lost_index = np.setdiff1d(np.arange(heard.index[-1] + 1), heard.index)
    times = lost_index * Fraction(rate) / Fraction(TARGET)
    assert lost_index.size == heard.lost == pytest.approx((end - first) * TARGET / rate, abs=1)
    assert times.min() >= first
    assert times.max() < end
    clean = heard.flags[:, 0] == Flag.NONE
    clean[:500] = clean[-500:] = False
    error = heard.samples[clean, 0] - np.sin(2 * np.pi * 441.0 * heard.index[clean] / TARGET)
    assert np.abs(error).max() < 1e-6
    beside_the_gap = np.isin(heard.index, [lost_index[0] - 1, lost_index[-1] + 1])
    assert (heard.flags[beside_the_gap] == Flag.GAP).all()
    assert np.count_nonzero(heard.flags) < 4 * 170 * max(1.0, TARGET / rate)


def test_a_gap_between_two_output_samples_still_shows(hear):
    """One sample lost of fifteen loses no output sample, but those around it are flagged."""
    heard = hear(Resampled(cut(np.ones((192_000, 1)), 192_000, [10_000], lost=(96_001, 96_002))))
    assert heard.lost == 0
    assert heard.flags[6400, 0] == Flag.GAP
    assert heard.flags[[5000, 8000], 0].tolist() == [0, 0]


def test_equal_rates_pass_the_very_blocks():
    """Without a conversion to do the blocks are handed on untouched."""
    source = cut(
        np.random.default_rng(1).standard_normal((5000, 2)), TARGET, [700], lost=(100, 200), flagged=(900, 901)
    )
    assert all(one is other for one, other in zip(Resampled(source).blocks(), source.blocks(), strict=True))


def test_a_huge_ratio_stays_within_bounds():
    """A recording at a very low rate does not turn one block into gigabytes."""
    source = Resampled(Synthetic.from_array(np.zeros((4096, 1)), 100))
    sizes = [len(block.samples) for block in source.blocks()]
    assert sum(sizes) == 4096 * 128
    assert max(sizes) < 100_000


def test_closing_closes_the_source():
    """Whoever closes the converter closes what it reads from."""
    source = cut(np.zeros((10, 1)), 48_000, [10])
    with Resampled(source):
        pass
    assert source.closed
