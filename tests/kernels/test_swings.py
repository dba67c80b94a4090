"""Swings of a calm cut, and what they say of the next one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chatter_monitor.kernels.heard import FIELDS, HERTZ
from chatter_monitor.kernels.kinds import LOUDER
from chatter_monitor.kernels.lines import ABSOLUTE_RISE, ARRIVAL, LONG_RISE, NEWS, RISE, SHARE
from chatter_monitor.kernels.swings import (
    BEYOND,
    DOWN,
    LATER,
    SECOND,
    SINCE,
    end_cut,
    forget_the_last,
    hold_back,
    new_swings,
)
from chatter_monitor.kernels.testimony import NO_CARRIER, Carrier
from chatter_monitor.kernels.vibration import VIBRATION

RISES = [RISE, LONG_RISE, ABSOLUTE_RISE, NEWS, ARRIVAL]
RISEN = 3.0  # what the spectrum tells of every line here
LONG_ENOUGH = 2 * LATER
HERTZ_HERE = 1266.0
NONE = np.empty(0, VIBRATION)


def interval(state, amplitude, hertz=HERTZ_HERE, *, calm=True, usual=0.0, vibrations=NONE):
    """What is left of the rises of a line with this logarithm of its amplitude."""
    line = np.zeros((1, FIELDS))
    line[0, HERTZ], line[0, SHARE], line[0, RISES] = hertz, 1.0, RISEN
    hold_back(line, math.exp(2.0 * amplitude), usual, calm, NO_CARRIER, vibrations, state)
    assert np.ptp(line[0, RISES]) == 0.0
    return line[0, RISE]


def swung(*, calm=True, intervals=LONG_ENOUGH):
    """State after an amplitude went up to one and stayed down for so many intervals."""
    state = new_swings()
    for amplitude in (0.0, 0.5, 1.0, 0.5, *np.zeros(intervals)):
        interval(state, amplitude, calm=calm)
    return state


def test_what_is_as_loud_as_in_a_swing_has_not_risen_for_certain():
    assert interval(swung(), 1.0) == pytest.approx(LOUDER, abs=0.01)
    assert interval(swung(), 1.5) == pytest.approx(LOUDER + 0.5, abs=0.01)
    assert interval(swung(), -5.0) == 0.0
    assert interval(swung(), 10.0) == RISEN


@pytest.mark.parametrize(
    ("carrier_hz", "arrival"),
    [(HERTZ_HERE, RISEN), (HERTZ_HERE - 40.0, LOUDER), (math.nan, LOUDER)],
)
def test_what_has_sidebands_has_come_with_the_tool_however_far_it_has_swung_since(carrier_hz, arrival):
    line = np.zeros((1, FIELDS))
    line[0, HERTZ], line[0, SHARE], line[0, RISES] = HERTZ_HERE, 1.0, RISEN
    hold_back(line, math.exp(2.0), 0.0, True, Carrier(carrier_hz, 91.7, either=False), NONE, swung())
    assert line[0, ARRIVAL] == pytest.approx(arrival, abs=0.01)
    assert line[0, RISE] == pytest.approx(LOUDER, abs=0.01)  # but it has not risen, for all that


def test_what_has_not_risen_stays_so():
    line = np.zeros((1, FIELDS))
    line[0, HERTZ], line[0, SHARE], line[0, RISES] = HERTZ_HERE, 1.0, -1.0
    hold_back(line, 1.0, 0.0, True, NO_CARRIER, NONE, swung())
    assert (line[0, RISES] == -1.0).all()


def test_a_swing_counts_later():
    """What begins to chatter comes and goes before it stays."""
    assert interval(swung(intervals=LATER // 2), 1.0) == RISEN


@pytest.mark.parametrize("down", [0.9 * DOWN, 1.1 * DOWN])
def test_it_has_to_come_down(down):
    state = new_swings()
    for amplitude in (1.0, *np.full(LONG_ENOUGH, 1.0 - down)):
        interval(state, amplitude)
    assert (interval(state, 1.0) < RISEN) == (down > DOWN)


def test_a_line_that_is_not_heard_has_come_down():
    state = new_swings()
    interval(state, 1.0)
    for _ in range(LONG_ENOUGH):
        hold_back(np.empty((0, FIELDS)), 1.0, 0.0, True, NO_CARRIER, NONE, state)
    assert interval(state, 1.0) < RISEN


def test_chatter_does_not_come_down_by_itself():
    assert interval(swung(calm=False), 1.0) == RISEN


def test_neither_does_what_ends_with_the_cut():
    state = new_swings()
    interval(state, 1.0)
    forget_the_last(state)
    for _ in range(LONG_ENOUGH):
        interval(state, -3.0)
    assert interval(state, 1.0) == RISEN


def chattered(hertz=HERTZ_HERE):
    """A vibration that there is an alarm about."""
    vibrations = np.zeros(1, VIBRATION)
    vibrations["frequency_hz"], vibrations["alarm_for"] = hertz, 1
    return vibrations


@pytest.mark.parametrize(("hertz", "forgotten"), [(1.05 * HERTZ_HERE, True), (1.3 * HERTZ_HERE, False)])
def test_what_swung_in_a_cut_before_it_chattered_there_was_its_onset(hertz, forgotten):
    """Nor is anything learned there until that cut has ended, the alarm over or not."""
    state = swung()
    interval(state, 0.0, vibrations=chattered(hertz))
    for amplitude in (0.0, 1.0, *np.zeros(LONG_ENOUGH)):
        interval(state, amplitude)
    assert bool(interval(state, 1.0) == RISEN) is forgotten
    end_cut(state)
    for amplitude in (0.0, 1.0, *np.zeros(LONG_ENOUGH)):
        interval(state, amplitude)
    assert interval(state, 1.0) < RISEN


def test_what_swung_in_the_cuts_before_counts_all_the_same():
    """They were calm to the end."""
    state = swung()
    end_cut(state)
    interval(state, 0.0, vibrations=chattered())
    assert interval(state, 1.0) == pytest.approx(LOUDER, abs=0.01)


@pytest.mark.parametrize(("hertz", "same"), [(1.05 * HERTZ_HERE, True), (1.3 * HERTZ_HERE, False)])
def test_it_counts_for_what_is_near(hertz, same):
    assert (interval(swung(), 1.0, hertz) < RISEN) == same


@pytest.mark.parametrize("beyond", [0.9, 1.1])
def test_what_is_far_beyond_the_usual_cut_is_beyond_its_swings(beyond):
    """A swing of a heavy cut says nothing of a light one."""
    usual = math.exp(2.0) / (beyond * BEYOND)
    assert (interval(swung(), 1.0, usual=usual) == RISEN) == (beyond > 1.0)


def test_it_is_forgotten_in_twenty_minutes():
    state = swung(intervals=LONG_ENOUGH + 20 * 60 * 20)
    assert interval(state, 1.0) == pytest.approx(LOUDER + 1.0, abs=0.01)


@pytest.mark.parametrize("hertz", [50.0, 6399.0])
def test_the_whole_band_has_a_place(hertz):
    state = new_swings()
    for amplitude in (1.0, *np.zeros(LONG_ENOUGH)):
        interval(state, amplitude, hertz)
    assert interval(state, 1.0, hertz) == pytest.approx(LOUDER, abs=0.01)


def noisy(intervals=200):
    """Logarithms of the amplitude of a mode that noise drives, that forgets in a tenth of a second, about 1."""
    rng = np.random.default_rng(5)
    mode = np.empty(intervals + 1, complex)
    mode[0] = 1.0
    for i, shock in enumerate(rng.standard_normal((intervals, 2)) @ (1.0, 1j) / math.sqrt(2.0)):
        mode[i + 1] = 0.6 * mode[i] + 0.8 * shock
    return 1.0 + np.log(np.abs(mode[1:]))


def steady(intervals=200):
    """Those of one that is limited, in an unsteady cut."""
    return 1.0 + 0.2 * np.random.default_rng(6).standard_normal(intervals)


def alarm(state, amplitudes, after=-3.0, *, line=True, recalled=False, before=None):
    """What an alarm was about while a line had these amplitudes, and another one since; some intervals after it."""
    vibrations = chattered() if before is None else before.copy()
    vibrations["recalled"] = recalled
    if not recalled:
        vibrations["chattered"], vibrations["dispersion"] = True, 1.0  # of an earlier alarm
    for i, amplitude in enumerate(amplitudes):
        vibrations["alarm_for"] = i + 1
        if line or i % 3:
            interval(state, amplitude, calm=False, vibrations=vibrations)
        else:
            hold_back(np.empty((0, FIELDS)), 1.0, 0.0, False, NO_CARRIER, vibrations, state)
    vibrations["alarm_for"] = 0
    for i in range(SINCE + 1):
        vibrations["over"] = i
        interval(state, after, calm=False, vibrations=vibrations)
    return vibrations[0]


BURST, BURSTS = SECOND - 4, 8
GROWS_EACH_TIME = np.tile(np.concatenate([np.linspace(-1.0, 1.0, 6), steady(8), [0.8, 0.2]]), BURSTS)


@pytest.mark.parametrize(
    ("amplitudes", "recalled", "chattered"),
    [
        (noisy(BURST * BURSTS), True, False),
        (noisy(BURST * BURSTS), False, True),  # each is one of its own, and too short
        (steady(BURST * BURSTS), True, True),
        (GROWS_EACH_TIME, True, True),
    ],
)
def test_short_alarms_that_need_the_memory_of_each_other_are_listened_to_together(amplitudes, recalled, chattered):
    """What comes and goes like noise is told after some of them; chatter is not taken for that, however often."""
    state, vibrations = new_swings(), None
    for burst in np.split(amplitudes, BURSTS):
        last = alarm(state, burst, recalled=recalled and vibrations is not None, before=vibrations)
        vibrations = last[np.newaxis]
        if not last["chattered"]:
            break
    assert last["chattered"] == chattered


@pytest.mark.parametrize("line", [True, False])
def test_what_came_and_went_like_noise_in_two_alarms_has_swung(line):
    """Where its line was heard."""
    state = new_swings()
    assert not alarm(state, noisy(), line=line)["chattered"]
    assert interval(state, noisy().max()) == RISEN
    assert not alarm(state, noisy() - 0.5, line=line)["chattered"]
    assert interval(state, noisy().max()) == pytest.approx(LOUDER, abs=0.25)


@pytest.mark.parametrize(
    ("amplitudes", "after"),
    [
        (steady(), -3.0),  # chatter
        (np.concatenate([np.linspace(-4.0, 1.0, 100), steady()]), -3.0),  # that takes its time to grow
        (noisy(SECOND), -3.0),  # nobody can tell
        (noisy(), noisy().max() - 0.9 * DOWN),  # it did not come down
    ],
)
def test_in_any_other_alarm_nothing_has_swung(amplitudes, after):
    state = new_swings()
    for _ in range(3):
        assert alarm(state, amplitudes, after)["chattered"]
    assert interval(state, 2.0) == RISEN


def test_how_far_it_swung_in_an_alarm_is_forgotten_in_twenty_minutes():
    """Though not that it did: it is a third of that by then."""
    state = new_swings()
    alarm(state, noisy())
    for _ in range(20 * 60 * 20):
        hold_back(np.empty((0, FIELDS)), 1.0, 0.0, True, NO_CARRIER, NONE, state)
    alarm(state, noisy() - 2.0)
    assert interval(state, noisy().max()) == pytest.approx(LOUDER + 1.0, abs=0.01)


def test_without_power_there_is_no_amplitude():
    state = new_swings()
    line = np.zeros((1, FIELDS))
    line[0, HERTZ] = HERTZ_HERE
    hold_back(line, 0.0, 0.0, True, NO_CARRIER, NONE, state)
    assert (state.crest == -math.inf).all()
