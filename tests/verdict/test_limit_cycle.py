"""When what keeps its amplitude and not its phase is an alarm: all five things tell it, for half a second."""

from __future__ import annotations

import math

import pytest

from chatter_monitor.tracking.spectrum import Cycle
from chatter_monitor.verdict.limit_cycle import BEGINS, GOES_ON, LEVEL_S, NOW_S, LimitCycle

INTERVAL_S = 0.05
NOW, LEVEL = round(NOW_S / INTERVAL_S), round(LEVEL_S / INTERVAL_S)
QUIET = 1.0
TELLING = BEGINS._replace(dispersion=0.3, foretold=0.6, repeating=0.3, share=0.8, louder=1.2)


def hear(followed, intervals, rules=TELLING):
    """How many times as loud each interval is said to be, if it is an alarm: of what is told by so much."""
    cycle = Cycle(800.0, rules.share, rules.dispersion, rules.foretold)
    power = QUIET * math.exp(2.0 * rules.louder)
    return [followed.hear(cycle, power, power, rules.repeating) for _ in range(intervals)]


def calm(rules=TELLING, intervals=LEVEL + NOW):
    """A cut that has been as loud as it is at its lowest for so long."""
    followed = LimitCycle(INTERVAL_S)
    assert not any(hear(followed, intervals, rules._replace(louder=0.0)))
    return followed


def weaker(rules, by=1.05):
    """Each thing that is asked for, missed by a little."""
    for name in ("dispersion", "foretold", "repeating"):
        yield rules._replace(**{name: by * getattr(rules, name)})
    for name in ("share", "louder"):
        yield rules._replace(**{name: getattr(rules, name) / by})


def stronger(rules, by=1.02):
    """All that is asked for, kept by a little."""
    kept = (rules.dispersion / by, rules.foretold / by, rules.repeating / by)
    return rules._replace(dispersion=kept[0], foretold=kept[1], repeating=kept[2], share=by * rules.share)


def test_all_together_are_an_alarm_after_half_a_second():
    """It tells how many times the lowest power there is now."""
    told = hear(calm(), 2 * NOW)
    assert any(told[:NOW])
    assert told[-1] == pytest.approx(math.exp(2.0 * TELLING.louder))


def test_what_is_just_enough():
    """Each thing at its limit, and the loudness a little above it."""
    assert hear(calm(), 2 * NOW, stronger(BEGINS)._replace(louder=1.02 * BEGINS.louder))[-1] > 0.0


@pytest.mark.parametrize("rules", [*weaker(BEGINS)])
def test_one_that_misses_is_none(rules):
    """Noise, a force, what repeats, a small line, and a cut that is no louder."""
    others = {name: getattr(TELLING, name) for name, asked in BEGINS._asdict().items() if getattr(rules, name) == asked}
    rules = rules._replace(**others)
    assert not any(hear(calm(rules), 3 * NOW, rules))


@pytest.mark.parametrize(("rules", "goes_on"), [(stronger(GOES_ON), True), *((r, False) for r in weaker(GOES_ON))])
def test_an_alarm_goes_on_with_less(rules, goes_on):
    """But not with any less than that."""
    followed = calm()
    assert hear(followed, 2 * NOW)[-1] > 0.0
    others = rules._replace(louder=1.02 * GOES_ON.louder) if goes_on else rules
    assert bool(hear(followed, 3 * NOW, others)[-1]) is goes_on


def test_a_cut_that_is_loud_from_the_start_has_no_lower_level():
    """Who does not know how loud the cut was does not say that it got louder."""
    assert not any(hear(LimitCycle(INTERVAL_S), 10 * LEVEL))
    assert not any(hear(calm(intervals=LEVEL // 2), 3 * NOW))


def test_another_cut_begins_anew():
    """And so does what is not looked at for an interval."""
    followed = calm()
    followed.rest()
    assert not any(hear(followed, 10 * LEVEL))
    followed = calm()
    assert hear(followed, 2 * NOW)[-1] > 0.0
    assert followed.hear(None, 10.0, 10.0, 0.9) == 0.0
    assert not any(hear(followed, NOW - 1))
    assert all(hear(followed, NOW))


def test_only_what_does_not_turn_may_chatter():
    """The band's share is that of the rest: of all power it may be little."""
    followed = calm()
    power = math.exp(2.0 * TELLING.louder)
    cycle = Cycle(800.0, 0.9, TELLING.dispersion, TELLING.foretold)
    assert not any(followed.hear(cycle, power, 0.4 * power, TELLING.repeating) for _ in range(3 * NOW))


def test_silence_is_no_alarm():
    """Nothing has no level."""
    followed = LimitCycle(INTERVAL_S)
    assert not any(followed.hear(None, 0.0, 0.0, 0.0) for _ in range(3 * LEVEL))
