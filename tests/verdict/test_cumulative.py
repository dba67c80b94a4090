"""What is summed is certain when it is enough, and until nothing is left of it."""

from __future__ import annotations

from chatter_monitor.verdict.cumulative import CumulativeSum


def certain(*told):
    """After each of these."""
    followed, result = CumulativeSum(1.0), []
    for telling in told:
        followed.add(telling)
        result.append(followed.certain)
    return result


def test_it_is_certain_from_enough_on_until_nothing_is_left():
    """What is more than enough does not last any longer."""
    assert certain(0.5, 0.5, -0.75, -0.25, 0.75) == [False, True, True, False, False]
    assert certain(9.0, -0.75, -0.25) == [True, True, False]


def test_what_speaks_against_it_is_not_owed():
    """Nor is it after a change to nothing."""
    assert certain(-9.0, 0.5, 0.5) == [False, False, True]
    followed = CumulativeSum(1.0)
    followed.add(1.0)
    followed.clear()
    assert not followed.certain
    followed.add(0.5)
    assert not followed.certain
