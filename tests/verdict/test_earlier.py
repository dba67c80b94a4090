"""A cut that is as it was, in this pass or the ones before, but for a line: an alarm soon after, and none else."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chatter_monitor.tracking.long_spectrum import LENGTH_S, OVERLAP, LongSpectrum
from chatter_monitor.verdict.earlier import BEFORE_ALARM_S, ENTERING_S, FEWEST_HERE, REMEMBERED, SAME_ROTATION, Earlier
from tests.verdict.test_same_cut import CHATTER_HZ, FRAME, PASSING_HZ, RATE_HZ, noise, teeth, tone

INTERVAL_S = FRAME / RATE_HZ
AIR_S, PASS_S = 1.5, 3.0
# The last spectrum is up to five intervals old.
SOON_S = LENGTH_S + ENTERING_S + 5 * INTERVAL_S
# A pass that is known from its own beginning, and one in which that is known.
KNOWN_S = LENGTH_S + ENTERING_S + BEFORE_ALARM_S + FEWEST_HERE * LENGTH_S / OVERLAP + 5 * INTERVAL_S
LONG_S = KNOWN_S + PASS_S


class Heard:
    """What is told of passes that are played one after the other, with air before each."""

    def __init__(self):
        self.earlier = Earlier(INTERVAL_S)
        self._long = LongSpectrum(RATE_HZ, FRAME)
        self._seed = 100

    def play(self, cut, calm_s=np.inf, air=0.0, air_s=AIR_S, rotation_hz=None, enters_s=(), lost_s=(np.inf, np.inf)):
        """Air, and a pass, until then without another alarm; returns when there was one, after it began (s).

        The spindle may be heard, but for a while.
        """
        for frame in self._frames(air + 0.01 * self._noise(air_s)):
            self.earlier.rest(self._long.hear(frame))
            assert self.earlier.new is None
            assert not self.earlier.same
        alarms, spectrum = [], None
        for number, frame in enumerate(self._frames(cut + 0.3 * self._noise(cut.size / RATE_HZ))):
            heard = self._long.hear(frame)  # with the next interval, as of `tracking.orders`
            now = number * INTERVAL_S
            calm, entering = now < calm_s and not alarms, any(0.0 <= now - each < 0.25 for each in enters_s)
            turning_hz = None if lost_s[0] <= now < lost_s[1] else rotation_hz
            self.earlier.cut(spectrum, np.mean(frame**2), turning_hz, calm=calm, entering=entering)
            spectrum = heard
            if self.earlier.new is not None:
                alarms.append((number + 1) * INTERVAL_S)
        return alarms

    def _noise(self, seconds):
        self._seed += 1
        return noise(self._seed, seconds)

    def _frames(self, signal):
        return signal.reshape(-1, FRAME)


def chatter(amplitude=4.0):
    """From the first contact on."""
    return amplitude * tone(CHATTER_HZ, PASS_S)


def turning(before_s, amplitude=4.0, after_s=PASS_S):
    """To chatter, after so long."""
    return np.concatenate([0.0 * tone(CHATTER_HZ, before_s), amplitude * tone(CHATTER_HZ, after_s)])


@pytest.fixture
def heard():
    """Of two calm passes of one cut."""
    played = Heard()
    assert played.play(teeth(seconds=PASS_S)) == []
    assert not played.earlier.same  # with nothing
    assert played.play(teeth(seconds=PASS_S)) == []
    assert played.earlier.same
    return played


@pytest.mark.parametrize(
    ("first_hz", "second_hz", "turns"), [(None, None, False), (None, PASSING_HZ, False), (PASSING_HZ, None, True)]
)
def test_it_turns_the_same_where_the_spindle_was_heard_in_a_pass_before(first_hz, second_hz, turns):
    """A speed that was told and never heard is nobody's for being the same cut; a new job is to be heard anew."""
    played = Heard()
    for rotation_hz in (first_hz, second_hz):
        assert not played.earlier.turns_the_same(PASSING_HZ)
        played.play(teeth(seconds=PASS_S), rotation_hz=rotation_hz)
    assert played.earlier.same
    assert played.earlier.turns_the_same(PASSING_HZ) is turns
    played.play(teeth(seconds=PASS_S))
    assert played.earlier.turns_the_same(PASSING_HZ) is (turns or second_hz is not None)
    played.earlier.begin_job()
    played.play(teeth(seconds=PASS_S))
    played.play(teeth(seconds=PASS_S))
    assert played.earlier.same
    assert not played.earlier.turns_the_same(PASSING_HZ)


@pytest.mark.parametrize(
    ("times", "turns"),
    [
        (1.0, True),
        (math.exp(0.99 * SAME_ROTATION), True),  # as it is told
        (math.exp(-1.01 * SAME_ROTATION), False),
        (1.5, False),  # every other line of that is one of the passes before
        (None, False),
    ],
)
def test_it_turns_the_same_at_the_speed_that_was_heard(heard, times, turns):
    """A speed that nobody has heard may share lines with the one that was: the others are off its orders."""
    heard.play(teeth(seconds=PASS_S), rotation_hz=0.9 * PASSING_HZ)
    heard.play(teeth(seconds=PASS_S), rotation_hz=PASSING_HZ)  # which it is by now
    heard.play(teeth(seconds=PASS_S))
    assert heard.earlier.same
    assert heard.earlier.turns_the_same(None if times is None else times * PASSING_HZ) is turns


def test_chatter_from_the_first_contact_on_is_an_alarm_and_the_next_calm_pass_none(heard):
    """Most of it is new, at its frequency; what chattered is not remembered as calm."""
    for enters_s in ([], [0.0]):
        alarms = heard.play(teeth(seconds=PASS_S) + chatter(), enters_s=enters_s)
        assert alarms[0] <= SOON_S
        assert len(alarms) == round((PASS_S - alarms[0]) / INTERVAL_S) + 1  # until the end
        assert heard.earlier.new.share == pytest.approx(0.85, abs=0.05)
        assert heard.earlier.new.hertz == pytest.approx(CHATTER_HZ, abs=12.5)
    assert heard.play(teeth(seconds=PASS_S)) == []
    assert heard.earlier.same


@pytest.mark.parametrize(
    ("rotation_hz", "lost_s", "begins"),
    [
        (PASSING_HZ, (0.3, 3.5), False),  # it may turn at another speed until it is heard again
        (PASSING_HZ, (1.9, 3.5), True),  # what is new may have drowned it
        (PASSING_HZ, (3.0, 5.0), True),  # the alarm goes on
        (None, (0.3, 3.5), True),  # it never was heard
    ],
)
def test_nothing_new_is_believed_while_a_spindle_that_was_heard_is_not(heard, rotation_hz, lost_s, begins):
    cut = teeth(seconds=2.0 + PASS_S) + turning(2.0)
    alarms = heard.play(cut, rotation_hz=rotation_hz, lost_s=lost_s)
    assert (alarms[0] <= 2.0 + SOON_S) is begins
    assert begins or alarms[0] == pytest.approx(3.5 + INTERVAL_S)
    assert alarms[-1] == pytest.approx(2.0 + PASS_S)


def test_what_came_before_an_alarm_is_not_remembered_as_calm():
    """It may have been chatter, too: of a short pass it has not been told yet."""
    played = Heard()
    begins_s = 2.0
    late = turning(begins_s)
    assert played.play(teeth(seconds=begins_s + PASS_S) + late, calm_s=begins_s + BEFORE_ALARM_S - 0.2) == []
    assert played.play(teeth(seconds=PASS_S) + chatter())[0] <= SOON_S


def test_a_share_that_is_hardly_enough_takes_longer(heard):
    """It is summed."""
    power = np.var(teeth()) + 0.3**2
    alarms = heard.play(teeth(seconds=PASS_S) + np.sqrt(2 * power * 0.3 / 0.7) * tone(CHATTER_HZ, PASS_S))
    assert SOON_S < alarms[0] < SOON_S + 0.5
    assert heard.play(teeth(seconds=PASS_S) + np.sqrt(2 * power * 0.15) * tone(CHATTER_HZ, PASS_S)) == []


@pytest.mark.parametrize("begins_s", [1.0, 1.05, 1.1, 1.15])
def test_a_blow_is_no_alarm(heard, begins_s):
    """It rings for a twentieth of a second, with most of the power of the spectrum that it is in."""
    t = np.arange(round(PASS_S * RATE_HZ)) / RATE_HZ - begins_s
    ring = np.where(t > 0.0, np.exp(-np.maximum(t, 0.0) / 0.05), 0.0) * chatter(8.0)
    assert heard.play(teeth(seconds=PASS_S) + ring) == []
    assert heard.earlier.same


@pytest.mark.parametrize(
    "cut",
    [
        8.0 * teeth(seconds=PASS_S),  # deeper
        teeth(1.03 * PASSING_HZ, PASS_S) + chatter(),  # another job, in which a force may be as loud
        0.0 * teeth(seconds=PASS_S) + chatter(),  # nothing of the cut before
    ],
)
def test_what_is_another_cut_or_has_nothing_new_is_no_alarm(heard, cut):
    """However loud."""
    assert heard.play(cut) == []


def test_the_first_pass_of_all_has_nothing_to_be_held_against():
    """Nor has one after a pass in which there was an alarm, or one that was too short, or without air before."""
    assert Heard().play(teeth(seconds=PASS_S) + chatter()) == []
    for first in ({"cut": teeth(seconds=PASS_S), "calm_s": 0.0}, {"cut": teeth(seconds=1.1)}):
        played = Heard()
        played.play(**first)
        assert played.play(teeth(seconds=PASS_S) + chatter()) == []
    played = Heard()
    played.play(teeth(seconds=PASS_S))
    assert played.play(teeth(seconds=PASS_S) + chatter(), air_s=0.4) == []


def test_a_pump_that_is_switched_on_in_the_air_is_none(heard):
    """It was heard without the tool."""
    pump = chatter()[: round(AIR_S * RATE_HZ)]
    assert heard.play(teeth(seconds=PASS_S) + chatter(), air=pump) == []
    assert heard.earlier.same


def test_a_speed_that_changes_within_the_pass_is_another_cut_soon(heard):
    """What was the same is not for long, and what is new then may be forced."""
    same, other = teeth(seconds=1.0), teeth(1.4 * PASSING_HZ, 2.0, (4.0, 5.0))
    heard.play(np.concatenate([same, 0.2 * other]))
    assert not heard.earlier.same


def test_a_new_job_is_the_one_to_be_held_against_from_its_first_pass_on(heard):
    """The one before is forgotten."""
    other = teeth(1.3 * PASSING_HZ, PASS_S)
    assert heard.play(other) == []
    assert heard.play(other + chatter())[0] <= SOON_S
    assert heard.play(teeth(seconds=PASS_S) + chatter()) == []


def test_another_job_has_nothing_to_be_held_against(heard):
    """Where it is told that another one begins, in the air or before; its own first pass is known then."""
    heard.earlier.begin_job()
    assert heard.play(teeth(seconds=PASS_S) + chatter(), calm_s=0.0) == []
    assert not heard.earlier.same
    assert heard.play(teeth(seconds=PASS_S)) == []
    assert heard.play(teeth(seconds=PASS_S) + chatter()) != []
    heard.earlier.begin_job()
    assert not heard.earlier.same
    assert heard.earlier.new is None


def test_an_alarm_ends_with_what_was_new(heard):
    """Within the time of two spectra or three."""
    over = np.concatenate([chatter()[: chatter().size // 2], np.zeros(chatter().size - chatter().size // 2)])
    alarms = heard.play(teeth(seconds=PASS_S) + over)
    assert alarms[0] <= SOON_S
    assert PASS_S / 2 <= alarms[-1] <= PASS_S / 2 + 1.0


def test_chatter_in_a_first_pass_is_an_alarm_where_it_begins():
    """It is held against what the pass was like until then, however loud it is cut by now."""
    deeper = np.where(np.arange(turning(KNOWN_S).size) < KNOWN_S * RATE_HZ, 1.0, 3.0)
    cut = deeper * teeth(seconds=LONG_S) + turning(KNOWN_S, 12.0)
    played = Heard()
    alarms = played.play(cut)
    assert KNOWN_S < alarms[0] <= KNOWN_S + SOON_S
    assert len(alarms) == round((LONG_S - alarms[0]) / INTERVAL_S) + 1  # until the end
    assert played.earlier.within
    assert played.earlier.new.hertz == pytest.approx(CHATTER_HZ, abs=12.5)
    assert Heard().play(deeper * teeth(seconds=LONG_S)) == []


def test_what_is_new_since_the_passes_before_is_not_called_new_within(heard):
    """Both are, where it begins in the pass; the other one tells more."""
    assert heard.play(teeth(seconds=LONG_S) + turning(KNOWN_S))
    assert not heard.earlier.within


def test_what_has_always_been_there_is_none():
    """Also where it began before enough was known."""
    assert Heard().play(teeth(seconds=LONG_S) + turning(0.0, after_s=LONG_S)) == []
    assert Heard().play(teeth(seconds=2 * KNOWN_S) + turning(KNOWN_S / 3, after_s=5 / 3 * KNOWN_S)) == []


def test_what_comes_by_and_by_over_a_long_time_is_none():
    """What is remembered is renewed, for a tool that wears is no chatter."""
    seconds = 4 * REMEMBERED * LENGTH_S / OVERLAP
    swelling = np.exp(np.linspace(-3.0, 1.0, teeth(seconds=seconds).size)) * tone(CHATTER_HZ, seconds)
    assert Heard().play(teeth(seconds=seconds) + swelling) == []


def test_without_air_only_what_is_on_orders_is_known_to_be_of_the_cut():
    """A pump that is as loud as before tells nothing of a cut that gets deeper."""
    cut = teeth(seconds=LONG_S) + turning(KNOWN_S)
    for rotation_hz, heard in ((PASSING_HZ / 4, True), (None, False), (PASSING_HZ / 3.6, False)):
        assert bool(Heard().play(cut, air_s=0.4, rotation_hz=rotation_hz)) is heard
    assert Heard().play(cut) != []  # with air


def test_what_came_before_a_tool_entered_is_none_of_the_cut():
    """It may have been air, in which nothing was known of the level of a cut."""
    silent = np.where(np.arange(teeth(seconds=LONG_S).size) < KNOWN_S * RATE_HZ, 0.0, 1.0)
    pump = teeth(61.0, LONG_S)
    cut = pump + silent * (teeth(seconds=LONG_S) + 2.0 * tone(CHATTER_HZ, LONG_S))
    assert Heard().play(cut, air_s=0.4, rotation_hz=61.0 / 4) != []
    assert Heard().play(cut, air_s=0.4, rotation_hz=61.0 / 4, enters_s=[KNOWN_S]) == []


def test_what_was_heard_until_a_tool_entered_is_the_air():
    """A pump that is switched on in the air makes a cut of it for the judge, and tells no level of the cut after it."""
    seconds = 2 * KNOWN_S + PASS_S
    pump, cutting = teeth(61.0, seconds), np.arange(teeth(seconds=seconds).size) >= KNOWN_S * RATE_HZ
    cut = pump + cutting * noise(7, seconds) + turning(2 * KNOWN_S)
    assert Heard().play(cut) != []
    assert Heard().play(cut, enters_s=[KNOWN_S]) == []
