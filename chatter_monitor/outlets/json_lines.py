"""JSON lines (``--jsonl``): one message of the public contract per line, ``type`` first."""

from __future__ import annotations

import sys
from pathlib import Path

from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.outlets.wire import encode
from chatter_monitor.records import Announcement, Health, Odp, OdpFrame


class JsonLines(Outlet):
    """Writes ODP summaries, verdicts, events, mismatches and health as JSON lines.

    A number that is not finite becomes null. Whoever follows the file is behind by one `Health` message at most.

    Parameters
    ----------
    path : Path or None
        File to write (an existing one is replaced); None for standard output, which is left open.

    Raises
    ------
    InputError
        If the file cannot be created.
    EnvironmentFault
        By any method, if writing fails: the disk is full, the reader of a pipe is gone.
    """

    def __init__(self, path: Path | None) -> None:
        self._name = "standard output" if path is None else str(path)
        self._owned = path is not None
        try:
            self._file = sys.stdout.buffer if path is None else path.open("wb")
        except OSError as error:
            raise InputError(
                f"JSON lines cannot be written: {error.strerror}", got=self._name, remedy="Choose another file."
            ) from error

    def frame(self, frame: OdpFrame, odp: Odp) -> None:  # noqa: ARG002  every sample goes to the table and the socket
        """Write the summary of the interval."""
        self._write(odp)

    def message(self, message: Announcement) -> None:
        """Write the message."""
        self._write(message)
        if isinstance(message, Health):
            self._flush()

    def close(self) -> None:
        """Write what is buffered and close the file."""
        if not self._owned:
            self._flush()
            return
        try:
            self._file.close()
        except OSError as error:
            raise self._fault(error) from error

    def _write(self, message: Odp | Announcement) -> None:
        try:
            self._file.write(encode(message) + b"\n")
        except OSError as error:
            raise self._fault(error) from error

    def _flush(self) -> None:
        try:
            self._file.flush()
        except OSError as error:
            raise self._fault(error) from error

    def _fault(self, error: OSError) -> EnvironmentFault:
        return EnvironmentFault(f"JSON lines stopped: {error.strerror}", got=self._name)
