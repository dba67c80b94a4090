"""JSON lines."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import msgspec
import pytest

from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.outlets.json_lines import JsonLines
from chatter_monitor.records import Event, Health, Odp, Verdict

LINE = msgspec.json.Decoder(Odp | Verdict | Event | Health)


def test_lines_parse_back_to_the_records(tmp_path, make_interval, messages):
    """Every line is a JSON object with its type first, and parses back to the record that was written."""
    path = tmp_path / "out.jsonl"
    frame, odp = make_interval()
    with JsonLines(path) as outlet:
        outlet.frame(frame, odp)
        for message in messages:
            outlet.message(message)
    lines = path.read_text().splitlines()
    assert [LINE.decode(line) for line in lines] == [odp, *messages]
    assert all(line.startswith('{"type":"') for line in lines)


def test_no_nan(tmp_path):
    """A number that is not finite is written as null."""
    path = tmp_path / "out.jsonl"
    verdict = Verdict(
        channel=0,
        t0=0.0,
        t1=0.05,
        sample0=0,
        sample1=640,
        state="idle",
        frequency_hz=math.nan,
        damping_ratio_ci95=(math.nan, math.inf),
    )
    with JsonLines(path) as outlet:
        outlet.message(verdict)
    line = msgspec.json.decode(path.read_bytes())
    assert line["frequency_hz"] is None
    assert line["damping_ratio_ci95"] == [None, None]


def test_health_brings_out_the_lines_before_it(tmp_path, messages):
    """Whoever follows the file has everything up to the last health message before the outlet is closed."""
    path = tmp_path / "out.jsonl"
    with JsonLines(path) as outlet:
        for message in messages:
            outlet.message(message)
        assert len(path.read_bytes().splitlines()) == len(messages)


def test_standard_output_is_left_open(capfdbinary, messages):
    """Without a path the lines go to standard output, which can still be used afterwards."""
    with JsonLines(None) as outlet:
        outlet.message(messages[0])
    sys.stdout.write("afterwards")
    line, rest = capfdbinary.readouterr().out.splitlines()
    assert LINE.decode(line) == messages[0]
    assert rest == b"afterwards"


@pytest.mark.parametrize("path", ["missing/out.jsonl", "."])
def test_a_file_that_cannot_be_created(tmp_path, path):
    """A path that cannot be written is the user's error, and is named."""
    with pytest.raises(InputError, match="cannot be written") as caught:
        JsonLines(tmp_path / path)
    assert str(tmp_path) in str(caught.value)


def test_full_disk(messages):
    """A full disk is a fault of the environment, and is named, whether it shows while writing or on closing."""
    outlet = JsonLines(Path("/dev/full"))
    outlet.message(messages[0])
    with pytest.raises(EnvironmentFault, match=r"No space left on device.*/dev/full"):
        outlet.message(messages[-1])
    with pytest.raises(EnvironmentFault, match="No space left on device"):
        outlet.close()
