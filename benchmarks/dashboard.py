"""The dashboard's memory over half an hour of signal, and what it costs the monitor.

A replay of chatter is kept and published over and over, faster than life, to a dashboard process that serves viewers
and is killed and started again on the way. Reported are the process's memory against what it was told to keep, and the
time that publishing an interval takes with and without somebody who looks at the signal. Then the same recording is
replayed at real time, in turns with and without a dashboard, and the latencies of its blocks are compared.

Run: python -m benchmarks.dashboard
"""

from __future__ import annotations

import contextlib
import io
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

import click
import msgspec
import numpy as np

from chatter_monitor.config import load
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.outlets.publisher import Clock, Publisher, PublishSettings
from chatter_monitor.records import Announcement, Block, Event, Health, Odp, OdpFrame, Verdict
from chatter_monitor.service.replay import Replay
from chatter_monitor.tracking.orders import Orders

RECORDING = Path(__file__).parents[1] / "replay_data/bar_turning.flac"
SPINDLE = {"spindle": {"speed_rpm": 1685.0}}
RATE_HZ = 12_800.0
INTERVAL = 640
PROGRAM = (sys.executable, "-m", "chatter_monitor")


@dataclass
class Kept(Outlet):
    """Everything that a replay gives its outlets."""

    blocks: list[Block] = field(default_factory=list)
    orders: list[Orders] = field(default_factory=list)
    frames: list[tuple[OdpFrame, Odp]] = field(default_factory=list)
    messages: list[Verdict | Event | Health] = field(default_factory=list)

    def block(self, block: Block) -> None:
        """Keep it."""
        self.blocks.append(block)

    def turning(self, _channel: int, orders: Orders) -> None:
        """Keep it."""
        self.orders.append(orders)

    def frame(self, frame: OdpFrame, odp: Odp) -> None:
        """Keep it."""
        self.frames.append((frame, odp))

    def message(self, message: Announcement) -> None:
        """Keep it, but for the end."""
        if not (isinstance(message, Health) and message.state == "finished"):
            self.messages.append(message)

    def close(self) -> None:
        """Nothing."""


def kept() -> Kept:
    """Replay the recording once."""
    outlet = Kept()
    with contextlib.redirect_stdout(io.StringIO()):
        Replay(file=RECORDING, settings=load([], SPINDLE), witnesses=(outlet,)).run(as_json=True)
    return outlet


def later(message: Verdict | Event | Health, seconds: float) -> Verdict | Event | Health:
    """The same message, so much later."""
    shift = round(seconds * RATE_HZ)
    match message:
        case Verdict():
            moved = {"t0": message.t0 + seconds, "t1": message.t1 + seconds}
            return msgspec.structs.replace(
                message, **moved, sample0=message.sample0 + shift, sample1=message.sample1 + shift
            )
        case Event():
            return msgspec.structs.replace(message, onset_s=message.onset_s + seconds, end_s=message.end_s + seconds)
        case Health():
            return msgspec.structs.replace(message, t=message.t + seconds)


def time_of(message: Announcement) -> float:
    """Time at which a message is sent."""
    return message.t1 if isinstance(message, Verdict) else message.end_s if isinstance(message, Event) else message.t


def publish(all_of_it: Kept, publisher: Publisher, cycle: int) -> Iterator[tuple[float, float]]:
    """Publish the recording once more; yields the time in the signal and what the interval took, in seconds."""
    samples = np.concatenate([block.samples for block in all_of_it.blocks])
    seconds = len(samples) / RATE_HZ
    messages = sorted(all_of_it.messages, key=time_of)
    for k, (frame, odp) in enumerate(all_of_it.frames):
        begin = k * INTERVAL
        first = begin + cycle * len(samples)
        block = Block(first, samples[begin : begin + INTERVAL], RATE_HZ)
        moved = replace(frame, first_sample=first)
        began = time.perf_counter()
        publisher.block(block)
        publisher.turning(0, all_of_it.orders[k])
        publisher.frame(moved, odp)
        took = time.perf_counter() - began
        end_s = (begin + INTERVAL) / RATE_HZ
        while messages and time_of(messages[0]) <= end_s + 1e-6:
            publisher.message(later(messages.pop(0), cycle * seconds))
        yield end_s + cycle * seconds, took


@contextmanager
def dashboard(endpoint: str, memory_limit: str) -> Iterator[subprocess.Popen[bytes]]:
    """A dashboard that serves viewers, in a process of its own."""
    options = ["--connect", endpoint, "--no-viewer", "--memory-limit", memory_limit]
    process = subprocess.Popen([*PROGRAM, "dashboard", *options], stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def memory_mb(process: subprocess.Popen[bytes]) -> float:
    """Resident memory of a process."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0]) / 1000.0


def soak(minutes: float, speed: float, memory_limit: str) -> None:
    """Half an hour faster than life."""
    all_of_it = kept()
    clock = Clock(RATE_HZ, datetime.now(UTC))
    settings = PublishSettings(bind="tcp://127.0.0.1:0")
    cost: dict[str, list[float]] = {"nobody": [], "dashboard": []}
    with Publisher(settings, clock=clock, machine="bench") as publisher:
        for _, took in publish(all_of_it, publisher, 0):
            cost["nobody"].append(took)
        cycle = 1
        for run, part in enumerate((0.2, 0.8)):  # killed after a fifth, and started again
            with dashboard(publisher.endpoint, memory_limit) as process:
                publisher.wait_for_subscriber(30.0)
                time.sleep(1.0)
                began, done_s, reported_s = time.monotonic(), 0.0, 0.0
                seen: list[tuple[float, float]] = []
                click.echo(f"dashboard {run + 1}: {memory_mb(process):.0f} MB before the first message")
                while done_s < part * 60.0 * minutes:
                    first_s = None
                    for t, took in publish(all_of_it, publisher, cycle):
                        cost["dashboard"].append(took)
                        first_s = t if first_s is None else first_s
                        time.sleep(max(0.0, began + (done_s + t - first_s) / speed - time.monotonic()))
                    cycle += 1
                    done_s += len(all_of_it.frames) * INTERVAL / RATE_HZ
                    if done_s - reported_s >= 180.0:
                        reported_s = done_s
                        seen.append((done_s, memory_mb(process)))
                        click.echo(f"  {done_s / 60.0:5.1f} min of signal: {seen[-1][1]:.0f} MB")
                click.echo(f"  {done_s / 60.0:5.1f} min of signal: {memory_mb(process):.0f} MB, then killed")
        later_half = np.array(seen[len(seen) // 2 :])
        hours = later_half[:, 0] / 3600.0
        if len(later_half) > 2:
            click.echo(f"second half: grows by {np.polyfit(hours, later_half[:, 1], 1)[0]:.1f} MB an hour of signal")
        click.echo(f"publications found a full queue {publisher.dropped} times")
    for who, times in cost.items():
        click.echo(f"publishing an interval, {who} looking: median {1e6 * float(np.median(times)):.0f} us of 50 ms")


def latencies(rounds: int) -> None:
    """Replays at real time, in turns with and without a dashboard."""
    found: dict[bool, list[tuple[float, float]]] = {False: [], True: []}
    with tempfile.TemporaryDirectory() as folder:
        config, jsonl = Path(folder) / "machine.toml", Path(folder) / "out.jsonl"
        config.write_text('[publish]\nbind = "tcp://127.0.0.1:5599"\n[spindle]\nspeed_rpm = 1685.0\n')
        for watched in (False, True) * rounds:
            with contextlib.ExitStack() as stack:
                if watched:
                    stack.enter_context(dashboard("tcp://127.0.0.1:5599", "20MB"))
                    time.sleep(3.0)
                command = [*PROGRAM, "replay", RECORDING, "--config", config, "--pace", "real", "--publish"]
                subprocess.run([*command, "--jsonl", jsonl, "--json"], check=True, stdout=subprocess.DEVNULL)
            said = [json.loads(line) for line in jsonl.read_text().splitlines()]
            health = [line for line in said if line["type"] == "health" and line["latency_ms_p50"] is not None]
            found[watched] += [(line["latency_ms_p50"], line["latency_ms_p99"]) for line in health[2:]]
    for watched, pairs in found.items():
        p50, p99 = np.median(np.array(pairs), axis=0)
        click.echo(
            f"latency of a block {'with' if watched else 'without'} a dashboard: {p50:.2f} ms, 99 %: {p99:.2f} ms"
        )


@click.command()
@click.option("--minutes", default=30.0, help="Of signal.")
@click.option("--speed", default=20.0, help="Times real time.")
@click.option("--memory-limit", default="20MB", help="Of the dashboard.")
@click.option("--rounds", default=2, help="Replays at real time, each with and without a dashboard.")
def main(minutes: float, speed: float, memory_limit: str, rounds: int) -> None:
    """Measure."""
    soak(minutes, speed, memory_limit)
    latencies(rounds)


if __name__ == "__main__":
    main()
