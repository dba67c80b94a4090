"""The recursion against its naive twin, and what it survives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.signal import lfilter

from chatter_monitor.kernels import rarma, track, udu
from tests import naive

RATE = 12800.0
FORGETTING = 1 - 1 / 1024
ORDERS = [(4, 3), (2, 0), (2, 6), (4, 0), (6, 4), (8, 6)]


class Channel:
    """The kernels with their state, for one channel."""

    def __init__(self, p: int = 4, q: int = 3, forgetting: float = FORGETTING) -> None:
        self.p, self.q, self.forgetting = p, q, forgetting
        self.state = track.new_state(p, q, np.array([forgetting]), np.array([RATE]), 0)
        self.recursion = rarma.parts(p, q, self.state.memory[0])

    def run(self, samples: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        n, modes = len(samples), self.p // 2
        out = (*(np.zeros((1, modes, n), np.float32) for _ in range(4)), np.zeros((1, modes, n), np.uint8))
        track.track(self.p, self.q, samples[None], self.state, out)
        return [column[0].T for column in out]


def cut(n: int, seed: int = 1) -> NDArray[np.float64]:
    """Two modes, 400 Hz 3 % and 2000 Hz 2 %, driven by white noise."""
    a = np.array([1.0])
    for f, z in ((400, 0.03), (2000, 0.02)):
        mu = np.exp(2 * np.pi * f / RATE * (-z + 1j * np.sqrt(1 - z * z)))
        a = np.convolve(a, [1.0, -2 * mu.real, abs(mu) ** 2])
    return np.asarray(lfilter([1.0, -1.1, 0.55, -0.125], a, np.random.default_rng(seed).standard_normal(n)))


@pytest.mark.parametrize(("p", "q"), ORDERS)
def test_kernel_equals_its_naive_twin(p: int, q: int) -> None:
    """Coefficients, covariance and ODPs are those of the plain recursion, for every order."""
    y = cut(1500, seed=p * 10 + q)
    channel, twin = Channel(p, q), naive.NaiveRarma(p, q, FORGETTING)
    out = channel.run(y)
    for sample in y:
        twin.step(sample)
    np.testing.assert_allclose(channel.recursion.theta, twin.theta, rtol=1e-6, atol=1e-8)
    u = np.eye(p + q)
    for j in range(p + q):
        u[:j, j] = channel.recursion.u[udu.column(j) : udu.column(j + 1)]
    covariance = u @ np.diag(channel.recursion.d) @ u.T
    scale = np.sqrt(np.diag(twin.covariance))
    np.testing.assert_allclose(covariance / np.outer(scale, scale), twin.covariance / np.outer(scale, scale), atol=1e-5)
    found = np.array([column[-1] for column in out[:4]]).T
    found = found[np.isfinite(found[:, 0])]
    found = found[np.argsort(found[:, 0])]
    np.testing.assert_allclose(found, np.array(twin.odps(RATE)).reshape(-1, 4), rtol=1e-4)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.integers(1, 700), min_size=1, max_size=12), st.sampled_from([(4, 3), (6, 4)]))
def test_any_chunking_gives_the_same_bits(sizes: list[int], orders: tuple[int, int]) -> None:
    """However the samples are handed over, every output of every sample is bit-identical."""
    y = cut(sum(sizes), seed=7)
    y[len(y) // 2] = np.nan
    whole = Channel(*orders).run(y)
    channel, begin, pieces = Channel(*orders), 0, []
    for size in sizes:
        pieces.append(channel.run(y[begin : begin + size]))
        begin += size
    for i, column in enumerate(whole):
        assert np.concatenate([piece[i] for piece in pieces]).tobytes() == column.tobytes()


@pytest.mark.parametrize("gain", [1e-6, -1.0, 1e6, 2.0**40])
def test_the_gain_of_the_microphone_does_not_matter(gain: float) -> None:
    """Scaling the signal leaves frequency, damping and their standard deviations as they are."""
    y = cut(20_000)
    for column, scaled in zip(Channel().run(y), Channel().run(gain * y), strict=True):
        np.testing.assert_allclose(scaled[200:], column[200:], rtol=2e-3)


def settle(channel: Channel, seed: int = 3) -> None:
    """After whatever happened, half a second of the cut must be tracked within five standard deviations."""
    out = channel.run(cut(25_600, seed))
    frequency, damping, frequency_sd, damping_sd = (np.sort(column[-1]) for column in out[:4])
    assert np.all(np.isfinite(channel.recursion.theta))
    np.testing.assert_array_less(abs(frequency - [400, 2000]), 5 * frequency_sd.max())
    np.testing.assert_array_less(abs(damping - [0.02, 0.03]), 5 * damping_sd.max())
    assert damping_sd.max() < 0.03


def test_an_hour_of_digital_silence_leaves_a_usable_tracker() -> None:
    """Zeros freeze the adaptation, hold the values and do not wind anything up."""
    channel = Channel()
    channel.run(cut(20_000))
    before = channel.recursion.theta.copy()
    silence = np.zeros(round(RATE) * 60)
    for _ in range(60):
        out = channel.run(silence)
    assert set(np.unique(out[4])) == {track.HELD}
    np.testing.assert_allclose(channel.recursion.theta, before, atol=0.5)
    settle(channel)


def test_silence_from_the_start_is_no_estimate() -> None:
    """A channel that never moved reports nothing, and tracks as soon as it is alive."""
    channel = Channel()
    out = channel.run(np.zeros(50_000))
    assert set(np.unique(out[4])) == {track.STARTING}
    assert np.all(np.isnan(out[0]))
    settle(channel)


@pytest.mark.parametrize("level", [1.0, -0.3, 1e-5])
def test_constant_input(level: float) -> None:
    """A stuck channel is held, and afterwards the tracker works."""
    channel = Channel()
    channel.run(cut(20_000))
    out = channel.run(np.full(200_000, level))
    assert set(np.unique(out[4][1000:])) == {track.HELD}
    settle(channel)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
def test_samples_that_are_no_numbers_are_missing_samples(bad: float) -> None:
    """NaN, infinite and absurd samples are counted, held over, and do no harm, alone or in bursts."""
    channel = Channel()
    y = cut(60_000)
    y[[10, 20_000, 20_003]] = bad
    y[40_000:41_000] = bad
    out = channel.run(y)
    assert channel.recursion.heard[rarma.MISSING] == 1003
    assert np.all(out[4][40_000:41_256] == track.HELD)
    assert np.all(out[4][41_256:] == track.OSCILLATORY)
    assert np.all(np.isfinite(out[1][19_000:40_500]))
    settle(channel)


def test_pure_tone_and_its_end() -> None:
    """A noiseless sine, the worst-conditioned input there is, reads zero damping and leaves a usable tracker."""
    channel = Channel()
    t = np.arange(400_000) / RATE
    out = channel.run(np.sin(2 * np.pi * 733.0 * t))
    nearest = np.argmin(abs(out[0][-1] - 733.0))
    assert abs(out[0][-1, nearest] - 733.0) < 0.1
    assert abs(out[1][-1, nearest]) < 1e-4
    settle(channel)


def test_growing_vibration_is_not_projected_back() -> None:
    """An unstable pole is the message: damping reads negative while the vibration grows."""
    n = 8000
    t = np.arange(n) / RATE
    zeta, omega = -0.004, 2 * np.pi * 900.0
    y = np.exp(-zeta * omega * t) * np.sin(omega * t) * 1e-3 + 1e-5 * np.random.default_rng(5).standard_normal(n)
    out = Channel().run(y)
    nearest = np.argmin(abs(out[0][-1] - 900.0))
    assert out[1][-1, nearest] == pytest.approx(zeta, abs=1e-3)


def test_impacts_do_not_take_over() -> None:
    """Single samples a thousand times too large move the damping by less than two of its standard deviations."""
    y = cut(60_000)
    clean = Channel().run(y)
    y[30_000::5000] *= 1000.0
    struck = Channel().run(y)
    assert abs(struck[1][59_000] - clean[1][59_000]).max() < 2 * clean[3][59_000].max()


def test_level_jumps_are_followed_within_a_few_memories() -> None:
    """After the level falls or rises a thousandfold with new dynamics, the new modes are found in five memories."""
    channel = Channel()
    y = cut(40_000)
    t = np.arange(6000) / RATE
    rng = np.random.default_rng(0)
    for level in (1e-3, 1.0, 1e3):
        channel.run(y)
        new = np.zeros(6000)
        mu = np.exp(2 * np.pi * 1200 / RATE * (-0.02 + 1j))
        for i in range(2, len(t)):
            new[i] = 2 * mu.real * new[i - 1] - abs(mu) ** 2 * new[i - 2] + rng.standard_normal()
        out = channel.run(level * new)
        assert np.nanmin(abs(out[0][-1] - 1200.0)) < 25.0


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_eight_hours_stay_sound() -> None:
    """After 3.7e8 updates of noise, tones, level changes and silence, the twin and the kernel still agree."""
    channel = Channel()
    rng = np.random.default_rng(11)
    second = int(RATE)
    t = np.arange(10 * second) / RATE
    tone = np.sin(2 * np.pi * 1067.0 * t)
    total = 0
    while total < 8 * 3600 * second:
        kind = rng.integers(5)
        if kind == 0:
            y = cut(len(t), seed=int(rng.integers(1 << 30)))
        elif kind == 1:
            y = tone.copy()
        elif kind == 2:
            y = tone + 1e-4 * rng.standard_normal(len(t))
        elif kind == 3:
            y = cut(len(t), seed=int(rng.integers(1 << 30))) * 10.0 ** rng.uniform(-6, 3)
        else:
            y = np.round(cut(len(t), seed=int(rng.integers(1 << 30))) * 3) / 32768
        for _ in range(12):
            channel.run(y)
        total += 12 * len(y)
        assert np.all(channel.recursion.d > 0)
        assert np.all(np.isfinite(channel.recursion.theta))
    settle(channel)
