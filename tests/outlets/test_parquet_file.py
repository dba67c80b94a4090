"""Parquet files that are there whole or not at all."""

from __future__ import annotations

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from chatter_monitor.errors import EnvironmentFault
from chatter_monitor.outlets import parquet_file
from chatter_monitor.outlets.parquet_file import ParquetFile
from tests.full_disk import file_size_limit

ROWS = pa.table({"t": [0.5, 1.5]})


def test_the_disk_has_it_before_it_has_its_name(tmp_path, monkeypatch):
    """A power failure finds the old file or the whole new one: the content is synchronised first, then the name."""
    path = tmp_path / "table.parquet"
    story = []

    def synchronise(what):
        if what == tmp_path:
            story.append(("names", path.exists()))
        else:
            story.append((pq.read_table(what).to_pylist(), path.exists()))

    monkeypatch.setattr(parquet_file, "synchronise", synchronise)
    with ParquetFile(path, ROWS.schema) as file:
        file.write(ROWS)
    assert story == [(ROWS.to_pylist(), False), ("names", True)]


def test_two_processes_at_one_file(tmp_path):
    """Whoever is done last has the name; neither sees the other's rows."""
    path = tmp_path / "table.parquet"
    with ParquetFile(path, ROWS.schema) as mine:
        mine.write(ROWS)
        with ParquetFile(path, ROWS.schema) as theirs:
            theirs.write(ROWS.slice(1))
        assert pq.read_table(path).num_rows == 1
    assert pq.read_table(path).num_rows == 2
    assert list(tmp_path.iterdir()) == [path]


def test_closing_again_does_nothing(tmp_path):
    """A file that is complete stays as it is, and one that failed does not come back."""
    path = tmp_path / "table.parquet"
    file = ParquetFile(path, ROWS.schema)
    file.close()
    file.close()
    path.unlink()
    failing = ParquetFile(path, ROWS.schema)
    with file_size_limit(2), pytest.raises(EnvironmentFault, match="cannot be written"):
        failing.close()
    failing.close()
    assert list(tmp_path.iterdir()) == []
