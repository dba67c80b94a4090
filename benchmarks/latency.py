"""How long after a block has been heard its verdicts are with a subscriber, and whether others can spoil it.

The daemon as it is installed (ring, trackers, judges, publisher, flight recorder, metrics) hears four channels at
12.8 kHz in blocks of 128 samples from a device that keeps the pace of a real one. Time runs from the callback that
delivers the last sample of a verdict's interval until a subscriber, a process of its own, holds the verdict.

All channels end an interval with the same sample. Their verdicts are made and sent one after the other, the first
channel's first; what nobody waits for (`Channel.digest`) comes after the last.

Three rounds of each in turn: alone; with a subscriber that asked for everything and never reads; with one that read for
a while and was then stopped (SIGSTOP), as a dashboard that hangs. Their queues are kept short, so that they are full
nearly all of the time; how often one was found full is shown (a queue that stays full counts once).

Run: python -m benchmarks.latency [--seconds S] [--rounds N]
"""

from __future__ import annotations

import argparse
import json
import logging
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import numpy as np
from rich.console import Console

from benchmarks.clockwork import CHANNELS, RATE_HZ, Clockwork, cut
from chatter_monitor.client import Subscriber
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.records import Announcement, Block, Health, Odp, OdpFrame, Verdict
from chatter_monitor.service.daemon import Daemon
from chatter_monitor.service.systemd import Notifier

TARGET_P99_MS = 3.0
SETTLE_S = 3.0
CONDITIONS = ("alone", "subscriber that never reads", "dashboard that hangs")

CONFIGURATION = """
[input]
channels = [0, 1, 2, 3]
[publish]
bind = "{endpoint}"
high_water_mark = 64
[metrics]
bind = "127.0.0.1:0"
[recorder]
directory = "{directory}/events"
"""


class Witness(Outlet):
    """Remembers when the last sample of each verdict was heard, and how many publications were dropped."""

    def __init__(self) -> None:
        self.heard_s: dict[str, float] = {}
        self.dropped = self.lost = 0
        self._lost_before: int | None = None  # until the device was open
        self._arrived_s = 0.0

    def block(self, block: Block) -> None:
        """Take note of the arrival."""
        self._arrived_s = block.arrived_s or self._arrived_s

    def frame(self, frame: OdpFrame, odp: Odp) -> None:
        """Nothing: the verdict follows at once."""

    def message(self, message: Announcement) -> None:
        """Take note of what the verdict rests on."""
        match message:
            case Verdict():
                self.heard_s[f"{message.channel}/{message.sample1}"] = self._arrived_s
            case Health(state="hearing"):
                if self._lost_before is None:
                    self._lost_before = message.lost
                self.dropped, self.lost = message.publications_dropped, message.lost - self._lost_before

    def close(self) -> None:
        """Nothing to give back."""


def daemon(folder: Path) -> None:
    """Listen until SIGTERM, then write down what was heard when."""
    logging.disable()  # the story of the cut would stand between the figures
    witness = Witness()
    console = Console(stderr=True)
    opener = Clockwork(cut())
    Daemon(
        [folder / "machine.toml"], notifier=Notifier(None), console=console, opener=opener, witnesses=[witness]
    ).run()
    about = {"heard_s": witness.heard_s, "dropped": witness.dropped, "lost": witness.lost}
    (folder / "heard.json").write_text(json.dumps(about))


def subscribe(endpoint: str, seconds: float, report: Path) -> None:
    """Receive verdicts and write down when each came."""
    received_s = {}
    with Subscriber(endpoint, ["verdict"]) as subscriber:
        until_s = time.monotonic() + seconds
        while (left_s := until_s - time.monotonic()) > 0:
            message = subscriber.receive(left_s)
            if message is not None and isinstance(message.body, Verdict):
                received_s[f"{message.body.channel}/{message.body.sample1}"] = time.monotonic()
    report.write_text(json.dumps(received_s))


def never_read(endpoint: str, *, at_first: bool) -> None:
    """Subscribe to everything and read nothing, or only for a second."""
    with Subscriber(endpoint, [""], high_water_mark=1) as subscriber:
        if at_first:
            until_s = time.monotonic() + 1.0
            while time.monotonic() < until_s:
                subscriber.receive(0.1)
            os.kill(os.getpid(), signal.SIGSTOP)
        time.sleep(1e6)


def role(name: str, *arguments: object) -> subprocess.Popen[bytes]:
    """Start this module in a process of its own."""
    return subprocess.Popen([sys.executable, "-m", "benchmarks.latency", "--role", name, *map(str, arguments)])


def measure(condition: str, seconds: float) -> tuple[list[tuple[int, float]], int, int]:
    """Channel and latency in ms of each verdict under one condition, publications dropped, samples lost."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        endpoint = f"ipc://{folder}/publish"
        (folder / "machine.toml").write_text(CONFIGURATION.format(endpoint=endpoint, directory=folder))
        processes = [role("daemon", folder)]
        try:
            with Subscriber(endpoint, ["verdict"]) as first:
                if first.receive(120.0) is None:
                    raise SystemExit("the daemon says nothing")
            if condition != CONDITIONS[0]:
                processes.append(role("stalled", endpoint, int(condition == CONDITIONS[2])))
            time.sleep(SETTLE_S)
            role("subscriber", endpoint, seconds, folder / "received.json").wait()
            processes[0].terminate()
            processes[0].wait()
        finally:
            for process in processes:
                process.kill()
                process.wait()
        heard = json.loads((folder / "heard.json").read_text())
        received_s = json.loads((folder / "received.json").read_text())
        latencies_ms = [
            (int(verdict.partition("/")[0]), 1000 * (at_s - heard["heard_s"][verdict]))
            for verdict, at_s in received_s.items()
        ]
        expected = seconds * CHANNELS * RATE_HZ / 640
        if len(latencies_ms) < 0.9 * expected:
            raise SystemExit(f"only {len(latencies_ms)} of {expected:.0f} verdicts arrived")
        return latencies_ms, heard["dropped"], heard["lost"]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=10.0, help="of each round")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--role", nargs="+", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    match arguments.role:
        case ["daemon", folder]:
            return daemon(Path(folder))
        case ["subscriber", endpoint, seconds, report]:
            return subscribe(endpoint, float(seconds), Path(report))
        case ["stalled", endpoint, at_first]:
            return never_read(endpoint, at_first=at_first == "1")
    latencies_ms: dict[str, list[float]] = defaultdict(list)
    medians: dict[str, list[float]] = defaultdict(list)
    by_channel: dict[int, list[float]] = defaultdict(list)  # alone
    dropped: dict[str, int] = defaultdict(int)
    lost = 0
    for _ in range(arguments.rounds):
        for condition in CONDITIONS:
            verdicts, dropped_now, lost_now = measure(condition, arguments.seconds)
            values = [ms for _, ms in verdicts]
            latencies_ms[condition] += values
            for channel, ms in verdicts if condition == CONDITIONS[0] else ():
                by_channel[channel].append(ms)
            medians[condition].append(float(np.median(values)))
            dropped[condition] += dropped_now
            lost += lost_now
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} processors; niceness {os.nice(0)}")
    columns = f"{'median':>8}{'p99':>8}{'max':>8}{'verdicts':>10}{'queue full':>12}   medians by round"
    print(f"{'ms from callback to subscriber':<32}{columns}")
    for condition, values in latencies_ms.items():
        median, p99 = np.percentile(values, [50, 99])
        rounds = ", ".join(f"{value:.2f}" for value in medians[condition])
        columns = f"{median:8.2f}{p99:8.2f}{max(values):8.2f}{len(values):10d}{dropped[condition]:12d}   {rounds}"
        print(f"{condition:<32}{columns}")
    ends = [(channel, *np.percentile(values, [50, 99])) for channel, values in sorted(by_channel.items())]
    print(
        f"alone, each channel: {', '.join(f'{channel}: {median:.2f}, p99 {p99:.2f}' for channel, median, p99 in ends)}"
    )
    met = np.percentile(latencies_ms[CONDITIONS[0]], 99) <= TARGET_P99_MS
    print(
        f"target: p99 within {TARGET_P99_MS} ms on an idle machine: {'met' if met else 'NOT met'}; samples lost: {lost}"
    )
    return None


if __name__ == "__main__":
    main()
