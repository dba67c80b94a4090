"""How likely an interval is chatter, whatever it is called."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest
from scipy.special import expit, logit

from chatter_monitor.kernels.kinds import LINE
from chatter_monitor.kernels.overview import Overview, overview
from chatter_monitor.kernels.vibration import NO_LINE, VIBRATION
from chatter_monitor.verdict.probability import (
    ALARM,
    BY_LOUDNESS,
    CALM,
    SURGE,
    WARNING,
    Grounds,
    Signs,
    chatter_probability,
    told_by_vibrations,
)
from chatter_monitor.verdict.vibrations import Told


def told(risen: float, *, alarm: bool = False) -> Told:
    """What is told of one vibration that has risen unexplained so likely."""
    records = np.zeros(1, VIBRATION)
    records["noise"], records["growing"], records["unexplained"] = 1.0 - risen, risen, 1.0
    records["alarm_for"], records["line"] = 3 * alarm, NO_LINE
    return Told(Overview(*overview(records, np.zeros(1, LINE))), records)


@pytest.mark.parametrize(("grounds", "fit"), [("alarm", ALARM), ("surge", SURGE), ("warning", WARNING), ("calm", CALM)])
def test_a_logistic_function_of_what_is_told(grounds, fit):
    """Each of the grounds has its own."""
    signs = Signs(grounds, 0.2, 1.5, 0.7)
    expected = expit(fit.sure * logit(0.2) + fit.louder * 1.5 + fit.own_rise * 0.7 + fit.offset)
    assert chatter_probability(signs) == pytest.approx(expected)


@pytest.mark.parametrize("grounds", get_args(Grounds))
def test_what_was_not_seen_tells_no_more_than_what_was(grounds):
    """Nothing is surer than one in a thousand, quieter than usual tells nothing, nor does what has fallen."""

    def likely(*signs):
        return chatter_probability(Signs(grounds, *signs))

    assert likely(0.0, -1.0, -1.0) == likely(0.001, 0.0, 0.0)
    assert likely(1.0, 5.0, 5.0) == likely(0.999, 2.0, 3.0)


@pytest.mark.parametrize("grounds", get_args(Grounds))
def test_the_louder_and_the_surer_the_likelier(grounds):
    """On whatever grounds: that is what is known of chatter."""
    by_loudness = [chatter_probability(Signs(grounds, 0.5, louder, 1.0)) for louder in np.linspace(0.0, 2.0, 5)]
    by_vibration = [chatter_probability(Signs(grounds, sure, 0.5, 1.0)) for sure in (0.01, 0.1, 0.5, 0.9)]
    assert (np.diff(by_loudness) > 0.0).all()
    assert (np.diff(by_vibration) > 0.0).all()


def test_an_alarm_is_likelier_than_a_warning_and_that_than_calm():
    """At the same loudness, with no more than each is called for."""
    for louder in (0.0, 1.0):
        signs = (Signs("alarm", 0.8, louder, 0.0), Signs("warning", 0.1, louder, 0.0), Signs("calm", 0.0, louder, 0.0))
        likely = [chatter_probability(each) for each in signs]
        assert likely == sorted(likely, reverse=True)


def test_what_vibrations_tell():
    """That of the alarm; without one that of the most suspicious; where loudness makes the alarm, nearly certain."""
    assert told_by_vibrations("alarm", told(0.9, alarm=True)) == pytest.approx(0.9)
    assert told_by_vibrations("warning", told(0.3)) == told_by_vibrations("calm", told(0.3)) == pytest.approx(0.3)
    assert told_by_vibrations("alarm", told(0.3)) == BY_LOUDNESS
