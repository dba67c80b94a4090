"""When a cut is in no order any more: what comes back no more outgrows the load, or three things at once tell it."""

from __future__ import annotations

import math

import pytest

from chatter_monitor.verdict.irregularity import (
    BEYOND_LOAD,
    GLIDES,
    GONE,
    LEAST_S,
    LESS_ALIKE,
    LOUD,
    LOUDER,
    MORE_RESTLESS,
    NOW_S,
    OF_THE_CUT,
    REPEATED,
    STILL,
    STILL_REPEATING,
    USUAL_S,
    Irregularity,
)

INTERVAL_S = 0.05
ENOUGH, LEAST, WINDOW = (round(s / INTERVAL_S) for s in (NOW_S, LEAST_S, USUAL_S))
BURST = 4.0  # from interval to interval, up and down
STILL_LOUD = STILL * LOUD


def hear(irregularity, power, intervals, *, recurring=None, repeating=0.9, restless=1.0, rotation_hz=25.0, **now):
    """Intervals, by number, of an alarm: power swings by so many times about its mean (logarithm)."""
    swing = restless**0.5
    powers = [power * (swing if i % 2 else 1.0 / swing) for i in range(intervals)]
    now = {"calm": True, "turns": True} | now
    return [i for i, p in enumerate(powers) if irregularity.hear(p, recurring, repeating, rotation_hz, **now)]


def calm(*, repeating=0.9, restless=1.0, intervals=ENOUGH + LEAST):
    """One that has heard a regular cut of power one."""
    irregularity = Irregularity(INTERVAL_S)
    assert hear(irregularity, 1.0, intervals, repeating=repeating, restless=restless) == []
    return irregularity


def test_bursts_in_no_order_are_an_alarm_within_half_a_second():
    first, *more = hear(calm(), 100.0, 40, repeating=0.3, restless=BURST)
    assert first < ENOUGH
    assert more == list(range(first + 1, 40))


@pytest.mark.parametrize(
    ("power", "repeating", "restless"),
    [
        (0.8 * LOUD, 0.3, BURST),  # as loud as a deeper cut
        (100.0, 1.1 * STILL_REPEATING * 0.9, BURST),  # a cut whose load jumps about
        (100.0, 0.3, 1.2),  # a noisy cut, after a pump in the air
    ],
)
def test_two_of_three_are_none(power, repeating, restless):
    assert hear(calm(), power, 60, repeating=repeating, restless=restless) == []


def test_what_never_repeated_or_was_always_restless_has_not_lost_its_order():
    assert hear(calm(repeating=0.9 * REPEATED), 100.0, 40, repeating=0.05, restless=BURST) == []
    often = BURST ** (1.2 / MORE_RESTLESS)
    assert hear(calm(restless=often), 100.0, 40, repeating=0.3, restless=BURST) == []


def test_it_goes_on_until_it_is_quieter():
    """It may find a rhythm meanwhile."""
    irregularity = calm()
    hear(irregularity, 100.0, 20, repeating=0.3, restless=BURST)
    assert len(hear(irregularity, 1.2 * STILL_LOUD, 40)) == 40
    assert max(hear(irregularity, 0.8 * STILL_LOUD, 40)) <= ENOUGH
    assert hear(irregularity, 100.0, 40) == []


@pytest.mark.parametrize(("intervals", "enough"), [(LEAST, False), (LEAST + 1, True)])
def test_something_has_to_be_known_of_the_cut(intervals, enough):
    """All but one of these are usual by the time in which all that is now is loud but one."""
    heard = hear(calm(intervals=intervals), 100.0, ENOUGH - 1, repeating=0.3, restless=BURST)
    assert bool(heard) is enough


def test_a_rest_forgets_the_cut():
    irregularity = calm()
    irregularity.rest()
    assert hear(irregularity, 100.0, 40, repeating=0.3, restless=BURST) == []


def test_what_is_heard_in_another_alarm_is_not_usual():
    irregularity = calm(intervals=WINDOW)
    assert hear(irregularity, 100.0, 2 * WINDOW, calm=False) == []
    assert hear(irregularity, 100.0, ENOUGH, repeating=0.3, restless=BURST, calm=False)


def test_it_tells_how_loud_it_is():
    irregularity = calm()
    hear(irregularity, 100.0, 20, repeating=0.3, restless=BURST)
    # half of them are double, half half
    assert irregularity.hear(50.0, None, 0.3, None, calm=False, turns=False) == pytest.approx(100.0)


def test_silence_is_quiet():
    assert hear(calm(), 0.0, 40, repeating=0.0) == []


def parts(back, rest):
    """Power, and share of it that comes back."""
    return {"power": back + rest, "recurring": back / (back + rest)}


def regular(*, back=0.95, rest=0.05, repeating=0.95, irregularity=None):
    """One that has heard a cut that comes back, but for some noise."""
    irregularity = irregularity or Irregularity(INTERVAL_S)
    assert hear(irregularity, intervals=WINDOW, repeating=repeating, **parts(back, rest)) == []
    return irregularity


def test_what_comes_back_no_more_and_outgrows_the_load_is_an_alarm():
    """Steady as it is; a load four times as high makes no more than four times as much of it."""
    load = 4.0
    rest = 0.05 * load * BEYOND_LOAD
    first, *_ = hear(regular(), intervals=40, repeating=0.8, **parts(0.95 * load, 1.1 * rest))
    assert first <= ENOUGH
    assert hear(regular(), intervals=40, repeating=0.8, **parts(0.95 * load, 0.9 * rest)) == []


@pytest.mark.parametrize(
    ("usual", "now", "repeating"),
    [
        ({}, parts(20.0, 1.0), 0.95),  # a load of twenty times
        ({}, parts(0.95, 0.9 * LOUDER - 0.95), 0.5),  # hardly louder than before
        ({}, parts(1.0, 10.0), 1.0 - 0.9 * LESS_ALIKE * 0.05),  # it comes back as before, but at another speed
        ({}, parts(0.9, 10.0), 0.3),  # what forced it does not come back any more: at that speed nothing turns
        ({"back": 0.9 * REPEATED, "rest": 1.0 - 0.9 * REPEATED}, parts(0.5, 10.0), 0.3),  # never came back
    ],
)
def test_what_a_load_or_a_speed_can_do_is_none(usual, now, repeating):
    assert hear(regular(**usual), intervals=40, repeating=repeating, **now) == []


def test_it_begins_only_while_the_spindle_is_heard():
    """One that is not may turn at another speed by now: then nothing comes back where it did, through a resonance."""
    irregularity = regular()
    now = {"repeating": 0.6, **parts(1.0, 5.0)}
    assert hear(irregularity, intervals=ENOUGH, turns=False, **now) == []
    for _ in range(5):  # what is heard for a moment is heard by chance
        assert hear(irregularity, intervals=1, **now) == []
        assert hear(irregularity, intervals=1, turns=False, **now) == []
    assert hear(irregularity, intervals=2, **now) == [1]
    assert len(hear(irregularity, intervals=40, turns=False, **now)) == 40


@pytest.mark.parametrize(("left", "alarm"), [(0.9 * GONE, False), (1.1 * GONE, True)])
def test_none_begins_with_an_interval_in_which_it_is_over(left, alarm):
    """Of a load that jumps for a moment a little damped machine swings in no order; that is known when it has gone."""
    irregularity = regular()
    now = {"repeating": 0.6, **parts(1.0, 5.0)}
    assert hear(irregularity, intervals=ENOUGH, turns=False, **now) == []
    assert hear(irregularity, intervals=1, repeating=0.6, **parts(left, 5.0 * left)) == []  # heard for the first time
    assert bool(hear(irregularity, intervals=1, repeating=0.6, **parts(left, 5.0 * left))) is alarm


@pytest.mark.parametrize(("slower", "alarm"), [(0.9 * GLIDES, True), (1.1 * GLIDES, False)])
def test_while_the_speed_changes_nothing_comes_back_as_it_was(slower, alarm):
    """On its way through a resonance it gets louder as well."""
    now = {"repeating": 0.6, "rotation_hz": 25.0 * math.exp(-slower), **parts(1.0, 5.0)}
    assert bool(hear(regular(), intervals=ENOUGH, **now)) is alarm


def test_it_goes_on_until_half_of_that_is_left():
    irregularity = regular()
    hear(irregularity, intervals=20, repeating=0.6, **parts(1.0, 5.0))
    enough = STILL * BEYOND_LOAD * 0.05
    assert len(hear(irregularity, intervals=40, repeating=0.9, **parts(1.3, 1.5 * 1.3 * enough / 0.95))) == 40
    assert max(hear(irregularity, intervals=40, repeating=0.9, **parts(1.3, 0.8 * 1.3 * enough / 0.95))) <= ENOUGH


@pytest.mark.parametrize(("before", "alarm"), [(0.9, True), (1.1, False)])
def test_a_machine_that_was_heard_before_the_cut_tells_no_load(before, alarm):
    """A pump comes back as well, and minds no tool: next to it any noise of a cut outgrows what comes back."""
    irregularity = Irregularity(INTERVAL_S)
    irregularity.idle(before * 0.95 / OF_THE_CUT, 1.0)
    heard = hear(regular(irregularity=irregularity), intervals=40, repeating=0.2, **parts(1.0, 10.0))
    assert bool(heard) is alarm
    irregularity.idle(1.0, None)  # nothing comes back
    assert hear(regular(irregularity=irregularity), intervals=40, repeating=0.2, **parts(1.0, 10.0))


def test_a_rotation_that_gets_known_begins_anew():
    """What was not known of the cut before is no measure."""
    irregularity = calm()
    assert hear(irregularity, 1.0, 2 * LEAST, recurring=0.95) == []
    assert hear(irregularity, intervals=ENOUGH, repeating=0.5, **parts(1.0, 10.0))
