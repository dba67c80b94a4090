"""The ODP table."""

from __future__ import annotations

import numpy as np
import pyarrow.parquet as pq
import pytest

from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.outlets import odp_table
from chatter_monitor.outlets.odp_table import MODE_COLUMNS, OdpTable
from chatter_monitor.records import OdpFrame
from tests.full_disk import file_size_limit

FS = 12_800.0


@pytest.fixture(autouse=True)
def _small_groups(monkeypatch):
    """Row groups that frames do not fit into evenly."""
    monkeypatch.setattr(odp_table, "ROWS_PER_GROUP", 1000)


def open_table(path, modes=2) -> OdpTable:
    return OdpTable(path, modes=modes, sample_rate_hz=FS, machine="lathe-3")


def test_reads_back_bit_equal(tmp_path, make_interval):
    """Every sample of every channel stands in the table with the very bits of the frames, NaN included."""
    intervals = [
        make_interval(first_sample=first, channel=channel, n=n)
        for first, n in [(0, 640), (640, 1), (641, 2500), (4000, 640)]
        for channel in (0, 300)
    ]
    with open_table(tmp_path / "odp.parquet") as table:
        for frame, odp in intervals:
            table.frame(frame, odp)
    read = pq.read_table(tmp_path / "odp.parquet")
    frames: list[OdpFrame] = [frame for frame, _ in intervals]
    sample = np.concatenate([frame.first_sample + np.arange(len(frame)) for frame in frames])
    expected = {
        "channel": np.concatenate([np.full(len(frame), frame.channel, np.uint16) for frame in frames]),
        "sample": sample,
        "t": sample / FS,
    }
    for mode in range(2):
        for name in MODE_COLUMNS:
            expected[f"{name}_{mode}"] = np.concatenate([getattr(frame, name)[:, mode] for frame in frames])
    assert read.column_names == list(expected)
    for name, values in expected.items():
        column = read[name].to_numpy()
        assert column.dtype == values.dtype
        assert column.tobytes() == values.tobytes()
        assert read[name].null_count == 0


def test_frames_may_reuse_their_arrays(tmp_path, make_interval):
    """The table keeps what it was given even if the tracker writes the next interval into the same arrays."""
    frame, odp = make_interval()
    before = frame.frequency_hz[:, 1].copy()
    with open_table(tmp_path / "odp.parquet") as table:
        table.frame(frame, odp)
        frame.frequency_hz[:] = -1.0
    np.testing.assert_array_equal(pq.read_table(tmp_path / "odp.parquet")["frequency_hz_1"], before)


def test_schema_metadata(tmp_path):
    """A table without rows is valid and tells its schema, sample rate, machine and status codes."""
    with open_table(tmp_path / "odp.parquet", modes=1):
        pass
    metadata = pq.read_table(tmp_path / "odp.parquet").schema.metadata
    assert metadata[b"schema"] == b"chatter-monitor/odp-table/1"
    assert metadata[b"sample_rate_hz"] == b"12800.0"
    assert metadata[b"machine"] == b"lathe-3"
    assert metadata[b"status"] == b"0 = oscillatory, 1 = real_pair, 2 = held, 3 = starting"


def test_memory_is_bounded(tmp_path, make_interval):
    """Row groups are written when they are full, not kept to the end."""
    with open_table(tmp_path / "odp.parquet") as table:
        for i in range(20):
            table.frame(*make_interval(first_sample=640 * i))
    file = pq.ParquetFile(tmp_path / "odp.parquet")
    assert [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)] == [1000] * 12 + [800]


def test_named_only_when_complete(tmp_path, make_interval):
    """Until the table is complete an earlier one of the same name stays as it was."""
    path = tmp_path / "odp.parquet"
    path.write_text("earlier")
    with open_table(path) as table:
        table.frame(*make_interval(n=2500))
        assert path.read_text() == "earlier"
    assert pq.read_metadata(path).num_rows == 2500
    assert list(tmp_path.iterdir()) == [path]


def test_nothing_is_left_behind_on_error(tmp_path, make_interval):
    """When the replay fails no part of the table stays, and an earlier one does."""
    path = tmp_path / "odp.parquet"
    path.write_text("earlier")
    with pytest.raises(RuntimeError), open_table(path) as table:  # noqa: PT012  the error comes after a written group
        table.frame(*make_interval(n=2500))
        raise RuntimeError
    assert path.read_text() == "earlier"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("frames", [1, 20])
def test_full_disk(tmp_path, make_interval, frames):
    """A disk that fails, while rows are written or at the end, is a fault of the environment; no part stays."""
    intervals = [make_interval(first_sample=640 * i) for i in range(frames)]

    def write() -> None:
        with open_table(tmp_path / "odp.parquet") as table:
            for frame, odp in intervals:
                table.frame(frame, odp)

    with file_size_limit(2000), pytest.raises(EnvironmentFault, match=r"table cannot be written: .*odp\.parquet"):
        write()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("path", ["missing/odp.parquet", "."])
def test_a_file_that_cannot_be_created(tmp_path, path):
    """A path that cannot be written is the user's error, told before the replay starts."""
    with pytest.raises(InputError, match="cannot be written"):
        open_table(tmp_path / path)
    assert list(tmp_path.iterdir()) == []
