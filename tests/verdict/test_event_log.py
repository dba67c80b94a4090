"""From verdicts to events, with advice."""

from __future__ import annotations

import msgspec
import pytest

from chatter_monitor.records import Verdict
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.verdict.advice import advise
from chatter_monitor.verdict.event_log import EventLog
from chatter_monitor.verdict.reasons import DOUBTED, WITHDRAWN

MILL = SpindleSettings(speed_rpm=1656.0, teeth=6, max_rpm=12_000.0)


def verdict_of(state, index, *, channel=0, damping=0.001, frequency=1067.0):
    return Verdict(
        channel=channel, t0=index * 0.05, t1=(index + 1) * 0.05, sample0=index * 640, sample1=(index + 1) * 640,
        state=state, damping_ratio=damping, frequency_hz=frequency,
    )  # fmt: skip


def event_of(*verdicts, spindle=None):
    """The one event of these verdicts."""
    log = EventLog("cut", spindle or SpindleSettings())
    events = [*map(log.follow, verdicts), log.finish(0)]
    (event,) = [event for event in events if event is not None]
    return event


def test_an_event_is_a_stretch_of_alarm():
    """It lasts from the first to the last interval of the alarm; it tells the least damping and the usual frequency."""
    log = EventLog("cut", SpindleSettings())
    assert log.follow(verdict_of("stable", 0)) is None
    assert log.follow(verdict_of("self_excited", 1)) is None
    assert log.follow(verdict_of("self_excited", 2, damping=-0.002, frequency=990.0)) is None
    assert log.follow(verdict_of("self_excited", 3)) is None
    event = log.follow(verdict_of("stable", 4))
    assert (event.kind, event.channel, event.id) == ("chatter", 0, "cut-0-0001")
    assert (event.onset_s, event.end_s) == pytest.approx((0.05, 0.2))
    assert (event.min_damping_ratio, event.peak_frequency_hz) == (-0.002, 1067.0)
    assert log.follow(verdict_of("stable", 5)) is None


def test_a_gap_neither_ends_an_event_nor_makes_two():
    """Intervals that nobody heard in the middle are part of the event; at its end they are not."""
    alarm, deaf = "self_excited", "unknown"
    states = [alarm, deaf, deaf, alarm, deaf, "stable"]
    event = event_of(*(verdict_of(state, i) for i, state in enumerate(states)))
    assert (event.onset_s, event.end_s) == pytest.approx((0.0, 0.2))


@pytest.mark.parametrize("after", ["stable", "idle", "forced", "approaching"])
def test_whatever_else_is_heard_ends_it(after):
    """Any state but alarm and deafness ends the event at once."""
    log = EventLog("cut", SpindleSettings())
    log.follow(verdict_of("self_excited", 0))
    assert log.follow(verdict_of(after, 1)).end_s == pytest.approx(0.05)


def test_an_event_is_about_the_vibration_that_lasts():
    """One interval in which another mode reads less damping changes neither the event's frequency nor its damping."""
    usual = [verdict_of("self_excited", i) for i in range(5)]
    event = event_of(*usual, verdict_of("self_excited", 5, damping=-0.1, frequency=1249.0))
    assert (event.min_damping_ratio, event.peak_frequency_hz) == (0.001, 1067.0)


def test_intervals_without_a_frequency_belong_to_it():
    """Intervals in which the line was not heard lengthen the event and say nothing of its frequency."""
    event = event_of(verdict_of("self_excited", 0), verdict_of("self_excited", 1, damping=None, frequency=None))
    assert (event.end_s, event.peak_frequency_hz) == (pytest.approx(0.1), 1067.0)


def test_an_alarm_that_is_in_no_line_leaves_an_event():
    """Where no damping is heard it has none; where no frequency is either, less depth is advised and no speed."""
    undamped = event_of(verdict_of("self_excited", 0, damping=None), spindle=MILL)
    assert (undamped.min_damping_ratio, undamped.peak_frequency_hz) == (None, 1067.0)
    assert undamped.advice
    unheard = event_of(verdict_of("self_excited", 0, damping=None, frequency=None), spindle=MILL)
    assert (unheard.min_damping_ratio, unheard.peak_frequency_hz, unheard.advice) == (None, None, [])
    assert unheard.remedy.startswith("reduce the depth of cut")


def test_events_of_channels_are_apart():
    """Each channel has events of its own, all with different names."""
    log = EventLog("cut", SpindleSettings())
    for channel in (0, 1):
        log.follow(verdict_of("self_excited", 0, channel=channel))
    first = log.follow(verdict_of("stable", 1, channel=1))
    log.follow(verdict_of("self_excited", 2, channel=1))
    second = log.follow(verdict_of("stable", 3, channel=1))
    last = log.finish(0)
    assert [event.channel for event in (first, second, last)] == [1, 1, 0]
    assert len({event.id for event in (first, second, last)}) == 3


def test_the_end_of_the_recording_ends_the_event():
    """What is under way at the end becomes an event once, what is not does not."""
    log = EventLog("cut", SpindleSettings())
    assert log.finish(0) is None
    log.follow(verdict_of("self_excited", 0))
    assert log.finish(0).end_s == pytest.approx(0.05)
    assert log.finish(0) is None


def test_with_the_speed_known_there_is_advice():
    """Speeds within the range, and the same in words."""
    event = event_of(verdict_of("self_excited", 0), spindle=MILL)
    assert event.advice
    for advice in event.advice:
        assert 828 <= advice.spindle_rpm <= 12_000
        assert f"{advice.spindle_rpm:.0f} rpm" in event.remedy


def test_the_speed_that_is_heard_counts_if_it_is_the_one_that_was_told():
    """It moves the lobes; a comb far from it is the chatter's own."""
    alarm = verdict_of("self_excited", 0)
    told, heard, other = (
        event_of(msgspec.structs.replace(alarm, order=order), spindle=MILL)
        for order in (None, 1067.0 / (1.02 * 1656.0 / 60.0), 1.0)
    )
    assert other.remedy == told.remedy
    expected = advise(1067.0, MILL, 1.02 * 1656.0 / 60.0)
    assert heard.remedy == expected.text != told.remedy
    assert heard.advice == list(expected.speeds)


def test_without_the_speed_the_remedy_says_what_is_missing():
    """Nothing is advised where neither speed nor range is known, and the remedy says why."""
    event = event_of(verdict_of("self_excited", 0))
    assert event.advice == []
    assert "neither the spindle's speed nor its range is known" in event.remedy


def test_advice_is_for_the_speed_at_the_end():
    """A speed that was announced during the event counts."""
    log = EventLog("cut", SpindleSettings())
    log.follow(verdict_of("self_excited", 0))
    log.set_spindle(MILL)
    assert log.follow(verdict_of("stable", 1)).advice


def test_nothing_is_advised_at_a_speed_that_is_not_believed():
    """Speeds for the teeth that were told would be wrong for those that turn; the remedy is to tell them."""
    alarm = verdict_of("self_excited", 0)
    event = event_of(msgspec.structs.replace(alarm, reasons=["grown", DOUBTED]), spindle=MILL)
    assert event.advice == []
    assert "tell the spindle's speed" in event.remedy
    assert event_of(alarm, spindle=MILL).advice


def test_an_event_that_was_none_asks_for_nothing():
    """Where the alarm is withdrawn no speed is advised, and the remedy says so; the next one is an alarm again."""
    alarm, after = verdict_of("self_excited", 0), verdict_of("forced", 1)
    withdrawn = event_of(alarm, msgspec.structs.replace(after, reasons=[WITHDRAWN, "on orders"]), spindle=MILL)
    assert withdrawn.advice == []
    assert withdrawn.withdrawn
    assert withdrawn.remedy.startswith("nothing: ")
    usual = event_of(alarm, after, spindle=MILL)
    assert usual.advice
    assert not usual.withdrawn
