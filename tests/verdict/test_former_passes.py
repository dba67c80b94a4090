"""A pass that is as the ones before but for a line: an alarm soon after the tool is in the cut, and none else."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.tracking.long_spectrum import LENGTH_S, LongSpectrum
from chatter_monitor.verdict.former_passes import BEFORE_ALARM_S, ENTERING_S, FormerPasses
from tests.verdict.test_same_cut import CHATTER_HZ, FRAME, PASSING_HZ, RATE_HZ, noise, teeth, tone

INTERVAL_S = FRAME / RATE_HZ
AIR_S, PASS_S = 1.5, 3.0
# The last spectrum is up to five intervals old.
SOON_S = LENGTH_S + ENTERING_S + 5 * INTERVAL_S


class Heard:
    """What is told of passes that are played one after the other, with air before each."""

    def __init__(self):
        self.passes = FormerPasses(INTERVAL_S)
        self._long = LongSpectrum(RATE_HZ, FRAME)
        self._seed = 100

    def play(self, cut, calm_s=np.inf, air=0.0, air_s=AIR_S):
        """Air, and a pass, until then without another alarm; returns when there was one, after it began (s)."""
        for frame in self._frames(air + 0.01 * self._noise(air_s)):
            self.passes.rest(self._long.hear(frame))
            assert self.passes.new is None
            assert not self.passes.same
        alarms, spectrum = [], None
        for number, frame in enumerate(self._frames(cut + 0.3 * self._noise(cut.size / RATE_HZ))):
            heard = self._long.hear(frame)  # with the next interval, as of `tracking.orders`
            self.passes.cut(spectrum, np.mean(frame**2), calm=number * INTERVAL_S < calm_s and not alarms)
            spectrum = heard
            if self.passes.new is not None:
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


@pytest.fixture
def heard():
    """Of two calm passes of one cut."""
    played = Heard()
    assert played.play(teeth(seconds=PASS_S)) == []
    assert not played.passes.same  # with nothing
    assert played.play(teeth(seconds=PASS_S)) == []
    assert played.passes.same
    return played


def test_chatter_from_the_first_contact_on_is_an_alarm_and_the_next_calm_pass_none(heard):
    """Most of it is new, at its frequency; what chattered is not remembered as calm."""
    for _ in range(2):
        alarms = heard.play(teeth(seconds=PASS_S) + chatter())
        assert alarms[0] <= SOON_S
        assert len(alarms) == round((PASS_S - alarms[0]) / INTERVAL_S) + 1  # until the end
        assert heard.passes.new.share == pytest.approx(0.85, abs=0.05)
        assert heard.passes.new.hertz == pytest.approx(CHATTER_HZ, abs=12.5)
    assert heard.play(teeth(seconds=PASS_S)) == []
    assert heard.passes.same


def test_what_came_before_an_alarm_is_not_remembered_as_calm():
    """It may have been chatter, too: of a first pass it has not been told yet."""
    played = Heard()
    late = np.concatenate([0.0 * chatter(), chatter()])
    assert played.play(teeth(seconds=2 * PASS_S) + late, calm_s=PASS_S + BEFORE_ALARM_S - 0.2) == []
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
    assert heard.passes.same


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
    assert heard.passes.same


def test_a_speed_that_changes_within_the_pass_is_another_cut_soon(heard):
    """What was the same is not for long, and what is new then may be forced."""
    same, other = teeth(seconds=1.0), teeth(1.4 * PASSING_HZ, 2.0, (4.0, 5.0))
    heard.play(np.concatenate([same, 0.2 * other]))
    assert not heard.passes.same


def test_a_new_job_is_the_one_to_be_held_against_from_its_first_pass_on(heard):
    """The one before is forgotten."""
    other = teeth(1.3 * PASSING_HZ, PASS_S)
    assert heard.play(other) == []
    assert heard.play(other + chatter())[0] <= SOON_S
    assert heard.play(teeth(seconds=PASS_S) + chatter()) == []


def test_an_alarm_ends_with_what_was_new(heard):
    """Within the time of two spectra or three."""
    over = np.concatenate([chatter()[: chatter().size // 2], np.zeros(chatter().size - chatter().size // 2)])
    alarms = heard.play(teeth(seconds=PASS_S) + over)
    assert alarms[0] <= SOON_S
    assert PASS_S / 2 <= alarms[-1] <= PASS_S / 2 + 1.0
