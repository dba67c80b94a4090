"""The sample index against the computer's clocks."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
import pytest

from chatter_monitor.acquisition.index_clock import IndexClock

RATE_HZ = 12_800.0
EPOCH_S = 1_800_000_000.0  # of the steady clock's zero


def delivered(true_rate_hz, duration_s, *, seed=1, late_s=0.003, broken=()):
    """A clock that has seen deliveries of 10 ms, each late by chance; within the times of `broken`, by 0.3 s more."""
    rng = np.random.default_rng(seed)
    now = {"s": 0.0}
    clock = IndexClock(RATE_HZ, steady=lambda: now["s"], utc=lambda: EPOCH_S + now["s"])
    for sample in range(128, round(duration_s * true_rate_hz), 128):
        now["s"] = sample / true_rate_hz + rng.exponential(late_s)
        if broken and broken[0] <= now["s"] < broken[1]:
            now["s"] += 0.3
        clock.observe(sample, now["s"])
    return clock


@pytest.mark.parametrize("ppm", [-200.0, 0.0, 37.0, 6000.0])
def test_drift_is_measured(ppm):
    """After two minutes of deliveries that are late by 3 ms on average the card's rate is known to 2 millionths."""
    clock = delivered(RATE_HZ * (1 + ppm * 1e-6), 120.0)
    assert clock.drift_ppm == pytest.approx(ppm, abs=2.0)


def test_a_stall_does_not_bend_the_rate():
    """Ten seconds in which everything comes 0.3 s late leave the rate alone."""
    assert delivered(RATE_HZ * (1 + 50e-6), 120.0, broken=(60.0, 70.0)).drift_ppm == pytest.approx(50.0, abs=2.0)


def test_drift_is_not_told_from_jitter_too_early():
    """In the first half minute nobody knows the drift; after it, it is known to a hundredth of what is a wrong rate."""
    assert delivered(RATE_HZ, 25.0).drift_ppm is None
    assert delivered(RATE_HZ, 35.0).drift_ppm == pytest.approx(0.0, abs=50.0)


def test_index_and_time_follow_the_card():
    """An hour into a card that runs 100 millionths fast, index and UTC agree to a millisecond instead of 360."""
    true_hz = RATE_HZ * (1 + 100e-6)
    now = {"s": 0.0}
    clock = IndexClock(RATE_HZ, steady=lambda: now["s"], utc=lambda: EPOCH_S + now["s"])
    rng = np.random.default_rng(2)
    for second in np.arange(0.1, 3600.0, 0.1):
        now["s"] = second + rng.exponential(0.0005)
        clock.observe(round(second * true_hz), now["s"])
    assert clock.index_at(3601.0) == pytest.approx(3601.0 * true_hz, abs=RATE_HZ * 1e-3)
    utc = datetime.fromisoformat(clock.utc_of(round(3600.0 * true_hz)))
    assert (utc - datetime.fromtimestamp(EPOCH_S + 3600.0, UTC)).total_seconds() == pytest.approx(0.0, abs=1e-3)


def test_another_stretch_begins_anew():
    """After a restart the drift is unknown again, and the index goes on from where it is told."""
    clock = delivered(RATE_HZ * (1 + 5000e-6), 60.0)
    clock.restart(1_000_000, 100.0)
    assert clock.drift_ppm is None
    assert clock.index_at(101.0) == 1_000_000 + RATE_HZ


def test_the_computers_clock_may_be_set():
    """When the time of day is set, the times of samples follow within two seconds, and the index does not move."""
    now, step = {"s": 0.0}, {"s": 0.0}
    clock = IndexClock(RATE_HZ, steady=lambda: now["s"], utc=lambda: EPOCH_S + now["s"] + step["s"])
    for number in range(1, 1200):
        now["s"] = number * 0.01
        step["s"] = 3600.0 if now["s"] > 10.0 else 0.0
        clock.observe(number * 128, now["s"])
    utc = datetime.fromisoformat(clock.utc_of(0))
    assert (utc - datetime.fromtimestamp(EPOCH_S + 3600.0, UTC)).total_seconds() == pytest.approx(0.0, abs=1e-5)
    assert clock.index_at(0.0) == pytest.approx(0.0, abs=0.01)
