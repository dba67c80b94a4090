"""Words for people."""

from __future__ import annotations

import pytest

from chatter_monitor.outlets.look import percent


@pytest.mark.parametrize(
    ("probability", "said"),
    [
        (0.0, "0 %"),
        (0.004, "< 1 %"),
        (0.005, "< 1 %"),
        (0.0051, "1 %"),
        (0.42, "42 %"),
        (0.9949, "99 %"),
        (0.995, "> 99 %"),
        (0.9999, "> 99 %"),
        (1.0, "100 %"),
    ],
)
def test_what_is_not_certain_is_not_said_to_be(probability, said):
    """Rounding makes neither nothing nor all of a probability between."""
    assert percent(probability) == said
