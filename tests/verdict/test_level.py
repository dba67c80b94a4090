"""How loud cutting has been."""

from __future__ import annotations

import pytest

from chatter_monitor.verdict.level import LEAST_S, REMEMBERED_S, Level

INTERVAL_S = 0.05
LEAST, MOST = round(LEAST_S / INTERVAL_S), round(REMEMBERED_S / INTERVAL_S)


@pytest.fixture
def level():
    return Level(INTERVAL_S)


def remember(level, power, intervals):
    for _ in range(intervals):
        level.remember(power)


def test_nine_times_the_power_is_three_times_as_loud(level):
    """Once a second is known; nothing is as loud as silence."""
    remember(level, 3.0, LEAST - 1)
    assert level.louder(27.0) == 0.0
    remember(level, 3.0, 1)
    assert level.louder(27.0) == pytest.approx(1.0986, abs=1e-4)
    assert level.louder(1.0) == pytest.approx(-0.5493, abs=1e-4)
    assert level.louder(0.0) == 0.0


def test_what_is_told_by_nobody_is_not_soon_usual(level):
    """What has been loud for less than half of what is remembered is louder still; then it is usual."""
    remember(level, 1.0, MOST)
    remember(level, 9.0, MOST // 2 - 1)
    assert level.louder(9.0) == pytest.approx(1.0986, abs=1e-4)
    remember(level, 9.0, 2)
    assert level.louder(9.0) == 0.0


def test_silence_is_no_level(level):
    """Against nothing everything would be infinitely loud."""
    remember(level, 0.0, LEAST)
    assert level.louder(1.0) == 0.0
