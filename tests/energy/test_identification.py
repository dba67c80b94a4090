"""Whole identifications of simulated records against their truth. Seeds from 500 on; development used those below."""

from __future__ import annotations

import json

import numpy as np
import pytest

from chatter_monitor.energy import identify
from chatter_monitor.energy.plots import save_all
from chatter_monitor.errors import InputError
from tests.energy.reference import damping, dry, energy_quantiles, noise_driven, simulate, turbulent

RATE = 12800.0


@pytest.fixture(scope="module")
def cubic():
    """Identification of 30 s of a cubic mode with 1 % damping, and the oscillator."""
    oscillator = noise_driven(0.01, k3=0.0375)
    return identify(simulate(oscillator, 30.0, 500), RATE), oscillator


def test_stiffness_of_a_cubic_mode(cubic):
    """U(x) is within 1 % of its target and k1, k3 are within twice the half-width of their intervals."""
    result, oscillator = cubic
    s = result.stiffness
    x = np.linspace(0.1, 2.3, 40)
    true = 0.5 * oscillator.k1 * x**2 + 0.25 * oscillator.k3 * x**4
    np.testing.assert_allclose(s.potential.energy(x), true, rtol=0.01)
    assert abs(s.k1 - oscillator.k1) < s.k1_ci95[1] - s.k1_ci95[0]
    assert abs(s.k3 - oscillator.k3) < s.k3_ci95[1] - s.k3_ci95[0]
    assert abs(s.k3 / oscillator.k3 - 1.0) < 0.15


def test_damping_of_a_cubic_mode(cubic):
    """Viscous damping and S0 come out of the same record within 12 and 5 %."""
    result, oscillator = cubic
    d = result.damping
    assert d.powers == (0,)
    np.testing.assert_allclose(d.h, oscillator.viscous, rtol=0.12)
    assert d.s0 == pytest.approx(oscillator.intensity, rel=0.05)
    assert d.disagreement < 3.0
    assert result.excitation.kind == "noise_driven"
    assert result.warnings == ()


def test_both_periods_agree(cubic):
    """T(E) from the potential is what the zero crossings show, within 1 % where most of the energy is."""
    p = cubic[0].period
    middle = (p.zone_energy > 0.2 * p.energy[-1]) & (p.zone_energy < 0.7 * p.energy[-1])
    np.testing.assert_allclose(
        p.zone_period_s[middle], np.interp(p.zone_energy[middle], p.energy, p.period_s), rtol=0.01
    )


def test_result_is_json_and_pictures(cubic, tmp_path):
    """The result is one JSON object without NaN tokens, and seven pictures can be written from it."""
    result = cubic[0]
    told = json.loads(result.to_json())
    assert told["stiffness"]["k1"] == result.stiffness.k1
    assert len(told["damping"]["h"]) == len(told["damping"]["energy"])
    files = save_all(result, tmp_path / "new")
    assert files[-1].name == "summary.png"
    assert len(files) == 7
    assert all(file.stat().st_size > 10_000 for file in files)


def test_scale_of_the_sensor_does_not_matter(cubic):
    """A gain of 1e-6 scales displacements and energies and leaves frequency, damping and verdict alone."""
    result, oscillator = cubic
    other = identify(1e-6 * simulate(oscillator, 30.0, 500), RATE)
    assert other.stiffness.k1 == pytest.approx(result.stiffness.k1, rel=1e-6)
    assert other.stiffness.k3 == pytest.approx(1e12 * result.stiffness.k3, rel=1e-6)
    assert other.damping.damping_ratio == pytest.approx(result.damping.damping_ratio, rel=1e-6)
    assert other.damping.s0 == pytest.approx(1e-12 * result.damping.s0, rel=1e-6)


@pytest.mark.parametrize("quantity", ["velocity", "acceleration"])
def test_sensors_agree(cubic, quantity):
    """Velocity and acceleration of the same motion give the same stiffness and intensity as its displacement."""
    result, oscillator = cubic
    other = identify(simulate(oscillator, 30.0, 500, quantity=quantity), RATE, quantity)
    assert other.stiffness.k1 == pytest.approx(result.stiffness.k1, rel=2e-3)
    assert other.stiffness.k3 == pytest.approx(result.stiffness.k3, rel=0.05)
    assert other.damping.s0 == pytest.approx(result.damping.s0, rel=0.03)


def test_same_input_same_output(cubic):
    """Identification is deterministic, bootstrap included."""
    result, oscillator = cubic
    assert identify(simulate(oscillator, 30.0, 500), RATE).to_json() == result.to_json()


@pytest.mark.slow
@pytest.mark.parametrize(("oscillator", "powers"), [(dry(), (-1,)), (turbulent(), (1,))])
def test_nonlinear_damping_has_its_shape(oscillator, powers):
    """Dry friction and v|v| are recognised by their power of E; h(E) is within three standard deviations (20 %)."""
    d = identify(simulate(oscillator, 60.0, 501), RATE).damping
    assert d.powers == powers
    at = energy_quantiles(oscillator, [0.025, 0.1, 0.5, 0.9, 0.975])
    np.testing.assert_allclose(np.interp(at, d.energy, d.h), damping(oscillator, at), rtol=0.2)


def test_bands_widen_with_the_energy(cubic):
    """The scatter of h at high energies, the paper's own caveat, shows in the errors of the zones."""
    d = cubic[0].damping
    well_known = d.zone_h_error[np.argmin(d.zone_h_error)]
    assert d.zone_h_error[-1] > 1.5 * well_known
    assert d.left_out


def test_short_record_is_called_short():
    """Three seconds of a lightly damped mode come with a warning about their length."""
    result = identify(simulate(noise_driven(0.001), 3.0, 502, settle_s=3.0), RATE)
    assert any("too short" in warning for warning in result.warnings)


def test_second_mode_is_called_out():
    """A second mode is kept out of the band and named in a warning."""
    two = simulate(noise_driven(0.01), 20.0, 503) + 0.4 * simulate(noise_driven(0.01, frequency_hz=960.0), 20.0, 504)
    result = identify(two, RATE)
    assert any("more than one mode" in warning for warning in result.warnings)
    assert np.sqrt(result.stiffness.k1) / (2 * np.pi) == pytest.approx(400.0, rel=0.01)


def test_band_with_nothing_in_its_middle_is_refused():
    """A band of two lines of the spectrum holds no mode."""
    noise = np.random.default_rng(6).standard_normal(40000)
    with pytest.raises(InputError, match="edge of the band"):
        identify(noise, RATE, band_hz=(500.0, 512.0))


def test_band_given_by_the_user_is_kept(cubic):
    """With a band given the same mode comes out, within that band."""
    result, oscillator = cubic
    other = identify(simulate(oscillator, 30.0, 500), RATE, band_hz=(60.0, 2500.0))
    assert (other.band.low_hz, other.band.high_hz) == (60.0, 2500.0)
    assert other.stiffness.k1 == pytest.approx(result.stiffness.k1, rel=2e-3)


def test_steady_tone_is_not_noise_driven():
    """A tone in weak noise knows no nonlinearity and no damping, says so, and is not taken for noise-driven."""
    t = np.arange(int(5 * RATE)) / RATE
    signal = np.sin(2 * np.pi * 733.0 * t) + 0.02 * np.random.default_rng(5).standard_normal(t.size)
    result = identify(signal, RATE)
    assert result.excitation.kind == "self_excited"
    assert any("forced line" in warning for warning in result.warnings)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"signal": np.ones(5000)}, "constant"),
        ({"signal": np.full(5000, np.nan)}, "not finite"),
        ({"signal": np.zeros((100, 2))}, "one channel"),
        ({"signal": np.random.default_rng(0).standard_normal(200)}, "too short"),
        ({"signal": np.sin(0.2 * np.arange(5000))}, "one amplitude"),
        ({"quantity": "pressure"}, "quantity"),
        ({"band_hz": (500.0, 400.0)}, "band"),
        ({"sample_rate_hz": 0.0}, "rate"),
    ],
)
def test_unusable_input_is_refused(change, words):
    """What cannot be identified is refused with an error that names the fault."""
    given = {"signal": np.random.default_rng(0).standard_normal(5000), "sample_rate_hz": RATE} | change
    with pytest.raises(InputError, match=words):
        identify(**given)
