"""The benchmark's generator against its own truth: what the equations promise is in the samples."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.verdict.cut import INTERVAL_SAMPLES, Label
from benchmarks.verdict.cutting import Drive, Mode, vibration
from benchmarks.verdict.families import FAMILIES
from benchmarks.verdict.generator import STEP_HZ, cut
from benchmarks.verdict.recipe import Engagement
from benchmarks.verdict.roots import critical_kappa, rightmost_root

ONE = (Mode(900.0, 0.03),)
TWO = (Mode(1900.0, 0.02), Mode(640.0, 0.03, compliance=0.3))
SMOOTH = Engagement()
TEETH = Engagement(depth=0.7, duty=0.45, edge=0.1)


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
@pytest.mark.parametrize("strength", [0.6, 1.4])
def test_growth_is_that_of_the_root(modes, engagement, strength):
    """A released vibration grows or decays at the rate of the rightmost root, to 0.0003 of damping."""
    tau_s = 256 / STEP_HZ
    harmonics = engagement.harmonics()
    kappa = strength * critical_kappa(modes, tau_s, harmonics)
    root = rightmost_root(modes, np.array([kappa]), np.array([tau_s]), harmonics)[0]
    growth = free_growth(modes, tau_s, engagement, kappa, seconds=0.3)
    assert growth / abs(root) == pytest.approx(root.real / abs(root), abs=3e-4)


def test_cut_depends_on_its_number_alone():
    """The same split and number give the same bits; another split gives other samples."""
    again, other = cut("development", 3), cut("report", 3)
    assert np.array_equal(cut("development", 3).samples, again.samples)
    assert not np.array_equal(again.samples[:INTERVAL_SAMPLES], other.samples[:INTERVAL_SAMPLES])


@pytest.mark.parametrize("family", ["step", "forced_at_resonance"])
def test_truth_covers_every_interval(family):
    """Each interval has a label and finite truth; unstable ones are labelled, stable families have none."""
    made = cut("development", list(FAMILIES).index(family))
    assert len(made.truth) * INTERVAL_SAMPLES == made.samples.size
    assert np.isfinite(made.truth.damping_ratio).all()
    assert np.isfinite(made.samples).all()
    assert np.abs(made.samples).max() <= 1.0
    unstable = made.truth.label == Label.SELF_EXCITED
    assert unstable.any() == (family == "step")
    assert (made.truth.damping_ratio[unstable] < 0).all()
