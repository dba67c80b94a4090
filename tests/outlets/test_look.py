"""Words for people."""

from __future__ import annotations

import pytest

from chatter_monitor.outlets.look import damping, hertz, percent, vibration
from tests.messages import event


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


def test_what_is_not_known_is_not_made_up():
    """A frequency or damping that nobody heard is a dash in a table, and said to be none in a sentence."""
    assert (hertz(898.4), hertz(None), damping(-0.0012), damping(None)) == ("898 Hz", "-", "-0.12 %", "-")
    assert vibration(event()) == "at 900 Hz, least damping -0.10 %"
    assert vibration(event(min_damping_ratio=None)) == "at 900 Hz, least damping unknown"
    assert vibration(event(peak_frequency_hz=None, min_damping_ratio=None)) == "in no line"
