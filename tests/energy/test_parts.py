"""Each part of the identification against a closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipk

from chatter_monitor.energy import blocks, damping_potential, equivalent_damping, excitation
from chatter_monitor.energy.band import Band, choose_band
from chatter_monitor.energy.kinematics import motion
from chatter_monitor.energy.potential import Potential
from tests.energy.reference import W0, noise_driven, simulate

RATE = 12800.0


@pytest.mark.parametrize(("quantity", "order"), [("displacement", 0), ("velocity", 1), ("acceleration", 2)])
def test_motion_of_a_harmonic_is_exact(quantity, order):
    """Amplitude and speed of a sine come out of each quantity to 0.5 %, though it does not fit the record."""
    t = np.arange(20000) / RATE
    w = 2 * np.pi * 317.3
    signal = w**order * np.sin(w * t + 0.5 * np.pi * order)
    moved = motion(signal, RATE, quantity, Band(317.3, 52.9, 1903.8, 0.0, ()))
    energy = 0.5 * moved.v**2 + 0.5 * w**2 * moved.x**2
    np.testing.assert_allclose(energy, 0.5 * w**2, rtol=1e-2)


def test_band_is_symmetric_and_keeps_out_a_second_mode():
    """With a second mode at 2.4 times the frequency the band ends between them, and the second one is named."""
    first = simulate(noise_driven(0.01), 20.0, 1)
    second = simulate(noise_driven(0.01, frequency_hz=960.0), 20.0, 2)
    band = choose_band(first + 0.4 * second, RATE, "displacement")
    assert 450.0 < band.high_hz < 900.0
    assert band.low_hz * band.high_hz == pytest.approx(band.peak_hz**2)
    assert any(abs(peak - 960.0) < 20.0 for peak in band.other_peaks_hz)


def test_band_gives_way_to_noise():
    """Sensor noise narrows the band, and what is left of it in the band is reported."""
    signal = simulate(noise_driven(0.01), 20.0, 1)
    noisy = signal + 0.1 * np.random.default_rng(1).standard_normal(signal.size)
    wide, narrow = choose_band(signal, RATE, "displacement"), choose_band(noisy, RATE, "displacement")
    assert narrow.high_hz < 0.8 * wide.high_hz
    assert wide.noise_share < 1e-3 < narrow.noise_share < 0.05


def test_period_of_a_cubic_spring_is_the_elliptic_integral():
    """T(E) of x'' + x + x^3 = 0 agrees with the complete elliptic integral to 1e-9, and dA/dE = T."""
    potential = Potential(np.array([0.0, 0.0, 0.5, 0.0, 0.25]), (-3.0, 3.0))
    amplitude = np.array([0.1, 0.5, 1.0, 2.0, 3.0])
    energy = potential.energy(amplitude)
    expected = 4.0 / np.sqrt(1.0 + amplitude**2) * ellipk(amplitude**2 / (2.0 * (1.0 + amplitude**2)))
    np.testing.assert_allclose(potential.period(energy), expected, rtol=1e-9)
    step = 1e-4 * energy
    slope = (potential.action(energy + step) - potential.action(energy - step)) / (2.0 * step)
    np.testing.assert_allclose(slope, expected, rtol=1e-6)


def test_potential_of_an_asymmetric_spring():
    """The turning points of a spring with a quadratic term solve U(x) = E on both sides."""
    potential = Potential(np.array([0.0, 0.01, 0.5, 0.1, 0.1]), (-1.0, 1.2))
    energy = np.array([0.05, 0.2, 0.4])
    for side in potential.turning_points(energy):
        np.testing.assert_allclose(potential.energy(side), energy, rtol=1e-9)
    assert abs(potential.force(np.array(potential.equilibrium()))) < 1e-12


def shells_of(energy, count=20):
    """Shells of energies drawn in a linear well of unit frequency."""
    potential = Potential(np.array([0.0, 0.0, 0.5]), (-10.0, 10.0))
    return damping_potential.count_shells(energy, np.arange(energy.size) * count // energy.size, potential, 20.0)


def test_damping_potential_of_a_linear_mode():
    """Energies drawn from an exponential density give H(E)/(pi S0) = E over its mean, eq. (11)."""
    energy = np.random.default_rng(3).exponential(0.7, 100_000)
    shells = shells_of(energy)
    fits = damping_potential.fit_all(shells, np.ones((1, 20)))
    assert damping_potential.MODELS[fits.chosen[0]] == (0,)
    slope = fits.slopes[0].value(np.array([0.1, 1.0, 3.0]))
    np.testing.assert_allclose(slope, 1.0 / 0.7, rtol=0.02)
    assert shells.independent() == pytest.approx(energy.size, rel=0.9)


def test_damping_potential_of_a_limit_cycle():
    """A density concentrated on a shell is self-excited, with the cycle at its energy; an exponential one is not."""
    rng = np.random.default_rng(4)
    ring = damping_potential.fit_all(shells_of(np.abs(3.0 + 0.8 * rng.standard_normal(50_000))), np.ones((1, 20)))
    found = excitation.excitation_kind(ring, 20.0)
    assert found.kind == "self_excited"
    assert found.confidence > 0.99
    assert found.cycle_energy == pytest.approx(3.0, rel=0.05)
    crater_free = damping_potential.fit_all(shells_of(rng.exponential(3.0, 50_000)), np.ones((1, 20)))
    assert excitation.excitation_kind(crater_free, 20.0).kind == "noise_driven"


def test_decay_shows_linear_damping_unchanged():
    """For a linear system eq. (14) shows h at every energy, however the energy diffuses."""
    shown = equivalent_damping.decay(np.full(60, 50.0), np.full(60, 2500.0), 0.1, 40.0, (0.00125, 0.00375))
    np.testing.assert_allclose(shown, 50.0, rtol=1e-6)


def test_decay_of_a_stiffening_mode_is_faster():
    """Dephasing by T(E) adds omega'^2 D E (t2^3 - t1^3) / 3 to the logarithm, to leading order."""
    step, strength, lags = 0.1, 1.0, (0.001, 0.003)
    energy = ((np.arange(60) + 0.5) * step) ** 2
    turn = 50.0
    shown = equivalent_damping.decay(np.full(60, 1.0), 2500.0 + turn * energy, step, strength, lags)
    expected = 1.0 + 2.0 * turn**2 * strength * energy * (lags[1] ** 3 - lags[0] ** 3) / 3.0 / (lags[1] - lags[0])
    middle = slice(15, 40)
    np.testing.assert_allclose(shown[middle] - 1.0, expected[middle] - 1.0, rtol=0.02)


def test_band_filter_is_allowed_for():
    """A band that cuts the mode's wings changes what eq. (14) shows, and the shift undoes it."""
    h, band, lags = 50.0, Band(400.0, 160.0, 1000.0, 0.0, ()), (0.00125, 0.00375)
    shown = equivalent_damping.shown_in_band(h, band, lags)
    assert abs(shown / h - 1.0) > 0.02
    assert shown + equivalent_damping.band_shift(shown, band, lags) == pytest.approx(h, rel=0.01)
    wide = Band(400.0, 4.0, 40000.0, 0.0, ())
    assert equivalent_damping.shown_in_band(h, wide, lags) == pytest.approx(h, rel=0.005)


def test_energy_balance_gives_the_intensity():
    """With h and its blur shared, the ratio returns pi S0 exactly."""
    slope = np.array([[1.0, 2.0, 3.0]])
    weight = np.array([[5.0, 2.0, 0.0]])
    measured = np.array([[7.0, 14.0, np.nan]])
    np.testing.assert_allclose(excitation.strength(measured, slope, weight), 7.0)


def test_blocks_are_longer_than_the_memory():
    """The number of blocks follows the damping, and bootstrap weights preserve the number of blocks."""
    signal = simulate(noise_driven(0.01), 30.0, 5)
    moved = motion(signal, RATE, "displacement", choose_band(signal, RATE, "displacement"))
    seconds = moved.x.size / moved.rate_hz
    assert blocks.count(moved, 400.0) == pytest.approx(min(seconds * 0.02 * W0 / blocks.MEMORIES, blocks.MOST), rel=0.4)
    assert (blocks.weights(30, 50, seed=1).sum(axis=1) == 30).all()
