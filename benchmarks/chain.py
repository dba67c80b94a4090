"""What one channel costs from samples to verdicts, stage by stage, next to the recursion alone and the C yardstick.

Simulated cuts of the development split (`benchmarks.verdict`), told their speed or not, and silence. Stages are run one
after the other on what the stage before gave, the whole chain runs in one; all of that in turns, least processor time
of each. A stage's share is that of the stages' sum, which the whole should come to. Then interval by interval, as a
live signal comes: how long the verdict takes, and what is done when it is out (`Channel.digest`); the least of all
rounds for each interval, by the clock. And how long the program takes to its first line, by the clock.

Run: python -m benchmarks.chain [--cuts N] [--rounds N]
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from benchmarks.tracker_speed import compile_yardstick, signal, tracker, yardstick_nanoseconds
from benchmarks.verdict.generator import cut
from chatter_monitor.records import Verdict
from chatter_monitor.tracking.channel import Channel, Observation, lines_of
from chatter_monitor.tracking.margin_tracker import MarginSettings, MarginTracker
from chatter_monitor.tracking.orders import Orders, OrderSettings, OrderTracker
from chatter_monitor.tracking.spectrum import Spectrum
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.tracking.tracker import INTERVAL_S, Tracker, TrackerSettings
from chatter_monitor.verdict.evidence import weigh
from chatter_monitor.verdict.judge import Judge
from chatter_monitor.verdict.settings import JudgeSettings

RATE_HZ = 12800.0
BLOCK = 32768
SILENCE_S = 20.0
TARGET = 60.0  # times real time
FRAME = round(INTERVAL_S * RATE_HZ)
T = TypeVar("T")
Samples = NDArray[np.float64]
Case = tuple[Samples, SpindleSettings]


class Stopwatch:
    """Processor time by name, summed over the cases of a round; the least of all rounds is kept."""

    def __init__(self) -> None:
        self._round: dict[str, float] = defaultdict(float)
        self.least_s: dict[str, float] = {}

    def time(self, name: str, run: Callable[[], T]) -> T:
        """Add the time of a call."""
        began = time.process_time()
        result = run()
        self._round[name] += time.process_time() - began
        return result

    def end_round(self) -> None:
        """Keep what was faster than before."""
        for name, seconds in self._round.items():
            self.least_s[name] = min(seconds, self.least_s.get(name, seconds))
        self._round.clear()


def blocks(samples: Samples) -> Iterable[tuple[int, Samples]]:
    """Yield a signal as a replay does."""
    return ((first, samples[first : first + BLOCK]) for first in range(0, len(samples), BLOCK))


def judge(observations: Iterable[Observation], spindle: SpindleSettings) -> list[Verdict]:
    """Verdict of each interval."""
    following = Judge(JudgeSettings(), interval_s=INTERVAL_S)
    return [
        following.verdict(weigh(seen, spindle), seen.odp.first_sample, len(seen.odp), RATE_HZ) for seen in observations
    ]


def whole(samples: Samples, spindle: SpindleSettings) -> list[Verdict]:
    """Run the chain as the monitor does."""
    channel = Channel(TrackerSettings(), OrderSettings(), spindle)
    following = Judge(JudgeSettings(), interval_s=INTERVAL_S)
    verdicts = []
    for block in blocks(samples):
        for seen, evidence in [(seen, weigh(seen, spindle)) for seen in channel.process(*block)]:
            verdicts.append(following.verdict(evidence, seen.odp.first_sample, len(seen.odp), RATE_HZ))
    return verdicts


def by_stage(watch: Stopwatch, samples: Samples, spindle: SpindleSettings) -> list[Verdict]:
    """Run the same, stage by stage."""
    orders = OrderTracker(OrderSettings(), RATE_HZ, spindle)
    turned: list[Orders] = []

    def residual() -> list[tuple[int, Samples]]:
        left = []
        for first, block in blocks(samples):
            rest, frames = orders.process(first, block)
            left.append((first, rest))
            turned.extend(frames)
        return left

    rest = watch.time("orders", residual)
    tracking = Tracker(TrackerSettings())
    frames = watch.time("recursions", lambda: [frame for block in rest for frame in tracking.process(*block)])
    spectrum = Spectrum(RATE_HZ, round(INTERVAL_S * RATE_HZ))
    lines = watch.time("lines", lambda: [lines_of(spectrum, f, o) for f, o in zip(frames, turned, strict=True)])
    margins = MarginTracker(MarginSettings(), RATE_HZ, spindle.teeth)

    def margin_of(frame: Samples, seen: Orders) -> list[object]:
        return [*margins.process(frame, *seen.spindle)]

    found = watch.time("margin", lambda: [margin_of(f.signal, o) for f, o in zip(frames, turned, strict=True)])
    seen = [
        Observation(frame, order, line, cutting, margin[-1], *engaged)  # type: ignore[arg-type]
        for frame, order, (line, cutting, *engaged), margin in zip(frames, turned, lines, found, strict=True)
    ]
    return watch.time("verdict", lambda: judge(seen, spindle))


def report(name: str, cases: list[Case], rounds: int, recursion_ns: float, yardstick_ns: float | None) -> float:
    """Measure one kind of signal and print its row; returns how many times faster than real time it is."""
    watch = Stopwatch()
    for _ in range(rounds):
        for samples, spindle in cases:
            verdicts = watch.time("whole", lambda samples=samples, spindle=spindle: whole(samples, spindle))
            if by_stage(watch, samples, spindle) != verdicts:
                raise RuntimeError("the stages one by one say something else than the chain")
        watch.end_round()
    samples = sum(len(samples) for samples, _ in cases)
    total = watch.least_s.pop("whole")
    stages = sum(watch.least_s.values())
    ns = total / samples * 1e9
    speed = 1e9 / (ns * RATE_HZ)
    yardstick = "-" if yardstick_ns is None else f"{ns / yardstick_ns:.1f}"
    shares = "".join(f"{100 * seconds / stages:10.0f} %" for seconds in watch.least_s.values())
    print(f"{name:16}{speed:8.0f}{ns:10.0f}{ns / recursion_ns:12.1f}{yardstick:>8}{shares}")
    return speed


def each_interval_s(samples: Samples, spindle: SpindleSettings) -> Samples:
    """Seconds until the verdict of each interval, and for what is done after it: shape (intervals, 2)."""
    channel, following = Channel(TrackerSettings(), OrderSettings(), spindle), Judge(JudgeSettings())
    took = []
    for first in range(0, len(samples) - FRAME + 1, FRAME):
        began = time.perf_counter()
        for seen in channel.process(first, samples[first : first + FRAME]):
            following.verdict(weigh(seen, spindle), first, FRAME, RATE_HZ)
        told = time.perf_counter()
        channel.digest()
        took.append((told - began, time.perf_counter() - told))
    return np.array(took)


def report_intervals(name: str, cases: list[Case], rounds: int) -> None:
    """Measure single intervals of one kind of signal and print their row."""
    least = [np.min([each_interval_s(*case) for _ in range(rounds)], axis=0) for case in cases]
    verdict_ms, after_ms = 1e3 * np.concatenate(least).T
    columns = [f(part) for part in (verdict_ms, after_ms) for f in (np.mean, lambda ms: np.percentile(ms, 99), np.max)]
    print(f"{name:16}{''.join(f'{value:8.2f}' for value in columns)}")


def first_line_s(*arguments: str) -> float:
    """Seconds until the program prints its first line: the least of three starts."""
    took = []
    for _ in range(3):
        began = time.perf_counter()
        command = [sys.executable, "-m", "chatter_monitor", *arguments]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
            if process.stdout is not None:
                process.stdout.readline()
            took.append(time.perf_counter() - began)
            process.kill()
    return min(took)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cuts", type=int, default=6)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    cuts = [cut("development", number) for number in range(arguments.cuts)]
    whole(cuts[0].samples, SpindleSettings(speed_rpm=cuts[0].nominal_rpm, teeth=cuts[0].teeth))  # compile
    noise = signal(500_000)
    tracker(noise[:1000])
    watch, yardstick_ns = Stopwatch(), None
    with tempfile.TemporaryDirectory() as name:
        program = compile_yardstick(Path(name))
        for _ in range(arguments.rounds):
            watch.time("recursion", lambda: tracker(noise))
            watch.end_round()
            if program is not None:
                yardstick_ns = min(yardstick_ns or np.inf, yardstick_nanoseconds(program))
    recursion_ns = watch.least_s["recursion"] / len(noise) * 1e9
    print(f"one recursion: {recursion_ns:.0f} ns a sample; the chain has one for each octave, 1.875 for each sample")
    if yardstick_ns is not None:
        print(f"C yardstick of one recursion, without standard deviations: {yardstick_ns:.0f} ns a sample")
    stages = ("orders", "recursions", "lines", "margin", "verdict")
    print(f"{'':16}{'x real':>8}{'ns':>10}{'recursions':>12}{'C':>8}{''.join(f'{stage:>12}' for stage in stages)}")
    rows = {
        "speed known": [(c.samples, SpindleSettings(speed_rpm=c.nominal_rpm, teeth=c.teeth)) for c in cuts],
        "speed unknown": [(c.samples, SpindleSettings()) for c in cuts],
        "silence": [(np.zeros(round(SILENCE_S * RATE_HZ)), SpindleSettings())],
    }
    speeds = [report(name, cases, arguments.rounds, recursion_ns, yardstick_ns) for name, cases in rows.items()]
    print(
        f"target: {TARGET:.0f} times real time for one channel on one core: {'' if min(speeds) > TARGET else 'NOT '}met"
    )
    print("\nms for an interval: until the verdict, and after it (mean, p99, longest)")
    for name, cases in rows.items():
        report_intervals(name, cases, arguments.rounds)
    recording = str(Path(__file__).parents[1] / "replay_data/bar_turning.flac")
    warm = first_line_s("replay", recording, "--jsonl", "/dev/stdout")
    print(f"--help after {first_line_s('--help'):.2f} s (target 0.3), a first result after {warm:.2f} s (target 2)")


if __name__ == "__main__":
    main()
