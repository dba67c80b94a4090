"""Messages as Parquet tables."""

from __future__ import annotations

import json
import math

import numpy as np
import pyarrow.parquet as pq
import pytest

from chatter_monitor.errors import EnvironmentFault
from chatter_monitor.outlets.message_tables import ROWS_PER_GROUP, TABLES, MessageTable, MessageTables
from chatter_monitor.outlets.wire import encode
from chatter_monitor.records import Advice, Event, Mode, Odp
from tests.full_disk import file_size_limit
from tests.messages import event, health, verdict

VERDICT = verdict(0, "unknown", channel=1, reasons=["it begins"])
FULL = verdict(
    1,
    "self_excited",
    frequency_hz=np.float64(900.0),
    damping_ratio=math.nan,
    damping_ratio_ci95=(-0.01, 0.01),
    order=3.5,
    confidence=0.9,
    chatter_probability=0.05,
    margin_percent=-4.0,
    margin_percent_ci95=(-8.0, 1.0),
    flags=["clipped"],
)
ODP = Odp(channel=0, t=0.05, modes=[Mode(900.0, 0.01, (0.0, 0.02), 0.7), Mode(None, None, None, 0.3)])
EVENT = event(advice=[Advice(1500.0, 3)])


@pytest.fixture
def paths(tmp_path):
    return {table: tmp_path / table / "part.parquet" for table in TABLES}


def test_rows_are_the_json_lines(paths):
    """A row reads as the JSON line of its message, but for the type, which the table is called after."""
    with MessageTables(paths) as tables:
        tables.frame(None, ODP)
        for message in (VERDICT, FULL, EVENT, health()):
            tables.message(message)
    for table, messages in {"verdict": [VERDICT, FULL], "odp": [ODP], "event": [EVENT]}.items():
        expected = [json.loads(encode(message)) for message in messages]
        assert {message.pop("type") for message in expected} == {table}
        assert pq.read_table(paths[table]).to_pylist() == expected


def test_columns_are_there_without_rows(paths):
    """A recording without an event has a table of events with no rows and all columns."""
    with MessageTables(paths):
        pass
    table = pq.read_table(paths["event"])
    assert table.num_rows == 0
    assert tuple(table.column_names) == Event.__struct_fields__


def test_long_tables_come_in_groups(tmp_path):
    """Memory does not grow with the table: full groups are written on the way, and nothing is lost between them."""
    path = tmp_path / "long.parquet"
    with MessageTable(path, Odp) as table:
        for number in range(2 * ROWS_PER_GROUP + 1):
            table.append(Odp(channel=0, t=float(number), modes=[]))
    assert pq.ParquetFile(path).num_row_groups == 3
    assert pq.read_table(path)["t"].to_pylist() == [float(number) for number in range(2 * ROWS_PER_GROUP + 1)]


def test_what_is_not_complete_is_not_there(paths, tmp_path):
    """A run that fails leaves no table, neither whole nor in part."""
    with pytest.raises(ZeroDivisionError), MessageTables(paths) as tables:  # noqa: PT012  the point is what follows
        tables.message(VERDICT)
        assert not paths["verdict"].exists()
        raise ZeroDivisionError
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_a_place_that_cannot_be_written(tmp_path):
    """It is a fault of the environment, told with the path; the tables opened before leave nothing."""
    (tmp_path / "event").touch()
    paths = {table: tmp_path / table / "part.parquet" for table in TABLES}
    with pytest.raises(EnvironmentFault, match="cannot be written") as caught:
        MessageTables(paths)
    assert caught.value.got == str(paths["event"])
    assert [path for path in tmp_path.rglob("*.part*") if path.is_file()] == []


def test_a_disk_that_is_full(paths, tmp_path):
    """It is a fault of the environment, whenever it is noticed, and no part of a table stays."""

    def write():
        with MessageTables(paths) as tables:
            for number in range(2000):
                tables.frame(None, Odp(channel=0, t=number**0.5, modes=[]))

    with file_size_limit(4096), pytest.raises(EnvironmentFault, match="cannot be written"):
        write()
    left = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert [path for path in left if path.parent.name == "odp" or path.suffix == ".part"] == []
