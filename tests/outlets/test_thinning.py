"""What goes on to a plant's network."""

from __future__ import annotations

import msgspec
import pytest

from chatter_monitor.outlets.thinning import Thinning
from tests.bridging import EVENT, HEALTH, verdict


def numbers(thinning, states):
    return [n for n, state in enumerate(states) if thinning.passed(verdict(n, state)) is not None]


def test_changes_at_once_and_the_rest_once_a_second():
    """A state that stays is told once a second, a new one with its first interval."""
    states = ["stable"] * 45 + ["self_excited"] * 3 + ["stable"] * 25
    assert numbers(Thinning(1.0), states) == [0, 20, 40, 45, 48, 68]


def test_everything_if_asked_for():
    """With 0 every message goes on."""
    assert numbers(Thinning(0.0), ["stable"] * 5) == [0, 1, 2, 3, 4]


def test_each_topic_by_itself():
    """One channel's verdict does not hold back another's, nor health; events always go on."""
    thinning = Thinning(60.0)
    first = verdict(0)
    other = msgspec.structs.replace(first, channel=1)
    assert [thinning.passed(m) for m in (first, other, HEALTH, EVENT, EVENT)] == [first, other, HEALTH, EVENT, EVENT]
    assert [thinning.passed(m) for m in (first, other, HEALTH)] == [None, None, None]


@pytest.mark.parametrize("later", [0, 3])
def test_a_monitor_that_starts_anew(later):
    """When time begins again, the next message goes on."""
    thinning = Thinning(60.0)
    assert thinning.passed(verdict(1000)) is not None
    assert thinning.passed(verdict(later)) is not None
