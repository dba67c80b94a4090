"""The tracker: what comes in in pieces goes out in frames."""

from __future__ import annotations

from dataclasses import fields
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chatter_monitor.acquisition.resample import Resampled
from chatter_monitor.acquisition.synthetic import Synthetic
from chatter_monitor.records import Flag, ModeStatus
from chatter_monitor.tracking.tracker import Tracker, TrackerSettings
from tests.signals import RATE_HZ, vibration

CUT = vibration(12_000, [(400, 0.03), (2000, 0.02)])
VALUES = ("frequency_hz", "damping_ratio", "frequency_sd_hz", "damping_sd")


def track(*pieces, orders=(4, 3), bands=1, **about):
    """Frames of pieces (first sample, samples, flags)."""
    tracker = Tracker(TrackerSettings(orders=orders, bands=bands), **about)
    frames = [frame for piece in pieces for frame in tracker.process(*piece)]
    return [*frames, *tracker.finish()]


def whole(frames, name):
    return np.concatenate([getattr(frame, name) for frame in frames])


def contents(frame):
    """Every bit of a frame."""
    values = [getattr(frame, field.name) for field in fields(frame)]
    return [value.tobytes() if isinstance(value, np.ndarray) else value for value in values]


@pytest.mark.parametrize("block", [1, 256, 640, 999, 32_768])
def test_frames_lie_on_a_grid(block):
    """Whatever the blocks, frames are 640 samples long, contiguous from 0, and the last one is what remains."""
    samples = CUT[:2000] if block == 1 else CUT
    pieces = [(first, samples[first : first + block]) for first in range(0, len(samples), block)]
    frames = track(*pieces, channel=3)
    assert [frame.first_sample for frame in frames] == list(range(0, len(samples), 640))
    assert [len(frame) for frame in frames[:-1]] == [640] * (len(frames) - 1)
    assert len(frames[-1]) == len(samples) % 640
    assert {(frame.channel, frame.sample_rate_hz, frame.lost, frame.flags) for frame in frames} == {
        (3, RATE_HZ, 0, Flag.NONE)
    }


def test_no_frame_of_nothing():
    """Without samples, or when the last frame is full, nothing is left at the end."""
    assert track() == []
    assert len(track((0, CUT[:1280]))) == 2


@settings(max_examples=25, derandomize=True, deadline=None)
@given(
    st.lists(st.integers(0, 1500), max_size=15),
    st.sampled_from([None, 5000.0, 8000.0]),
    st.sampled_from([((4, 3), 1), ((2, 1), 1), ((4, 3), 4), ((6, 4), 2)]),
)
def test_any_blocks_give_the_same_bits(cuts, source_rate_hz, model):
    """Values, shares, signal, levels, losses and flags of every frame are the same for any cuts between the blocks."""
    stretches = [
        (0, CUT[:3001], Flag.NONE),
        (3001, CUT[3001:4100], Flag.NON_FINITE),
        (4100, CUT[4100:6000], Flag.CLIPPED),
        (7333, CUT[7333:9000], Flag.NONE),  # 1333 samples are lost
    ]
    pieces = []
    for first, samples, flags in stretches:
        edges = sorted({0, len(samples), *(cut for cut in cuts if cut < len(samples))})
        pieces += [(first + begin, samples[begin:end], flags) for begin, end in pairwise(edges)]
    about = {"orders": model[0], "bands": model[1], "source_rate_hz": source_rate_hz}
    frames, expected = (track(*given, **about) for given in (pieces, stretches))
    assert [contents(frame) for frame in frames] == [contents(frame) for frame in expected]


def test_lost_samples_are_held_counted_and_flagged():
    """A jump of the index fills the grid with held values; GAP and the count stand on the frames that it touches."""
    frames = track((0, CUT[:5000]), (8000, CUT[8000:]))
    assert [frame.first_sample for frame in frames] == list(range(0, 12_000, 640))
    status = whole(frames, "status")
    assert np.all(status[5000:8256] == ModeStatus.HELD)
    assert not np.any(status[1000:5000] == ModeStatus.HELD)
    assert not np.any(status[8256:] == ModeStatus.HELD)
    for name in VALUES:
        values = whole(frames, name)
        assert np.all(np.isfinite(values[4990:]))
        np.testing.assert_array_equal(values[5000:8000], np.broadcast_to(values[4999], (3000, 2)))
    lost = [frame.lost for frame in frames]
    assert lost == [0] * 7 + [120, 640, 640, 640, 640, 320] + [0] * 6
    assert [frame.flags for frame in frames] == [Flag.GAP if count else Flag.NONE for count in lost]
    assert [frame.rms for frame in frames[8:12]] == [0.0] * 4
    assert frames[12].rms == pytest.approx(1.4, abs=0.5)  # of the samples that are there


def test_a_gap_at_the_start_is_not_known():
    """Samples that are missing before the first one are nothing known yet, and lost all the same."""
    frames = track((1500, CUT[1500:]))
    assert np.all(whole(frames, "status")[:1500] == ModeStatus.STARTING)
    assert np.all(np.isnan(whole(frames, "frequency_hz")[:1500]))
    assert sum(frame.lost for frame in frames) == 1500
    assert [bool(frame.flags & Flag.GAP) for frame in frames[:4]] == [True, True, True, False]


def test_a_long_gap_takes_no_memory():
    """An hour of lost samples is worked through frame by frame, not at once."""
    tracker = Tracker(TrackerSettings())
    list(tracker.process(0, CUT))
    frames = tracker.process(3600 * 12_800, CUT)
    assert [next(frames).lost for _ in range(3)] == [640 - 12_000 % 640, 640, 640]


def test_samples_that_are_no_numbers_are_missing_not_zero():
    """Placeholders under NON_FINITE are not adapted to, and do not count as lost."""
    pieces = [(0, CUT[:5000]), (5000, np.zeros(3000), Flag.NON_FINITE), (8000, CUT[8000:])]
    frames = track(*pieces)
    gap = track((0, CUT[:5000]), (8000, CUT[8000:]))
    for name in (*VALUES, "status"):
        assert whole(frames, name).tobytes() == whole(gap, name).tobytes()
    assert sum(frame.lost for frame in frames) == 0
    flagged = [frame.first_sample for frame in frames if frame.flags == Flag.NON_FINITE]
    assert flagged == list(range(4480, 8000, 640))


def test_clipped_samples_are_used():
    """Clipping bends the signal but tells the time: it is flagged and tracked."""
    plain, clipped = track((0, CUT)), track((0, CUT, Flag.CLIPPED))
    assert {frame.flags for frame in clipped} == {Flag.CLIPPED}
    assert whole(plain, "damping_ratio").tobytes() == whole(clipped, "damping_ratio").tobytes()


def test_level_is_that_of_the_vibration():
    """The level is the root mean square without the offset, for each frame by itself."""
    t = np.arange(12_800) / RATE_HZ
    loud = np.where(t < 0.5, 1.0, 3.0)
    frames = track((0, 50.0 + loud * np.sqrt(2) * np.sin(2 * np.pi * 800 * t)))
    levels = np.array([frame.rms for frame in frames])
    np.testing.assert_allclose(levels[5:10], 1.0, rtol=2e-3)
    np.testing.assert_allclose(levels[12:], 3.0, rtol=2e-3)


def test_absurd_samples_do_not_spoil_the_level():
    """Numbers that no sensor means do not make the level infinite, which would make everything after it look idle."""
    samples = CUT.copy()
    samples[6000] = 1e200
    levels = [frame.rms for frame in track((0, samples))]
    assert np.all(np.isfinite(levels))


def test_modes_are_found_with_their_shares():
    """The last frame of a second of two equal modes has both, within three standard deviations, and half the power."""
    frame = track((0, vibration(25_600, [(400, 0.03), (2000, 0.02)], seed=4)))[-1]
    order = np.argsort(frame.frequency_hz[-1])
    for name, sd, truth in (
        ("frequency_hz", "frequency_sd_hz", [400, 2000]),
        ("damping_ratio", "damping_sd", [0.03, 0.02]),
    ):
        off = abs(getattr(frame, name)[-1, order] - truth)
        np.testing.assert_array_less(off, 3 * getattr(frame, sd)[-1, order])
    np.testing.assert_allclose(frame.share, 0.5, atol=0.25)
    assert frame.share.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("bands", [1, 4])
@pytest.mark.parametrize(("rate_hz", "decimation"), [(5000.0, 4), (8000.0, 2), (11_025.0, 2), (1600.0, 8)])
def test_a_slow_source_is_tracked_at_its_own_band(rate_hz, decimation, bands):
    """Values of a 684 Hz mode, converted up from any rate, are right within three sd, held between the samples."""
    signal = vibration(int(4 * rate_hz), [(684, 0.01)], rate_hz=rate_hz)
    signal += 0.1 * np.random.default_rng(2).standard_normal(len(signal))
    source = Resampled(Synthetic.from_array(signal, rate_hz), RATE_HZ)
    blocks = ((block.first_sample, block.samples[:, 0]) for block in source.blocks())
    frames = track(*blocks, bands=bands, source_rate_hz=rate_hz)
    if bands > 1:
        decimation = max(decimation, 4)  # 684 Hz is at home in the octave from 400 to 800 Hz, at 3.2 kHz
    assert sum(len(frame) for frame in frames) == 4 * RATE_HZ
    mode = int(np.nanargmin(abs(frames[-1].frequency_hz[-1] - 684)))
    columns = {name: whole(frames, name)[:, mode] for name in VALUES}
    late = slice(-12_800, None, 640)  # one value per memory or so
    z = (columns["frequency_hz"] - 684)[late] / columns["frequency_sd_hz"][late]
    assert np.median(abs(z)) < 1.5
    assert np.median(columns["frequency_sd_hz"][late]) < 5
    assert np.median(abs(columns["damping_ratio"] - 0.01)[late] / columns["damping_sd"][late]) < 1.5
    changes = np.flatnonzero(np.diff(columns["frequency_hz"][-6400:])) + len(columns["frequency_hz"]) - 6400 + 1
    assert np.all(changes % decimation == 0)
    assert len(changes) > 0.99 * 6400 / decimation


def test_the_rate_of_the_source_is_no_reason_where_it_is_high():
    """A source as fast as the tracker or faster is tracked at every sample."""
    for rate_hz in (RATE_HZ, 48_000.0):
        frames = track((0, CUT), source_rate_hz=rate_hz)
        assert whole(frames, "damping_ratio").tobytes() == whole(track((0, CUT)), "damping_ratio").tobytes()


@pytest.mark.parametrize("orders", [(2, 0), (2, 1), (4, 0), (6, 4), (8, 6)])
def test_other_orders(orders):
    """With one band, frames have a slot for every pair of poles, and one of them is the mode that is there."""
    frame = track((0, vibration(25_600, [(900, 0.02)])), orders=orders)[-1]
    assert frame.frequency_hz.shape == (len(frame), orders[0] // 2)
    assert frame.share.shape == (orders[0] // 2,)
    strongest = int(np.argmax(frame.share))
    assert frame.frequency_hz[-1, strongest] == pytest.approx(900, abs=20)
    assert frame.damping_ratio[-1, strongest] == pytest.approx(0.02, abs=0.02)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"orders": [3, 3]}, r"orders must be \[2, 4, 6 or 8, 0 to 6\], got \[3, 3\]"),
        ({"orders": [10, 3]}, r"orders must be .* got \[10, 3\]"),
        ({"orders": [0, 0]}, r"orders must be"),
        ({"orders": [4, 7]}, r"orders must be .* got \[4, 7\]"),
        ({"orders": [4, -1]}, r"Expected `int` >= 0"),
        ({"orders": [4]}, r"length 2"),
        ({"memory_ms": 0}, r"Expected `float` > 0"),
        ({"memory_ms": 5}, r"memory_ms must hold at least ten samples for each of the 7 coefficients, got 5"),
        ({"sample_rate_hz": -1}, r"Expected `float` > 0"),
        ({"high_pass_hz": -1}, r"Expected `float` >= 0"),
        ({"high_pass_hz": 6400}, r"high_pass_hz must be below half of sample_rate_hz, got 6400"),
        ({"forgetting": 0.9}, r"unknown field `forgetting`"),
    ],
)
def test_settings_that_make_no_tracker_are_refused(table, message):
    """What is refused is told with the value and what is allowed."""
    with pytest.raises(msgspec.ValidationError, match=message):
        msgspec.convert(table, TrackerSettings)
