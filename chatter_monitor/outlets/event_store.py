"""The directory of recorded events: whole recordings only, within a quota, whatever happens to the program.

```
DIRECTORY/
  .lock                 held by the recorder that writes here
  .part-<id>/           being written, or left behind by a crash
  .removed-<id>/        being removed
  <id>/                 a recorded event, complete
    <id>.flac or .wav, <id>.parquet, <id>.jsonl, <id>.json
    protected           only if the quota and purging must leave it alone
```

A recording is written into a hidden folder, synchronised to the disk, and gets its name by one renaming; it is removed
by one renaming, too. So at any moment a name stands for a complete recording.
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.outlets.durable import synchronise

PART = ".part-"
REMOVED = ".removed-"
PROTECTED = "protected"
LONGEST_NAME = 100


@dataclass(frozen=True, slots=True)
class Entry:
    """A recorded event as it lies in the store.

    Attributes
    ----------
    path : Path
        Its folder.
    size_bytes : int
        Room that its files take.
    written : float
        When it was completed, in seconds since 1970; the oldest goes first.
    protected : bool
        Whether quota and purging leave it alone.
    """

    path: Path
    size_bytes: int
    written: float
    protected: bool

    @property
    def id(self) -> str:
        """The event's name."""
        return self.path.name

    @property
    def json(self) -> Path:
        """What the recording is of; `event_files.read` reads it."""
        return self.path / f"{self.id}.json"


class EventStore:
    """Recorded events in a directory, for reading and tidying up; any number of processes may at the same time.

    Parameters
    ----------
    directory : Path
        Where they are.
    """

    def __init__(self, directory: Path) -> None:
        self.directory = directory

    def entries(self) -> list[Entry]:
        """List what is complete, oldest first.

        Raises
        ------
        InputError
            If the directory cannot be read.
        """
        try:
            folders = [path for path in self.directory.iterdir() if not path.name.startswith(".")]
            found = [entry for path in folders if (entry := _entry(path)) is not None]
        except OSError as error:
            raise InputError(
                f"there are no recorded events: {error.strerror}",
                got=str(self.directory),
                remedy="Check the path, or [recorder] directory in the configuration.",
            ) from error
        return sorted(found, key=lambda entry: (entry.written, entry.id))

    def find(self, name: str) -> Entry:
        """Entry of an event.

        Raises
        ------
        InputError
            If there is none of that name.
        """
        for entry in self.entries():
            if entry.id == name:
                return entry
        raise InputError(
            f"no recorded event of that name in {str(self.directory)!r}",
            got=name,
            remedy="`chatter-monitor events` lists them.",
        )

    def protect(self, entry: Entry, *, protected: bool = True) -> None:
        """Let quota and purging leave an event alone, or not any more."""
        marker = entry.path / PROTECTED
        try:
            if protected:
                marker.touch()
            else:
                marker.unlink(missing_ok=True)
        except OSError as error:
            raise EnvironmentFault(
                f"the event's protection cannot be changed: {error.strerror}", got=str(entry.path)
            ) from error

    def remove(self, entry: Entry) -> None:
        """Remove an event; one that somebody else has just removed is fine."""
        hidden = self.directory / f"{REMOVED}{entry.id}"
        try:
            _remove_folder(hidden)  # a removal of the same name that was interrupted
            entry.path.rename(hidden)
            _remove_folder(hidden)
        except FileNotFoundError:
            pass
        except OSError as error:
            raise EnvironmentFault(
                f"the event cannot be removed: {error.strerror or error}", got=str(entry.path)
            ) from error

    def export(self, entry: Entry, out: Path) -> Path:
        """Copy the files of an event into a new folder of its name within `out`, and return that.

        Raises
        ------
        InputError
            If the folder exists already or cannot be made.
        """
        target = out / entry.id
        part = out / f"{PART}{entry.id}"
        if target.exists():
            raise InputError("the event is there already", got=str(target), remedy="Choose another --out.")
        try:
            out.mkdir(parents=True, exist_ok=True)
            _remove_folder(part)
            shutil.copytree(entry.path, part, ignore=shutil.ignore_patterns(PROTECTED))
            part.rename(target)
        except (OSError, shutil.Error) as error:
            shutil.rmtree(part, ignore_errors=True)
            what = f"the event cannot be copied: {getattr(error, 'strerror', None) or error}"
            raise InputError(what, got=str(target), remedy="Choose another --out.") from error
        return target


class EventWriter(EventStore):
    """The one who adds to a store and keeps it within its quota. One thread owns it.

    Parameters
    ----------
    directory : Path
        The store; it is made if it does not exist.
    quota_bytes : float
        Room that all recordings together may take. While a recording is being written, it comes on top.
    """

    def __init__(self, directory: Path, quota_bytes: float) -> None:
        super().__init__(directory)
        self._quota_bytes = quota_bytes
        self._lock: int | None = None

    def open(self) -> None:
        """Make the directory, lock it against other writers and clean up after a crash; harmless when open already.

        Raises
        ------
        InputError
            If the directory cannot be made or written, or another recorder uses it.
        """
        if self._lock is not None:
            return
        lock = None
        try:
            self.directory.mkdir(parents=True, exist_ok=True)
            lock = os.open(self.directory / ".lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            for pattern in (f"{PART}*", f"{REMOVED}*"):
                for leftover in self.directory.glob(pattern):
                    _remove_folder(leftover)
        except OSError as error:
            if lock is not None:
                os.close(lock)
            why = "another recorder uses it" if isinstance(error, BlockingIOError) else error.strerror
            raise InputError(
                f"the directory of recorded events cannot be used: {why}",
                got=str(self.directory),
                remedy="Choose another one, or see who may write there.",
            ) from error
        self._lock = lock

    def add(self, wanted_name: str, write: Callable[[Path, str], None]) -> str:
        """Add a recording; returns once it is safely on the disk.

        Parameters
        ----------
        wanted_name : str
            Name to give it, as far as it is free and can be a folder's name.
        write : callable
            Takes an empty folder and the name, and writes the files into it, ``<name>.json`` among them.

        Returns
        -------
        str
            Its name.

        Raises
        ------
        EnvironmentFault
            If the quota leaves no room, because the recording is too large or too many others are protected.
        InputError
            If the directory has become unusable.
        Exception
            Whatever `write` raises; nothing of the recording stays, and no other one goes.
        """
        self.open()
        name = self._free_name(wanted_name)
        part = self.directory / f"{PART}{name}"
        try:
            part.mkdir()
            write(part, name)
            for path in (*part.iterdir(), part):
                synchronise(path)
            self._make_room(sum(path.stat().st_size for path in part.iterdir()))
            part.rename(self.directory / name)
            synchronise(self.directory)
        except BaseException:
            shutil.rmtree(part, ignore_errors=True)
            self.close()  # the directory may be gone, or another disk: the next attempt begins anew
            raise
        return name

    def close(self) -> None:
        """Let other recorders use the directory."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _free_name(self, wanted: str) -> str:
        # The end of an event's id tells it from others.
        name = re.sub(r"[^\w.+-]+", "_", wanted, flags=re.ASCII)[-LONGEST_NAME:].lstrip(".") or "event"
        candidate, count = name, 1
        while (self.directory / candidate).exists():
            count += 1
            candidate = f"{name}-{count}"
        return candidate

    def _make_room(self, needed_bytes: int) -> None:
        """Remove the oldest recordings that may go until so much fits into the quota."""
        entries = self.entries()
        kept_bytes = sum(entry.size_bytes for entry in entries if entry.protected)
        if kept_bytes + needed_bytes > self._quota_bytes:
            raise EnvironmentFault(
                "the quota of recorded events leaves no room",
                got=f"{needed_bytes / 1e6:.1f} MB, and {kept_bytes / 1e6:.1f} MB are protected",
                allowed=f"{self._quota_bytes / 1e6:.1f} MB",
                remedy="Raise [recorder] quota_gb, or export and unprotect events.",
            )
        total_bytes = needed_bytes + sum(entry.size_bytes for entry in entries)
        for entry in entries:
            if total_bytes <= self._quota_bytes:
                return
            if not entry.protected:
                self.remove(entry)
                total_bytes -= entry.size_bytes


def _entry(path: Path) -> Entry | None:
    """Entry of a folder; None if it is not that of an event, or has just been removed."""
    try:
        written = (path / f"{path.name}.json").stat().st_mtime
        size_bytes = sum(file.stat().st_size for file in path.iterdir())
        return Entry(path, size_bytes, written, (path / PROTECTED).exists())
    except (FileNotFoundError, NotADirectoryError):
        return None


def _remove_folder(path: Path) -> None:
    """Remove a folder, if it is there, with what is in it."""
    with suppress(FileNotFoundError):
        shutil.rmtree(path)
