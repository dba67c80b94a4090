"""What goes on to a plant's network."""

from __future__ import annotations

import pytest

from chatter_monitor.outlets.thinning import Thinning
from tests.messages import event, health, verdict


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
    held = [verdict(0), verdict(0, channel=1), health()]
    assert [thinning.passed(message) for message in (*held, event(), event())] == [*held, event(), event()]
    assert [thinning.passed(message) for message in held] == [None, None, None]


@pytest.mark.parametrize("later", [0, 3])
def test_a_monitor_that_starts_anew(later):
    """When time begins again, the next message goes on."""
    thinning = Thinning(60.0)
    assert thinning.passed(verdict(1000)) is not None
    assert thinning.passed(verdict(later)) is not None
