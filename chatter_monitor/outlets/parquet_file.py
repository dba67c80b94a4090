"""A Parquet file that is there whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import pyarrow as pa
import pyarrow.parquet as pq

from chatter_monitor.errors import EnvironmentFault
from chatter_monitor.outlets.durable import synchronise


class ParquetFile:
    """A hidden file that row groups are written to; it gets its name when it is complete and safely on the disk.

    Use it as a context manager: leaving by an exception discards it.

    Parameters
    ----------
    path : Path
        Name of the file; an existing one is replaced on `close`.
    schema : pyarrow.Schema
        Its columns.
    **options
        Of `pyarrow.parquet.ParquetWriter`.

    Raises
    ------
    OSError
        If it cannot be created.
    EnvironmentFault
        By `write` and `close`, if the disk is full or fails; nothing of it stays.
    """

    def __init__(self, path: Path, schema: pa.Schema, **options: Any) -> None:
        self._path = path
        # Two processes may be at the same file: one of them was given up for dead.
        self._unfinished = path.with_name(f".{path.name}.{os.getpid()}.{os.urandom(4).hex()}.part")
        self._file = pa.OSFile(str(self._unfinished), "wb")
        self._writer = pq.ParquetWriter(self._file, schema, **options)

    def write(self, rows: pa.Table) -> None:
        """Write rows as one row group."""
        try:
            self._writer.write_table(rows, row_group_size=len(rows))
        except OSError as error:
            raise self._fault(error) from error

    def close(self) -> None:
        """Complete the file and give it its name; a second call does nothing."""
        if self._file.closed:
            return
        try:
            self._writer.close()
            self._file.close()
            synchronise(self._unfinished)
            self._unfinished.replace(self._path)
            synchronise(self._path.parent)
        except OSError as error:
            raise self._fault(error) from error

    def discard(self) -> None:
        """Remove what is not complete."""
        self._writer.is_open = False  # or it would try to complete the file when it is collected
        self._file.close()
        self._unfinished.unlink(missing_ok=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.discard()

    def _fault(self, error: OSError) -> EnvironmentFault:
        """Remove what cannot be completed, and say why."""
        self.discard()
        return EnvironmentFault(f"the table cannot be written: {error.strerror or error}", got=str(self._path))
