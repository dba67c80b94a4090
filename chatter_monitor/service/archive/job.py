"""One recording of an archive, from its file to its place in the data set: what a worker does."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec

from chatter_monitor.acquisition.recording import Recording
from chatter_monitor.acquisition.resample import Resampled
from chatter_monitor.config import Settings, decisive_tables, load, settings_of
from chatter_monitor.errors import ChatterMonitorError, EnvironmentFault
from chatter_monitor.outlets.event_files import recorded_event
from chatter_monitor.outlets.message_tables import TABLES, MessageTables
from chatter_monitor.outlets.timeline import Timeline
from chatter_monitor.reports.archive import Summary
from chatter_monitor.service.archive.dataset import SCHEMA, Claim, DataSet
from chatter_monitor.service.archive.recordings import Remote
from chatter_monitor.service.monitor import Monitor
from chatter_monitor.service.replay import FAST_BLOCK_SAMPLES


@dataclass(frozen=True)
class Job:
    """A recording to replay.

    Attributes
    ----------
    recording : Remote
        Where it is.
    tables : dict
        What the machine configuration says, without its defaults.
    out : Path
        The data set; every worker must see the same directory.
    version : str
        Of the program that asks for it.
    """

    recording: Remote
    tables: dict[str, dict[str, Any]]
    out: Path
    version: str


@dataclass(frozen=True)
class Outcome:
    """How a job ended; `problem` is None for a recording that is done, and then `exit_code` is 0."""

    recording: str
    problem: str | None = None
    exit_code: int = 0


def claim(tables: dict[str, dict[str, Any]]) -> Claim:
    """What the results of a configuration depend on, but for the recordings."""
    return Claim(SCHEMA, version("chatter-monitor"), decisive_tables(settings_of(tables)))


def work(job: Job) -> Outcome:
    """Replay a recording, unless that has been done; whatever is wrong with it is told, not raised."""
    name = job.recording.name
    try:
        _work(job)
    except ChatterMonitorError as error:
        return Outcome(name, str(error), error.exit_code)
    except Exception as error:
        return Outcome(name, f"this is a bug: {type(error).__name__}: {error}", 1)
    return Outcome(name)


def _work(job: Job) -> None:
    if job.version != (own := version("chatter-monitor")):
        raise EnvironmentFault("the worker has another version of the program", got=own, allowed=job.version)
    results = DataSet(job.out)
    if not job.out.is_dir():  # on another machine it would be made, and nobody would ever look there
        raise EnvironmentFault(
            "the worker does not see the directory of the results",
            got=str(job.out),
            remedy="Share it with all workers.",
        )
    with job.recording.fetched() as file:
        beside = [file.with_suffix(".json")] if recorded_event(file) is not None else []
        settings = load(beside, job.tables)
        with Recording(
            file,
            channels=settings.input.channels,
            full_scale_per_unit=settings.input.full_scale_per_unit,
            block_samples=FAST_BLOCK_SAMPLES,
        ) as recording:
            key = _key(file, settings)
            if not results.is_done(job.recording.name, key):
                results.commit(job.recording.name, _replay(recording, file, settings, key, job, results))


def _replay(recording: Recording, file: Path, settings: Settings, key: str, job: Job, results: DataSet) -> Summary:
    event = recorded_event(file)
    timeline = Timeline(recording.channels)
    with MessageTables({table: results.file(table, job.recording.name, key) for table in TABLES}) as tables:
        monitor = Monitor(
            settings,
            Resampled(recording, settings.tracker.sample_rate_hz),
            [tables, timeline],
            counts=recording,
            source_rate_hz=event.source_rate_hz if event else recording.sample_rate_hz,
            session=file.stem,
            clock=lambda: 0.0,  # nobody asks for latencies
        )
        for _ in monitor.run():
            pass
    whole = timeline.summary(file, recording.missing_samples)
    worst = min(whole.events, key=lambda event: event.min_damping_ratio, default=None)
    seconds = {
        f"{state}_s": sum(channel.get(state, 0.0) for channel in whole.seconds_in)
        for channel in whole.seconds_in
        for state in channel
    }
    return Summary(
        key=key,
        machine=settings.machine.name,
        duration_s=whole.duration_s,
        channels=whole.channels,
        events=len(whole.events),
        peak_frequency_hz=worst.peak_frequency_hz if worst else None,
        min_damping_ratio=worst.min_damping_ratio if worst else None,
        samples_lost=whole.samples_lost,
        samples_missing=whole.samples_missing,
        samples_clipped=whole.samples_clipped,
        samples_non_finite=whole.samples_non_finite,
        **seconds,
    )


def _key(file: Path, settings: Settings) -> str:
    """Key of a recording's content, the settings and the program: 128 bits of SHA-256."""
    with file.open("rb") as opened:
        content = hashlib.file_digest(opened, "sha256").hexdigest()
    whole = msgspec.json.encode(
        [SCHEMA, version("chatter-monitor"), content, decisive_tables(settings)], order="sorted"
    )
    return hashlib.sha256(whole).hexdigest()[:32]
