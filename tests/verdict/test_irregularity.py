"""When a cut is in no order any more: louder, less alike and more restless than it was, all three."""

from __future__ import annotations

import pytest

from chatter_monitor.verdict.irregularity import (
    LEAST_S,
    LOUD,
    MORE_RESTLESS,
    NOW_S,
    REPEATED,
    STILL_LOUD,
    STILL_REPEATING,
    USUAL_S,
    Irregularity,
)

INTERVAL_S = 0.05
ENOUGH, LEAST, WINDOW = (round(s / INTERVAL_S) for s in (NOW_S, LEAST_S, USUAL_S))
BURST = 4.0  # from interval to interval, up and down


def hear(irregularity, power, intervals, *, repeating=0.9, restless=1.0, calm=True):
    """Intervals, by number, of an alarm: power swings by so many times about its mean (logarithm)."""
    swing = restless**0.5
    powers = [power * (swing if i % 2 else 1.0 / swing) for i in range(intervals)]
    return [i for i, p in enumerate(powers) if irregularity.hear(p, repeating, calm=calm)]


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
    assert irregularity.hear(50.0, 0.3, calm=False) == pytest.approx(100.0)  # half of them are double, half half


def test_silence_is_quiet():
    assert hear(calm(), 0.0, 40, repeating=0.0) == []
