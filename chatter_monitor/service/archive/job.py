"""One recording of an archive, from its file to its place in the data set: what a worker does."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec

from chatter_monitor.acquisition.recording import Recording
from chatter_monitor.errors import ChatterMonitorError, EnvironmentFault
from chatter_monitor.service.archive.dataset import SCHEMA, Claim, Place
from chatter_monitor.service.archive.kind import Kind, Tables
from chatter_monitor.service.archive.recordings import Remote


@dataclass(frozen=True)
class Job:
    """A recording with which something is to be done.

    Attributes
    ----------
    recording : Remote
        Where it is.
    kind : Kind
        What is to be done.
    out : Path
        The data set; every worker must see the same directory.
    version : str
        Of the program that asks for it.
    """

    recording: Remote
    kind: Kind[Any]
    out: Path
    version: str


@dataclass(frozen=True)
class Outcome:
    """How a job ended; `problem` is None for a recording that is done, and then `exit_code` is 0."""

    recording: str
    problem: str | None = None
    exit_code: int = 0


def claim(kind: Kind[Any]) -> Claim:
    """What the results depend on, but for the recordings."""
    return Claim(SCHEMA, version("chatter-monitor"), kind.decisive())


def work(job: Job) -> Outcome:
    """Do a job, unless it has been done; whatever is wrong with the recording is told, not raised."""
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
    if not job.out.is_dir():  # on another machine it would be made, and nobody would ever look there
        raise EnvironmentFault(
            "the worker does not see the directory of the results",
            got=str(job.out),
            remedy="Share it with all workers.",
        )
    results, name = job.kind.results(job.out), job.recording.name
    with job.recording.fetched() as file:
        Recording(file).close()  # what is no recording is told before anything is made of it
        key = _key(file, job.kind.decisive(file))
        if not results.is_done(name, key):
            results.commit(name, job.kind.do(file, Place(results, name, key)))


def _key(file: Path, decisive: Tables) -> str:
    """Key of a recording's content, what else decides, and the program: 128 bits of SHA-256."""
    with file.open("rb") as opened:
        content = hashlib.file_digest(opened, "sha256").hexdigest()
    whole = msgspec.json.encode([SCHEMA, version("chatter-monitor"), content, decisive], order="sorted")
    return hashlib.sha256(whole).hexdigest()[:32]
