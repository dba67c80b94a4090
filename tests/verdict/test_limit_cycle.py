"""When what keeps its amplitude and not its phase is an alarm: it takes most of the power, and made the cut louder."""

from __future__ import annotations

import math

import pytest

from chatter_monitor.kernels.kinds import LOUDER
from chatter_monitor.kernels.limit_cycle import LEAST_SHARE, MOST_REPEATING
from chatter_monitor.tracking.spectrum import Cycle
from chatter_monitor.verdict.limit_cycle import BETWEEN, ENOUGH, FORETOLD, LEVEL_S, NOISE, NOW_S, REPEATING, LimitCycle

INTERVAL_S = 0.05
NOW, LEVEL = round(NOW_S / INTERVAL_S), round(LEVEL_S / INTERVAL_S)
TELLING = Cycle(800.0, 0.8, 0.25, 0.6)
LOUD = 1.5 * LOUDER
# Intervals until it is certain, and in which it gets louder by a load that grows.
LATER, GROWS = math.ceil(ENOUGH / (BETWEEN - TELLING.dispersion)), 60


def hear(followed, intervals, cycle=TELLING, louder=LOUD, rest=1.0, repeating=0.3):
    """How many times as loud each interval is said to be, if it is an alarm: as loud, and with so much not turning."""
    power = math.exp(2.0 * louder)
    return [followed.hear(cycle, power, rest * power, repeating) for _ in range(intervals)]


def calm(intervals=LEVEL + NOW):
    """A cut that has been as loud as it is at its lowest for so long."""
    followed = LimitCycle(INTERVAL_S)
    assert not any(hear(followed, intervals, louder=0.0))
    return followed


def louder(by=LOUD, followed=None, begins=0.0):
    """One that has got louder by and by since it was calm, of noise, and is as loud now."""
    followed = followed or calm()
    for step in range(GROWS):
        assert not any(hear(followed, 1, cycle=None, louder=begins + (by - begins) * step / GROWS))
    assert not any(hear(followed, NOW, cycle=None, louder=by))
    return followed


def test_what_tells_is_summed_until_it_is_certain():
    """It tells how many times the lowest power there is now; of what is nearer to noise it takes longer."""
    told = hear(louder(), 2 * LATER)
    assert not any(told[: LATER - 1])
    assert all(told[LATER:])
    assert told[-1] == pytest.approx(math.exp(2.0 * LOUD))
    doubtful = TELLING._replace(dispersion=BETWEEN - 0.1)
    assert not any(hear(louder(), round(ENOUGH / 0.1) - 1, doubtful))
    assert hear(louder(), math.ceil(ENOUGH / 0.1) + 1, doubtful)[-1] > 0.0


@pytest.mark.parametrize(
    ("about", "alarm"),
    [
        ({"cycle": TELLING._replace(dispersion=1.02 * BETWEEN)}, False),
        ({"cycle": TELLING._replace(foretold=0.98 * FORETOLD)}, True),
        ({"cycle": TELLING._replace(foretold=1.02 * FORETOLD)}, False),
        ({"cycle": TELLING._replace(share=1.02 * LEAST_SHARE)}, True),
        ({"cycle": TELLING._replace(share=0.98 * LEAST_SHARE)}, False),
        ({"rest": 0.98 * LEAST_SHARE / TELLING.share}, False),  # of all power it may be little
        ({"louder": 1.02 * LOUDER}, True),
        ({"louder": 0.98 * LOUDER}, False),
        ({"repeating": 0.98 * REPEATING}, True),
        ({"repeating": 1.02 * REPEATING}, False),
        ({"cycle": None}, False),
    ],
)
def test_noise_a_force_a_small_line_and_a_cut_that_is_no_louder_are_none(about, alarm):
    """Each thing that is asked for, had or missed by a little, the others being had."""
    assert bool(hear(louder(about.get("louder", LOUD)), 3 * LATER, **about)[-1]) is alarm


def test_an_alarm_goes_on_until_as_much_speaks_against_it():
    """What is not a cycle any more is as good as noise."""
    followed = louder()
    assert hear(followed, 2 * LATER)[-1] > 0.0
    against = math.ceil(ENOUGH / (NOISE - BETWEEN))
    assert all(hear(followed, against - 1, cycle=None))
    assert not any(hear(followed, against, cycle=None)[1:])
    assert not any(hear(followed, LATER - 1))
    assert hear(followed, LATER)[-1] > 0.0


@pytest.mark.parametrize(("repeating", "goes_on"), [(0.98 * MOST_REPEATING, True), (1.02 * MOST_REPEATING, False)])
def test_an_alarm_goes_on_where_more_repeats(repeating, goes_on):
    """About the border it would come and go."""
    followed = louder()
    assert hear(followed, 2 * LATER)[-1] > 0.0
    assert bool(hear(followed, 2 * LATER, repeating=repeating)[-1]) is goes_on


def test_a_cut_that_is_loud_from_the_start_has_no_lower_level():
    """Who does not know how loud the cut was does not say that it got louder."""
    assert not any(hear(LimitCycle(INTERVAL_S), 10 * LEVEL))
    assert not any(hear(calm(intervals=LEVEL // 2), 10 * LATER))


def test_a_load_that_jumps_is_another_level():
    """How loud it was before says nothing then; what gets louder from there on does. An alarm goes on through it."""
    followed = calm()
    assert not any(hear(followed, 10 * LEVEL))
    louder(2.0 * LOUD, followed, begins=LOUD)
    assert hear(followed, LATER + 1, louder=2.0 * LOUD)[-1] == pytest.approx(math.exp(2.0 * LOUD))
    assert all(hear(followed, 10 * LEVEL, louder=3.0 * LOUD))


def test_another_cut_begins_anew():
    """Its level is not that of the one before, nor is the alarm."""
    followed = louder()
    assert hear(followed, 2 * LATER)[-1] > 0.0
    followed.rest()
    assert not any(hear(followed, 10 * LEVEL))


def test_silence_is_no_alarm():
    """Nothing has no level."""
    followed = LimitCycle(INTERVAL_S)
    assert not any(followed.hear(None, 0.0, 0.0, 0.0) for _ in range(3 * LEVEL))
