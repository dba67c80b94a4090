"""When loudness alone makes an alarm, and how long one lasts: until the cut gets quieter."""

from __future__ import annotations

import pytest

from chatter_monitor.verdict.irregularity import REPEATED
from chatter_monitor.verdict.loudness import (
    LEAP,
    LEAST_S,
    LOUD,
    QUIETER_S,
    STILL_LOUD,
    STILL_THERE,
    SURE_ENOUGH,
    SUSPECTED_S,
    TELLING_S,
    USUAL_S,
    Loudness,
)

INTERVAL_S = 0.05
LEAST, TELLING, ENOUGH, WINDOW, MOMENT = (
    round(s / INTERVAL_S) for s in (LEAST_S, TELLING_S, SUSPECTED_S, USUAL_S, QUIETER_S)
)
CHATTER = 32.0  # times the power of a calm cut
SUSPICIOUS = {"odds": 1.0, "calm": False}


def hear(loudness, power, intervals=40, *, turning=0.0, repeating=0.0, **heard):
    """In how many intervals of that power it is an alarm for its loudness."""
    heard = {"alarm": False, "odds": 0.0, "calm": True, "outlasts": False} | heard
    return sum(loudness.hear(power, turning, repeating, **heard) for _ in range(intervals))


def after(*, calm=LEAST, alarm=TELLING, power=CHATTER, turning=0.0, repeating=0.0):
    """A calm cut of power one and what turns besides, and an alarm of so many intervals."""
    loudness = Loudness(INTERVAL_S)
    assert hear(loudness, 1.0, calm, turning=turning, repeating=repeating) == 0
    hear(loudness, power, alarm, alarm=True)
    return loudness


def test_an_alarm_goes_on_while_the_cut_is_as_loud():
    """It lasts for as long as the power does, and tells by how much that is above what is usual."""
    loudness = after()
    assert hear(loudness, CHATTER, 400) == 400
    assert loudness.rise == pytest.approx(CHATTER)
    assert loudness.usual == 1.0


def test_it_ends_when_the_cut_gets_quieter():
    """Below a quarter of the alarm, though far above what is usual; or near what is."""
    assert hear(after(power=100.0 * CHATTER), 0.9 * STILL_THERE * 100.0 * CHATTER) < 10
    assert hear(after(power=1.5 * STILL_LOUD), 0.9 * STILL_LOUD) < 10


@pytest.mark.parametrize(
    ("turned", "turning", "lasts"),
    [(0.0, CHATTER, True), (CHATTER, CHATTER, False), (CHATTER, 1.9 * CHATTER, False), (CHATTER, 3.0 * CHATTER, True)],
)
def test_what_catches_on_the_teeth_is_as_loud(turned, turning, lasts):
    """Chatter that is taken out with what turns since it got there; not what turned as loud before."""
    loudness = after(turning=turned, alarm=0)
    hear(loudness, 0.9 * LEAP, 2, turning=turned, calm=False)
    hear(loudness, CHATTER, TELLING, turning=turned, alarm=True)
    assert (hear(loudness, 1.0, 400, turning=turning) == 400) == lasts
    assert not lasts or loudness.rise > STILL_LOUD


def test_of_a_cut_that_began_with_an_alarm_nobody_knows_what_turns():
    """What chatters from the first contact on may end while the teeth go on, far louder than the room before."""
    loudness = after(alarm=0)
    hear(loudness, 2.0 * LEAP, TELLING, alarm=True)
    assert hear(loudness, 1.0, 40, turning=2.0 * LEAP) < 20


def test_of_what_grew_out_of_a_mode_all_may_be_chatter():
    """However quickly it came, it came in the same cut, in which nothing turned as loud."""
    loudness = after(alarm=0)
    hear(loudness, 2.0 * LEAP, TELLING, alarm=True)
    assert hear(loudness, 1.0, 400, turning=2.0 * LEAP, outlasts=True) == 400


def test_what_turns_begins_no_alarm():
    """A load makes what turns louder, too."""
    assert hear(after(alarm=0), 1.0, 400, turning=100.0 * LOUD, **SUSPICIOUS) == 0


def test_it_does_not_come_back_by_itself():
    """What has ended is no alarm when it gets loud again: another alarm has to tell."""
    loudness = after()
    hear(loudness, 1.0)
    assert hear(loudness, CHATTER) == 0


@pytest.mark.parametrize(("moments", "again"), [(0.7, True), (1.5, False)])
def test_but_after_a_moment(moments, again):
    """What chatters jumps between lines; and what it is then says nothing of what is usual."""
    loudness = after()
    assert hear(loudness, 0.2 * CHATTER, round(moments * MOMENT)) < 5
    assert (hear(loudness, CHATTER) > 35) == again
    assert (loudness.usual == 1.0) == again


def test_no_alarm_goes_on_that_did_not_tell():
    """One shorter than half a second; one with less than a second of cutting before it; none at all."""
    assert hear(after(alarm=TELLING - 1), CHATTER) == 0
    assert hear(after(calm=LEAST - 1), CHATTER) == 0
    assert hear(after(alarm=0), CHATTER) == 0


def test_rest_ends_it():
    """A tool that leaves the cut, or enters the next, takes the alarm with it; what was usual is remembered."""
    loudness = after()
    loudness.rest()
    assert hear(loudness, CHATTER, calm=False) == 0
    hear(loudness, CHATTER, TELLING, alarm=True)
    assert hear(loudness, CHATTER) == 40


def test_usual_is_what_was_calm_in_the_last_seconds():
    """A cut that has been loud for long is what the next alarm is compared with, but not what was suspicious."""
    loudness = after(alarm=0)
    hear(loudness, CHATTER, WINDOW, calm=False)
    assert loudness.usual == 1.0
    hear(loudness, CHATTER, WINDOW)
    assert loudness.usual == CHATTER


def test_what_is_suspected_is_an_alarm_when_it_gets_loud():
    """Within a quarter of a second, and for as long as it is loud; not where nothing is suspected."""

    def grown():
        loudness = after(alarm=0)
        hear(loudness, 0.9 * LEAP, 2, calm=False)
        return loudness

    assert hear(grown(), 1e2, ENOUGH - 1, **SUSPICIOUS) == 0
    loudness = grown()
    assert hear(loudness, CHATTER, 40 + ENOUGH, **SUSPICIOUS) >= 35
    assert hear(loudness, CHATTER, 40) == 40
    assert hear(grown(), CHATTER, 40) == 0


@pytest.mark.parametrize("odds", [0.2, 1.0, 3.0])
def test_the_surer_it_is_the_less_loud_it_has_to_be(odds):
    """The odds times how many times as loud it is have to be enough, and it has to be louder at all."""
    enough = max(LOUD, SURE_ENOUGH / odds)

    def alarmed(power):
        loudness = after(alarm=0)
        for step in (0.25, 0.5, 0.75):
            hear(loudness, step * power, 2, calm=False)
        return hear(loudness, power, 40, odds=odds, calm=False)

    assert alarmed(1.1 * enough) > 0
    assert alarmed(0.9 * enough) == 0


def test_a_cut_that_begins_loud_is_only_another_cut():
    """What this cut usually is has to be known: that the one before was quieter says nothing."""
    loudness = after(alarm=0)
    loudness.rest()
    assert hear(loudness, CHATTER, 40, **SUSPICIOUS) == 0


def test_what_is_loud_at_once_has_not_grown():
    """A tool that enters out of a room in which nothing else was heard to change is no chatter, however suspicious."""
    assert hear(after(alarm=0), 1.1 * LEAP, 40, **SUSPICIOUS) == 0


@pytest.mark.parametrize(
    ("repeating", "calm", "grown"),
    [(1.1 * REPEATED, LEAST, True), (0.9 * REPEATED, LEAST, False), (1.1 * REPEATED, LEAST - 1, False)],
)
def test_out_of_a_cut_what_is_loud_at_once_has_grown(repeating, calm, grown):
    """Where all repeated for long enough a tool was in the cut already."""
    loudness = after(calm=calm, alarm=0, repeating=repeating)
    assert (hear(loudness, 1.1 * LEAP, 40, **SUSPICIOUS) > 30) == grown


def test_an_alarm_in_what_is_loud_at_once_goes_on():
    """What its line has told is compared with the room before the leap: chatter that came with the tool is no calm."""
    loudness = after(calm=2 * LEAST, alarm=0)
    hear(loudness, 2.0 * LEAP, LEAST)  # not suspicious yet
    assert hear(loudness, 2.0 * LEAP, TELLING, alarm=True) == 0
    assert hear(loudness, 2.0 * LEAP, 400, calm=False) == 400
