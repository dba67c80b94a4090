"""The subscriber in C of docs/examples, compiled as it says, hears a replay as the replay's own files have it."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet
import pytest

from tests.pages import ROOT
from tests.system.components import need, need_header

pytestmark = [pytest.mark.system, pytest.mark.timeout(900)]

SOURCE = ROOT / "docs" / "examples" / "subscriber.c"
WAIT_S = 120.0
INTERVAL = 640
VERDICT = re.compile(r"verdict\.0 (\S+) s: (\w+) (\S+) Hz")
ODP = re.compile(r"odp\.0 sample (\d+), last row:(.*)")


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The program, built by the command that stands in it, without a warning."""
    need(cc="gcc")
    need_header("zmq.h", package="libzmq3-dev")
    need_header("cjson/cJSON.h", package="libcjson-dev")
    folder = tmp_path_factory.mktemp("program")
    (folder / SOURCE.name).write_text(SOURCE.read_text())
    command = re.search(r"\* +(cc .*?)  ", SOURCE.read_text())
    assert command is not None
    assert (
        command[1].replace("subscriber.c", "docs/examples/subscriber.c") in (ROOT / "docs/subscribing.md").read_text()
    )
    done = subprocess.run(command[1].split(), cwd=folder, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return folder / "subscriber"


def keys(folder: Path) -> tuple[str, list[str]]:
    """Certificates of a monitor and of a client that it lets in: configuration, and arguments of the client."""
    for arguments in (
        ["new", "server", "--directory", "server"],
        ["new", "logger", "--directory", "logger"],
        ["allow", "logger/logger.key", "--directory", "server"],
    ):
        subprocess.run([sys.executable, "-m", "chatter_monitor", "keys", *arguments], cwd=folder, check=True)
    lines = f'server_key = "{folder}/server/server.key_secret"\nallowed_clients = "{folder}/server/allowed"\n'
    return lines, [f"{folder}/server/server.key", f"{folder}/logger/logger.key_secret"]


@pytest.mark.parametrize("encrypted", [False, True])
def test_it_hears_what_the_replay_writes(program: Path, tmp_path: Path, encrypted: bool) -> None:
    """Every verdict and the last row of every frame come as they are, none is lost, and it ends by itself."""
    endpoint = f"ipc://{tmp_path}/published"
    tables, certificates = keys(tmp_path) if encrypted else ("", [])
    (tmp_path / "machine.toml").write_text(f'[publish]\nbind = "{endpoint}"\n{tables}')
    replay = ["replay", str(ROOT / "replay_data" / "bar_turning.flac"), "--config", "machine.toml"]
    replay += [
        "--spindle-rpm",
        "1685",
        "--publish",
        "--wait-subscriber",
        "60",
        "--jsonl",
        "out.jsonl",
        "--odp",
        "out.parquet",
    ]
    listening = subprocess.Popen(
        [program, endpoint, *certificates], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        subprocess.run(
            [sys.executable, "-m", "chatter_monitor", *replay], cwd=tmp_path, check=True, stdout=subprocess.DEVNULL
        )
        heard, said = listening.communicate(timeout=WAIT_S)
    finally:
        listening.kill()
        listening.wait()
    assert (listening.returncode, said) == (0, "0 messages lost\n")

    messages = [json.loads(line) for line in (tmp_path / "out.jsonl").read_text().splitlines()]
    verdicts = [message for message in messages if message["type"] == "verdict"]
    printed = [(float(t0), state, float(hz)) for t0, state, hz in VERDICT.findall(heard)]
    assert len(printed) == len(verdicts)
    for (t0, state, hz), verdict in zip(printed, verdicts, strict=True):
        assert t0 == pytest.approx(verdict["t0"], abs=0.006)
        assert state == verdict["state"]
        assert same(hz, verdict["frequency_hz"], 0.006)
    alarms = [t0 for t0, state, _ in printed if state == "self_excited"]
    assert 5.95 < min(alarms) < max(alarms) < 16.0  # in truth it is unstable from 5.95 s to 14.05 s

    table = pyarrow.parquet.read_table(tmp_path / "out.parquet")
    rows = ODP.findall(heard)
    assert len(rows) == len(verdicts)
    for name, at, tolerance in (("frequency_hz", 0, 0.006), ("damping_ratio", 2, 6e-6)):
        for mode in range(4):
            column = table[f"{name}_{mode}"].to_pylist()
            for first, row in rows:
                assert same(float(row.split()[3 * mode + at]), column[int(first) + INTERVAL - 1], tolerance)


def same(printed: float, written: float | None, tolerance: float) -> bool:
    """Whether two values agree, where no value is NaN in one form and null or NaN in the other."""
    if written is None or math.isnan(written):
        return math.isnan(printed)
    return abs(printed - written) <= tolerance
