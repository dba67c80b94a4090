"""What is told of the spindle."""

from __future__ import annotations

import pytest

from chatter_monitor.tracking.spindle import SpindleSettings


@pytest.mark.parametrize(
    ("one", "other", "alike"),
    [
        ((1700.0, 4), (1710.0, 4), True),
        ((1700.0, 4), (1730.0, 4), False),
        ((1700.0, 4), (1700.0, 3), False),
        ((1700.0, 4), (None, 4), False),
        ((None, 4), (None, 4), True),
        ((None, 4), (None, 3), False),
    ],
)
def test_a_speed_is_the_same_within_what_a_control_tells_of_it(one, other, alike):
    """With as many teeth; whichever was told first, and what the machine can do says nothing of it."""
    one, other = SpindleSettings(*one, max_rpm=9000.0), SpindleSettings(*other)
    assert one.turns_as(other) is alike
    assert other.turns_as(one) is alike
