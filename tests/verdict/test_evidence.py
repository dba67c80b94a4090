"""From frames to numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chatter_monitor.records import Flag, ModeStatus, OdpFrame
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.verdict.evidence import (
    SIGNIFICANT_SHARE,
    ModeEvidence,
    modes_evidence,
    probability_below,
    spindle_order,
    weigh,
)

OSCILLATORY, REAL_PAIR, HELD, STARTING = ModeStatus
N = 101


def frame(*, damping=(0.02, 0.001), share=(0.5, 0.5), status=None, flags=Flag.NONE, rms=0.25):
    """Two modes at 400 and 1000 Hz whose values scatter evenly about their medians."""
    scatter = np.linspace(-1, 1, N)[:, np.newaxis]
    values = [
        np.array([400.0, 1000.0]) + 10 * scatter,
        np.array(damping) + 0.001 * scatter,
        np.array([2.0, 3.0]) + scatter,
        np.array([0.004, 0.0005]) + 0.0001 * scatter,
    ]
    columns = [column.astype(np.float32) for column in values]
    if status is None:
        status = np.full((N, 2), OSCILLATORY)
    status = np.asarray(status, dtype=np.uint8)
    for column in columns:
        column[np.isin(status, [REAL_PAIR, STARTING])] = np.nan
    return OdpFrame(0, 0, 12_800.0, *columns, status, np.array(share), rms=rms, flags=flags)


def status_of(mode, *stretches):
    """Status of two modes, oscillatory but for the stretches (rows, status) of one of them."""
    status = np.full((N, 2), OSCILLATORY, dtype=np.uint8)
    for rows, value in stretches:
        status[rows, mode] = value
    return status


def test_a_mode_is_the_medians_of_its_samples():
    """Frequency, damping and standard deviation are those of the middle sample, each by itself."""
    mode = modes_evidence(frame())[1]
    assert mode.frequency_hz == pytest.approx(1000.0)
    assert mode.damping_ratio == pytest.approx(0.001)
    assert mode.damping_sd == pytest.approx(0.0005)
    assert mode.share == 0.5


@pytest.mark.parametrize("other", [REAL_PAIR, HELD])
def test_samples_without_an_estimate_of_their_own_do_not_count(other):
    """Real pairs and held values are left out of the medians; from half of the interval on there is no mode."""
    mode = modes_evidence(frame(status=status_of(0, (slice(61, None), other))))[0]
    assert mode.frequency_hz == pytest.approx(396.0, abs=0.3)  # the median of the first 61
    assert modes_evidence(frame(status=status_of(0, (slice(50, None), other))))[0] is None
    assert modes_evidence(frame(status=status_of(0, (slice(51, None), other))))[0] is not None


def test_the_least_damped_of_the_significant_modes_is_critical():
    """The mode with the lowest damping is looked at, as long as it carries a share of the power."""
    assert weigh(frame()).critical.frequency_hz == pytest.approx(1000.0)
    assert weigh(frame(damping=(-0.01, 0.001))).critical.frequency_hz == pytest.approx(400.0)
    quiet = (1 - SIGNIFICANT_SHARE, 0.99 * SIGNIFICANT_SHARE)
    assert weigh(frame(share=quiet)).critical.frequency_hz == pytest.approx(400.0)
    assert weigh(frame(share=(0.0, 0.0))).critical is None
    assert weigh(frame(status=status_of(0, (slice(None), REAL_PAIR)), share=(1.0, 0.0))).critical is None


def test_held_only_if_nothing_moved_at_all():
    """One sample that was adapted to makes an interval that is not held."""
    all_held = np.full((N, 2), HELD)
    assert weigh(frame(status=all_held)).held
    all_held[50] = OSCILLATORY
    assert not weigh(frame(status=all_held)).held


def test_starting_as_soon_as_one_sample_is():
    """An interval with a sample before the tracker knew anything is one of the start."""
    assert not weigh(frame()).starting
    assert weigh(frame(status=status_of(1, (slice(0, 1), STARTING)))).starting


def test_level_and_flags_are_handed_on():
    """Level and flags are those of the frame."""
    evidence = weigh(frame(rms=0.125, flags=Flag.GAP | Flag.CLIPPED))
    assert (evidence.rms, evidence.flags) == (0.125, Flag.GAP | Flag.CLIPPED)


@pytest.mark.parametrize(
    ("damping", "sd", "below", "probability"),
    [
        (0.003, 0.001, 0.003, 0.5),
        (0.0, 0.001, 0.00196, 0.975),
        (0.00196, 0.001, 0.0, 0.025),
        (-0.001, 0.0, 0.0, 1.0),
        (0.001, 0.0, 0.0, 0.0),
        (0.001, math.inf, 0.003, 0.5),
        (0.001, math.nan, 0.003, 0.5),
    ],
)
def test_probability_is_that_of_the_normal_distribution(damping, sd, below, probability):
    """The probability that the damping is below a value; one half where the estimate says nothing."""
    mode = ModeEvidence(1000.0, damping, sd, 1.0)
    assert probability_below(mode, below) == pytest.approx(probability, abs=5e-4)


def test_spindle_order_is_the_frequency_in_revolutions():
    """At 1656 rpm 993.6 Hz is the 36th order; without a speed there is none."""
    assert spindle_order(993.6, SpindleSettings(speed_rpm=1656.0, teeth=6)) == pytest.approx(36.0)
    assert spindle_order(993.6, SpindleSettings()) is None
