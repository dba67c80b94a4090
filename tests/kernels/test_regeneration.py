"""Whittle's likelihood of the regenerative spectrum against a twin that can be checked by eye, and its maximum."""

import numpy as np
import pytest
from scipy.linalg import toeplitz

from chatter_monitor.kernels.delay_roots import critical_coefficient
from chatter_monitor.kernels.regeneration import VALUE, Likelihood, begin_climb, climb, race, solve, stabilise
from chatter_monitor.kernels.regenerative_spectrum import (
    DELAYS,
    KAPPA,
    LOG_GAIN,
    LOG_OMEGA,
    LOG_SPREAD,
    LOG_TAU,
    LOG_ZETA,
    MODULATION,
    PARAMETERS,
)
from chatter_monitor.kernels.whittle import WORK, whittle

FIRST, WIDTH, CENTRE, BINS = 2 * np.pi * 600.0, 2 * np.pi * 0.4, 2 * np.pi * 950.0, 1500
THETA = np.array([-3.0, 1.7, np.log(2 * np.pi * 990.0), np.log(0.03), 0.025, np.log(0.027), np.log(0.003), 0.6, -5.0])
STEADY = THETA * (np.arange(PARAMETERS) != MODULATION)  # a process stiffness that the teeth do not modulate

OFF = np.array([1.02, 0.98, 1.0002, 1.02, 0.9, 1.0002, 1.02, 0.9, 1.02])  # by which the starts of a climb are wrong


def spectrum(theta, omega, delays):
    """S as in the docstring of `regenerative_spectrum`, but solved for the three frequencies that the teeth couple."""
    gain, floor, modulation = np.exp(theta[0]), np.exp(theta[8]), np.array([theta[7] / 2, 1, theta[7] / 2])
    slope, w, zeta, kappa = theta[1], np.exp(theta[2]), np.exp(theta[3]), theta[4]
    offs, weights = np.polynomial.hermite_e.hermegauss(delays)
    coupled = toeplitz([modulation[1], modulation[2], 0])
    square = np.convolve(modulation, modulation)
    noise = toeplitz(square[2:]) / square[2]
    r = (omega[:, np.newaxis] + 2 * np.pi * np.exp(-theta[5]) * np.arange(-1, 2)) / w
    mean = 0
    for off, weight in zip(offs, weights / weights.sum(), strict=True):
        delayed = kappa * (1 - np.exp(-1j * omega * np.exp(theta[5]) * (1 + np.exp(theta[6]) * off)))
        alone = (1 - r**2 + 2j * zeta * r)[..., np.newaxis] * np.eye(3)
        stiffness = alone + delayed[:, np.newaxis, np.newaxis] * coupled
        row = np.linalg.inv(stiffness)[:, 1]
        mean = mean + weight * np.einsum("ni,ij,nj->n", row, noise, row.conj()).real
    return gain * (omega / CENTRE) ** slope * mean + floor


def windowed(theta, delays):
    """Mean of a periodogram of Hann windows: S convolved with the window's power response, finely."""
    fine = np.arange(-4.0, 4.0, 0.01) + 0.005
    response = (np.sinc(fine) / (1 - fine**2)) ** 2
    response /= response.sum()
    omega = FIRST + WIDTH * np.arange(BINS)
    seen = (weight * spectrum(theta, omega + WIDTH * at, delays) for at, weight in zip(fine, response, strict=True))
    return sum(seen)


AT = np.arange(-1.0, BINS + 2.0)
LOG_FREQUENCY = np.log((FIRST + WIDTH * np.stack([AT, AT - 0.5])) / CENTRE)


def run(theta, periodogram, used=None, delays=DELAYS):
    model, score, information = np.empty(BINS), np.empty(PARAMETERS), np.empty((PARAMETERS, PARAMETERS))
    used = np.ones(BINS, np.bool_) if used is None else used
    work = np.full(WORK, 7.0)  # whatever was in it
    value = whittle(theta, FIRST, WIDTH, delays, LOG_FREQUENCY, periodogram, used, work, model, score, information)
    return value, score, information, model


@pytest.mark.parametrize("theta", [THETA, STEADY])
@pytest.mark.parametrize("delays", [1, DELAYS])
def test_the_model_is_the_mean_of_a_windowed_periodogram(delays, theta):
    """The spectrum left behind is S seen through the Hann window, within 0.5 % at the sharpest peak."""
    model = run(theta, np.ones(BINS), delays=delays)[3]
    np.testing.assert_allclose(model, windowed(theta, delays), rtol=5e-3)


def test_a_slight_modulation_is_next_to_none():
    """Both ways to the spectrum meet."""
    slight = STEADY + 1e-6 * np.eye(PARAMETERS)[MODULATION]
    np.testing.assert_allclose(run(slight, np.ones(BINS))[3], run(STEADY, np.ones(BINS))[3], rtol=1e-5)


def test_a_spindle_that_hardly_wanders_has_one_delay():
    """With next to no spread the spectrum is that of a single delay; with 0.3 % the comb of 27 waves is flatter."""
    steady, single = THETA + np.log(1e-6) * np.eye(PARAMETERS)[LOG_SPREAD], run(THETA, np.ones(BINS), delays=1)[3]
    np.testing.assert_allclose(run(steady, np.ones(BINS))[3], single, rtol=1e-9)
    wandering = run(THETA, np.ones(BINS))[3]
    assert wandering.max() < 0.9 * single.max()
    assert wandering.mean() == pytest.approx(single.mean(), rel=0.05)


def test_the_likelihood_is_the_sum_over_the_bins_in_use():
    """Sum of log S + I / S; bins that are left out change nothing, whatever is in them."""
    rng = np.random.default_rng(1)
    periodogram = rng.exponential(size=BINS)
    used = rng.random(BINS) < 0.9
    value, score, _, model = run(THETA, periodogram, used)
    assert value == pytest.approx(np.sum((np.log(model) + periodogram / model)[used]))
    other_value, other_score, _, _ = run(THETA, np.where(used, periodogram, 1e9), used)
    assert other_value == value
    np.testing.assert_array_equal(other_score, score)


@pytest.mark.parametrize("theta", [THETA, STEADY])
def test_the_score_is_the_negative_gradient(theta):
    """Each entry agrees with a central difference of the likelihood."""
    periodogram = run(theta, np.ones(BINS))[3] * np.random.default_rng(2).exponential(size=BINS)
    _, score, _, _ = run(theta, periodogram)
    for i in range(PARAMETERS):
        step = 1e-6 * np.eye(PARAMETERS)[i]
        slope = (run(theta + step, periodogram)[0] - run(theta - step, periodogram)[0]) / 2e-6
        assert -slope == pytest.approx(score[i], rel=1e-3, abs=1e-2)


def test_the_information_is_the_hessian_where_the_model_is_true():
    """With the periodogram equal to its mean, differences of the score give the Fisher information."""
    truth = run(THETA, np.ones(BINS))[3]
    _, score, information, _ = run(THETA, truth)
    np.testing.assert_allclose(score, 0.0, atol=1e-9)
    for i in range(PARAMETERS):
        step = 1e-6 * np.eye(PARAMETERS)[i]
        row = (run(THETA - step, truth)[1] - run(THETA + step, truth)[1]) / 2e-6
        np.testing.assert_allclose(row, information[i], rtol=1e-3, atol=1e-4 * np.abs(information[i]).max())


@pytest.mark.parametrize("at_once", [1, 3, 40])
def test_the_climb_ends_at_the_maximum(at_once):
    """From 2 % off, the parameters are found from a periodogram that equals its mean, in pieces, with priors or not."""
    truth = run(THETA, np.ones(BINS))[3]
    for precision in (0.0, 1e-3):
        prior = (THETA, np.full(PARAMETERS, precision))
        likelihood = Likelihood(
            FIRST, WIDTH, DELAYS, LOG_FREQUENCY, truth, np.ones(BINS, np.bool_), np.zeros(WORK), np.empty(BINS), 2.0,
            *prior,
        )  # fmt: skip
        theta, information = OFF * THETA, np.empty((PARAMETERS, PARAMETERS))
        climbing = theta, likelihood, 40, np.empty((2 * PARAMETERS + 4, PARAMETERS)), information, np.empty(3)
        begin_climb(*climbing)
        while climb(*climbing[:2], at_once, *climbing[3:]):
            pass
        value = climbing[-1][VALUE]
        expected, _, expected_information, model = run(THETA, truth)
        assert value == pytest.approx(2.0 * expected, abs=1e-3)
        sd = np.sqrt(np.diag(np.linalg.inv(information)))
        np.testing.assert_array_less(abs(theta - THETA), 0.2 * sd)
        np.testing.assert_allclose(likelihood.spectrum, model, rtol=0.05)
        assert information[KAPPA, KAPPA] == pytest.approx(2.0 * expected_information[KAPPA, KAPPA] + precision, rel=0.1)


def test_a_race_is_a_climb_from_the_gain_at_which_the_spectrum_has_the_mean():
    """Whatever gain a start comes with, the race climbs from the one that gives the spectrum its mean."""
    truth = run(THETA, np.ones(BINS))[3]
    likelihood = Likelihood(
        FIRST, WIDTH, DELAYS, LOG_FREQUENCY, truth, np.ones(BINS, np.bool_), np.zeros(WORK), np.empty(BINS), 2.0,
        THETA, np.zeros(PARAMETERS),
    )  # fmt: skip
    start = np.where(np.arange(PARAMETERS) == LOG_GAIN, THETA, OFF * THETA)
    room = np.empty((2 * PARAMETERS + 4, PARAMETERS)), np.empty((PARAMETERS, PARAMETERS)), np.empty(3)
    theta = start + np.eye(PARAMETERS)[LOG_GAIN]
    value = race(theta, likelihood, truth.mean(), 3, *room)
    with_gain_one = run(start * (np.arange(PARAMETERS) != LOG_GAIN), np.ones(BINS))[3]
    expected = start.copy()
    expected[LOG_GAIN] = np.log(truth.mean() / with_gain_one.mean())
    begin_climb(expected, likelihood, 3, *room)
    assert climb(expected, likelihood, 3, *room) is False
    np.testing.assert_allclose(theta, expected, rtol=1e-9)
    assert value == pytest.approx(room[-1][VALUE], rel=1e-9)
    assert value < 2.0 * run(start, truth)[0]


def test_what_is_beyond_the_limit_is_mirrored():
    """A kappa above the critical one comes back by as much as it was beyond, to half of it at most; one below stays."""
    critical = critical_coefficient(*np.exp(THETA[[LOG_OMEGA, LOG_ZETA, LOG_TAU]]))
    for share, expected in ((0.9, 0.9), (1.2, 0.8), (5.0, 0.5)):
        theta = THETA.copy()
        theta[KAPPA] = share * critical
        stabilise(theta)
        assert theta[KAPPA] == pytest.approx(expected * critical)
    theta = -THETA[MODULATION] * np.eye(PARAMETERS)[MODULATION]
    stabilise(theta)
    assert theta[MODULATION] == THETA[MODULATION]


@pytest.mark.parametrize("seed", range(3))
def test_equations_are_solved(seed):
    """Any system is solved as by LAPACK, one that needs its rows exchanged too; a singular one is refused."""
    rng = np.random.default_rng(seed)
    matrix, vector = rng.standard_normal((PARAMETERS, PARAMETERS)), rng.standard_normal(PARAMETERS)
    matrix[0, 0] = 0.0
    solution = vector.copy()
    assert solve(matrix.copy(), solution)
    np.testing.assert_allclose(solution, np.linalg.solve(matrix, vector), rtol=1e-9)
    matrix[:, 3] = 0.0
    assert not solve(matrix, vector)
