"""An alarm about what turns out to be on an order of a spindle that was not heard as it began."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.kernels.vibration import VIBRATION
from chatter_monitor.kernels.vibrations import CLIMB, JUST_NOW, SURELY_ON
from chatter_monitor.verdict.vibrations import Told
from chatter_monitor.verdict.withdrawal import Withdrawal

NONE, GIVEN, FOUND, REFINED = None, "given", "found", "refined"


def told(*, alarm=False, place=SURELY_ON - 1.0, climbed=0.0, over=0, others=()):
    """What was heard of a vibration that there is or was an alarm about, and the places of others that were, too."""
    vibrations = np.zeros(1 + len(others), VIBRATION)
    vibrations["chattered"], vibrations["over"], vibrations["alarm_for"] = True, over, 5 if alarm else 0
    vibrations["order_odds"] = place, *others
    vibrations["height"], vibrations["leap"] = 1.0 + climbed, 1.0
    return Told(vibrations=vibrations)


class Alarm(Withdrawal):
    """One that what turns does not explain, or may."""

    def __init__(self, *, outlasts=False):
        super().__init__()
        self._outlasts = outlasts

    def hear(self, *args, **alarm):
        return super().hear(*args, **alarm, outlasts=self._outlasts)


def withdrawn(before, after, *, climbed=0.0, outlasts=False, **at_the_end):
    """Whether an alarm that begins with the former speed is withdrawn when its line makes none, with the latter."""
    withdrawal = Alarm(outlasts=outlasts)
    assert not withdrawal.hear((before, before), Told(), by_line=False, goes_on=False)
    assert not withdrawal.hear((before, before), told(alarm=True, climbed=climbed), by_line=True, goes_on=False)
    assert not withdrawal.hear((before, after), told(alarm=True, climbed=climbed), by_line=True, goes_on=True)
    return withdrawal.hear((after, after), told(**at_the_end), by_line=False, goes_on=True)


@pytest.mark.parametrize(
    ("before", "after", "is_withdrawn"),
    [
        (GIVEN, REFINED, True),
        (NONE, FOUND, True),
        (GIVEN, FOUND, True),
        (GIVEN, GIVEN, False),
        (NONE, NONE, False),
        (REFINED, FOUND, True),
        (FOUND, FOUND, False),
        (FOUND, REFINED, False),
        (NONE, REFINED, False),
        (REFINED, REFINED, False),
        (REFINED, GIVEN, False),
    ],
)
def test_it_takes_a_spindle_that_was_not_heard_before(before, after, is_withdrawn):
    """What was an alarm although its order was known already is one; a speed that comes out of memory is not heard."""
    assert withdrawn(before, after) is is_withdrawn


@pytest.mark.parametrize(
    "at_the_end",
    [{"place": SURELY_ON + 0.1}, {"others": (0.0,)}, {"over": JUST_NOW}],
)
def test_all_that_it_was_about_has_to_be_on_orders(at_the_end):
    """One line off the orders, or none that was heard lately, and the alarm was right as far as is known."""
    assert not withdrawn(GIVEN, REFINED, **at_the_end)
    assert withdrawn(GIVEN, REFINED, others=(SURELY_ON - 0.1,))


@pytest.mark.parametrize(("climbed", "is_withdrawn"), [(0.9 * CLIMB, True), (1.1 * CLIMB, False)])
def test_what_climbed_was_no_force_that_set_in(climbed, is_withdrawn):
    """A comb may be found in the overtones of chatter."""
    assert withdrawn(GIVEN, REFINED, climbed=climbed) is is_withdrawn


def test_what_grew_out_of_a_mode_was_no_force_that_set_in():
    """However quickly it came, the mode had sounded in the cut."""
    assert not withdrawn(NONE, FOUND, outlasts=True)
    assert withdrawn(NONE, FOUND)


def test_each_alarm_has_a_beginning_of_its_own():
    """What was heard in the one before says nothing of the next."""
    withdrawal = Alarm()
    climbed = told(alarm=True, climbed=2.0 * CLIMB)
    withdrawal.hear((GIVEN, GIVEN), climbed, by_line=True, goes_on=False)
    withdrawal.hear((GIVEN, REFINED), climbed, by_line=True, goes_on=True)
    withdrawal.hear((REFINED, REFINED), Told(), by_line=False, goes_on=False)
    withdrawal.hear((REFINED, REFINED), told(alarm=True), by_line=True, goes_on=False)
    assert not withdrawal.hear((REFINED, REFINED), told(), by_line=False, goes_on=True)
    withdrawal.hear((REFINED, GIVEN), Told(), by_line=False, goes_on=False)
    withdrawal.hear((GIVEN, GIVEN), told(alarm=True), by_line=True, goes_on=False)
    assert withdrawal.hear((GIVEN, REFINED), told(), by_line=False, goes_on=True)
