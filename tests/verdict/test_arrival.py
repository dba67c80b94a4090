"""An alarm that came with the tool, as known when it leaves."""

from __future__ import annotations

import pytest

from chatter_monitor.kernels.vibrations import FORGOTTEN_CHATTER
from chatter_monitor.verdict.arrival import AS_LOUD, BEFORE_S, ENTERING, GROWING_S, Arrival

INTERVAL_S = 0.05
ROOM, CUT, CHATTER = 1.0, 10.0, 300.0  # powers


def hear(arrival, power, intervals=60, *, alarm=False):
    for _ in range(intervals):
        arrival.hear(power, alarm=alarm)


def leave(arrival):
    for _ in range(ENTERING + 1):
        arrival.rest()


@pytest.mark.parametrize("after", [ROOM, 1.01 * ROOM / AS_LOUD, 0.99 * ROOM * AS_LOUD])
def test_what_leaves_a_room_as_loud_as_before_the_alarm_came_with_the_tool(after):
    arrival = Arrival(INTERVAL_S)
    hear(arrival, ROOM)
    hear(arrival, CHATTER, alarm=True)
    leave(arrival)
    assert arrival.came_with_tool(after, alone=False)
    assert not arrival.came_with_tool(ROOM * AS_LOUD, alone=False)
    assert not arrival.came_with_tool(ROOM / AS_LOUD, alone=False)


def test_a_tool_that_leaves_may_be_heard_for_another_moment():
    arrival = Arrival(INTERVAL_S)
    hear(arrival, ROOM)
    hear(arrival, CHATTER, alarm=True)
    for _ in range(ENTERING):
        arrival.rest()
        assert not arrival.came_with_tool(ROOM, alone=False)
        assert not arrival.came_with_tool(ROOM, alone=True)
    arrival.rest()
    assert arrival.came_with_tool(ROOM, alone=False)


@pytest.mark.parametrize(
    ("before", "recalled", "came"),
    [
        (CUT, False, False),
        (0.99 * AS_LOUD * ROOM, False, True),  # nothing louder than what is heard now
        (None, False, True),  # nothing at all: it was there with the tool
        (None, True, False),  # but was known from a cut before
        (0.99 * AS_LOUD * ROOM, True, True),
    ],
)
def test_of_a_cut_heard_by_lines_alone_it_comes_out_of_what_was_louder_than_the_room(before, recalled, came):
    arrival = Arrival(INTERVAL_S)
    if before is not None:
        hear(arrival, before)
    arrival.hear(CHATTER, alarm=True, recalled=recalled)
    leave(arrival)
    assert arrival.came_with_tool(ROOM, alone=True) is came


def test_a_calm_cut_that_is_heard_by_lines_alone_says_nothing_of_those_before():
    arrival = Arrival(INTERVAL_S)
    arrival.hear(CHATTER, alarm=True)
    leave(arrival)
    assert arrival.came_with_tool(ROOM, alone=True)
    hear(arrival, CUT)
    leave(arrival)
    assert not arrival.came_with_tool(ROOM, alone=True)


def test_chatter_comes_out_of_a_cut():
    """It leaves a room that is quieter; and a tool that was heard to enter says all that there is to know."""
    arrival = Arrival(INTERVAL_S)
    assert not arrival.came_with_tool(ROOM, alone=False)
    hear(arrival, CUT)
    hear(arrival, CHATTER, alarm=True)
    hear(arrival, CUT)
    hear(arrival, CHATTER, alarm=True)
    assert not arrival.came_with_tool(ROOM, alone=False)
    for soon in (0, 1, round(2.0 * GROWING_S / INTERVAL_S) - 1):
        leave(arrival)
        hear(arrival, CUT, soon)
        hear(arrival, CHATTER, alarm=True)
        leave(arrival)
        assert not arrival.came_with_tool(CUT, alone=False)


@pytest.mark.parametrize(
    ("powers", "by_tool"),
    [
        ([ROOM, CHATTER], True),
        ([ROOM, CHATTER, CHATTER], False),  # a tool needs no longer to be heard
        ([ROOM, CUT, CHATTER], True),  # it had begun to enter
        ([ROOM, 1.01 * AS_LOUD * ROOM, CUT, CHATTER], False),  # what grows is louder before it is an alarm
        ([ROOM, 0.99 * AS_LOUD * ROOM, CUT, CHATTER], True),
        ([ROOM, CHATTER, ROOM], False),  # it is over
    ],
)
def test_an_alarm_that_has_just_begun_is_the_tools_that_enters(powers, by_tool):
    arrival = Arrival(INTERVAL_S)
    hear(arrival, ROOM)
    for power in powers:
        arrival.hear(power, alarm=power == CHATTER)
    assert arrival.began_with_tool() is by_tool
    arrival.rest()
    assert not arrival.began_with_tool()


@pytest.mark.parametrize(("rests", "by_tool"), [(FORGOTTEN_CHATTER - 62, False), (FORGOTTEN_CHATTER, True)])
def test_what_has_chattered_within_a_minute_may_do_so_again(rests, by_tool):
    arrival = Arrival(INTERVAL_S)
    hear(arrival, CHATTER, 1, alarm=True)
    for _ in range(rests):
        arrival.rest()
    hear(arrival, ROOM)
    hear(arrival, CHATTER, 1, alarm=True)
    assert arrival.began_with_tool() is by_tool


def test_who_has_hardly_listened_knows_of_no_tool():
    arrival = Arrival(INTERVAL_S)
    hear(arrival, ROOM, round(GROWING_S / INTERVAL_S) - 1)
    hear(arrival, CHATTER, 1, alarm=True)
    assert not arrival.began_with_tool()


@pytest.mark.parametrize(("entered_s", "came"), [(1.0, True), (2.0, False)])
def test_the_room_is_what_was_heard_for_most_of_the_time_before(entered_s, came):
    """The tool may have been in the cut for a moment."""
    arrival = Arrival(INTERVAL_S)
    hear(arrival, ROOM, round(BEFORE_S / INTERVAL_S))
    hear(arrival, CUT, round(entered_s / INTERVAL_S))
    hear(arrival, CHATTER, alarm=True)
    leave(arrival)
    assert arrival.came_with_tool(ROOM, alone=False) is came
