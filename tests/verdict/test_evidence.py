"""From frames to numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from chatter_monitor.kernels.heard import AUDIBLE_SHARE, ORDER_TOLERANCE_HZ, SIGNIFICANT_SHARE, place
from chatter_monitor.kernels.kinds import LIFTED
from chatter_monitor.kernels.lines import MEASURES
from chatter_monitor.records import Flag, ModeStatus, OdpFrame
from chatter_monitor.tracking.channel import Observation
from chatter_monitor.tracking.margin import Margin
from chatter_monitor.tracking.orders import NOMINAL_SD, Orders
from chatter_monitor.tracking.spectrum import LOWEST_HZ, Line
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.verdict.evidence import ModeEvidence, probability_below, speed, spindle_order
from chatter_monitor.verdict.evidence import weigh as weigh_observation

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
    return OdpFrame(0, 0, 12_800.0, *columns, status, np.array(share), rms=rms, flags=flags, hold=np.ones(2, int))


def line(frequency_hz, share=0.5, coherence=0.8):
    return Line(frequency_hz, share, 20.0, 0.3, 0.0, 0.0, 0.0, 15.0, coherence)


def orders_of(rotation_hz=None, source=None, share=0.0):
    sd_hz = None if rotation_hz is None else rotation_hz * (NOMINAL_SD if source == "given" else 1e-4)
    return Orders(0, rotation_hz, sd_hz, source, share)


def weigh(frame, orders=None, lines=(), spindle=None):
    """Evidence of a frame by itself."""
    rows = np.array(lines, float).reshape(-1, MEASURES)
    observation = Observation(frame, orders or orders_of(), rows, True, Margin(reason="too little signal yet"))
    return weigh_observation(observation, spindle or SpindleSettings())


def status_of(mode, *stretches):
    """Status of two modes, oscillatory but for the stretches (rows, status) of one of them."""
    status = np.full((N, 2), OSCILLATORY, dtype=np.uint8)
    for rows, value in stretches:
        status[rows, mode] = value
    return status


def test_a_mode_is_the_medians_of_its_samples():
    """Frequency, damping and standard deviation are those of the middle sample, each by itself."""
    mode = weigh(frame()).critical
    assert mode.frequency_hz == pytest.approx(1000.0)
    assert mode.damping_ratio == pytest.approx(0.001)
    assert mode.damping_sd == pytest.approx(0.0005)
    assert mode.share == 0.5


@pytest.mark.parametrize("other", [REAL_PAIR, HELD])
def test_samples_without_an_estimate_of_their_own_do_not_count(other):
    """Real pairs and held values are left out of the medians; from half of the interval on there is no mode."""

    def first(until):
        return weigh(frame(share=(0.5, 0.0), status=status_of(0, (slice(until, None), other)))).critical

    mode = first(61)
    assert mode.frequency_hz == pytest.approx(396.0, abs=0.3)  # the median of the first 61
    assert first(50) is None
    assert first(51) is not None


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


def test_level_is_that_of_the_whole_signal():
    """The level counts what turns with the spindle, which the frame is without; flags are those of the frame."""
    flags = Flag.GAP | Flag.CLIPPED
    assert (weigh(frame(rms=0.125)).rms, weigh(frame(flags=flags)).flags) == (0.125, flags)
    assert weigh(frame(rms=0.1), orders_of(27.6, "found", share=0.99)).rms == pytest.approx(1.0)


def test_a_line_has_the_least_damped_mode_that_is_near():
    """A line takes the mode at its frequency, whatever its share, and none where there is none."""
    near, far = weigh(frame(share=(0.0, 0.9)), lines=[line(405.0), line(600.0)]).vibrations
    assert (near.mode.frequency_hz, near.mode.damping_ratio) == pytest.approx((400.0, 0.02))
    assert far.mode is None


def test_a_line_that_is_hardly_heard_is_left_out():
    """Lines below the audible share of the power are no vibrations; those above keep their sequence."""
    lines = [line(700.0), line(800.0, 0.9 * AUDIBLE_SHARE), line(300.0, 1.1 * AUDIBLE_SHARE)]
    assert [v.line.frequency_hz for v in weigh(frame(), lines=lines).vibrations] == [700.0, 300.0]


def test_a_line_below_the_band_is_left_out():
    """A line whose phase tells a frequency below the band is none, though its crest stands at the band's edge."""
    lines = [line(0.8 * LOWEST_HZ), line(1.2 * LOWEST_HZ)]
    assert [v.line.frequency_hz for v in weigh(frame(), lines=lines).vibrations] == [1.2 * LOWEST_HZ]


@pytest.mark.parametrize("rotation_hz", [27.6, 100.0])
def test_by_chance_is_the_share_of_frequencies_on_an_order(rotation_hz):
    """Of frequencies drawn anywhere, as many are on an order as the probability says."""
    frequencies = np.random.default_rng(5).uniform(1000.0, 1000.0 + 20.0 * rotation_hz, 4000)
    places = [place(f, speed(orders_of(rotation_hz, "found")), 1, ORDER_TOLERANCE_HZ) for f in frequencies]
    assert np.mean(places, axis=0)[0] == pytest.approx(np.mean(places, axis=0)[1], abs=0.03)


@pytest.mark.parametrize(
    ("frequency_hz", "rotation_hz", "teeth", "source", "on_order"),
    [
        (993.6, 27.6, 6, "found", True),  # the 36th order, the sixth tooth passing
        (993.6 + 0.9 * ORDER_TOLERANCE_HZ, 27.6, 6, "found", True),
        (993.6 + 1.1 * ORDER_TOLERANCE_HZ, 27.6, 6, "found", False),
        (27.6 * 35, 27.6, 6, "found", True),  # an order of the spindle though not of the teeth
        (60.0, 120.0, 6, "found", False),  # below the first
        (993.6, 10.0, 6, "found", False),  # orders so near to each other that every frequency would be one
        (960.0, 10.0, 6, "found", True),  # but the teeth are far enough apart
        (300.0 * 1.03, 100.0, 3, "given", True),  # a nominal speed is some percent off
        (300.0 * 1.03, 100.0, 3, "found", False),
        (3600.0 * 1.03, 100.0, 3, "given", False),  # of which 3.5 % are too much to tell orders apart
        (320.8, 40.1, 1, "given", False),  # lines 40 Hz apart are one line to the short-time spectrum
        (320.8, 40.1, 1, "refined", True),  # when the spindle is heard they are out of the signal
        (131.4 * 30 * 0.9965, 131.4, 6, "refined", True),  # a spindle wanders within the time that its speed is of
        (131.4 * 30 * 0.9935, 131.4, 6, "refined", False),
        (993.6, None, 6, None, False),
    ],
)
def test_on_an_order_where_orders_can_be_told_apart(frequency_hz, rotation_hz, teeth, source, on_order):
    """A frequency is on an order within what it and the speed are known to, unless every frequency would be."""
    spindle = SpindleSettings(teeth=teeth)
    (vibration,) = weigh(frame(), orders_of(rotation_hz, source), [line(frequency_hz)], spindle).vibrations
    assert vibration.on_order is on_order


def test_who_turns_at_another_speed_may_have_other_teeth():
    """Of a speed that is doubted every order is one of the teeth as far as anybody knows."""
    for doubted, at_teeth in ((False, False), (True, True)):
        turns = orders_of(27.6, "found")._replace(doubted=doubted)
        (vibration,) = weigh(frame(), turns, [line(27.6 * 35)], SpindleSettings(teeth=6)).vibrations
        assert vibration.teeth.near is at_teeth


@pytest.mark.parametrize(("off_hz", "on_order"), [(2.5, (True, True)), (4.0, (True, False)), (7.0, (False, False))])
def test_where_a_coherent_line_is_is_known_better(off_hz, on_order):
    """By half, so that what is told from an order, and an order from chance, is told sooner."""
    for coherence, on in zip((0.8, 0.95), on_order, strict=True):
        lines = [line(300.0 + off_hz, coherence=coherence)]
        (vibration,) = weigh(frame(), orders_of(100.0, "refined"), lines, SpindleSettings(teeth=3)).vibrations
        assert vibration.on_order is on


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
    """At 27.6 revolutions a second 993.6 Hz is the 36th order; without a speed there is none."""
    assert spindle_order(993.6, orders_of(27.6, "found")) == pytest.approx(36.0)
    assert spindle_order(993.6, orders_of()) is None


def test_the_rise_of_what_is_loudest():
    """Of the line with most of the power what its surroundings and it did not lift; nothing where there is no line."""
    faint = line(400.0, share=0.2)._replace(long_rise=3.0, absolute_rise=3.0)
    loud = line(900.0, share=0.6)._replace(long_rise=0.5, absolute_rise=2.0)
    seen = weigh(frame(), lines=[faint, loud]).vibrations
    assert seen.loudest.line.frequency_hz == 900.0
    assert seen.own_rise == pytest.approx(0.5 + LIFTED * 2.0)
    nothing = weigh(frame()).vibrations
    assert (nothing.loudest, nothing.own_rise) == (None, 0.0)
