"""What lines say for self-excitation, against what is defined plainly."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chatter_monitor.kernels.heard import BY_CHANCE, FIELDS, HERTZ, NEAR, NEAR_TEETH, TEETH_BY_CHANCE
from chatter_monitor.kernels.kinds import LIFTED, LINE
from chatter_monitor.kernels.lines import ABSOLUTE_RISE, ARRIVAL, COHERENCE, LONG_RISE, NEWS, SHARE
from chatter_monitor.kernels.testimony import NO_CARRIER, NOT_THIS, Carrier, witness
from chatter_monitor.kernels.vibrations import Odds

ODDS = Odds(unknown_speed=-0.6, off_found=0.5)
NOTHING = np.empty((0, 3))


def said_of(
    heard,
    *,
    taken=NOTHING,
    found=False,
    spindle=False,
    carrier=NO_CARRIER,
    growth=0.0,
    power=2.0,
    usual=0.0,
):
    lines = np.empty(len(heard), LINE)
    witness(heard, taken, found, spindle, carrier, growth, power, usual, ODDS, lines)
    return lines


def line(hertz, share=0.5, near=0.0, by_chance=0.2, near_teeth=0.0, teeth_by_chance=0.1):
    row = np.zeros(FIELDS)
    row[[HERTZ, SHARE, NEWS, ARRIVAL]] = hertz, share, 1.5, 2.5
    row[[NEAR, BY_CHANCE, NEAR_TEETH, TEETH_BY_CHANCE]] = near, by_chance, near_teeth, teeth_by_chance
    return row


@pytest.mark.parametrize(
    ("place", "found", "odds"),
    [
        ((0.0, math.nan, 0.0, math.nan), False, -0.6),  # nobody knows the speed
        ((0.0, math.nan, 1.0, 0.9), False, 0.0),  # orders so dense that each frequency is one
        ((1.0, 0.2, 1.0, 0.1), False, -math.log(0.75 / 0.1 + 0.2 / 0.2)),
        ((1.0, 0.2, 0.0, 0.1), False, -math.log(0.2 / 0.2) + 0.0),
        ((0.0, 0.2, 0.0, 0.1), False, -math.log(0.05 / 0.8)),
        ((0.0, 0.2, 0.0, 0.1), True, 0.5),  # off a comb that may be another machine's
        ((1.0, 0.2, 1.0, 0.1), True, -math.log(0.75 / 0.1 + 0.2 / 0.2)),
    ],
)
def test_odds_are_those_of_its_place(place, found, odds):
    """Forced lines are at multiples of the teeth, of the rotation, or off both, in known shares."""
    (said,) = said_of(np.array([line(500.0, 0.5, *place)]), found=found, spindle=not found)
    assert said["order_odds"] == pytest.approx(odds)


@pytest.mark.parametrize("near", [0.0, 1.0])
def test_a_told_speed_that_is_not_heard_may_not_be_true(near):
    """Then a line says nothing by its place, on an order or off: odds are those of the mixture."""
    heard = np.array([line(500.0, 0.5, near, 0.2, near)])
    (sure,), (unsure,) = said_of(heard, spindle=True), said_of(heard)
    forced = NOT_THIS + (1.0 - NOT_THIS) * math.exp(-sure["order_odds"])
    assert unsure["order_odds"] == pytest.approx(-math.log(forced))
    assert abs(unsure["order_odds"]) < abs(sure["order_odds"])


def test_what_does_not_come_on_top_of_the_cut_has_a_share_of_that():
    """What is quieter than the cut usually is takes less of it than of what is heard; what is louder takes its own."""
    heard = np.array([line(500.0, 0.8)])
    assert said_of(heard, power=2.0, usual=8.0)["dominance"] == pytest.approx(0.2)
    assert said_of(heard, power=2.0, usual=1.0)["dominance"] == pytest.approx(0.8)


def test_nothing_is_new_on_an_order_however_dense_they_are():
    """Where every third frequency is on an order of the rotation, being on one says nothing against chatter."""
    (said,) = said_of(np.array([line(500.0, 0.9, 1.0, 0.3, 0.0, 0.1)]), spindle=True)
    assert said["order_odds"] > 0.0
    assert (said["long_rise"], said["arrival"]) == (0.0, 0.0)


@pytest.mark.parametrize(("spindle", "place", "rise"), [(True, 0.0, 1.5), (False, 0.0, 0.0), (True, 1.0, 0.0)])
def test_news_count_off_the_orders_of_a_spindle_that_is_heard(spindle, place, rise):
    """What is new in this cut counts as risen by as much, but on an order, or where no spindle is heard."""
    (said,) = said_of(np.array([line(500.0, 0.5, place, 0.2, place)]), spindle=spindle)
    assert (said["long_rise"], said["absolute_rise"], said["own_rise"]) == (rise, rise, rise)


@pytest.mark.parametrize(("speed_known", "own"), [(True, 2.0), (False, 0.5 + 2.0 * LIFTED)])
def test_without_a_speed_what_the_surroundings_have_risen_is_a_load(speed_known, own):
    """But for what a line lifts by itself; where forced lines are known by their places, all of it counts."""
    row = line(500.0) if speed_known else line(500.0, by_chance=math.nan, teeth_by_chance=math.nan)
    row[[LONG_RISE, ABSOLUTE_RISE]] = 0.5, 2.0
    (said,) = said_of(np.array([row]))
    assert said["own_rise"] == pytest.approx(own)


@pytest.mark.parametrize(
    ("spindle", "place", "share", "came"),
    [(True, 0.0, 0.7, 2.5), (True, 0.0, 0.3, 0.0), (False, 0.0, 0.7, 0.0), (True, 1.0, 0.7, 0.0)],
)
def test_what_came_with_the_tool_counts_off_the_orders_where_it_takes_most(spindle, place, share, came):
    """Where a spindle is heard, and the line is on none of its orders; each mode that noise drives comes, too."""
    (said,) = said_of(np.array([line(500.0, share, place, 0.2, place)]), spindle=spindle)
    assert said["arrival"] == came


def test_the_share_of_a_line_is_its_own_and_that_of_its_overtones():
    """Beside what is taken out less is its own; overtones count off the orders, with what is their own."""
    heard = np.array([line(500.0, 0.3), line(1001.0, 0.2), line(1530.0, 0.1)])
    taken = np.array([[510.0, 0.5, 0.0], [1010.0, 0.2, 0.0], [300.0, 9.0, 9.0]])
    own = np.array([0.3, 0.2, 0.1])
    own[:2] *= own[:2] * 2.0 / (own[:2] * 2.0 + np.array([0.5, 0.2]) ** 2)
    said = said_of(heard, taken=taken)
    assert said["dominance"] == pytest.approx([own[0] + own[1], *own[1:]])
    assert said["power"].tolist() == [2.0] * 3


@pytest.mark.parametrize(("missed", "share"), [(0.0, 0.5), (0.3, 0.2), (0.6, 0.0)])
def test_an_order_that_is_not_taken_out_now_is_heard_again(missed, share):
    """Up to twice the power that it had is its; only what is louder is something else."""
    (said,) = said_of(np.array([line(500.0, 0.5)]), taken=np.array([[510.0, 0.0, missed]]))
    assert said["dominance"] == pytest.approx(share)


@pytest.mark.parametrize(
    ("rise", "coherence", "dominance"), [(2.0, 0.95, 0.98), (2.0, 0.8, 0.3), (0.7, 0.95, 0.3), (-1.0, 0.95, 0.3)]
)
def test_what_alone_got_louder_counts_as_all_of_it(rise, coherence, dominance):
    """A coherent line of a third of the power, off the orders, beside a louder one that is as loud as ever."""
    heard = np.array([line(500.0, 0.3), line(720.0, 0.6)])
    heard[0, [ABSOLUTE_RISE, COHERENCE]] = rise, coherence
    heard[1, ABSOLUTE_RISE] = 0.005
    said = said_of(heard)
    assert said["dominance"].tolist() == pytest.approx([dominance, 0.6], abs=0.01)


def test_growth_is_the_strongest_lines():
    """What grows from rotation to rotation is many lines; it counts as the strongest, wherever that is."""
    said = said_of(np.array([line(500.0, 0.2, 1.0, 0.2, 1.0), line(700.0, 0.3, 1.0, 0.2, 1.0)]), growth=1.0)
    assert said["growth"].tolist() == [0.0, 1.0]
    assert said["order_odds"][1] == 0.5
    assert said["dominance"].tolist() == pytest.approx([0.2, 1.0 - math.exp(-2.0)])


@pytest.mark.parametrize(
    ("hertz", "share", "carriers"),
    [
        ([505.0, 1005.0], [0.1, 0.3], [True, True]),
        ([505.0, 1005.0], [0.3, 0.1], [True, False]),  # an overtone
        ([1005.0], [0.3], [False]),  # what has sidebands is over
        ([505.0, 1520.0], [0.1, 0.3], [True, False]),
    ],
)
def test_what_is_louder_at_twice_the_frequency_may_be_what_has_sidebands(hertz, share, carriers):
    heard = np.array([line(*each) for each in zip(hertz, share, strict=True)])
    said = said_of(heard, carrier=Carrier(500.0, 100.0, either=False))
    assert said["carrier"].tolist() == carriers


def test_where_either_of_two_may_have_sidebands_both_are_on_no_order():
    """Which of them it is the sidebands do not tell: what was steady before is none, and that is known elsewhere."""
    heard = np.array([line(hertz, 0.3, 1.0, 0.2, 1.0) for hertz in (505.0, 1400.0, 700.0)])
    for either, carriers in ((False, [True, False, False]), (True, [True, True, False])):
        assert said_of(heard, carrier=Carrier(500.0, 1400.0, either))["carrier"].tolist() == carriers


@pytest.mark.parametrize(
    ("hertz", "spacing_hz", "fell", "carrier"),
    [
        (505.0, 100.0, 0.0, True),
        (520.0, 100.0, 0.0, False),
        (520.0, 30.0, 0.0, True),  # so near to each other they are one line, anywhere between
        (535.0, 30.0, 0.0, False),
        (505.0, 100.0, -1.0, False),
    ],
)
def test_what_has_sidebands_is_on_no_order(hertz, spacing_hz, fell, carrier):
    """The line at their middle, whatever speed is told or none, and what is new in it counts; not once it is over."""
    heard = line(hertz, 0.3, 1.0, 0.2, 1.0)
    heard[ABSOLUTE_RISE] = fell
    (said,) = said_of(heard[np.newaxis], carrier=Carrier(500.0, spacing_hz, either=False))
    assert said["carrier"] == carrier
    assert (said["order_odds"], said["arrival"]) == (
        (pytest.approx(-math.log(0.05)), 2.5) if carrier else (pytest.approx(-math.log(0.2 + 0.8 * (7.5 + 1.0))), 0.0)
    )
