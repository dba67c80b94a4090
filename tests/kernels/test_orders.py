"""The harmonic series against a naive twin that knows no table: exact Fourier sums and matrices."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

from chatter_monitor.kernels import comb, orders
from tests.signals import RATE_HZ

TWO_PI = 2 * math.pi
DRIFT = (1e-14, 1e-10)
CORNER = TWO_PI * 10 / RATE_HZ
FRAME = 640
MEMORY = RATE_HZ


@dataclass
class NaiveHarmonics:
    """Kalman filter of (angle, speed) at the middle of a tile, and averages of the amplitudes that each fold shows."""

    count: int
    speed: float
    speed_sd: float
    amplitude: NDArray[np.complex128] = field(init=False)

    def __post_init__(self) -> None:
        self.h = np.arange(1, self.count + 1)
        self.amplitude = np.zeros(self.count, dtype=complex)
        self.weight, self.variance, self.gate = np.zeros((3, self.count))
        self.state = np.array([0.0, self.speed])
        self.covariance = np.diag([0.0, self.speed_sd**2])
        self.drift, self.noise, self.innovation = math.sqrt(DRIFT[0] * DRIFT[1]), 1.0, 0.0
        self.offset = self.turned = 0.0
        self.correlation = np.zeros(self.count, dtype=complex)
        self.folded = self.learned = self.jumps = 0

    def waves(self) -> NDArray[np.complex128]:
        """exp(j h angle) over the tile, shape (samples, orders)."""
        angle = self.state[0] + self.state[1] * (np.arange(orders.TILE) - 0.5 * (orders.TILE - 1))
        return np.exp(1j * np.outer(angle, self.h))

    def tile(self, samples: NDArray[np.float64]) -> NDArray[np.float64]:
        waves, taken = self.waves(), self.gate * self.amplitude
        residual = samples - (waves @ taken).real
        present = np.isfinite(residual)
        centred = np.full(len(samples), np.nan)
        for t in np.flatnonzero(present):
            self.offset += CORNER * (residual[t] - self.offset)
            centred[t] = samples[t] - self.offset
        slope = (waves @ (1j * self.h * taken)).real[present]
        weighted = (waves @ (1j * self.h * self.weight * self.amplitude)).real[present]
        if slope @ weighted > 0:
            innovation = (centred - (waves @ taken).real)[present] @ weighted / (slope @ weighted)
            spread = self.covariance[0, 0] + self.noise / (slope @ weighted)
            gain = self.covariance[:, 0] / spread
            self.state += gain * innovation
            self.covariance -= np.outer(gain, gain) * spread
            relative = np.clip(innovation / math.sqrt(spread), -3, 3)
            self.noise = np.clip(self.noise * math.exp(orders.ADAPTATION * (relative**2 - 1)), 1, orders.LARGEST_NOISE)
            self.drift = np.clip(self.drift * math.exp(orders.ADAPTATION * relative * self.innovation), *DRIFT)
            self.innovation = relative
        waves = self.waves()
        left = centred - (waves @ taken).real
        self.correlation += left[present] @ waves[present].conj()
        self.folded += int(present.sum())
        n = orders.TILE
        self.turned += n * self.state[1]
        move = np.array([[1, n], [0, 1]])
        self.state = move @ self.state
        walk = self.drift * np.array([[n**3 / 3, n**2 / 2], [n**2 / 2, n]])
        self.covariance = move @ self.covariance @ move.T + walk
        return residual

    def learn(self) -> None:
        if self.turned < TWO_PI:
            return
        self.learned += 1
        rate = max(1 / self.learned, self.folded / MEMORY)
        step = 2 / self.folded * self.correlation - (1 - self.gate) * self.amplitude
        clear = self.gate == 1
        if clear.any():
            h, a, v = self.h[clear], self.amplitude[clear], self.variance[clear]
            turn = np.sum(h * (step[clear] * a.conj()).imag / v) / np.sum(h**2 * abs(a) ** 2 / v)
            ratio, told = step[clear] / a, abs(a) ** 2 / (abs(a) ** 2 + v)
            louder = np.average(ratio.real, weights=told)
            alike = louder**2 > orders.ALIKE * np.average(abs(ratio) ** 2, weights=told)
            if len(h) > 3 and louder > orders.JUMP and alike:
                step = step - louder * self.amplitude
                self.amplitude = (1 + louder) * self.amplitude
                self.variance = (1 + louder) ** 2 * self.variance
                turn /= 1 + louder
                self.jumps += 1
            step = step - 1j * self.h * turn * self.amplitude
        self.variance += rate * (abs(step) ** 2 - self.variance)
        self.amplitude = self.amplitude + rate * step
        significance = (2 / rate - 1) * abs(self.amplitude) ** 2 / self.variance
        self.gate = np.clip((significance - orders.FAINT) / (orders.CLEAR - orders.FAINT), 0, 1)
        sure = (self.gate == 1) & (self.h**2 * self.covariance[0, 0] < orders.LARGEST_PHASE_SD**2)
        if np.any(self.gate == 1):
            sure[np.flatnonzero(self.gate == 1)[0]] = True
        self.weight = np.where(sure, 4 / (self.variance * self.folded), 0.0)
        self.correlation[:] = self.turned = self.folded = 0


def wandering_comb(
    seconds: float, seed: int = 1, louder_from_s: float = math.inf
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Five harmonics of a speed that swings by 0.3 %, in noise and on an offset, at last threefold; with the angle."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    angle = np.cumsum(TWO_PI * 43.0 * (1 + 0.003 * np.sin(TWO_PI * 0.5 * t)) / RATE_HZ)
    signal = sum(a * np.cos(h * angle + h) for h, a in ((1, 0.5), (2, 1.0), (5, 0.7), (6, 0.3), (11, 0.2)))
    signal *= np.where(t < louder_from_s, 1.0, 3.0)
    return 0.3 + signal + 0.3 * rng.standard_normal(len(t)), angle


def test_it_is_its_naive_twin():
    """Residual, speed, amplitudes and gates are those of the twin, to the error of the table's interpolation."""
    samples, _ = wandering_comb(3.0, louder_from_s=2.2)
    samples[20_000:20_100] = np.nan
    count, speed = 20, TWO_PI * 43.02 / RATE_HZ
    state = orders.new_state(count, speed, 2e-3 * speed, DRIFT)
    twin = NaiveHarmonics(count, speed, 2e-3 * speed)
    out = np.empty(FRAME)
    for first in range(0, len(samples) - FRAME + 1, FRAME):
        frame = samples[first : first + FRAME]
        orders.subtract(frame, state, CORNER, out)
        expected = np.concatenate([twin.tile(tile) for tile in frame.reshape(-1, orders.TILE)])
        np.testing.assert_allclose(out, expected, atol=0.02)
        if state.angle[orders.TURNED] >= TWO_PI:
            orders.learn(state, 1, MEMORY)
        twin.learn()
        assert state.angle[orders.SPEED] == pytest.approx(twin.state[1], rel=1e-4)
    np.testing.assert_allclose(state.real + 1j * state.imag, twin.amplitude, atol=0.01)
    assert set(np.flatnonzero(state.gate == 1)) == set(np.flatnonzero(twin.gate == 1)) == {0, 1, 4, 5, 10}
    assert twin.jumps == 1  # which has been tried
    assert np.std(out) < 0.33  # the noise


@pytest.mark.parametrize("gain", [1.0, 1e-6, 1e9])
@pytest.mark.parametrize("count", [1, 2, 6, 43, 256])
def test_its_transforms_are_those_of_numpy(count, gain):
    """Of the fold into amplitudes, and from their spectra into tables that go once around and a little farther.

    The second table gets smaller as the signal gets larger.
    """
    rng = np.random.default_rng(count)
    state = orders.new_state(count, 0.02, 1e-4, DRIFT)
    points = state.fold.size
    angles = np.arange(points) * TWO_PI / points
    signal = sum(np.cos(order * angles + order) for order in range(1, count + 1))
    for _ in range(40):  # so often that all of them are steady
        fold = gain * (signal + 0.1 * rng.standard_normal(points))
        state.fold[:] = fold
        state.counts[orders.FOLDED] = points
        told = state.gate.copy(), state.real + 1j * state.imag
        orders.learn(state, 1, MEMORY)
        if not told[0].any():  # nothing is taken out yet, and no harmonic turns with the others
            part = np.pi * np.arange(1, count + 1) / points
            heard = 2.0 / points * (part / np.sin(part)) ** 2 * np.fft.rfft(fold)[1 : count + 1]
            np.testing.assert_allclose(state.coefficients[1:], heard - told[1], atol=1e-12 * gain)
    assert not state.fold.any()
    assert state.spectra[:, 1:].all()
    spectra = np.zeros((2, points // 2 + 1), np.complex128)
    spectra[:, : count + 1] = state.spectra
    tables = np.fft.irfft(spectra, axis=1)
    scale = abs(tables).max(axis=1, keepdims=True)
    np.testing.assert_allclose(state.tables[:, 1 : points + 1] / scale, tables / scale, atol=1e-12)
    np.testing.assert_array_equal(state.tables[:, 0], state.tables[:, points])
    np.testing.assert_array_equal(state.tables[:, points + 1 :], state.tables[:, 1:3])


def test_nothing_steers_the_angle_before_a_harmonic_is_steady_beyond_doubt():
    """The table that tells by how much the angle is off is empty then, to the last bit: the other one is not."""
    rng = np.random.default_rng(1)
    state = orders.new_state(6, 0.02, 1e-4, DRIFT)
    points = state.fold.size
    signal = np.cos(3 * np.arange(points) * TWO_PI / points)
    doubtful = 0
    for _ in range(40):
        state.fold[:] = signal + 2.0 * rng.standard_normal(points)
        state.counts[orders.FOLDED] = points
        orders.learn(state, 1, MEMORY)
        if 0.0 < state.gate.max() < 1.0:
            doubtful += 1
            assert state.tables[orders.SIGNAL].any()
            assert not state.tables[orders.WEIGHTED].any()
    assert doubtful


def test_its_standard_deviation_of_the_speed_is_honest():
    """The speed is within two of its standard deviations in 85 to 100 % of the frames of a swinging speed."""
    samples, angle = wandering_comb(8.0, seed=2)
    speed = TWO_PI * 43.0 / RATE_HZ
    state = orders.new_state(20, speed, 2e-3 * speed, DRIFT)
    out, inside = np.empty(FRAME), []
    for first in range(0, len(samples) - FRAME, FRAME):
        orders.subtract(samples[first : first + FRAME], state, CORNER, out)
        orders.learn(state, 1, MEMORY)
        middle = first + FRAME + orders.TILE // 2  # of the tile to come
        true = (angle[min(middle + 32, len(angle) - 1)] - angle[middle - 32]) / 64
        inside.append(abs(state.angle[orders.SPEED] - true) < 2 * math.sqrt(state.angle[orders.SPEED_VAR]))
    assert 0.85 <= np.mean(inside[40:]) <= 1.0


@pytest.mark.parametrize("teeth", [1, 2, 5])
def test_surprise_is_the_sum_over_lines(teeth):
    """Candidates are the parts of the lines within the range, each with the log chance of the lines on it.

    Lines at multiples of the teeth are so many times less likely there by chance.
    """
    frequencies, tolerances = np.array([100.0, 150.2, 61.0]), np.array([0.5, 0.5, 0.4])
    candidates, gains, hits = np.empty(50), np.empty(50), np.empty(50, dtype=np.int64)
    made = comb.surprise(frequencies, tolerances, 20.0, 60.0, teeth, candidates, gains, hits)
    expected = [f / k for f in frequencies for k in range(1, 8) if 20.0 <= f / k <= 60.0]
    np.testing.assert_allclose(candidates[:made], expected)
    for candidate, gain, hit in zip(candidates[:made], gains[:made], hits[:made], strict=True):
        order = np.round(frequencies / candidate)
        on = abs(frequencies - order * candidate) <= tolerances
        surprises = -np.log(2 * tolerances / (candidate * np.where(order % teeth == 0, teeth, 1)))[on]
        assert hit == on.sum()
        assert gain == pytest.approx(surprises.sum() - surprises.max())
