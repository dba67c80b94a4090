"""ODPs at every sample of every channel as a Parquet table (``--odp``)."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from chatter_monitor.errors import InputError
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.outlets.parquet_file import ParquetFile
from chatter_monitor.records import Announcement, ModeStatus, Odp, OdpFrame

SCHEMA = "chatter-monitor/odp-table/1"

# Measured on two modes drifting with a memory of 80 ms (52 B a row in memory), rows per second of CPU time on a 2.8 GHz
# Xeon: lz4 11 M at 21.6 B a row, zstd 6.6 M at 21.4 B, zstd level 3 5.5 M at 20.9 B, uncompressed 12 M at 60 B.
# Mantissas are noise, so a better compressor finds nothing more; splitting the bytes of the floats finds the exponents
# (unsplit, lz4 gains nothing on them). Columns that may be null would cost a third of the speed. Copying frames into
# the buffer takes a third of the whole: 7 M rows/s remain, 550 times real time.
COMPRESSION = "lz4"
# 10 s of one channel, 8 MB of buffer for two modes; from 16 k to 1 M rows neither speed nor size changed by 20 %.
ROWS_PER_GROUP = 131_072

MODE_COLUMNS = ("frequency_hz", "damping_ratio", "frequency_sd_hz", "damping_sd", "status")


class OdpTable(Outlet):
    """Streams frames into a Parquet file that gets its name when it is complete.

    Columns: ``channel``, ``sample``, ``t`` (seconds), and per mode m ``frequency_hz_m``, ``damping_ratio_m``,
    ``frequency_sd_hz_m``, ``damping_sd_m`` (NaN where the mode has none), ``status_m`` (a `ModeStatus`). Rows stand in
    the order in which frames came: one interval of each channel after the other. The schema's metadata holds the
    schema's name, the sample rate, the machine and the meaning of the status codes.

    Parameters
    ----------
    path : Path
        The table; an existing one is replaced on `close`.
    modes : int
        Mode slots of the frames.
    sample_rate_hz : float
        Rate of the frames' sample index.
    machine : str
        Name of the machine.

    Raises
    ------
    InputError
        If the file cannot be created.
    EnvironmentFault
        By `frame` and `close`, if the disk is full or fails.
    """

    def __init__(self, path: Path, *, modes: int, sample_rate_hz: float, machine: str) -> None:
        self._modes = modes
        self._sample_rate_hz = sample_rate_hz
        self._rows = 0
        self._channel = np.empty(ROWS_PER_GROUP, np.uint16)
        self._sample = np.empty(ROWS_PER_GROUP, np.int64)
        self._of_mode: dict[str, NDArray[np.generic]] = {
            name: np.empty((ROWS_PER_GROUP, modes), np.uint8 if name == "status" else np.float32)
            for name in MODE_COLUMNS
        }
        self._schema = pa.schema(
            [pa.field(n, pa.from_numpy_dtype(c.dtype), nullable=False) for n, c in self._columns().items()],
            metadata={
                "schema": SCHEMA,
                "sample_rate_hz": repr(sample_rate_hz),
                "machine": machine,
                "status": ", ".join(f"{status.value} = {status.name.lower()}" for status in ModeStatus),
            },
        )
        floats = {name: "BYTE_STREAM_SPLIT" for name, c in self._columns().items() if c.dtype.kind == "f"}
        try:
            if path.exists() and not path.is_file():  # a device would be replaced by the table
                raise OSError(None, "It is not a regular file")
            self._file = ParquetFile(
                path,
                self._schema,
                compression=COMPRESSION,
                use_dictionary=False,
                column_encoding=floats | {"sample": "DELTA_BINARY_PACKED"},
                write_statistics=["channel", "sample", "t"],  # what readers select by
            )
        except OSError as error:
            raise InputError(
                f"the ODP table cannot be written: {error.strerror}", got=str(path), remedy="Choose another file."
            ) from error

    def frame(self, frame: OdpFrame, odp: Odp) -> None:  # noqa: ARG002  the table has every sample, not the summary
        """Append all samples of the frame."""
        self.append(frame)

    def append(self, frame: OdpFrame) -> None:
        """Append all samples of a frame, of which the summary is not at hand."""
        done = 0
        while done < len(frame):
            count = min(len(frame) - done, ROWS_PER_GROUP - self._rows)
            self._append(frame, done, count)
            done += count
            if self._rows == ROWS_PER_GROUP:
                self._write_group()

    def message(self, message: Announcement) -> None:
        """Ignore the message: the table holds ODPs only."""

    def close(self) -> None:
        """Write the rest and give the file its name."""
        self._write_group()
        self._file.close()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if kind is None:
            self._write_group()
        self._file.__exit__(kind, error, traceback)

    def _append(self, frame: OdpFrame, start: int, count: int) -> None:
        """Copy rows ``start ... start + count`` of the frame behind those that are buffered."""
        rows = slice(self._rows, self._rows + count)
        self._channel[rows] = frame.channel
        self._sample[rows] = np.arange(frame.first_sample + start, frame.first_sample + start + count)
        for name, buffer in self._of_mode.items():
            buffer[rows] = getattr(frame, name)[start : start + count]
        self._rows += count

    def _columns(self) -> dict[str, NDArray[np.generic]]:
        """Buffered rows, by column."""
        sample = self._sample[: self._rows]
        columns: dict[str, NDArray[np.generic]] = {
            "channel": self._channel[: self._rows],
            "sample": sample,
            "t": sample / self._sample_rate_hz,
        }
        for mode in range(self._modes):
            for name, buffer in self._of_mode.items():
                columns[f"{name}_{mode}"] = np.ascontiguousarray(buffer[: self._rows, mode])
        return columns

    def _write_group(self) -> None:
        """Write the buffered rows as one row group."""
        if self._rows == 0:
            return
        arrays = [pa.array(column, from_pandas=False) for column in self._columns().values()]
        self._rows = 0
        self._file.write(pa.table(arrays, schema=self._schema))
