"""How long an alarm lasts: until the cut gets quieter."""

from __future__ import annotations

from chatter_monitor.verdict.loudness import BEFORE_S, LEAST_S, STILL_LOUD, STILL_THERE, TELLING_S, Loudness

INTERVAL_S = 0.05
LEAST, TELLING = round(LEAST_S / INTERVAL_S), round(TELLING_S / INTERVAL_S)
LOUD = 4.0 * STILL_LOUD  # times the power of a calm cut


def after(*, calm=LEAST, alarm=TELLING, power=LOUD):
    """A calm cut of power one, and an alarm of so many intervals."""
    loudness = Loudness(INTERVAL_S)
    for _ in range(calm):
        assert not loudness.goes_on(1.0)
    for _ in range(alarm):
        loudness.alarm(power)
    return loudness


def lasts(loudness, power, intervals=40):
    """For how many intervals it goes on at that power."""
    return sum(loudness.goes_on(power) for _ in range(intervals))


def test_an_alarm_goes_on_while_the_cut_is_as_loud():
    """It lasts for as long as the power does, and tells by how much that is above what it was before."""
    loudness = after()
    assert lasts(loudness, LOUD, 400) == 400
    assert abs(loudness.rise - LOUD) < 1e-9


def test_it_ends_when_the_cut_gets_quieter():
    """Below a quarter of the alarm, though far above what was before; or near what was before."""
    assert lasts(after(power=100.0 * LOUD), 0.9 * STILL_THERE * 100.0 * LOUD) < 10
    assert lasts(after(power=1.5 * STILL_LOUD), 0.9 * STILL_LOUD) < 10


def test_it_does_not_come_back_by_itself():
    """What has ended is no alarm when it gets loud again: another alarm has to tell."""
    loudness = after()
    lasts(loudness, 1.0)
    assert lasts(loudness, LOUD) == 0


def test_no_alarm_goes_on_that_did_not_tell():
    """One shorter than half a second; one with less than a second of cutting before it; none at all."""
    assert lasts(after(alarm=TELLING - 1), LOUD) == 0
    assert lasts(after(calm=LEAST - 1), LOUD) == 0
    assert lasts(after(alarm=0), LOUD) == 0


def test_rest_ends_it():
    """A tool that leaves the cut, or enters the next, takes the alarm with it; what was before is remembered."""
    loudness = after()
    loudness.rest()
    assert lasts(loudness, LOUD) == 0
    for _ in range(TELLING):
        loudness.alarm(1e3 * LOUD)
    assert lasts(loudness, 1e3 * LOUD) == 40


def test_before_is_the_last_seconds():
    """A cut that has been loud for long is what the next alarm is compared with."""
    loudness = after(calm=LEAST, alarm=0)
    lasts(loudness, LOUD, round(BEFORE_S / INTERVAL_S))
    for _ in range(TELLING):
        loudness.alarm(2.0 * LOUD)
    assert lasts(loudness, 2.0 * LOUD) == 0
