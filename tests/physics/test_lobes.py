"""Stability lobes and recommended speeds against published closed forms."""

import math

import numpy as np
import pytest

from chatter_monitor.errors import InputError
from chatter_monitor.physics.lobes import plot_lobes, recommended_speeds, stability_limit, stability_lobes
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Mode, Spindle
from chatter_monitor.physics.stability import rightmost_root
from chatter_monitor.physics.terms import CATALOGUE


def turning(mode, coefficient, speed_rpm, teeth=1, others=()):
    cut = AppliedTerm(CATALOGUE["regenerative_delay"], {"coefficient": coefficient})
    return MachiningSystem((mode, *others), (cut,), spindle=Spindle(speed_rpm, teeth))


@pytest.mark.parametrize("damping_ratio", [0.005, 0.02, 0.05, 0.1])
def test_least_limit_is_the_closed_form(damping_ratio):
    """b_lim = -1 / (2 K_f min Re G) of one mode is 2 zeta (1 + zeta) k / K_f, at w sqrt(1 + 2 zeta) (Tlusty)."""
    mode = Mode(500.0, damping_ratio)
    (lobe,) = stability_lobes(turning(mode, 0.01, 6000.0), [1])
    least = np.argmin(lobe.coefficient)
    assert lobe.coefficient[least] == pytest.approx(2.0 * damping_ratio * (1.0 + damping_ratio), rel=1e-3)
    assert lobe.frequency_hz[least] == pytest.approx(500.0 * math.sqrt(1.0 + 2.0 * damping_ratio), rel=2e-3)


# Stepan 1989; Insperger and Stepan, Semi-Discretization for Time-Delay Systems, 2011, section 2.2: with r the
# frequency of the vibration over that of the mode, process stiffness over modal stiffness and speed over frequency are
#   w = [(1 - r^2)^2 + 4 zeta^2 r^2] / [2 (r^2 - 1)],   Omega = r / [j - arctan((r^2 - 1) / (2 zeta r)) / pi],   j >= 1
@pytest.mark.parametrize("j", [1, 2, 5])
@pytest.mark.parametrize("ratio", [1.003, 1.0198, 1.05, 1.3])
def test_lobes_are_those_of_the_published_parametric_form(j, ratio):
    """Speed and process stiffness at a given chatter frequency agree with Stepan's formulas."""
    zeta, frequency = 0.02, 500.0
    stiffness = ((1.0 - ratio**2) ** 2 + 4.0 * zeta**2 * ratio**2) / (2.0 * (ratio**2 - 1.0))
    speed_hz = frequency * ratio / (j - math.atan((ratio**2 - 1.0) / (2.0 * zeta * ratio)) / math.pi)
    (lobe,) = stability_lobes(turning(Mode(frequency, zeta), 0.01, 6000.0), [j - 1])
    assert np.interp(frequency * ratio, lobe.frequency_hz, lobe.coefficient) == pytest.approx(stiffness, rel=2e-3)
    assert np.interp(frequency * ratio, lobe.frequency_hz, lobe.speed_rpm) == pytest.approx(60.0 * speed_hz, rel=1e-3)


@pytest.mark.parametrize("others", [(), (Mode(1130.0, 0.015, -0.8),)], ids=["one mode", "two modes"])
def test_the_limit_separates_stable_from_unstable_roots(others):
    """One percent below the limit the rightmost root is stable, one percent above it is not, at 60 speeds."""
    mode, teeth = Mode(700.0, 0.02), 3
    speeds = np.linspace(1500.0, 16000.0, 60)
    limit = stability_limit(turning(mode, 0.01, 6000.0, teeth, others), speeds)
    finite = np.isfinite(limit) & (limit < 2.0)
    assert finite.sum() > 50
    for speed, coefficient in zip(speeds[finite], limit[finite], strict=True):
        assert rightmost_root(turning(mode, 0.99 * coefficient, speed, teeth, others)).stable
        assert not rightmost_root(turning(mode, 1.01 * coefficient, speed, teeth, others)).stable


def test_recommended_speeds_put_a_tooth_harmonic_on_the_chatter():
    """898.5 Hz with six teeth: 60 f / (k z) = 8985, 4492.5, 2995 rpm between 2500 and 10000 rpm."""
    advice = recommended_speeds(898.5, 6, 2500.0, 10000.0)
    assert [(a.lobe, a.spindle_rpm) for a in advice.speeds] == [(1, 8985.0), (2, 4492.5), (3, 2995.0)]
    assert advice.text == "8985 rpm, 4492 rpm, 2995 rpm"


def test_only_stable_speeds_are_recommended_and_none_is_said():
    """With a model the unstable lobes go, and a cut that is too heavy for every speed is told so."""
    mode = Mode(900.0, 0.02)
    limit = 2.0 * 0.02 * 1.02
    easy, heavy, hopeless = (
        recommended_speeds(910.0, 4, 1000.0, 14000.0, turning(mode, factor * limit, 5000.0, 4))
        for factor in (0.9, 6.0, 300.0)
    )
    assert len(easy.speeds) == 13
    assert 0 < len(heavy.speeds) < 13
    assert all(rightmost_root(turning(mode, 6.0 * limit, a.spindle_rpm, 4)).stable for a in heavy.speeds)
    assert hopeless.speeds == ()
    assert "none is stable between 1000 and 14000 rpm" in hopeless.text
    assert recommended_speeds(910.0, 4, 7000.0, 9000.0).text == "no lobe lies between 7000 and 9000 rpm"


def test_a_senseless_request_for_speeds_is_refused():
    """A range upside down is an input error that says what is allowed."""
    with pytest.raises(InputError, match="0 < lowest <= highest"):
        recommended_speeds(900.0, 4, 9000.0, 2000.0)


def test_the_diagram_shows_limit_and_working_point():
    """The plot holds the limit over the given speeds and the cut's own point."""
    speeds = np.linspace(2000.0, 8000.0, 50)
    system = turning(Mode(700.0, 0.02), 0.03, 5000.0)
    curve, point = plot_lobes(system, speeds).axes[0].lines
    np.testing.assert_array_equal(curve.get_ydata(), stability_limit(system, speeds))
    assert (point.get_xdata()[0], point.get_ydata()[0]) == (5000.0, pytest.approx(0.03))
