"""How the cost grows: with channels, with length, with the sample rate, with the model's order.

The whole chain, from samples to messages, as the monitor runs it, told the spindle speed; each run in a process of its
own. The signal is the cut of the demonstration, again and again, in and out of chatter.

Run: python -m benchmarks.growth [--rounds N]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from itertools import pairwise
from multiprocessing import get_context

import numpy as np
import soxr

from benchmarks.clockwork import RATE_HZ, cut
from benchmarks.memory import resident_mb
from benchmarks.results import Growth
from benchmarks.tracker_speed import FORGETTING, signal
from chatter_monitor.acquisition.resample import Resampled
from chatter_monitor.acquisition.synthetic import Synthetic
from chatter_monitor.config import Settings
from chatter_monitor.kernels import track
from chatter_monitor.service.heap import keep_flat
from chatter_monitor.service.monitor import Monitor
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.tracking.tracker import TrackerSettings

CHANNELS = (1, 2, 4, 8, 16, 32, 64)
LENGTHS_S = (20.0, 40.0, 80.0, 160.0, 320.0)  # whole cuts
RATES_HZ = (12_800.0, 25_600.0, 51_200.0)
ORDERS = ((2, 1), (4, 3), (6, 5), (8, 6))
SECONDS = 10.0
BLOCK_S = 0.32
SPINDLE = SpindleSettings(speed_rpm=1685.0, teeth=1)
TARGET = 1.05  # exponent in channels and in length


@dataclass(frozen=True)
class Run:
    """What the chain is to be run on.

    Attributes
    ----------
    channels : int
        Of the signal.
    at_s : tuple of float
        Seconds of signal after which cost and memory are read; the last one ends the run.
    source_rate_hz : float
        Rate of the signal.
    tracker : TrackerSettings
        The tracker's rate, which the signal is converted to, and its orders.
    """

    channels: int = 1
    at_s: tuple[float, ...] = (SECONDS,)
    source_rate_hz: float = RATE_HZ
    tracker: TrackerSettings = field(default_factory=TrackerSettings)

    def signal(self) -> Synthetic:
        """The cut again and again."""
        samples = cut(self.channels)
        if self.source_rate_hz != RATE_HZ:
            samples = soxr.resample(samples, RATE_HZ, self.source_rate_hz)
        return Synthetic(
            lambda index: samples[index % len(samples)].astype(np.float64),
            self.source_rate_hz,
            channels=self.channels,
            length=round(self.at_s[-1] * self.source_rate_hz),
            block_samples=round(BLOCK_S * self.source_rate_hz),
        )


@dataclass(frozen=True)
class Reading:
    """Processor seconds since the first sample, and memory gained since before the monitor was made."""

    seconds: float
    resident_mb: float


def measure(run: Run) -> list[Reading]:
    """Run the chain; one reading for each of `at_s`."""
    keep_flat()
    heard = run.signal()
    before_mb = resident_mb()
    monitor = Monitor(
        Settings(spindle=SPINDLE, tracker=run.tracker),
        Resampled(heard, run.tracker.sample_rate_hz),
        [],
        counts=heard,
        source_rate_hz=run.source_rate_hz,
        session="growth",
        clock=time.monotonic,
    )
    readings: list[Reading] = []
    began = time.process_time()
    due = [round(at_s * run.tracker.sample_rate_hz) for at_s in run.at_s]
    for done in monitor.run():
        while len(readings) < len(due) and done >= due[len(readings)]:
            readings.append(Reading(time.process_time() - began, resident_mb() - before_mb))
    return readings


def in_own_process(run: Run) -> list[Reading]:
    """Measure with nothing left behind by other runs; what this process has loaded need not be loaded again."""
    with ProcessPoolExecutor(1, mp_context=get_context("fork")) as process:
        return process.submit(measure, run).result()


def recursion_seconds(orders: tuple[int, int]) -> float:
    """Processor seconds of one recursion with standard deviations for a second of signal."""
    p, q = orders
    samples = signal(round(SECONDS * RATE_HZ))
    out = (
        *(np.empty((1, p // 2, len(samples)), np.float32) for _ in range(4)),
        np.empty((1, p // 2, len(samples)), np.uint8),
    )
    began = time.process_time()
    track.track(p, q, samples[None], track.new_state(p, q, np.array([FORGETTING]), np.array([RATE_HZ]), 0), out)
    return time.process_time() - began


def least(rounds: Iterable[list[Reading]]) -> tuple[list[float], list[float]]:
    """Least seconds and least memory of all rounds, reading by reading."""
    readings = list(zip(*rounds, strict=True))
    return [min(r.seconds for r in same) for same in readings], [min(r.resident_mb for r in same) for same in readings]


def chain_along(along: str, at: Iterable[float], run: Callable[[float], Run], rounds: int) -> Growth:
    """Cost of the chain at each value, one run for each."""
    at = list(at)
    found = [[in_own_process(run(value))[-1] for value in at] for _ in range(rounds)]
    seconds, memory_mb = least(found)
    return Growth("chain", along, at, seconds, memory_mb)


def growths(rounds: int) -> list[Growth]:
    """All of them."""
    measure(Run(at_s=(1.0,)))  # loads the kernels
    seconds, memory_mb = least(in_own_process(Run(at_s=LENGTHS_S)) for _ in range(rounds))
    recursions = [[recursion_seconds(orders) for orders in ORDERS] for _ in range(rounds + 1)][1:]  # the first compiles
    coefficients = [float(sum(orders)) for orders in ORDERS]
    by_coefficients = dict(zip(coefficients, ORDERS, strict=True))
    return [
        chain_along("channels", CHANNELS, lambda channels: Run(channels=int(channels)), rounds),
        Growth("chain", "seconds of signal", list(LENGTHS_S), seconds, memory_mb),
        chain_along(
            "rate of the tracker, Hz",
            RATES_HZ,
            lambda rate: Run(source_rate_hz=rate, tracker=TrackerSettings(sample_rate_hz=rate)),
            rounds,
        ),
        chain_along("rate of the recording, Hz", RATES_HZ, lambda rate: Run(source_rate_hz=rate), rounds),
        Growth("one recursion", "coefficients of the model", coefficients, np.min(recursions, axis=0).tolist()),
        chain_along(
            "coefficients of the model",
            coefficients,
            lambda count: Run(tracker=TrackerSettings(orders=by_coefficients[count])),
            rounds,
        ),
    ]


def report(found: Iterable[Growth]) -> None:
    """Print cost and memory at each value, the exponents, and whether the targets are met."""
    for growth in found:
        print(f"\n{growth.cost} by {growth.along}: exponent {growth.exponent:.2f}")
        memory = growth.resident_mb or [float("nan")] * len(growth.at)
        for at, seconds, resident in zip(growth.at, growth.seconds, memory, strict=True):
            print(f"{at:10g} {seconds:10.2f} s {resident:10.1f} MB")
        if growth.along in ("channels", "seconds of signal"):
            print(f"  target: at most {TARGET}: {'' if growth.exponent <= TARGET else 'NOT '}met")
        if growth.along == "seconds of signal":
            steps = [after / before - 1 for before, after in pairwise(memory)]
            print(f"  memory by doubling: {', '.join(f'{100 * step:+.1f} %' for step in steps)}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=2)
    report(growths(parser.parse_args().rounds))


if __name__ == "__main__":
    main()
