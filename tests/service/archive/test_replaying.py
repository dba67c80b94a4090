"""`replay --out`: an archive whole, killed half-way, on a cluster; always as if done one recording at a time.

A named pipe among the recordings holds up the worker that opens it, so that something can be killed in the midst.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from chatter_monitor.service.archive.dataset import open_table
from tests.pages import ROOT, blocks
from tests.replaying import replay
from tests.service.archive.cuts import NAMES, make, write

PROGRAM = (sys.executable, "-m", "chatter_monitor")
HELD = "held.wav"
PATIENCE_S = 200.0


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """Four recordings, a fifth beside them, and the data set of all five, done by one process."""
    folder = tmp_path_factory.mktemp("archive")
    make(folder / "cuts")
    write(folder / HELD, 1200.0)
    command = [*PROGRAM, "replay", "cuts", HELD, "--out", "expected", "--jobs", "1"]
    subprocess.run(command, cwd=folder, check=True, timeout=PATIENCE_S, capture_output=True)
    return folder


@pytest.fixture
def held(archive, tmp_path):
    """The same recordings elsewhere, but for one that never comes: its place is taken by a pipe."""
    shutil.copytree(archive / "cuts", tmp_path / "cuts")
    os.mkfifo(tmp_path / HELD)
    return tmp_path


def let_go(folder: Path, archive: Path) -> None:
    """Put the recording where the pipe is; who waits at the pipe goes on waiting."""
    shutil.copy(archive / HELD, folder / "copy.wav")
    (folder / HELD).rename(folder / "pipe")
    (folder / "copy.wav").rename(folder / HELD)


def wake(pipe: Path) -> None:
    """Let whoever waits at the pipe read nothing; nobody may."""
    os.close(os.open(pipe, os.O_RDWR | os.O_NONBLOCK))


def contents(out: Path) -> dict[str, bytes]:
    return {str(path.relative_to(out)): path.read_bytes() for path in out.rglob("*.parquet")}


def summaries(out: Path) -> list[Path]:
    return list(out.glob("summary/*/*.parquet"))


def wait_until(condition) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "it never came"
        time.sleep(0.01)


@contextmanager
def started(*command, cwd, log=os.devnull):
    """A program that is gone afterwards, whatever happens."""
    with open(log, "wb") as told:
        process = subprocess.Popen(command, cwd=cwd, stdout=told, stderr=subprocess.STDOUT)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def children(pid: int) -> list[int]:
    """Processes that a process has started, but for those that only look after others."""
    pids = [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    return [child for child in pids if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]


def alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_results_are_those_of_replay(archive, tmp_path):
    """Verdicts, ODPs and events of a recording are those that `replay --jsonl` writes for it."""
    outcome = replay(archive / "cuts" / NAMES[0], tmp_path)
    for kind in ("verdict", "odp", "event"):
        rows = open_table(archive / "expected", kind).to_table().to_pylist()
        mine = [row for row in rows if row.pop("source") == f"cuts/{NAMES[0]}"]
        assert mine == [{key: m[key] for key in m if key != "type"} for m in outcome.of(kind)]
        assert mine


def test_the_table_and_the_page(run, archive, monkeypatch):
    """Both name every recording, say how many chatter, and need nothing to be done again."""
    monkeypatch.chdir(archive)
    before = contents(archive / "expected")
    code, out, err = run("replay", "cuts", HELD, "--out", "expected")
    assert (code, err) == (0, "")
    assert "5 of 5 recordings chatter." in out
    page = (archive / "expected/report.html").read_text()
    for name in (*(f"cuts/{name}" for name in NAMES), HELD):
        assert name in out
        assert name in page
    assert contents(archive / "expected") == before


def test_the_page_on_archives_reads_the_results(archive, tmp_path):
    """The program in docs/archives.md finds the chatter."""
    (program,) = (block.text for block in blocks(ROOT / "docs/archives.md") if block.mark == "python")
    (tmp_path / "results").symlink_to(archive / "expected")
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True)
    states = open_table(archive / "expected", "verdict").to_table()["state"].to_pylist()
    assert done.stdout == f"{states.count('self_excited')} intervals of chatter\n"
    assert "self_excited" in states


def test_a_broken_recording_does_not_stop_the_rest(run, archive, tmp_path, monkeypatch):
    """It is told in the table, on the page, in JSON and by the exit code; mended, it is done the next time."""
    shutil.copytree(archive / "cuts", tmp_path / "cuts")
    shutil.copytree(archive / "expected", tmp_path / "out")
    (tmp_path / HELD).write_text("this is no sound")
    monkeypatch.chdir(tmp_path)
    code, out, err = run("replay", "cuts", HELD, "--out", "out", "--jobs", "1", "--json")
    assert code == 2
    assert "a recording could not be replayed; got 'held.wav'" in err
    told = json.loads(out)
    assert "not a sound file" in told["broken"][HELD]
    assert len(told["done"]) == 5  # what it once was is still there
    assert "not a sound file" in (tmp_path / "out/report.html").read_text()
    assert contents(tmp_path / "out") == contents(archive / "expected")


def test_what_cannot_be(run, archive, tmp_path, monkeypatch):
    """Options of a single recording, two ways to spread, other settings, a busy directory: refused before any work."""
    monkeypatch.chdir(archive)
    for code, reason, *options in (
        (2, "--pace does not go with --out", "--out", "expected", "--pace", "real"),
        (2, "--jsonl does not go with --out", "--out", "expected", "--jsonl", "x"),
        (2, "--jobs does not go with a single recording", "--jobs", "2"),
        (2, "Is a directory", *()),
        (2, "one of --jobs and --scheduler", "--out", "expected", "--jobs", "1", "--scheduler", "tcp://127.0.0.1:1"),
        (2, "no address of a Dask scheduler", "--out", tmp_path / "new", "--scheduler", "there"),
        (2, "results of other settings", "--out", "expected", "--spindle-rpm", "1000"),
        (2, "cannot be read", "--out", "expected", "--config", "absent.toml"),
        (3, "cannot be written", "--out", "/dev/null/out"),
    ):
        exit_code, out, err = run("replay", "cuts", *options)
        assert (exit_code, out) == (code, "")
        assert reason in err
        assert len(err.splitlines()) == 1


def test_the_client_killed_half_way(archive, held):
    """Killed with SIGKILL and run again, it does what is left and nothing twice; its workers end by themselves.

    Meanwhile nobody else may work in the directory.
    """
    command = (*PROGRAM, "replay", "cuts", HELD, "--out", "out", "--jobs", "1")
    workers: list[int] = []
    try:
        with started(*command, cwd=held) as client:
            wait_until(lambda: len(summaries(held / "out")) == len(NAMES))
            second = subprocess.run(command, cwd=held, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
            assert second.returncode == 3
            assert "another run is at work" in second.stderr
            workers = children(client.pid)
            client.send_signal(signal.SIGKILL)
            client.wait(PATIENCE_S)
        assert len(workers) == 1
        let_go(held, archive)
        wait_until(lambda: wake(held / "pipe") or not any(alive(pid) for pid in workers))
    finally:
        for pid in filter(alive, workers):
            os.kill(pid, signal.SIGKILL)
    done = {path: path.stat().st_mtime_ns for path in (held / "out").rglob("*.parquet")}
    subprocess.run(command, cwd=held, check=True, timeout=PATIENCE_S, capture_output=True)
    assert {path: path.stat().st_mtime_ns for path in done} == done
    assert contents(held / "out") == contents(archive / "expected")


def test_a_worker_killed(archive, held):
    """Killed with SIGKILL in the midst of a recording, a worker is replaced, and so is an idle one."""
    command = (*PROGRAM, "replay", "cuts", HELD, "--out", "out", "--jobs", "2")
    with started(*command, cwd=held) as client:
        wait_until(lambda: len(summaries(held / "out")) == len(NAMES))
        let_go(held, archive)
        for pid in children(client.pid):
            os.kill(pid, signal.SIGKILL)
        assert client.wait(PATIENCE_S) == 0
    assert contents(held / "out") == contents(archive / "expected")


def test_a_worker_of_a_cluster_killed(archive, held):
    """Of two workers of a real Dask cluster one is killed in the midst of a recording: the other one does it."""
    dask, file = (sys.executable, "-m", "dask"), held / "scheduler.json"
    here = ("--host", "127.0.0.1", "--dashboard-address", "127.0.0.1:0", "--scheduler-file", str(file))
    worker = (*dask, "worker", *here, "--nthreads", "1", "--no-nanny", "--local-directory", str(held))
    with started(*dask, "scheduler", *here, "--port", "0", cwd=held), started(*worker, cwd=held) as first:
        wait_until(lambda: file.exists() and file.read_text().endswith("}"))
        address = json.loads(file.read_text())["address"]
        command = (*PROGRAM, "replay", "cuts", HELD, "--out", "out", "--scheduler", address)
        with started(*command, cwd=held) as client:
            # As long as it is alone it does all the others, and is then held up.
            wait_until(lambda: len(summaries(held / "out")) == len(NAMES))
            log = held / "second.log"
            with started(*worker, cwd=held, log=log):
                wait_until(lambda: "Registered to" in log.read_text())
                let_go(held, archive)
                first.kill()
                assert client.wait(PATIENCE_S) == 0
    assert contents(held / "out") == contents(archive / "expected")
