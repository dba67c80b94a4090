"""The flight recorder: what it keeps, and that it neither waits nor grows."""

from __future__ import annotations

import errno
import threading
import tracemalloc
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
import soundfile

from chatter_monitor.errors import InputError
from chatter_monitor.outlets.event_files import read, read_verdicts, write
from chatter_monitor.outlets.event_store import EventStore, EventWriter
from chatter_monitor.outlets.flight_recorder import WAITING, FlightRecorder, RecorderSettings
from chatter_monitor.outlets.odp_table import MODE_COLUMNS
from chatter_monitor.records import Flag
from chatter_monitor.tracking.spindle import SpindleSettings
from tests.full_disk import file_size_limit
from tests.outlets.recorder_feed import (
    CLOCK,
    INTERVAL,
    RATE_HZ,
    SETTINGS,
    Feed,
    feed,
    frame,
    origin,
    signal,
    verdict,
)

# 4 intervals before, 2 after, 20 at most
BRIEF = RecorderSettings(pre_s=0.2, post_s=0.1, max_s=1.0)
CUT = "-----###-----"


@pytest.fixture
def directory(tmp_path):
    return tmp_path / "events"


@pytest.fixture
def record(directory):
    """Make recorders into the directory."""

    def record(settings=BRIEF, *, channels=1, quota_bytes=1e9, patient=True, full_scale_per_unit=1.0, **options):
        store = EventWriter(directory, quota_bytes)
        return FlightRecorder(
            settings, store, origin(channels, full_scale_per_unit), utc_of=CLOCK.utc_of, patient=patient, **options
        )

    return record


@pytest.fixture
def kept(directory):
    """Recorded events with their samples, in the order of their onsets."""

    def kept():
        found = []
        for entry in EventStore(directory).entries():
            recorded = read(entry.json)
            samples, rate = soundfile.read(entry.path / recorded.recording, always_2d=True)
            assert rate == RATE_HZ
            found.append((recorded, samples))
        return sorted(found, key=lambda pair: (pair[0].onset_s, pair[0].channel))

    return kept


@pytest.mark.parametrize("size", [100, 640, 5000, 100_000])
def test_samples_are_bit_exact_at_their_index(record, kept, size):
    """From pre_s before the onset to post_s after the end, in all channels, whatever the blocks, to the last bit."""
    with record(channels=2) as recorder:
        (event,) = feed(recorder, "----------#####----------", "-------------------------", size=size)
    ((recorded, samples),) = kept()
    first, end = 6 * INTERVAL, 17 * INTERVAL
    assert (recorded.first_sample, recorded.samples) == (first, end - first)
    np.testing.assert_array_equal(samples, signal(first, end, 2))
    assert recorded.recording == "cut-0-0001.flac"
    assert (recorded.onset_s, recorded.end_s) == (event.onset_s, event.end_s) == (0.5, 0.75)
    assert (recorded.missing_samples, recorded.truncated) == (0, False)
    assert recorder.problems() == []


def test_json_is_the_event_and_its_origin(record, kept):
    """The JSON has the event's fields, machine, settings, rates, and the time of the first sample and of the onset."""
    with record() as recorder:
        (event,) = feed(recorder, "----------#####----------")
    ((recorded, _),) = kept()
    for field in ("id", "channel", "kind", "peak_frequency_hz", "min_damping_ratio", "advice"):
        assert getattr(recorded, field) == getattr(event, field)
    assert (recorded.machine, recorded.settings) == ("lathe-3", SETTINGS)
    assert (recorded.sample_rate_hz, recorded.source_rate_hz) == (RATE_HZ, 48_000.0)
    assert recorded.utc == "2026-03-01T08:30:00.300000+00:00"
    assert recorded.onset_utc == "2026-03-01T08:30:00.500000+00:00"


def test_odps_are_the_frames(record, directory):
    """The table has every sample of the event's channel within the recording, with the very bits of the frames."""
    with record(channels=2) as recorder:
        feed(recorder, "-" * 25, "----------#####----------")
    read_back = pq.read_table(directory / "cut-1-0001" / "cut-1-0001.parquet")
    frames = [frame(interval, channel=1) for interval in range(6, 17)]
    np.testing.assert_array_equal(read_back["sample"], np.arange(6 * INTERVAL, 17 * INTERVAL))
    assert set(read_back["channel"].to_pylist()) == {1}
    for mode in range(2):
        for name in MODE_COLUMNS:
            expected = np.concatenate([getattr(frame, name)[:, mode] for frame in frames])
            assert read_back[f"{name}_{mode}"].to_numpy().tobytes() == expected.tobytes()


def test_verdicts_are_those_that_were_given(record, directory):
    """One for each frame, in their order: what was said on the event's channel from before the onset on."""
    with record(channels=2) as recorder:
        feed(recorder, "-" * 25, "-------?--#?###------#---")
    stable, alarm, deaf = ("stable", "self_excited", "unknown")
    states = {6: stable, 7: deaf, 8: stable, 9: stable, 10: alarm, 11: deaf, 12: alarm, 13: alarm, 14: alarm}
    said = [verdict(interval, states.get(interval, stable), channel=1) for interval in range(6, 17)]
    file = directory / "cut-1-0001" / read(directory / "cut-1-0001" / "cut-1-0001.json").verdicts
    assert read_verdicts(file) == said


def test_verdicts_that_cannot_be_read(tmp_path):
    """Another file in their place, or none, is an error that names it."""
    file = tmp_path / "cut.jsonl"
    with pytest.raises(InputError, match=r"cannot be read: No such file.*cut\.jsonl"):
        read_verdicts(file)
    file.write_text('{"type":"health"}\n')
    with pytest.raises(InputError, match=r"not the verdicts of an event.*cut\.jsonl"):
        read_verdicts(file)


def test_the_signal_may_begin_and_end_with_an_event(record, kept):
    """Where the monitor starts or stops within pre_s or post_s, there is less to keep, and no more is claimed."""
    with record() as recorder:
        feed(recorder, "--####-----#")
    (first, samples), (last, _) = kept()
    assert (first.first_sample, first.samples) == (0, 8 * INTERVAL)
    np.testing.assert_array_equal(samples, signal(0, 8 * INTERVAL))
    assert (last.first_sample, last.samples) == (7 * INTERVAL, 5 * INTERVAL)


@pytest.mark.parametrize(("states", "event"), [("###????###-------", 10), ("###????----------", 3)])
def test_an_unknown_interval_does_not_end_an_event(record, kept, states, event):
    """Being deaf for a moment neither ends nor splits a recording, and what follows counts from the last alarm."""
    with record() as recorder:
        feed(recorder, "------" + states)
    ((recorded, _),) = kept()
    assert (recorded.first_sample, recorded.samples) == (2 * INTERVAL, (4 + event + 2) * INTERVAL)


def test_overlapping_events_have_recordings_of_their_own(record, kept):
    """Each event of each channel is kept whole, with the samples of all channels, though they overlap."""
    with record(channels=2) as recorder:
        events = feed(recorder, "------####-####---------", "-------###--------------")
    stretches = [(r.channel, r.first_sample // INTERVAL, r.samples // INTERVAL) for r, _ in kept()]
    assert len(events) == 3
    assert stretches == [(0, 2, 10), (1, 3, 9), (0, 7, 10)]
    for recorded, samples in kept():
        begin = recorded.first_sample
        np.testing.assert_array_equal(samples, signal(begin, begin + recorded.samples, 2))


def test_a_long_event_is_truncated_and_says_so(record, kept):
    """No more than max_s from the onset on is kept; the next event has its own recording."""
    with record() as recorder:
        feed(recorder, "-----" + "#" * 50 + "------###------")
    (long, samples), (brief, _) = kept()
    assert (long.truncated, brief.truncated) == (True, False)
    assert long.end_s == 55 * 0.05
    np.testing.assert_array_equal(samples, signal(INTERVAL, 25 * INTERVAL))


def test_what_follows_may_be_truncated_too(record, kept):
    """An event that fits into max_s, with not all of post_s, counts as truncated."""
    with record() as recorder:
        feed(recorder, "-----" + "#" * 19 + "------")
    ((recorded, samples),) = kept()
    assert (recorded.truncated, len(samples)) == (True, 24 * INTERVAL)


@pytest.mark.parametrize(("offset", "suffix"), [(0.0, "flac"), (1.0, "wav"), (-1.0, "flac"), (-1.0001, "wav")])
def test_beyond_full_scale_samples_are_floats(record, kept, offset, suffix):
    """FLAC holds -1 to 1; a signal that leaves that range goes into a WAV of floats."""
    with record() as recorder:
        Feed(recorder, change=lambda block: replace(block, samples=block.samples + offset)).run(CUT)
    ((recorded, samples),) = kept()
    assert recorded.recording == f"cut-0-0001.{suffix}"
    expected = signal(INTERVAL, 10 * INTERVAL) + offset
    np.testing.assert_array_equal(samples, expected.astype(np.float32) if suffix == "wav" else expected)


def test_units_are_taken_out(record, kept):
    """In a sound file full scale is 1; what the samples were divided by is multiplied again and told."""
    with record(full_scale_per_unit=0.03) as recorder:
        Feed(recorder, change=lambda block: replace(block, samples=block.samples / 0.03)).run(CUT)
    ((recorded, samples),) = kept()
    assert (recorded.recording, recorded.full_scale_per_unit) == ("cut-0-0001.flac", 0.03)
    np.testing.assert_array_equal(samples, signal(INTERVAL, 10 * INTERVAL))


def test_more_channels_than_flac_holds(record, kept):
    """Nine channels go into a WAV."""
    with record(channels=9) as recorder:
        feed(recorder, CUT, *["-" * 13] * 8)
    ((recorded, samples),) = kept()
    assert recorded.recording == "cut-0-0001.wav"
    np.testing.assert_array_equal(samples, signal(INTERVAL, 10 * INTERVAL, 9))


def test_missing_samples_are_not_made_up(record, kept):
    """What was lost is NaN at its place and counted; so is what was no number, in its channel only."""
    lost = range(6 * INTERVAL + 100, 6 * INTERVAL + 150)
    bad = range(7 * INTERVAL + 150, 8 * INTERVAL + 150)

    def faulty(block):
        return replace(block, flags=(Flag.NONE, Flag.NON_FINITE)) if block.first_sample == bad.start else block

    with record(channels=2) as recorder:
        Feed(recorder, 2, lost=lost, change=faulty).run("-----####------", "-" * 15)
    ((recorded, samples),) = kept()
    expected = signal(0, 11 * INTERVAL, 2)
    expected[lost] = np.nan
    expected[bad, 1] = np.nan
    np.testing.assert_array_equal(samples, expected[INTERVAL:])
    assert (recorded.recording, recorded.missing_samples) == ("cut-0-0001.wav", 50)


def test_a_new_spindle_speed_stands_in_the_next_recording(record, kept):
    """An event carries the spindle settings of its onset, for a replay to the same verdicts."""
    with record() as recorder:
        cut = Feed(recorder)
        cut.run(CUT)
        recorder.spindle(SpindleSettings(1700.0, 4))
        cut.run(CUT)
    assert [recorded.settings["spindle"] for recorded, _ in kept()] == [
        SETTINGS["spindle"],
        {"speed_rpm": 1700.0, "teeth": 4, "min_rpm": None, "max_rpm": None},
    ]


class Stall:
    """Writes events when it is let."""

    def __init__(self):
        self.go_on = threading.Event()
        self.begun = threading.Event()

    def __call__(self, *arguments):
        self.begun.set()
        assert self.go_on.wait(60)
        write(*arguments)


def test_a_stalled_disk_holds_nobody_up(record, kept):
    """While the disk hangs everything is taken without waiting; what finds no room is lost, counted and told."""
    disk = Stall()
    recorder = record(patient=False, write_event=disk)
    cut = Feed(recorder)
    cut.run(CUT)
    assert disk.begun.wait(60)
    for _ in range(WAITING + 3):
        cut.run(CUT)
    assert recorder.lost == 3
    assert recorder.problems() == ["3 recordings of events lost, because the disk does not keep up"]
    disk.go_on.set()
    recorder.close()
    assert [recorded.id for recorded, _ in kept()] == [f"cut-0-{n:04d}" for n in range(1, WAITING + 2)]


def test_a_patient_recorder_loses_nothing(record, kept):
    """A replay waits for a slow disk instead of losing events."""
    with record() as recorder:
        feed(recorder, CUT * 3 * WAITING)
    assert len(kept()) == 3 * WAITING
    assert (recorder.recorded, recorder.lost) == (3 * WAITING, 0)


@pytest.mark.parametrize("states", ["-", "#", "?", "#?", "-##-"])
def test_memory_is_bounded(record, states):
    """However long it goes on, calm, chattering or deaf, no more than pre_s and max_s is remembered."""
    intervals = 2000
    of_interval = (states * intervals)[:intervals]
    disk = Stall()
    recorder = record(patient=False, write_event=disk)
    tracemalloc.start()
    try:
        feed(recorder, of_interval)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    disk.go_on.set()
    recorder.close()
    per_interval = INTERVAL * (8 + 2 * 17)
    stretch = (4 + 20 + 2) * per_interval
    verdicts = intervals * 1000  # of the log of events, not of the recorder
    assert peak < (WAITING + 3) * stretch + verdicts
    assert intervals * per_interval > 5 * peak


def test_a_full_disk_is_told_and_monitoring_goes_on(record, kept, directory):
    """What cannot be written leaves nothing behind; the next event is recorded, and the loss remains counted."""
    full = [True]

    def disk(*arguments):
        write(*arguments)
        if full[0]:
            raise OSError(errno.ENOSPC, "No space left on device")

    recorder = record(write_event=disk)
    cut = Feed(recorder)
    cut.run(CUT)
    wait_until(lambda: recorder.failed == 1)
    assert recorder.problems() == [
        "events are not recorded: No space left on device",
        "1 recordings of events could not be written",
    ]
    assert [path.name for path in directory.iterdir()] == [".lock"]
    full[0] = False
    cut.run(CUT)
    recorder.close()
    assert [recorded.id for recorded, _ in kept()] == ["cut-0-0002"]
    assert recorder.problems() == ["1 recordings of events could not be written"]


@pytest.mark.parametrize("limit_bytes", [0, 1000, 20_000, 60_000])
def test_files_that_cannot_be_completed(record, directory, limit_bytes):
    """Whichever file it is that the disk has no room for, nothing of the recording stays."""
    with record() as recorder, file_size_limit(limit_bytes):
        feed(recorder, "----------#####----------")
        recorder.close()
    assert recorder.failed == 1
    assert "File too large" in recorder.problems()[0]
    assert [path.name for path in directory.iterdir()] == [".lock"]


def test_a_directory_that_cannot_be_used(record, kept, directory):
    """It is told before the first event, nothing stops, and once it can be used events are recorded."""
    directory.write_text("in the way")
    recorder = record()
    wait_until(recorder.problems)
    assert "cannot be used: File exists" in recorder.problems()[0]
    cut = Feed(recorder)
    cut.run(CUT)
    wait_until(lambda: recorder.failed == 1)
    directory.unlink()
    cut.run(CUT)
    recorder.close()
    assert [recorded.id for recorded, _ in kept()] == ["cut-0-0002"]


def test_a_bug_in_writing_is_told(record, kept):
    """Something unforeseen does not stop the thread that writes."""
    bugs = [ZeroDivisionError("somewhere")]

    def buggy(*arguments):
        if bugs:
            raise bugs.pop()
        write(*arguments)

    with record(write_event=buggy) as recorder:
        cut = Feed(recorder)
        cut.run(CUT)
        wait_until(lambda: recorder.failed == 1)
        assert recorder.problems()[0] == "events are not recorded: ZeroDivisionError: somewhere"
        cut.run(CUT)
    assert [recorded.id for recorded, _ in kept()] == ["cut-0-0002"]


def test_closing_does_not_wait_for_a_disk_that_hangs(record, monkeypatch):
    """A daemon that has to stop gives the disk a bounded time."""
    monkeypatch.setattr("chatter_monitor.outlets.flight_recorder.CLOSE_TIMEOUT_S", 0.05)
    disk = Stall()
    recorder = record(patient=False, write_event=disk)
    feed(recorder, CUT * (WAITING + 1))
    assert disk.begun.wait(60)
    recorder.close()
    disk.go_on.set()


def wait_until(condition):
    """Wait for the writer thread; the time limit of the test ends it."""
    tick = threading.Event()
    while not condition():
        tick.wait(0.005)
