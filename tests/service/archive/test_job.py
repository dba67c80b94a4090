"""What a worker does with one recording."""

from __future__ import annotations

import dataclasses
from importlib.metadata import version
from pathlib import Path

import fsspec
import pyarrow.parquet as pq
import pytest

from chatter_monitor.service.archive.dataset import open_table
from chatter_monitor.service.archive.job import Job, claim, work
from chatter_monitor.service.archive.recordings import find
from chatter_monitor.service.archive.replays import Replays
from chatter_monitor.service.archive.spread import ATTEMPTS, in_processes
from tests.service.archive.cuts import Deadly, write


@pytest.fixture
def job(tmp_path):
    """A recording that has not been replayed."""
    write(tmp_path / "cut.wav", 900.0)
    (recording,) = find([str(tmp_path / "cut.wav")])
    (tmp_path / "out").mkdir()
    return Job(recording, Replays({}), tmp_path / "out", version("chatter-monitor"))


def files(job: Job) -> list[Path]:
    return sorted(path.relative_to(job.out) for path in job.out.rglob("*.parquet"))


def test_results_of_a_recording(job):
    """Every table gets the recording's rows, and the summary says what they come to."""
    assert work(job).problem is None
    (summary,) = job.kind.results(job.out).summaries().values()
    verdicts = open_table(job.out, "verdict").to_table()
    events = open_table(job.out, "event").to_table().to_pylist()
    assert set(verdicts["source"].to_pylist()) == {job.recording.name}
    assert verdicts.num_rows == open_table(job.out, "odp").to_table().num_rows == 40
    seconds = {f"{state}_s": 0.05 * verdicts["state"].to_pylist().count(state) for state in ("self_excited", "stable")}
    assert seconds["self_excited_s"] > 0.0
    assert {name: getattr(summary, name) for name in seconds} == pytest.approx(seconds)
    assert summary.events == len(events) > 0
    assert summary.peak_frequency_hz == pytest.approx(900.0, rel=0.05)
    assert (summary.duration_s, summary.channels, summary.samples_lost) == (2.0, 1, 0)


def test_what_is_done_is_not_done_again(job):
    """A second time nothing is written; other settings or another content take the first result's place."""
    work(job)
    once, names = {path: (job.out / path).stat().st_mtime_ns for path in files(job)}, set(files(job))
    work(job)
    assert {path: (job.out / path).stat().st_mtime_ns for path in files(job)} == once
    work(dataclasses.replace(job, kind=Replays({"spindle": {"speed_rpm": 1500.0}})))
    other = set(files(job))
    assert len(other) == len(names) == 4
    assert not names & other
    write(Path(job.recording.path), 1000.0)
    work(job)
    assert len(set(files(job))) == 4
    assert not set(files(job)) & (names | other)


def test_what_says_where_to_publish_changes_no_result():
    """The key depends on what verdicts depend on, not on sockets and directories."""
    assert claim(Replays({"publish": {"bind": "tcp://127.0.0.1:1"}})) == claim(Replays({}))
    assert claim(Replays({"tracker": {"memory_ms": 90}})) != claim(Replays({}))


def test_a_result_without_summary_is_done_again(job):
    """The summary comes last: whoever was killed before it leaves a recording that is not done, and no row twice."""
    work(job)
    summary = next(job.out.glob("summary/*/*.parquet"))
    expected = pq.read_table(summary).to_pylist()
    summary.unlink()
    assert job.kind.results(job.out).summaries() == {}
    work(job)
    assert pq.read_table(summary).to_pylist() == expected
    assert open_table(job.out, "verdict").to_table().num_rows == 40


def test_broken_recordings_are_told(job):
    """What cannot be heard, fetched or named comes back as a sentence with its exit code, and leaves nothing."""
    Path(job.recording.path).write_text("this is no sound")
    outcome = work(job)
    assert outcome.exit_code == 2
    assert "not a sound file" in str(outcome.problem)
    gone = dataclasses.replace(job.recording, path="/absent.wav", files=fsspec.filesystem("memory"))
    assert "no such recording" in str(work(dataclasses.replace(job, recording=gone)).problem)
    write(Path(job.recording.path), 900.0)
    endless = dataclasses.replace(job.recording, name="a" * 300)
    assert "too long" in str(work(dataclasses.replace(job, recording=endless)).problem)
    assert files(job) == []


def test_workers_that_cannot(job):
    """A worker of another version, or one that does not see the results' directory, is the environment's fault."""
    old = work(dataclasses.replace(job, version="0.0.1"))
    blind = work(dataclasses.replace(job, out=job.out / "elsewhere"))
    assert (old.exit_code, blind.exit_code) == (3, 3)
    assert "another version" in str(old.problem)
    assert "does not see" in str(blind.problem)
    assert not (job.out / "elsewhere").exists()


def test_a_bug_does_not_stop_the_rest(job):
    """What nobody foresaw is told as a bug, with exit code 1."""
    outcome = work(dataclasses.replace(job, kind=Replays({"spindle": None})))
    assert outcome.exit_code == 1
    assert "this is a bug" in str(outcome.problem)


def test_a_recording_that_kills_is_given_up(job):
    """A recording at which every worker dies is told after some attempts; the others are done."""
    deadly = dataclasses.replace(job, recording=dataclasses.replace(job.recording, name="deadly.wav", files=Deadly()))
    outcomes = {outcome.recording: outcome for outcome in in_processes([deadly, job], 1)}
    assert outcomes[job.recording.name].problem is None
    assert f"{ATTEMPTS} worker processes died" in str(outcomes["deadly.wav"].problem)
    assert outcomes["deadly.wav"].exit_code == 3
