"""The results of an archive on disk: a data set of Parquet tables, partitioned by where they come from.

``DIR/<table>/source=<name>/<key>.parquet``, where the key is that of the recording's content, the settings and the
program. The table ``summary`` has one row for each recording and is written last: a recording with a summary is done.
A recording may have a folder of pages, too: ``DIR/pages/source=<name>/<key>``.
"""

from __future__ import annotations

import fcntl
import shutil
import urllib.parse
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import msgspec
import pyarrow.dataset as ds

from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.outlets.durable import synchronise
from chatter_monitor.outlets.message_tables import write_table
from chatter_monitor.reports.archive import Row

SCHEMA = "chatter-monitor/archive/1"
SUMMARY, PAGES = "summary", "pages"
LONGEST_NAME = 255  # bytes, of Linux's file systems


class Claim(msgspec.Struct, frozen=True):
    """What a data set was made with, in ``archive.json``."""

    schema: str
    version: str
    settings: dict[str, dict[str, Any]]


R = TypeVar("R", bound=Row)


@dataclass(frozen=True)
class DataSet(Generic[R]):
    """A directory that holds the results of an archive.

    Attributes
    ----------
    path : Path
        The directory.
    tables : tuple of str
        Names of the tables beside the summary.
    summary : type
        Class of the summary's rows.
    """

    path: Path
    tables: tuple[str, ...]
    summary: type[R]

    @contextmanager
    def claimed(self, claim: Claim) -> Iterator[None]:
        """The directory for one run alone, and for results of these settings only.

        Raises
        ------
        InputError
            If it holds results of other settings or of another version of the program.
        EnvironmentFault
            If another run is at work there, or it cannot be written.
        """
        mark = self.path / "archive.json"
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            with (self.path / ".lock").open("w") as lock:
                try:
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # let go of when the process ends, however it does
                except BlockingIOError as error:
                    raise EnvironmentFault("another run is at work in this directory", got=str(self.path)) from error
                if mark.exists():
                    self._compare(mark, claim)
                else:
                    part = mark.with_suffix(".part")
                    part.write_bytes(msgspec.json.format(msgspec.json.encode(claim), indent=1) + b"\n")
                    synchronise(part)
                    part.replace(mark)
                for left in self.path.glob("*/*/.*.part"):  # by a run that was killed
                    _remove(left)
                yield
        except OSError as error:
            raise EnvironmentFault(f"the results cannot be written: {error.strerror}", got=str(self.path)) from error

    def _compare(self, mark: Path, claim: Claim) -> None:
        try:
            there = msgspec.json.decode(mark.read_bytes(), type=Claim)
        except msgspec.DecodeError as error:
            raise InputError(f"this is not the archive.json of results: {error}", got=str(mark)) from error
        # As JSON has them, where a tuple is a list.
        if there != msgspec.json.decode(msgspec.json.encode(claim), type=Claim):
            raise InputError(
                "the directory holds results of other settings or of another version of the program",
                got=str(self.path),
                remedy=f"Choose another directory, or compare {mark} with the configuration.",
            )

    def file(self, table: str, recording: str, key: str) -> Path:
        """File of a recording in a table.

        Raises
        ------
        InputError
            If the recording's name is too long to be one of a folder.
        """
        folder = f"source={urllib.parse.quote(recording, safe='')}"
        if len(folder) > LONGEST_NAME:
            raise InputError(
                "the recording's name is too long for a folder of the data set",
                got=recording,
                allowed=f"{LONGEST_NAME} bytes, as {folder[:40]}...",
                remedy="Start in a folder nearer to the recordings, so that their names are shorter.",
            )
        return self.path / table / folder / f"{key}.parquet"

    def is_done(self, recording: str, key: str) -> bool:
        """Whether there is a result for this content and these settings."""
        return self.file(SUMMARY, recording, key).exists()

    def commit(self, recording: str, summary: R) -> None:
        """Make a recording's tables, which are there already, its only result.

        Raises
        ------
        EnvironmentFault
            If the disk is full or fails.
        """
        for table in (*self.tables, PAGES, SUMMARY):
            for other in self.file(table, recording, summary.key).parent.glob("[!.]*"):
                if other.stem != summary.key:  # of what the recording was before it was replaced
                    _remove(other)
        for folder in (*self.tables, PAGES):  # a summary that outlives a power failure must find what belongs to it
            if (self.path / folder).is_dir():
                synchronise(self.path / folder)
        write_table(self.file(SUMMARY, recording, summary.key), [summary])

    def summaries(self) -> dict[str, R]:
        """Summary of every recording that is done, by name."""
        if not any(self.path.glob(f"{SUMMARY}/*/*.parquet")):
            return {}
        rows = open_table(self.path, SUMMARY).to_table().to_pylist()
        return {row.pop("source"): msgspec.convert(row, self.summary) for row in sorted(rows, key=_source)}


@dataclass(frozen=True)
class Place(Generic[R]):
    """Where the result of a recording goes.

    Attributes
    ----------
    results : DataSet
    recording : str
        Its name.
    key : str
        Of its content, what else decides, and the program.
    """

    results: DataSet[R]
    recording: str
    key: str

    def file(self, table: str) -> Path:
        """File of a table."""
        return self.results.file(table, self.recording, self.key)

    @property
    def folder(self) -> Path:
        """Where the recording's pages are."""
        return self.file(PAGES).with_suffix("")

    @contextmanager
    def pages(self) -> Iterator[Path]:
        """A folder for the recording's pages, to be filled; it gets its name when it is complete.

        Raises
        ------
        EnvironmentFault
            If the disk is full or fails.
        """
        folder = self.folder
        part = folder.with_name(f".{self.key}.part")
        try:
            _remove(part)
            part.mkdir(parents=True)
            yield part
            for written in (*part.iterdir(), part):
                synchronise(written)
            _remove(folder)
            part.replace(folder)
            synchronise(folder.parent)
        except OSError as error:
            raise EnvironmentFault(f"pages cannot be written: {error.strerror}", got=str(folder)) from error
        finally:
            _remove(part)


def open_table(path: Path, table: str) -> ds.Dataset:
    """Open a table of the data set for reading, with the column ``source``."""
    return ds.dataset(path / table, format="parquet", partitioning="hive")


def _remove(path: Path) -> None:
    """Remove a file or a folder, if there is one."""
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _source(row: dict[str, object]) -> str:
    return str(row["source"])
