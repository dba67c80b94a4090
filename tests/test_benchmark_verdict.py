"""The benchmark's generator against its own truth: what the equations promise is in the samples."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.signal import welch

from benchmarks.verdict.cache import _save, cached_cuts
from benchmarks.verdict.cut import INTERVAL_SAMPLES, RATE_HZ, Label
from benchmarks.verdict.cutting import Drive, Mode, vibration
from benchmarks.verdict.families import FAMILIES
from benchmarks.verdict.generator import STEP_HZ, _recorded, cut, simulate
from benchmarks.verdict.labels import _labels
from benchmarks.verdict.recipe import Engagement
from benchmarks.verdict.roots import critical_kappa, rightmost_root

ONE = (Mode(900.0, 0.03),)
TWO = (Mode(1900.0, 0.02), Mode(640.0, 0.03, compliance=0.3))
SMOOTH = Engagement()
TEETH = Engagement(depth=0.7, duty=0.45, edge=0.1)


@cache
def made_cut(family):
    """Return the first cut of a family of the development split."""
    return cut("development", list(FAMILIES).index(family))


def free_growth(modes, tau_s, engagement, kappa, seconds):
    """Root that the envelope and phase of a released cut follow, while the tool stays in the cut."""
    n = round(seconds * STEP_HZ)
    stiffness = kappa * modes[0].omega ** 2 * engagement.teeth(np.arange(n) / (tau_s * STEP_HZ))
    # the steady force is held, so that the cut rests until it is kicked; a kick so small that it stays in the cut
    held = -stiffness
    held[1000] += 1e3
    drive = Drive(stiffness, np.ones(n), np.zeros(n), np.full(n, tau_s * STEP_HZ), held, np.full(n, np.inf))
    motion = vibration(modes, drive, STEP_HZ, "displacement")
    assert not motion.limited.any()
    # one period of the coefficients apart, the motion repeats itself but for a factor: least squares over many
    lag = round(tau_s * STEP_HZ)
    tail = motion.seen[n // 2 :]
    grown = np.linalg.lstsq(np.stack([tail[lag:-lag], tail[: -2 * lag]], axis=1), tail[2 * lag :], rcond=None)[0]
    factors = np.roots([1.0, -grown[0], -grown[1]])
    return np.log(np.abs(factors).max()) / (lag / STEP_HZ)


@pytest.mark.parametrize("engagement", [SMOOTH, TEETH], ids=["constant", "teeth"])
@pytest.mark.parametrize("modes", [ONE, TWO], ids=["one mode", "two modes"])
@pytest.mark.parametrize(("strength", "steps", "seconds"), [(0.6, 256, 0.3), (1.4, 256, 0.3), (0.7, 1024, 1.0)])
def test_growth_is_that_of_the_root(modes, engagement, strength, steps, seconds):
    """A released vibration grows or decays at the rate of the rightmost root, to 0.0003 of damping."""
    tau_s = steps / STEP_HZ
    harmonics = engagement.harmonics()
    kappa = strength * critical_kappa(modes, tau_s, harmonics)
    root = rightmost_root(modes, np.array([kappa]), np.array([tau_s]), harmonics)[0]
    growth = free_growth(modes, tau_s, engagement, kappa, seconds)
    assert growth / abs(root) == pytest.approx(root.real / abs(root), abs=3e-4)


def test_cut_depends_on_its_number_alone():
    """The same split and number give the same bits; another split gives other samples."""
    again, other = cut("development", 1), cut("report", 1)
    assert np.array_equal(made_cut("step").samples, again.samples)
    assert not np.array_equal(again.samples[:INTERVAL_SAMPLES], other.samples[:INTERVAL_SAMPLES])


@pytest.mark.parametrize("family", ["step", "forced_at_resonance"])
def test_truth_covers_every_interval(family):
    """Each interval has a label and finite truth; unstable ones are labelled, stable families have none."""
    made = made_cut(family)
    assert len(made.truth) * INTERVAL_SAMPLES == made.samples.size
    assert np.isfinite(made.truth.damping_ratio).all()
    assert np.isfinite(made.samples).all()
    assert np.abs(made.samples).max() <= 1.0
    unstable = made.truth.label == Label.SELF_EXCITED
    assert unstable.any() == (family == "step")
    assert (made.truth.damping_ratio[unstable] < 0).all()


def spectrum(samples):
    """Amplitude spectrum and its frequencies."""
    return np.abs(np.fft.rfft(samples * np.hanning(samples.size))), np.fft.rfftfreq(samples.size, 1.0 / RATE_HZ)


def test_a_feed_that_wanders_does_not_turn():
    """What moves the tool without teeth that can be told apart is no synchronous power; what teeth add to it is."""
    shares = []
    for engagement in (SMOOTH, replace(TEETH, depth=0.4)):
        rng = np.random.default_rng(3)
        plain = FAMILIES["stable"](rng)
        recipe = replace(plain, engagement=engagement, run_out=0.0, feed_wander=0.4, sensor="displacement")
        shares.append(np.median(simulate(recipe, "cut", "stable", rng).truth.synchronous_share))
    assert shares[0] < 0.01
    assert shares[1] > 0.3


def test_forced_lines_are_at_the_true_speed():
    """A forced cut has its strongest line at a harmonic of the teeth at the true speed, not at the nominal one."""
    made = made_cut("forced")
    second = slice(round(2 * RATE_HZ), round(3 * RATE_HZ))  # short enough for the wander of the speed
    amplitude, f = spectrum(made.samples[second])
    line_hz = f[np.argmax(amplitude)]
    order = line_hz / (made.teeth * made.true_rpm(2.5) / 60.0)
    assert order == pytest.approx(round(order), abs=0.015 * round(order))
    assert 0.0099 < abs(made.nominal_rpm / made.true_rpm(np.linspace(0, 8, 800)).mean() - 1.0) < 0.0325


def test_chatter_is_at_the_frequency_of_the_root():
    """Shortly after a sudden onset the line that has grown most is within 3 % of the root's frequency."""
    made = made_cut("step")
    at = round(made.truth.unstable[0].crossing_s * RATE_HZ)
    before, f = spectrum(made.samples[at - round(RATE_HZ) : at])
    after, _ = spectrum(made.samples[at + round(0.2 * RATE_HZ) : at + round(1.2 * RATE_HZ)])
    strong = after > 0.3 * after.max()
    grown_hz = f[strong][np.argmax(after[strong] / before[strong])]
    expected_hz = np.median(made.truth.frequency_hz[made.truth.label == Label.SELF_EXCITED])
    assert grown_hz == pytest.approx(expected_hz, rel=0.03)


def test_white_noise_stays_white_up_to_the_edge():
    """Decimation leaves the top 5 % of the band as full as the rest, within 1 dB."""
    noise = np.random.default_rng(3).standard_normal(2**20)
    f, p = welch(_recorded(noise), RATE_HZ, nperseg=1024)
    assert 10 * np.log10(p[f > 6080].mean() / p[(f > 500) & (f < 5000)].mean()) == pytest.approx(0.0, abs=1.0)


def test_kept_cut_is_the_cut(tmp_path):
    """A cut read from its file equals the generated one in every field."""
    made = made_cut("step")
    _save(made, tmp_path / "development-0000.npz")
    kept = next(cached_cuts("development", 1, tmp_path))
    assert np.array_equal(kept.samples, made.samples)
    assert kept.truth.unstable == made.truth.unstable
    for name in ("label", "damping_ratio", "kappa_critical", "vibration_rms"):
        assert np.array_equal(getattr(kept.truth, name), getattr(made.truth, name)), name
    assert (kept.name, kept.teeth, kept.sensor, kept.snr_db) == (made.name, made.teeth, made.sensor, made.snr_db)


@pytest.mark.parametrize(("clearance", "low", "high"), [(0.1, 0.08, 0.3), (np.inf, 0.5, 3.0)])
def test_chatter_saturates_at_the_flank_or_out_of_the_cut(clearance, low, high):
    """The amplitude stays at a few clearances where the flank rubs, else it grows until the tool leaves the cut."""
    n, tau_s = round(2.0 * STEP_HZ), 256 / STEP_HZ
    stiffness = np.full(n, 1.5 * critical_kappa(ONE, tau_s) * ONE[0].omega ** 2)
    steepest = np.full(n, clearance * ONE[0].omega)
    drive = Drive(stiffness, np.ones(n), np.zeros(n), np.full(n, tau_s * STEP_HZ), np.zeros(n), steepest)
    motion = vibration(ONE, drive, STEP_HZ, "displacement")
    settled = motion.seen[n // 2 :]
    assert low < 0.5 * np.ptp(settled) < high
    assert 0.02 < motion.limited[n // 2 :].mean() < 0.6
    assert (motion.force[n // 2 :] == 0.0).any() == np.isinf(clearance)


def test_labels_follow_the_rules_of_the_truth():
    """Unscored at the start, for 150 ms from the crossing and while it dies down; self-excited between, calm again."""
    damping = np.repeat([0.02, -0.01, 0.02], [20, 20, 20])
    rms = np.concatenate((np.ones(20), np.full(20, 10.0), 10.0 * 0.5 ** np.arange(20)))
    share = np.where(np.arange(60) < 10, 0.9, 0.0)
    label, stretches = _labels(damping, rms, share, np.zeros(60, bool))
    expected = np.repeat(
        [Label.UNSCORED, Label.FORCED, Label.OTHER, Label.UNSCORED, Label.SELF_EXCITED, Label.UNSCORED, Label.OTHER],
        [6, 4, 10, 3, 17, 3, 17],
    )
    assert label.tolist() == expected.tolist()
    assert len(stretches) == 1
    assert 0.975 < stretches[0].zero_s < stretches[0].crossing_s < 1.025


def test_weak_instability_counts_once_the_vibration_is_large():
    """At a damping between -0.0015 and 0 intervals are open until the vibration is limited, then self-excited."""
    damping = np.repeat([0.02, -0.001], [20, 40])
    saturated = np.arange(60) >= 40
    label, stretches = _labels(damping, np.ones(60), np.zeros(60), saturated)
    assert (label[20:43] == Label.UNSCORED).all()
    assert (label[43:] == Label.SELF_EXCITED).all()
    assert stretches[0].crossing_s is None
