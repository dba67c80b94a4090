"""The messages of the public contract as Parquet tables: what ``--jsonl`` writes, for whoever asks many recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec
import pyarrow as pa

from chatter_monitor.errors import EnvironmentFault
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.outlets.parquet_file import ParquetFile
from chatter_monitor.outlets.wire import encode
from chatter_monitor.records import Announcement, Event, Odp, OdpFrame, Verdict

# 7 minutes of one channel's verdicts, about 10 MB as Python objects before they are written.
ROWS_PER_GROUP = 8192
TABLES: dict[str, type[msgspec.Struct]] = {"verdict": Verdict, "odp": Odp, "event": Event}

_PLAIN = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}


def arrow_type(annotation: Any) -> pa.DataType:
    """Arrow's type for the type of a message's field: so each field is described once, in `records`."""
    if annotation in _PLAIN:
        return _PLAIN[annotation]
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return pa.dictionary(pa.int8(), pa.string())
    if origin in (Union, UnionType):  # with None: every column may be null
        (inner,) = (argument for argument in arguments if argument is not type(None))
        return arrow_type(inner)
    if origin in (list, tuple):
        return pa.list_(arrow_type(arguments[0]))
    if isinstance(annotation, type) and issubclass(annotation, msgspec.Struct):
        return pa.struct(list(table_schema(annotation)))
    raise TypeError(annotation)


def table_schema(message: type[msgspec.Struct]) -> pa.Schema:
    """Columns of a table of messages: the fields of their class."""
    hints = get_type_hints(message)
    return pa.schema([pa.field(name, arrow_type(hints[name])) for name in message.__struct_fields__])


def write_table(path: Path, rows: Sequence[msgspec.Struct]) -> None:
    """Write messages of one class as a table that is there whole or not at all.

    Raises
    ------
    EnvironmentFault
        If the disk is full or fails.
    """
    with MessageTable(path, type(rows[0])) as table:
        for row in rows:
            table.append(row)


class MessageTable:
    """A Parquet file of messages of one class; it gets its name when it is complete.

    Parameters
    ----------
    path : Path
        The table; an existing one is replaced, missing directories are made.
    message : type
        Class of the messages.

    Raises
    ------
    EnvironmentFault
        By every method, if the disk is full or fails.
    """

    def __init__(self, path: Path, message: type[msgspec.Struct]) -> None:
        self._schema = table_schema(message)
        self._rows: list[dict[str, Any]] = []
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = ParquetFile(path, self._schema, compression="zstd")
        except OSError as error:
            raise EnvironmentFault(f"a table cannot be written: {error.strerror}", got=str(path)) from error

    def append(self, message: msgspec.Struct) -> None:
        """Append a row."""
        self._rows.append(msgspec.json.decode(encode(message)))  # null for what is not finite, as in JSON lines
        if len(self._rows) == ROWS_PER_GROUP:
            self._write_group()

    def close(self) -> None:
        """Write the rest and give the file its name."""
        self._write_group()
        self._file.close()

    def __enter__(self) -> MessageTable:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is None:
            self._write_group()
        self._file.__exit__(kind, error, traceback)

    def _write_group(self) -> None:
        if self._rows:
            rows = pa.Table.from_pylist(self._rows, schema=self._schema)
            self._rows.clear()
            self._file.write(rows)


class MessageTables(Outlet):
    """Verdicts, ODP summaries and events, a table each; columns are the fields of the messages.

    Parameters
    ----------
    paths : mapping
        File of each table, by its name in `TABLES`.
    """

    def __init__(self, paths: Mapping[str, Path]) -> None:
        with ExitStack() as opened:
            self._tables = {
                name: opened.enter_context(MessageTable(paths[name], message)) for name, message in TABLES.items()
            }
            self._open = opened.pop_all()

    def frame(self, frame: OdpFrame, odp: Odp) -> None:  # noqa: ARG002  the summary is enough here
        """Append the summary of the interval."""
        self._tables["odp"].append(odp)

    def message(self, message: Announcement) -> None:
        """Append a verdict or an event."""
        match message:
            case Verdict():
                self._tables["verdict"].append(message)
            case Event():
                self._tables["event"].append(message)

    def close(self) -> None:
        """Give the tables their names, or none of those that are left when one fails; a second call does nothing."""
        self._open.close()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._open.__exit__(kind, error, traceback)
