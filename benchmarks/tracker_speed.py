"""What a sample costs, next to yardsticks timed in the same run, in turns.

The yardstick is the plain C arithmetic of one RARMA(4, 3) step with poles, damping and frequency (no standard
deviations, no guards), compiled on the spot. Its source is looked for in ../shared/limits; where it is absent, or there
is no compiler, that row is left out and said so.

Run: python -m benchmarks.tracker_speed [--rounds N]
"""

from __future__ import annotations

import argparse
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import padasip
from numba import njit
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.tracker_accuracy import autoregression
from chatter_monitor.kernels import odp, track
from chatter_monitor.kernels.options import OPTIONS
from tests import naive

ROOT = Path(__file__).resolve().parents[1]
YARDSTICK = ROOT.parent / "shared" / "limits" / "rarma_limit.c"
# It asks for the time by the clock, in which other work on the machine counts as its own.
PROCESSOR_TIME = "#include <time.h>\n#undef CLOCK_MONOTONIC\n#define CLOCK_MONOTONIC CLOCK_PROCESS_CPUTIME_ID\n"
RATE_HZ = 12800.0
FORGETTING = 1 - 1 / 1024
RECORDING = ROOT / "replay_data" / "bar_turning.flac"


def signal(n: int) -> NDArray[np.float64]:
    """Two modes driven by white noise."""
    a = autoregression([(400, 0.03), (2000, 0.02)])
    return np.asarray(lfilter([1.0, -1.1, 0.55, -0.125], a, np.random.default_rng(1).standard_normal(n)))


def nanoseconds(run: Callable[[NDArray[np.float64]], object], samples: NDArray[np.float64]) -> float:
    """Nanoseconds of processor time per sample of one run."""
    began = time.process_time()
    run(samples)
    return (time.process_time() - began) / len(samples) * 1e9


def tracker(samples: NDArray[np.float64]) -> None:
    """Everything: recursion, poles, damping, frequency, standard deviations, status."""
    out = (*(np.empty((1, 2, len(samples)), np.float32) for _ in range(4)), np.empty((1, 2, len(samples)), np.uint8))
    track.track(4, 3, samples[None], track.new_state(4, 3, np.array([FORGETTING]), np.array([RATE_HZ]), 0), out)


def two_trackers(samples: NDArray[np.float64]) -> None:
    """Both halves of a signal side by side, as two octaves of a channel go."""
    halves = samples.reshape(2, -1)
    out = (*(np.empty((2, *halves.shape), np.float32) for _ in range(4)), np.empty((2, *halves.shape), np.uint8))
    track.track(4, 3, halves, track.new_state(4, 3, np.full(2, FORGETTING), np.full(2, RATE_HZ), 0), out)


def values_from_poles(samples: NDArray[np.float64]) -> None:
    """The part of the tracker that the yardstick lacks most of: frequency, damping, standard deviations from poles."""
    tile = odp.new_tile(4)
    for mode, factor in enumerate([(-1.9, 0.95), (-1.0, 0.9)]):
        begin = odp.factor_row(mode)
        tile[begin : begin + 2 * odp.TILE] = np.repeat(factor, odp.TILE)
    _evaluate(tile, len(samples) // odp.TILE)


@njit(**OPTIONS)
def _evaluate(tile: NDArray[np.float64], times: int) -> None:
    """Evaluate both modes of a tile again and again."""
    for _ in range(times):
        for mode in range(2):
            odp.evaluate(4, mode, tile)


def numpy_loop(samples: NDArray[np.float64]) -> None:
    """The naive twin: the same recursion and poles in NumPy, one Python iteration a sample."""
    twin = naive.NaiveRarma(4, 3, FORGETTING)
    for sample in samples:
        twin.step(float(sample))
        np.roots([1, *twin.theta[3:]])


def padasip_rls(samples: NDArray[np.float64]) -> None:
    """Padasip's recursive least squares on four lags: AR only, no poles, no confidence."""
    lags = np.lib.stride_tricks.sliding_window_view(samples, 4)[:-1]
    padasip.filters.FilterRLS(4, mu=FORGETTING).run(samples[4:], lags)


def compile_yardstick(folder: Path, lanes: int = 1) -> Path | None:
    """Compiled C yardstick of so many channels side by side in vector lanes, or None with a word on why not."""
    if not YARDSTICK.exists() or shutil.which("gcc") is None:
        print("no C yardstick here: the comparison with C is left out")
        return None
    program = folder / f"yardstick_{lanes}"
    command = ["gcc", "-O3", "-march=native", f"-DL={lanes}", "-x", "c", "-", "-o", program, "-lm"]
    subprocess.run(command, input=PROCESSOR_TIME + f'#include "{YARDSTICK}"\n', text=True, check=True)
    return program


def yardstick_nanoseconds(program: Path) -> float:
    """Nanoseconds of processor time per sample that the yardstick prints."""
    text = subprocess.run([program], check=True, capture_output=True, text=True).stdout
    match = re.search(r"per channel-sample ([\d.]+)", text)
    if match is None:
        raise RuntimeError(text)
    return float(match[1])


def replay_speed(folder: Path) -> tuple[float, float]:
    """Seconds of signal per second of one whole replay with JSON lines and Parquet: of the process, and of its loop."""
    command = [sys.executable, "-m", "benchmarks.tracker_speed", "--one-replay", str(folder)]
    text = subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT).stdout
    loop, whole = text.split()[-2:]
    return float(whole), float(loop)


def one_replay(folder: Path) -> None:
    """Child process: replay two minutes of sound, print the speed of the second run (loop) and of that run in all."""
    import soundfile

    from chatter_monitor.config import load
    from chatter_monitor.service.replay import Replay

    samples, rate = soundfile.read(RECORDING)
    long = folder / "long.wav"
    soundfile.write(long, np.tile(samples, 6), rate)
    seconds = 6 * len(samples) / rate
    job = Replay(file=long, settings=load([]), jsonl=folder / "out.jsonl", odp_table=folder / "out.parquet")
    job.run(as_json=True)
    began, cpu = time.perf_counter(), time.process_time()
    job.run(as_json=True)
    print(seconds / (time.perf_counter() - began), seconds / (time.process_time() - cpu))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--one-replay", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one_replay:
        one_replay(arguments.one_replay)
        return
    samples = signal(500_000)
    tracker(samples[:1000])  # compile
    with tempfile.TemporaryDirectory() as name:
        program = compile_yardstick(Path(name))
        ours, theirs = [], []
        for _ in range(arguments.rounds):
            ours.append(nanoseconds(tracker, samples))
            if program is not None:
                theirs.append(yardstick_nanoseconds(program))
        print(f"{'':38}ns per sample (least, median of {arguments.rounds})   ratio to C (median of pairs)")
        ratio = f"{statistics.median(a / b for a, b in zip(ours, theirs, strict=True)):.2f}" if theirs else "-"
        print(f"{'tracker, poles, standard deviations':38}{min(ours):8.0f} {statistics.median(ours):8.0f} {ratio:>24}")
        part = min(nanoseconds(values_from_poles, samples) for _ in range(arguments.rounds))
        print(f"{'  of that: values and deviations':38}{part:8.0f}")
        if theirs:
            print(f"{'C yardstick (no standard deviations)':38}{min(theirs):8.0f} {statistics.median(theirs):8.0f}")
        for label, peer, n in (
            ("NumPy loop (naive twin)", numpy_loop, 3000),
            ("padasip RLS, AR(4)", padasip_rls, 20_000),
        ):
            cost = nanoseconds(peer, samples[:n])
            print(f"{label:38}{cost:8.0f} {'':8} {cost / min(ours):15.0f} times the tracker")
        whole, loop = replay_speed(Path(name))
        print(
            f"replay --pace fast, one channel, JSON lines and Parquet: {whole:.0f} times real time by the process's CPU"
        )
        print(f"time on all its threads, {loop:.0f} times by the clock")


if __name__ == "__main__":
    main()
