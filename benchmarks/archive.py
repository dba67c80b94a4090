"""An archive replayed by one worker process and by two: how much sooner it is done, and whether the results are equal.

Recordings are simulated, the boring bar of ``config`` with another seed each. Each run is the command line with a data
set of its own, starting of processes included; rounds are taken in turns. Two workers cannot be faster than the
processors that other programs leave to them, so processor time is taken as well: the client's, and then half of the
workers', who take a recording each as they are ready for it, is an estimate of what passes when nobody else wants the
processors. It is no measurement: on a busy machine processor time itself grows.

Run: python -m benchmarks.archive [--recordings N] [--seconds S] [--rounds N]
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from chatter_monitor.service.modelling import simulate_to_file

MODEL = Path(__file__).parents[1] / "config/bar.model.toml"
TARGET = 1.8
RATE_HZ = 12_800
LOOK_S = 0.05


class Run(NamedTuple):
    """Seconds that passed, and of processor time of the client and of all workers."""

    elapsed_s: float
    client_s: float
    workers_s: float


def processor_s(pid: int) -> float:
    """Processor time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def replay(folder: Path, out: Path, workers: int) -> Run:
    """Replay the archive; processes are looked at until they end."""
    command = [sys.executable, "-m", "chatter_monitor", "replay", "cuts", "--out", str(out), "--jobs", str(workers)]
    busy: dict[int, float] = {}
    began = time.perf_counter()
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL) as client:
        while client.poll() is None:
            with suppress(FileNotFoundError, ProcessLookupError):
                children = Path(f"/proc/{client.pid}/task/{client.pid}/children").read_text().split()
                for pid in (client.pid, *map(int, children)):
                    busy[pid] = processor_s(pid)
            time.sleep(LOOK_S)
        elapsed_s = time.perf_counter() - began
        if client.returncode:
            raise SystemExit(client.returncode)
    own_s = busy.pop(client.pid)
    return Run(elapsed_s, own_s, sum(busy.values()))


def contents(out: Path) -> dict[str, bytes]:
    """Every table of a data set."""
    return {str(path.relative_to(out)): path.read_bytes() for path in out.rglob("*.parquet")}


def main() -> None:
    """Simulate, replay in turns, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--recordings", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        (folder / "cuts").mkdir()
        for seed in range(options.recordings):
            simulate_to_file(MODEL, options.seconds, seed, folder / f"cuts/{seed:03d}.wav", RATE_HZ)
        print(f"{options.recordings} recordings of {options.seconds:g} s, {os.cpu_count()} processors")
        print(f"{'workers':>8}{'elapsed s':>12}{'client s':>12}{'workers s':>12}{'load before':>13}")
        ratios, reference = [], None
        for number in range(options.rounds):
            runs = {}
            for workers in (1, 2):
                load, out = os.getloadavg()[0], folder / f"out-{number}-{workers}"
                runs[workers] = run = replay(folder, out, workers)
                times = "".join(f"{seconds:12.1f}" for seconds in run)
                print(f"{workers:8d}{times}{load:13.2f}", flush=True)
                reference = reference or contents(out)
                if contents(out) != reference:
                    raise SystemExit("the results differ")
            one, two = runs[1], runs[2]
            estimated = (one.client_s + one.workers_s) / (two.client_s + two.workers_s / 2.0)
            ratios.append((one.elapsed_s / two.elapsed_s, estimated))
    elapsed, estimated = (statistics.median(column) for column in zip(*ratios, strict=True))
    print(f"two workers are {elapsed:.2f} times one, {estimated:.2f} times by processor time (target {TARGET})")
    print("results equal, bit by bit")


if __name__ == "__main__":
    main()
