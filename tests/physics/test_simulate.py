"""Simulated recordings: statistics of the response, sensors, excitation, growth and limit cycles."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal, stats

from chatter_monitor.errors import InputError
from chatter_monitor.physics.excitation import random_force
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Drift, Excitation, Mode, Sensor, Spindle
from chatter_monitor.physics.simulate import simulate
from chatter_monitor.physics.stability import characteristic_roots
from chatter_monitor.physics.terms import CATALOGUE, Parameter, Term

RATE = 12800.0


def applied(name, **parameters):
    return AppliedTerm(CATALOGUE[name], parameters)


def amplitude_at(samples, frequency_hz):
    """Complex amplitude of one line over a whole number of its periods."""
    return 2.0 * np.mean(samples * np.exp(-2j * np.pi * frequency_hz * np.arange(samples.size) / RATE))


def test_the_same_seed_gives_the_same_recording_and_another_one_does_not():
    """A recording is a function of the model and the seed."""
    system = MachiningSystem((Mode(412.0, 0.02),), sensor=Sensor(noise_rms=0.1))
    first, again, other = (simulate(system, 0.5, seed).signal for seed in (1, 1, 2))
    assert first.size == 6400
    np.testing.assert_array_equal(first, again)
    assert not np.allclose(first, other)


def test_a_longer_recording_begins_with_the_shorter_one():
    """Where a recording ends has no influence on it, down to its last sample."""
    system = MachiningSystem((Mode(412.0, 0.02),))
    shorter, longer = simulate(system, 0.5, 1), simulate(system, 0.6, 1)
    np.testing.assert_allclose(shorter.displacement, longer.displacement[:6400], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(shorter.velocity, longer.velocity[:6400], rtol=1e-12, atol=1e-9)


def test_white_pulses_have_the_spectrum_of_equation_6():
    """Linearly interpolated pulses have S_0 [sin(w dt / 2) / (w dt / 2)]^4, checked to 3 % up to the first zero."""
    step, finer, intensity = 1e-4, 16, 3.0
    system = MachiningSystem((Mode(400.0, 0.02),), excitation=Excitation(intensity=intensity))
    time = step * np.arange(400_000)
    pulses = random_force(system, time, step, np.random.default_rng(11))
    fine = np.interp(np.arange(time.size * finer) / finer, np.arange(time.size), pulses)
    frequency, density = signal.welch(fine, finer / step, nperseg=256 * finer, detrend=False)
    half = np.pi * frequency * step  # w dt / 2
    for low, high in ((0.1, 0.4), (0.4, 0.8), (0.8, 1.2), (1.2, 1.8), (1.8, 2.4)):
        band = (half > low) & (half < high)
        expected = 4.0 * np.pi * intensity * np.mean((np.sin(half[band]) / half[band]) ** 4)  # one-sided, per Hz
        assert np.mean(density[band]) == pytest.approx(expected, rel=0.03)


def test_stationary_variances_are_those_of_the_theory():
    """var(v) = pi S0 / (2 zeta w) and var(x) = var(v) / w^2, within four standard deviations of their estimates."""
    mode, intensity, duration = Mode(800.0, 0.05), 1e6, 60.0
    run = simulate(MachiningSystem((mode,), excitation=Excitation(intensity=intensity)), duration, 3, settle_s=0.1)
    expected = math.pi * intensity / (2.0 * mode.damping_ratio * mode.omega)
    tolerance = 4.0 / math.sqrt(mode.damping_ratio * mode.omega * duration)
    assert tolerance < 0.035
    beyond = 4.0 * mode.damping_ratio * mode.frequency_hz / (math.pi * RATE / 2.0)  # share of var(v) above the band
    assert np.var(run.velocity) == pytest.approx((1.0 - beyond) * expected, rel=tolerance)
    assert np.var(run.displacement) == pytest.approx(expected / mode.omega**2, rel=tolerance)


ENERGY_DAMPING = Term(
    name="damping_by_energy",
    equation="coefficient E v",
    source="eq. (7) with h(E) proportional to the energy",
    parameters=(Parameter("coefficient", "1/s / (u/s)^2", "h over E", linear=True),),
    force=lambda x, v, lagged, angle, w, memory, p: p[0] * 0.5 * (v * v + w * w * x * x) * v,  # noqa: ARG005
    limits_growth=True,
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("damping_ratio", "share"),
    [(0.05, 0.0), (0.05, 1.0), (0.0, 1.0), (-0.02, 2.0)],
    ids=["linear", "linear and nonlinear", "nonlinear", "self-excited"],
)
def test_density_of_the_energy_is_that_of_equation_11(damping_ratio, share):
    """p(E) ~ exp(-H(E) / (pi S0)) with h(E) = 2 zeta w + b E: Kolmogorov-Smirnov on independent samples, 1 in 1000."""
    mode = Mode(800.0, damping_ratio)
    scale = 0.1 * mode.omega  # damping of a 5 % mode
    intensity = scale / math.pi  # so that E / u^2 s^-2 is of order one
    system = MachiningSystem(
        (mode,),
        (AppliedTerm(ENERGY_DAMPING, {"coefficient": share * scale}),),
        Excitation(intensity=intensity),
    )
    rate = 2.0 * RATE  # at RATE, 0.8 % of var(v) lies above half the rate
    run = simulate(system, 120.0, seed=17, sample_rate_hz=rate, settle_s=1.0)
    spacing = int(0.04 * rate)  # 20 decay times of the energy of the 5 % mode
    energy = 0.5 * (run.velocity**2 + (mode.omega * run.displacement) ** 2)[::spacing]
    grid = np.linspace(0.0, 40.0, 40001)
    potential = 2.0 * damping_ratio * mode.omega * grid + 0.5 * share * scale * grid**2
    density = np.exp(-potential / (math.pi * intensity))
    distribution = np.concatenate(([0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))))
    result = stats.kstest(energy, lambda e: np.interp(e, grid, distribution / distribution[-1]))
    assert energy.size == 3000
    assert result.pvalue > 1e-3


def test_a_vibration_grows_as_its_rightmost_root_says():
    """Above the limit the simulated cut grows with the real part and turns with the imaginary part of the root."""
    mode = Mode(500.0, 0.02)
    system = MachiningSystem(
        (mode, Mode(1300.0, 0.03, 0.5)),
        (applied("regenerative_delay", coefficient=0.09),),
        Excitation(intensity=1.0),
        Spindle(6000.0, 2),
    )
    root = characteristic_roots(system)[0]
    growth = 25.0 / root.real
    run = simulate(system, growth, seed=1)
    envelope = run.displacement - 1j * run.velocity / root.imag
    late = slice(int(0.6 * envelope.size), int(0.95 * envelope.size))
    time = np.arange(envelope.size)[late] / RATE
    rate = np.polyfit(time, np.log(np.abs(envelope[late])), 1)[0]
    turn = np.polyfit(time, np.unwrap(np.angle(envelope[late])), 1)[0]
    assert rate == pytest.approx(root.real, rel=0.005)
    assert turn == pytest.approx(root.imag, rel=1e-5)


def test_loss_of_contact_bounds_chatter_and_its_absence_is_reported():
    """An unstable cut settles on a limit cycle once the tool can leave the cut; without that the user is told."""
    mode = Mode(500.0, 0.02)
    cut = MachiningSystem(
        (mode,),
        (applied("loss_of_contact", coefficient=0.2, chip_thickness=0.1),),
        Excitation(intensity=1.0),
        Spindle(6200.0, 1),
    )
    run = simulate(cut, 12.0, seed=2)
    early, late = np.split(run.displacement[int(2.0 * RATE) :], 2)
    assert np.max(np.abs(run.displacement)) < 20 * 0.1
    assert np.std(early) > 0.05
    assert np.std(late) == pytest.approx(np.std(early), rel=0.02)
    assert run.truth.unstable_s == [(0.0, 12.0)]
    assert run.truth.chatter_s[0][0] > 0.05
    assert run.truth.chatter_s[0][1] == 12.0
    endless = replace(cut, terms=(applied("regenerative_delay", coefficient=0.2),))
    with pytest.raises(InputError, match=r"without bound.*loss_of_contact"):
        simulate(endless, 60.0, seed=2)


def test_a_measured_force_meets_the_receptance_of_two_modes():
    """Driven by a given sine the tool answers with sum g^2 / (w_i^2 - w^2 + 2 i zeta w_i w), amplitude and phase."""
    modes = (Mode(300.0, 0.03), Mode(700.0, 0.05, -0.8))
    time = np.arange(2 * 12800) / RATE
    for frequency in (200.0, 310.0, 650.0):
        interpolated = np.sinc(frequency / RATE) ** 2  # what linear interpolation leaves of the sine
        system = MachiningSystem(modes, excitation=Excitation("measured"))
        run = simulate(system, 2.0, seed=0, force=np.cos(2.0 * np.pi * frequency * time))
        w = 2.0 * np.pi * frequency
        expected = interpolated * sum(
            m.participation**2 / (m.omega**2 - w**2 + 2j * m.damping_ratio * m.omega * w) for m in modes
        )
        assert amplitude_at(run.displacement[12800:], frequency) == pytest.approx(expected, rel=1e-3)
        assert amplitude_at(run.velocity[12800:], frequency) == pytest.approx(1j * w * expected, rel=1e-3)


def test_a_force_above_half_the_rate_leaves_no_alias():
    """A line at 3 kHz reaches the accelerometer whole, one at 8 kHz does not come back at 4.8 kHz."""
    lines = tuple(applied("periodic_forcing", coefficient=1.0, order=order) for order in (30.0, 80.0))
    system = MachiningSystem(
        (Mode(50.0, 0.5),), lines, Excitation(intensity=0.0), Spindle(6000.0), Sensor("acceleration")
    )
    run = simulate(system, 1.5, seed=0)
    settled = run.signal[6400:]
    settled = settled[:12800]
    assert abs(amplitude_at(settled, 3000.0)) == pytest.approx(1.0, rel=0.01)
    assert abs(amplitude_at(settled, 4800.0)) < 1e-4


def test_sensors_deliver_their_quantity():
    """Velocity and acceleration are j w and (j w)^2 times the displacement; pressure is acceleration above 20 Hz."""
    force = np.cos(2.0 * np.pi * 400.0 * np.arange(12800) / RATE)
    outputs = {}
    for quantity in ("displacement", "velocity", "acceleration", "pressure"):
        system = MachiningSystem(
            (Mode(300.0, 0.05),), excitation=Excitation("measured"), sensor=Sensor(quantity, gain=2.0)
        )
        outputs[quantity] = amplitude_at(simulate(system, 1.0, seed=0, force=force).signal[6400:], 400.0)
    w = 2.0 * np.pi * 400.0
    assert outputs["velocity"] == pytest.approx(1j * w * outputs["displacement"], rel=1e-3)
    assert outputs["acceleration"] == pytest.approx(-(w**2) * outputs["displacement"], rel=1e-3)
    assert outputs["pressure"] == pytest.approx(outputs["acceleration"] / (1.0 - 20.0j / 400.0), rel=0.01)


def test_sensors_add_noise_hum_offset_and_drift_and_clip():
    """What the sensor adds to silence is what its parameters say."""
    silent = MachiningSystem((Mode(300.0, 0.05),), excitation=Excitation(intensity=0.0))
    sensor = Sensor(noise_rms=0.1, hum_amplitude=0.5, hum_hz=50.0, offset=0.2, drift_per_s=0.3)
    output = simulate(replace(silent, sensor=sensor), 4.0, seed=6).signal
    slope, level = np.polyfit(np.arange(output.size) / RATE, output, 1)
    assert (slope, level) == pytest.approx((0.3, 0.2), abs=0.02)
    assert abs(amplitude_at(output, 50.0)) == pytest.approx(0.5, rel=0.02)
    assert np.std(np.diff(output)) / math.sqrt(2.0) == pytest.approx(0.1, rel=0.03)
    clipped = simulate(replace(silent, sensor=replace(sensor, clip_level=0.4)), 4.0, seed=6).signal
    np.testing.assert_array_equal(clipped, np.clip(output, -0.4, 0.4))


def test_excitation_kinds_keep_the_intensity_and_change_what_they_name():
    """Coloured loses half its power at the corner, impulses have heavy tails, modulation swells; S_0 is kept."""
    step, time = 1e-4, 1e-4 * np.arange(1_000_000)
    mode, intensity = Mode(400.0, 0.02), 2.0

    def pulses(excitation):
        return random_force(MachiningSystem((mode,), excitation=excitation), time, step, np.random.default_rng(8))

    expected = 2.0 * np.pi * intensity / step
    impulsive = pulses(Excitation("impulsive", intensity, impacts_per_s=50.0, impact_share=0.5))
    assert np.var(impulsive) == pytest.approx(expected, rel=0.05)
    assert stats.kurtosis(impulsive) > 50.0
    modulated = pulses(Excitation("modulated", intensity, modulation_hz=2.0, modulation_depth=0.8))
    swell = np.cos(2.0 * np.pi * 2.0 * time)
    assert np.var(modulated) == pytest.approx(expected, rel=0.02)
    assert np.std(modulated[swell > 0.99]) / np.std(modulated[swell < -0.99]) == pytest.approx(9.0, rel=0.1)
    coloured = pulses(Excitation("coloured", intensity, corner_hz=500.0))
    frequency, density = signal.welch(coloured, 1.0 / step, nperseg=1000)
    assert np.mean(density[2:20]) == pytest.approx(4.0 * np.pi * intensity, rel=0.05)
    assert density[frequency == 500.0][0] == pytest.approx(2.0 * np.pi * intensity, rel=0.15)
    assert stats.kurtosis(coloured) == pytest.approx(0.0, abs=0.1)


def test_drifting_intensity_and_frequency_are_heard():
    """The response follows a frequency and an intensity that change during the recording."""
    system = MachiningSystem(
        (Mode(400.0, 0.01),),
        excitation=Excitation(intensity=1.0),
        drifts=(
            Drift("mode.1.frequency_hz", (1.0, 9.0), (400.0, 600.0)),
            Drift("excitation.intensity", (4.9, 5.1), (1.0, 16.0)),
        ),
    )
    run = simulate(system, 10.0, seed=9, settle_s=0.3)
    first, last = run.displacement[:12800], run.displacement[-12800:]
    for part, frequency in ((first, 400.0), (last, 600.0)):
        lines, density = signal.welch(part, RATE, nperseg=2048)
        assert lines[np.argmax(density)] == pytest.approx(frequency, abs=10.0)
    assert np.std(last) / np.std(first) == pytest.approx(4.0 * (400.0 / 600.0) ** 1.5, rel=0.25)
    assert [round(root.frequency_hz) for root in (run.truth.roots[0], run.truth.roots[-1])] == [400, 600]


def test_drifts_count_from_the_start_of_the_recording():
    """Settling beforehand does not shift the moment at which a parameter changes."""
    system = MachiningSystem((Mode(400.0, 0.01),), drifts=(Drift("mode.1.frequency_hz", (0.99, 1.01), (400.0, 800.0)),))
    run = simulate(system, 2.0, seed=3, settle_s=1.5)
    for part, frequency in ((run.displacement[:12800], 400.0), (run.displacement[13440:], 800.0)):
        lines, density = signal.welch(part, RATE, nperseg=2048)
        assert lines[np.argmax(density)] == pytest.approx(frequency, abs=10.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"duration_s": 0.0}, "too short"),
        ({"force": np.zeros(12800)}, "measured force was given"),
    ],
)
def test_senseless_requests_are_refused(change, words):
    """What cannot be simulated is said."""
    with pytest.raises(InputError, match=words):
        simulate(**({"system": MachiningSystem((Mode(300.0, 0.05),)), "duration_s": 1.0, "seed": 0} | change))


@pytest.mark.parametrize(
    ("force", "words"), [(None, "no force was given"), (np.zeros(7), r"got \(7,\); allowed: \(12800,\)")]
)
def test_a_measured_force_has_to_be_there_and_fit(force, words):
    """Excitation "measured" without a force, or with one of another length, is an input error."""
    with pytest.raises(InputError, match=words):
        simulate(MachiningSystem((Mode(300.0, 0.05),), excitation=Excitation("measured")), 1.0, 0, force=force)
