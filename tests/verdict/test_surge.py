"""How much louder a cut gets from one moment to the next."""

from __future__ import annotations

import pytest

from chatter_monitor.verdict.surge import OF_A_CUT, Surge

CUT, ROOM = 0.5, 0.08


def surges(*heard):
    """What is told of each interval, by its power and the share of it that is forced."""
    surge = Surge(0.05)
    return [surge.hear(power, share) for power, share in heard]


def test_a_cut_that_gets_louder():
    """Nine times the power is three times the amplitude, against half a second before."""
    assert surges(*[(1.0, CUT)] * 10, (9.0, CUT))[-1] == pytest.approx(1.0986, abs=1e-4)


def test_it_is_news_for_a_quarter_of_a_second():
    """Once half of what it is held against is as loud, it is no surge any more."""
    told = surges(*[(1.0, CUT)] * 10, *[(9.0, CUT)] * 8)[10:]
    assert [rise > 1.0 for rise in told] == [True] * 5 + [False] * 3


def test_one_loud_interval_is_no_level():
    """What follows a blow is as loud as what came before it, and a second one as much louder."""
    told = surges(*[(1.0, CUT)] * 10, (100.0, CUT), (1.0, CUT), (100.0, CUT))
    assert told[-3:] == pytest.approx([2.3026, 0.0, 2.3026], abs=1e-4)


def test_half_a_second_has_to_be_known():
    """With less nothing is told; after a rest it begins anew."""
    surge = Surge(0.05)
    assert [surge.hear(power, CUT) for power in [1.0] * 9 + [9.0]] == [0.0] * 10
    assert surge.hear(81.0, CUT) > 2.0
    surge.rest()
    assert [surge.hear(power, CUT) for power in [1.0] * 9 + [9.0]] == [0.0] * 10


@pytest.mark.parametrize(("share", "told"), [(ROOM, 0.0), (0.9 * OF_A_CUT, 0.0), (1.1 * OF_A_CUT, 1.1513)])
def test_a_tool_that_enters_is_no_surge(share, told):
    """Out of what hardly repeats, as a room does, nothing is told."""
    assert surges(*[(1.0, share)] * 10, (10.0, CUT))[-1] == pytest.approx(told, abs=1e-4)


def test_silence_is_no_level():
    """After no power at all, and with none, there is no ratio."""
    assert surges(*[(0.0, CUT)] * 10, (1.0, CUT))[-1] == 0.0
    assert surges(*[(1.0, CUT)] * 10, (0.0, CUT))[-1] == 0.0
