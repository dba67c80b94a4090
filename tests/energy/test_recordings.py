"""Real recordings, which are not part of the project."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import soundfile
from scipy.io import loadmat

from chatter_monitor.energy import identify

DATA = Path(__file__).parents[2] / ".." / "shared" / "data"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not DATA.is_dir(), reason="the real recordings are not here (../shared/data)"),
]


def test_silverbox_output_is_hardening():
    """From its output alone the Silverbox hardens: k3 within a factor of 1.6 of 3.9, damping within 10 % of 4.9 %."""
    result = identify(loadmat(DATA / "silverbox_SNLS80mV.mat")["V2"].ravel(), 610.35)
    unit = (2.0 * np.pi * 68.32) ** 2 / 0.990
    s = result.stiffness
    assert s.k3_ci95[0] > 0.0
    assert 3.915 / 1.6 < s.k3 / unit < 3.915 * 1.6
    assert s.k1 / unit == pytest.approx(0.990, rel=0.02)
    assert result.damping.damping_ratio == pytest.approx(0.049, rel=0.1)
    assert any("bent" in warning for warning in result.warnings)


def test_milling_chatter_is_hardly_damped():
    """Chatter at 1065-1085 Hz has less than half the damping of the forced recording, and is worth few samples."""
    chatter, rate = soundfile.read(DATA / "ubc_milling_chatter.flac", start=8 * 44100, stop=int(17.5 * 44100))
    result = identify(chatter, rate, "velocity")
    assert 1065.0 < np.sqrt(result.stiffness.k1) / (2.0 * np.pi) < 1085.0
    assert result.damping.damping_ratio < 0.0006
    assert any("too short" in warning for warning in result.warnings)
    forced, rate = soundfile.read(DATA / "ubc_milling_no_chatter.flac")
    assert identify(forced, rate, "velocity").damping.damping_ratio > 0.001


@pytest.mark.parametrize("name", ["turning_c_770_005_10k", "turning_s_320_030_10k", "turning_s_320_040_10k"])
def test_turning_excerpts_are_survived(name):
    """One second of turning is identified with finite numbers and warned about where it is not one mode."""
    samples, rate = soundfile.read(DATA / f"{name}.wav")
    result = identify(samples, rate, "acceleration")
    assert np.isfinite([result.stiffness.k1, result.damping.damping_ratio, result.damping.s0]).all()
    assert result.warnings
