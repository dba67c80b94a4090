"""An archive replayed by one worker process and by two: how much sooner it is done, and whether the results are equal.

Recordings are simulated, the boring bar of ``config`` with another seed each. Each run is the command line with a data
set of its own, starting of processes included; rounds are taken in turns. What the machine did besides is told as its
load and as the processor time that the runs got, since two workers cannot be faster than the processors left to them.

Run: python -m benchmarks.archive [--recordings N] [--seconds S] [--rounds N]
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from chatter_monitor.service.modelling import simulate_to_file

MODEL = Path(__file__).parents[1] / "config/bar.model.toml"
TARGET = 1.8
RATE_HZ = 12_800


def run(folder: Path, out: Path, workers: int) -> tuple[float, float]:
    """Replay the archive; returns seconds that passed and seconds of processor time."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    began = time.perf_counter()
    command = [sys.executable, "-m", "chatter_monitor", "replay", "cuts", "--out", str(out), "--jobs", str(workers)]
    subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)
    elapsed = time.perf_counter() - began
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return elapsed, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


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
        print(f"{'workers':>8}{'elapsed s':>12}{'processor s':>13}{'x real time':>13}{'load before':>13}")
        ratios, reference = [], None
        for number in range(options.rounds):
            elapsed = {}
            for workers in (1, 2):
                load, out = os.getloadavg()[0], folder / f"out-{number}-{workers}"
                elapsed[workers], busy = run(folder, out, workers)
                times = options.recordings * options.seconds / elapsed[workers]
                print(f"{workers:8d}{elapsed[workers]:12.1f}{busy:13.1f}{times:13.0f}{load:13.2f}", flush=True)
                reference = reference or contents(out)
                if contents(out) != reference:
                    raise SystemExit("the results differ")
            ratios.append(elapsed[1] / elapsed[2])
    print(f"two workers: {statistics.median(ratios):.2f} times one (target {TARGET}); results equal, bit by bit")


if __name__ == "__main__":
    main()
