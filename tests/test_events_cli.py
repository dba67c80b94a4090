"""Recorded events from the command line: recording, replaying, listing, exporting, purging, protecting."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest
import soundfile
from scipy.signal import resample_poly

from chatter_monitor.outlets.event_files import read
from chatter_monitor.outlets.event_store import EventStore, EventWriter
from chatter_monitor.outlets.flight_recorder import FlightRecorder, RecorderSettings
from tests.outlets.recorder_feed import CLOCK, feed, origin

CUT = Path(__file__).resolve().parents[1] / "replay_data" / "bar_turning.flac"
# A tracker that starts anew agrees with one that has run for long after so much time: ten of its memories.
SETTLING_S = 0.8
A, B, C = (f"cut-0-000{number}" for number in (1, 2, 3))


@pytest.fixture
def directory(tmp_path):
    """Three recorded events, the first of them ten days old, the last one truncated."""
    directory = tmp_path / "events"
    settings = RecorderSettings(pre_s=0.2, post_s=0.1, max_s=0.5)
    store = EventWriter(directory, 1e9)
    with FlightRecorder(settings, store, origin(), utc_of=CLOCK.utc_of, patient=True) as recorder:
        feed(recorder, "-----###------------###-----------###########-----")
    for name, age_days in [(A, 10), (B, 2), (C, 0)]:
        path = directory / name / f"{name}.json"
        written = path.stat().st_mtime - 86_400 * age_days
        os.utime(path, (written, written))
    return directory


def names(directory):
    return [entry.id for entry in EventStore(directory).entries()]


def verdicts(path):
    found = [json.loads(line) for line in path.read_text().splitlines()]
    return {message["sample0"]: message for message in found if message["type"] == "verdict"}


def sound(tmp_path, rate_hz):
    samples, _ = soundfile.read(CUT, stop=18 * 12_800)
    factor = np.gcd(rate_hz, 12_800)
    path = tmp_path / "bar.wav"
    soundfile.write(path, resample_poly(samples, rate_hz // factor, 12_800 // factor), rate_hz, subtype="PCM_24")
    return path


@pytest.mark.parametrize("rate_hz", [12_800, 48_000, 8_000])
def test_a_recorded_event_replays_to_the_same_verdicts(run, tmp_path, rate_hz):
    """The recording alone gives the same alarm and the same event, two intervals later at most.

    The monitor starts anew pre_s before the onset and knows less of what was usual, so "same" means: after a settling
    time every interval says chatter or not as it did, but for the first two; from then on the whole state is the same,
    and damping and frequency agree within the confidence interval.
    """
    settings = tmp_path / "machine.toml"
    settings.write_text("[spindle]\nspeed_rpm = 1685.0\nteeth = 1\n[recorder]\npre_s = 6\npost_s = 2\n")
    events, first, second = tmp_path / "events", tmp_path / "first.jsonl", tmp_path / "second.jsonl"
    file = sound(tmp_path, rate_hz)
    code, out, _ = run("replay", file, "--config", settings, "--record", events, "--jsonl", first)
    assert code == 0
    assert f"Recorded in {events}: 1 event." in out
    (entry,) = EventStore(events).entries()
    recorded = read(entry.json)
    assert recorded.source_rate_hz == rate_hz
    assert recorded.samples == round((6 + recorded.end_s - recorded.onset_s + 2) * 12_800)

    code, out, _ = run("replay", entry.path / recorded.recording, "--jsonl", second, "--json")
    assert code == 0
    (event,) = json.loads(out)["events"]
    offset_s = recorded.first_sample / 12_800
    late_s = event["onset_s"] + offset_s - recorded.onset_s
    assert 0.0 <= late_s <= 0.1001
    assert event["end_s"] + offset_s == pytest.approx(recorded.end_s)
    assert event["peak_frequency_hz"] == pytest.approx(recorded.peak_frequency_hz, rel=0.005)
    before = verdicts(first)
    onset = round((recorded.onset_s + late_s) * 12_800)
    begins = range(round(recorded.onset_s * 12_800), onset)
    for sample, again in verdicts(second).items():
        at = sample + recorded.first_sample
        if again["t0"] >= SETTLING_S and at not in begins:
            assert (before[at]["state"] == "self_excited") == (again["state"] == "self_excited")
        if at >= onset:
            assert again["state"] == before[at]["state"]
        if before[at]["state"] == "self_excited" and before[at]["damping_ratio_ci95"] and at >= onset:
            low, high = before[at]["damping_ratio_ci95"]
            assert low <= again["damping_ratio"] <= high


def test_recordings_at_the_trackers_rate_are_bit_exact(run, tmp_path):
    """A 24-bit source at the tracker's rate is recorded bit by bit, in units as well."""
    settings = tmp_path / "machine.toml"
    settings.write_text("[input]\nfull_scale_per_unit = 0.013\n[recorder]\npre_s = 1\npost_s = 1\n")
    assert run("replay", CUT, "--config", settings, "--record", tmp_path / "events")[0] == 0
    (entry,) = EventStore(tmp_path / "events").entries()
    recorded = read(entry.json)
    source, _ = soundfile.read(CUT, start=recorded.first_sample, frames=recorded.samples)
    samples, _ = soundfile.read(entry.path / recorded.recording)
    assert recorded.recording.endswith(".flac")
    np.testing.assert_array_equal(samples, source)


def test_events_that_could_not_be_recorded(run, tmp_path):
    """A quota without room is no reason to stop: the timeline is shown, then the trouble, with exit 3."""
    settings = tmp_path / "machine.toml"
    settings.write_text("[recorder]\nquota_gb = 1e-5\npost_s = 0\n")
    code, out, err = run("replay", CUT, "--config", settings, "--record", tmp_path / "events")
    assert code == 3
    assert "quota of recorded events leaves no room" in err
    assert "20.0 s in all" in out
    assert names(tmp_path / "events") == []


def test_a_directory_to_record_in_that_cannot_be_used(run, tmp_path):
    """It is refused before the replay starts."""
    (tmp_path / "file").touch()
    code, out, err = run("replay", CUT, "--record", tmp_path / "file")
    assert (code, out) == (2, "")
    assert "cannot be used: File exists" in err


def test_list(run, directory):
    """The table has the id, the time of the onset, length, frequency and what is special, oldest first."""
    run("events", "protect", B, "--directory", directory)
    code, out, err = run("events", directory)
    assert (code, err) == (0, "")
    heading, *rows, total = out.splitlines()
    assert heading.split() == ["id", "onset", "(UTC)", "ch", "chatter", "s", "Hz", "damping", "%", "kept", "s", "MB"]
    cells = [row.split() for row in rows]
    assert [row[0] for row in cells] == [A, B, C]
    assert cells[0][1:7] == ["2026-03-01", "08:30:00", "0", "0.15", "900", "0.10"]
    assert [row[9:] for row in cells] == [[], ["protected"], ["truncated"]]
    assert total.startswith("3 recorded events, ")
    assert run("events", "list", directory)[1] == out


def test_a_withdrawn_alarm_is_listed_as_such(run, directory):
    """Who looks through the list need not open it."""
    path = directory / A / f"{A}.json"
    path.write_text(json.dumps(json.loads(path.read_text(encoding="utf-8")) | {"withdrawn": True}), encoding="utf-8")
    _, out, _ = run("events", directory)
    assert [row.split()[9:] for row in out.splitlines() if row.startswith(A)] == [["withdrawn"]]


def test_list_as_json(run, directory):
    """With --json the list is one object with the events' fields, their folders, sizes and protection."""
    code, out, _ = run("events", "--json", directory)
    assert code == 0
    listed = json.loads(out)
    assert listed["directory"] == str(directory)
    assert [event["id"] for event in listed["events"]] == [A, B, C]
    (event, *_) = listed["events"]
    assert (event["type"], event["onset_s"], event["recording"]) == ("event", 0.25, f"{A}.flac")
    assert event["protected"] is False
    assert event["size_bytes"] == sum(path.stat().st_size for path in Path(event["path"]).iterdir())


def test_an_event_that_cannot_be_read_is_listed_all_the_same(run, directory):
    """A damaged JSON neither hides an event nor the others."""
    (directory / B / f"{B}.json").write_text("{")
    code, out, _ = run("events", directory)
    assert code == 0
    assert len(out.splitlines()) == 5
    assert "its JSON cannot be read" in out
    assert [event["id"] for event in json.loads(run("events", "--json", directory)[1])["events"]][-1] == B


def test_the_directory_of_the_configuration(run, directory, tmp_path):
    """Without DIR it is [recorder] directory; an empty one is no error."""
    config = tmp_path / "machine.toml"
    config.write_text(f'[recorder]\ndirectory = "{directory}"\n')
    assert run("events", "--config", config)[1] == run("events", directory)[1]
    empty = tmp_path / "empty"
    empty.mkdir()
    assert run("events", empty) == (0, f"No recorded events in {empty}.\n", "")


def test_export(run, directory, tmp_path):
    """The files of an event are copied into a folder of its name, and replay from there."""
    out = tmp_path / "for" / "the engineer"
    run("events", "protect", A, "--directory", directory)
    code, printed, _ = run("events", "export", A, "--out", out, "--directory", directory)
    assert (code, printed) == (0, f"{out / A}: exported.\n")
    assert sorted(path.name for path in (out / A).iterdir()) == [
        f"{A}.flac",
        f"{A}.json",
        f"{A}.jsonl",
        f"{A}.parquet",
    ]
    for copy in (out / A).iterdir():
        assert copy.read_bytes() == (directory / A / copy.name).read_bytes()
    assert [path.name for path in out.iterdir()] == [A]
    code, _, err = run("events", "export", A, "--out", out, "--directory", directory)
    assert code == 2
    assert "there already" in err


@pytest.mark.parametrize(
    ("options", "left"),
    [
        (["--older-than", "5"], [B, C]),
        (["--older-than", "1"], [C]),
        (["--all"], []),
        (["--older-than", "30"], [A, B, C]),
    ],
)
def test_purge(run, directory, options, left):
    """What is older goes, or everything; without --yes it is only told; protected ones stay in any case."""
    code, out, _ = run("events", "purge", *options, "--directory", directory)
    assert (code, len(names(directory))) == (0, 3)
    assert out.count("would be removed") == 3 - len(left)
    run("events", "protect", B, "--directory", directory)
    code, out, _ = run("events", "purge", *options, "--yes", "--directory", directory)
    assert code == 0
    assert names(directory) == sorted({*left, B})
    run("events", "protect", B, "--off", "--directory", directory)
    code, out, _ = run("events", "purge", *options, "--yes", "--json", "--directory", directory)
    assert json.loads(out)["chosen"] == ([] if B in left else [B])
    assert names(directory) == left


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        (["purge"], "either --older-than DAYS or --all"),
        (["purge", "--all", "--older-than", "3"], "either --older-than DAYS or --all"),
        (["purge", "--older-than", "-1"], "not in the range"),
        (["export", A], "Missing option '--out'"),
        (["export", "nothing", "--out", "out", "--directory", "DIRECTORY"], "no recorded event of that name"),
        (["protect", "../events", "--directory", "DIRECTORY"], "no recorded event of that name"),
        (["absent"], "there are no recorded events: No such file"),
        (["--directory", "x"], "No such option"),
    ],
)
def test_what_the_user_got_wrong(run, directory, arguments, reason):
    """Exit 2 and one line that says what is wrong; nothing is touched."""
    arguments = [str(directory) if argument == "DIRECTORY" else argument for argument in arguments]
    code, out, err = run("events", *arguments)
    assert (code, out) == (2, "")
    (line,) = err.splitlines()
    assert reason in line
    assert len(names(directory)) == 3
