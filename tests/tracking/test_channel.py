"""One channel from samples to observations."""

from __future__ import annotations

from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chatter_monitor.records import Flag
from chatter_monitor.tracking.channel import Channel
from chatter_monitor.tracking.orders import OrderSettings
from chatter_monitor.tracking.spectrum import Line
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.tracking.tracker import TrackerSettings
from tests.signals import RATE_HZ, vibration

SPINDLE = SpindleSettings(speed_rpm=1656.0, teeth=6)


def milling(seconds: float) -> np.ndarray:
    """A mode that noise drives, and teeth."""
    signal = vibration(round(seconds * RATE_HZ), [(990, 0.02)], seed=8)
    angle = 2 * np.pi * 27.6 * np.arange(len(signal)) / RATE_HZ
    return signal + sum(np.cos(6 * k * angle + k) / k for k in range(1, 8))


CUT = milling(1.0)


def channel(spindle=SPINDLE) -> Channel:
    return Channel(TrackerSettings(), OrderSettings(), spindle)


def observe(*pieces, spindle=SPINDLE):
    following = channel(spindle)
    return [*(seen for piece in pieces for seen in following.process(*piece)), *following.finish()]


def contents(seen):
    """Every bit of an observation."""
    odp = [getattr(seen.odp, field.name) for field in fields(seen.odp)]
    frame = [value.tobytes() if isinstance(value, np.ndarray) else value for value in odp]
    return [*frame, repr(seen.orders), repr(seen.lines.tolist()), repr(seen.margin)]


TOLD, NOT_TOLD = SpindleSettings(speed_rpm=5580.0, teeth=2), SpindleSettings()


@pytest.mark.parametrize("spindle", [TOLD, NOT_TOLD])
@pytest.mark.parametrize("leaves_s", [None, 2.7, 2.9, 3.1, 3.5, 4.1])
def test_a_comb_that_is_taken_out_is_no_tool_that_leaves(spindle, leaves_s):
    """Teeth that are heard in all of the spectrum leave next to nothing from when they are known; air is quiet, too."""
    signal = 0.01 * np.random.default_rng(3).standard_normal(round(8 * RATE_HZ))
    begin, end = (round(time_s * RATE_HZ) for time_s in (1.0, leaves_s or 8.0))
    angle = 2 * np.pi * 93.0 * np.arange(end - begin) / RATE_HZ
    comb = sum(0.5 / k * np.cos(k * angle + k * k) for k in range(1, 68))
    signal[begin:end] += comb + 0.005 * vibration(end - begin, [(990, 0.02)], seed=8)
    seen = observe((0, signal), spindle=spindle)
    assert all(one.cutting for one in seen[40 : round((leaves_s or 7.9) / 0.05)])
    assert seen[-1].orders.heard is (leaves_s is None)
    assert leaves_s is None or not any(one.cutting for one in seen[-20:])


@settings(max_examples=10, derandomize=True, deadline=None)
@given(st.lists(st.integers(0, 5000), max_size=12))
def test_any_blocks_give_the_same_observations(cuts):
    """ODPs, orders, lines and margin of every interval are the same for any cuts between the blocks, gaps included."""
    stretches = [
        (0, CUT[:5001], Flag.NONE),
        (5001, CUT[5001:6100], Flag.NON_FINITE),
        (6100, CUT[6100:8000], Flag.CLIPPED),
        (9333, CUT[9333:], Flag.NONE),
    ]
    pieces = []
    for first, samples, flags in stretches:
        edges = sorted({0, len(samples), *(cut for cut in cuts if cut < len(samples))})
        pieces += [(first + begin, samples[begin:end], flags) for begin, end in pairwise(edges)]
    seen, expected = observe(*pieces), observe(*stretches)
    assert [contents(each) for each in seen] == [contents(each) for each in expected]


def test_observations_lie_on_the_grid_with_their_flags():
    """Each interval carries the flags of its own samples and its part of the loss; the last one is what remains."""
    seen = observe((0, CUT[:3000]), (4000, CUT[4000:8000], Flag.CLIPPED), (8000, CUT[8000:9000]))
    assert [each.odp.first_sample for each in seen] == list(range(0, 9000, 640))
    assert len(seen[-1].odp) == 9000 % 640
    assert [each.odp.lost for each in seen] == [0] * 4 + [200, 640, 160] + [0] * 8
    gap, clipped = range(4, 7), range(6, 13)
    for index, each in enumerate(seen):
        expected = (Flag.GAP if index in gap else Flag.NONE) | (Flag.CLIPPED if index in clipped else Flag.NONE)
        assert each.odp.flags == expected


def test_what_turns_with_the_spindle_is_not_in_the_lines():
    """Teeth at a known speed are in the orders; the first line is the machine's mode, and none lies on a tooth."""
    last = observe((0, milling(4.0)))[-1]
    assert last.orders.rotation_hz == pytest.approx(27.6, abs=0.1)
    lines = [Line._make(row) for row in last.lines.tolist()]
    assert lines[0].frequency_hz == pytest.approx(990, abs=40)
    teeth = 27.6 * 6 * np.arange(1, 4)
    assert all(np.min(abs(teeth - line.frequency_hz)) > 5 for line in lines if line.share > 0.05)


def test_without_a_speed_there_is_no_margin():
    """The delay is known only with the spindle."""
    assert observe((0, milling(4.0)), spindle=SpindleSettings())[-1].margin.kappa is None


def test_in_air_there_is_no_margin():
    """What the tool leaves behind is the room's; before the tool has left, and when it is back, a cut is heard."""
    signal = milling(12.0)
    air = slice(round(6.0 * RATE_HZ), round(8.0 * RATE_HZ))
    signal[air] = 1e-3 * np.random.default_rng(8).standard_normal(signal[air].size)
    seen = observe((0, signal))
    assert seen[119].margin.kappa is not None
    assert {each.margin.reason for each in seen if not each.cutting} == {"nothing is cut"}
    assert all(each.cutting == (each.margin.reason != "nothing is cut") for each in seen)
    assert sum(not each.cutting for each in seen) > 30
    assert seen[-1].margin.kappa is not None


def test_a_new_speed_holds_from_the_next_interval():
    """After `set_spindle` the comb is looked for at the new speed, and other teeth start the margin anew."""
    following = channel(SpindleSettings(speed_rpm=3000.0, teeth=4))
    signal = milling(6.0)
    half = len(signal) // 2
    before = list(following.process(0, signal[:half]))
    following.set_spindle(SPINDLE)
    after = list(following.process(half, signal[half:]))
    assert before[-1].orders.rotation_hz is None or abs(before[-1].orders.rotation_hz - 27.6) > 1
    assert after[-1].orders.rotation_hz == pytest.approx(27.6, abs=0.1)
    assert after[0].margin.kappa is None


def test_when_an_interval_is_digested_changes_nothing():
    """Learning right after an interval, or with the next sample only, gives the same observations."""
    blocks = [(first, CUT[first : first + 480]) for first in range(0, len(CUT), 480)]
    early, late = channel(), channel()
    seen = []
    for block in blocks:
        for observation in early.process(*block):
            seen.append(contents(observation))
            early.digest()
        early.digest()
    assert seen == [contents(observation) for block in blocks for observation in late.process(*block)]


@pytest.mark.parametrize("spindle", [SPINDLE, SpindleSettings()])
def test_a_feed_that_falls_at_once_is_no_air(spindle):
    """A cut that is 15 dB fainter from one moment to the next is cut on; silence but for the room is air."""
    cut = milling(3.0)
    falls = np.arange(len(cut)) > 1.7 * RATE_HZ
    lighter = observe((0, np.where(falls, 0.18, 1.0) * cut), spindle=spindle)
    assert all(seen.cutting for seen in lighter)
    room = 1e-3 * np.random.default_rng(5).standard_normal(len(cut))
    leaves = observe((0, np.where(falls, 0.0, cut) + room), spindle=spindle)
    assert all(seen.cutting for seen in leaves[:33])
    assert not any(seen.cutting for seen in leaves[37:48])


def test_a_tool_that_enters_repeats_before_its_lines_are_followed():
    """Air, then teeth: it enters for some frames, and most of it repeats when the cut is known to go on."""
    cut = milling(3.0)
    room = 1e-3 * np.random.default_rng(5).standard_normal(len(cut))
    seconds = np.arange(len(cut)) / RATE_HZ
    seen = observe((0, np.where((seconds > 1.0) & (seconds < 1.6), 0.0, cut) + room), spindle=SpindleSettings())
    entering = [i for i, each in enumerate(seen) if each.entering]
    assert set(entering) & {32, 33, 34}
    assert not any(each.cutting for i, each in enumerate(seen) if i in entering)
    assert seen[42].orders.repeating_share > 0.45
