"""Recordings wherever fsspec finds them: folders, globs, object stores, archives of files."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from fsspec import AbstractFileSystem
from fsspec.core import url_to_fs
from fsspec.implementations.local import LocalFileSystem

from chatter_monitor.errors import ChatterMonitorError, EnvironmentFault, InputError

# Which files of a folder are recordings. A glob means what it matches.
SUFFIXES = (".wav", ".flac", ".aif", ".aiff", ".au", ".caf", ".mp3", ".oga", ".ogg", ".opus", ".rf64", ".w64")
_MAGIC = frozenset("*?[")


@dataclass(frozen=True)
class Remote:
    """A recording, not necessarily on this machine; it can be sent to another process.

    Attributes
    ----------
    name : str
        What people call it: the path or URL, in the form in which it was asked for.
    files : AbstractFileSystem
        Where it is.
    path : str
        Its path there.
    """

    name: str
    files: AbstractFileSystem
    path: str

    @contextmanager
    def fetched(self) -> Iterator[Path]:
        """A local file of the recording, with its JSON beside it where there is one.

        Raises
        ------
        InputError
            If there is no such file.
        EnvironmentFault
            If it cannot be had.
        """
        if isinstance(self.files, LocalFileSystem):
            yield Path(self.path)
            return
        with tempfile.TemporaryDirectory(prefix="chatter-monitor-") as folder:
            copy = Path(folder, PurePosixPath(self.path).name)  # events are called after the file
            try:
                self._copy(self.path, copy)
                beside = str(PurePosixPath(self.path).with_suffix(".json"))
                if self.files.exists(beside):
                    self._copy(beside, copy.with_suffix(".json"))
            except FileNotFoundError as error:
                raise InputError("there is no such recording", got=self.name) from error
            except Exception as error:  # whatever a plugin raises
                raise EnvironmentFault(f"the recording cannot be fetched: {error}", got=self.name) from error
            yield copy

    def _copy(self, path: str, to: Path) -> None:
        with self.files.open(path, "rb") as there, to.open("wb") as here:
            shutil.copyfileobj(there, here)


def find(asked: Sequence[str]) -> list[Remote]:
    """Recordings in folders, by globs, by name; sorted by name, each once.

    Parameters
    ----------
    asked : sequence of str
        Paths or URLs of files or folders, or globs of them.

    Raises
    ------
    InputError
        If one of them leads to no recording.
    EnvironmentFault
        If a place cannot be reached.
    """
    found: dict[str, Remote] = {}
    for one in asked:
        recordings = _find(one)
        if not recordings:
            raise InputError(
                "there is no recording",
                got=one,
                allowed="sound files, folders with some, and globs, as paths or URLs",
                remedy="Of a folder, files count that end in " + ", ".join(SUFFIXES) + ".",
            )
        found |= {recording.name: recording for recording in recordings}
    return [found[name] for name in sorted(found)]


def _find(asked: str) -> list[Remote]:
    try:
        files, path = url_to_fs(asked)
        if files.isdir(path):
            paths = [name for name in files.find(path) if _is_recording(name, path)]
        elif files.exists(path) or not _MAGIC & set(path):
            paths = [path] if files.exists(path) else []
        else:
            paths = [name for name in files.glob(path) if not files.isdir(name)]
    except ChatterMonitorError:
        raise
    except ValueError as error:  # unknown protocol, malformed URL
        raise InputError(f"this is no place for recordings: {error}", got=asked) from error
    except Exception as error:  # whatever a plugin raises, the plugin that is missing included
        raise EnvironmentFault(f"the recordings cannot be listed: {error}", got=asked) from error
    return [Remote(_name(asked, files, path), files, path) for path in paths]


def _is_recording(path: str, folder: str) -> bool:
    inside = PurePosixPath(path).relative_to(folder) if path.startswith(folder) else PurePosixPath(path)
    return inside.suffix.lower() in SUFFIXES and not any(part.startswith(".") for part in inside.parts)


def _name(asked: str, files: AbstractFileSystem, path: str) -> str:
    """Name of a file in the form of what was asked for, so that it is the same whenever this is asked again."""
    if "://" not in asked:
        return path if os.path.isabs(asked) else os.path.relpath(path)
    _, chained, inner = asked.partition("::")
    return str(files.unstrip_protocol(path)) + chained + inner
