"""Advice on spindle speeds against the stability chart of physics.lobes."""

import numpy as np
import pytest

from chatter_monitor.errors import InputError
from chatter_monitor.physics.lobes import stability_limit
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Mode, Spindle
from chatter_monitor.physics.terms import CATALOGUE
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.verdict.advice import MOST_SPEEDS, WORTH_IT, Structure, advise, shallowest

TERM = AppliedTerm(CATALOGUE["regenerative_delay"], {"coefficient": 0.01})


def limit(structure, teeth, speed_rpm):
    """Largest stable coefficient at some speeds, from the chart."""
    system = MachiningSystem((Mode(*structure),), (TERM,), spindle=Spindle(5000.0, teeth))
    return stability_limit(system, np.atleast_1d(speed_rpm))


@pytest.mark.parametrize("frequency_hz", [400.0, 990.0, 2100.0])
@pytest.mark.parametrize("damping_ratio", [0.01, 0.03, 0.05])
@pytest.mark.parametrize("teeth", [1, 3, 6])
def test_advised_speeds_are_the_tops_of_the_chart(frequency_hz, damping_ratio, teeth):
    """No speed within 2 % of an advised one allows 1 % more, and all allow half more than the worst speed does."""
    structure = Structure(frequency_hz, damping_ratio)
    here = 60.0 * frequency_hz / (teeth * 3.4)
    advice = advise(1.01 * frequency_hz, SpindleSettings(here, teeth), structure)
    assert 1 <= len(advice.speeds) <= MOST_SPEEDS
    for speed in advice.speeds:
        at_speed = limit(structure, teeth, speed.spindle_rpm)[0]
        around = limit(structure, teeth, speed.spindle_rpm * np.linspace(0.98, 1.02, 41))
        assert at_speed > 0.99 * around.max()
        assert at_speed >= 0.99 * WORTH_IT * shallowest(damping_ratio)


@pytest.mark.parametrize("damping_ratio", [0.01, 0.03, 0.05])
def test_the_bare_rule_beats_the_present_speed(damping_ratio):
    """Without the mode, speeds from the chatter frequency alone allow deeper cuts than the bottom of a lobe does."""
    structure = Structure(990.0, damping_ratio)
    chatter_hz = 990.0 * np.sqrt(1.0 + 2.0 * damping_ratio)  # at the bottom of every lobe
    here = 60.0 * 990.0 * (1.0 + damping_ratio) / (4 * 2.75)
    advice = advise(chatter_hz, SpindleSettings(here, 4))
    assert [speed.lobe for speed in advice.speeds] == [3, 4, 2]
    assert [speed.spindle_rpm for speed in advice.speeds] == pytest.approx(
        [60.0 * chatter_hz / (4 * k) for k in (3, 4, 2)]
    )
    for speed in advice.speeds:
        assert limit(structure, 4, speed.spindle_rpm)[0] > 1.2 * limit(structure, 4, here)[0]
    assert "taken for granted" in advice.text


def test_the_nearest_speeds_within_the_machines_range_come_first():
    """Only speeds that the spindle reaches are given, sorted by their distance from the present one."""
    wide, narrow = (
        advise(900.0, SpindleSettings(5200.0, 3, low, high), Structure(890.0, 0.02))
        for low, high in ((1000.0, 20000.0), (4000.0, 7000.0))
    )
    assert [speed.lobe for speed in wide.speeds] == [4, 3, 5]
    assert [speed.lobe for speed in narrow.speeds] == [4, 3]
    assert "or" in wide.text


def test_at_low_speed_less_depth_is_advised():
    """Where more than ten waves fit between two teeth the lobes overlap, and the advice is to reduce the depth."""
    advice = advise(990.0, SpindleSettings(740.0, 3), Structure(985.0, 0.03))
    assert advice.speeds == ()
    assert advice.text.startswith("reduce the depth of cut: with")
    assert advise(990.0, SpindleSettings(740.0, 3, 700.0, 12000.0), Structure(985.0, 0.03)).speeds


def test_a_cut_too_deep_for_a_lobe_is_not_sent_to_it():
    """Speeds that are unstable at the strength heard are left out; with none left, the depth has to go down."""
    structure, spindle = Structure(890.0, 0.03), SpindleSettings(5200.0, 3, 2500.0, 20000.0)
    ordinary = advise(905.0, spindle, structure, kappa=0.07)
    heavy = advise(905.0, spindle, structure, kappa=0.2)
    hopeless = advise(905.0, spindle, structure, kappa=2.0)
    assert {speed.lobe for speed in heavy.speeds} < {speed.lobe for speed in ordinary.speeds} | {1, 2}
    for speed in (*ordinary.speeds, *heavy.speeds):
        assert limit(structure, 3, speed.spindle_rpm)[0] > (0.2 if speed in heavy.speeds else 0.07)
    assert hopeless.speeds == ()
    assert "too deep for every speed" in hopeless.text


def test_chatter_at_an_advised_speed_leaves_only_the_higher_lobes():
    """Who already stands between two lobes and chatters is sent to faster ones or told to reduce the depth."""
    structure = Structure(890.0, 0.03)
    (best, *_) = advise(905.0, SpindleSettings(5900.0, 3, 2500.0, 20000.0), structure).speeds
    again = advise(905.0, SpindleSettings(best.spindle_rpm, 3, 2500.0, 20000.0), structure)
    assert again.speeds
    assert all(speed.lobe < best.lobe for speed in again.speeds)


def test_without_any_speed_nothing_is_advised():
    """With neither speed nor range known there is no advice, but a reason; a range alone is enough."""
    assert "neither" in advise(900.0, SpindleSettings()).text
    assert advise(900.0, SpindleSettings(None, 3, 3000.0, 12000.0)).speeds
    with pytest.raises(InputError):
        advise(-1.0, SpindleSettings(5000.0, 3))


def test_a_range_upside_down_is_refused():
    """The least speed of the machine is not above its largest."""
    with pytest.raises(ValueError, match="min_rpm must not be above max_rpm"):
        SpindleSettings(min_rpm=5000.0, max_rpm=4000.0)
