"""Whether memory stays flat and every sample arrives, over hours.

Two runs through what the service runs, flight recorder and metrics included:

- a shift of 8 hours as fast as it can be worked through, one channel;
- with --minutes, the daemon on four channels of 128-sample blocks that come at real time through the card's ring,
  with a subscriber in another process that misses nothing either.

What is heard is mostly stable, with 20 s in and out of chatter every 5 minutes, each recorded until the quota makes the
oldest go.

Memory is the resident set, taken a hundred times. The reference is the median of the second tenth, when every buffer
has been filled and an event has been recorded; flat means that the median of the last tenth is within 5 % of it. The
largest is shown, too: while an event is collected there is more. A sample is lost if health counts it, or if verdicts
leave a gap.

Run: python -m benchmarks.memory [--hours H] [--minutes M]
"""

from __future__ import annotations

import argparse
import logging
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from benchmarks.clockwork import CHANNELS, RATE_HZ, Clockwork, cut
from chatter_monitor.acquisition.synthetic import Synthetic
from chatter_monitor.client import Subscriber
from chatter_monitor.config import Settings, load
from chatter_monitor.outlets.event_store import EventWriter
from chatter_monitor.outlets.metrics import Metrics
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.outlets.publisher import Clock, Publisher, PublishSettings
from chatter_monitor.records import Announcement, Event, Health, Odp, OdpFrame, Verdict
from chatter_monitor.service.daemon import Daemon
from chatter_monitor.service.heap import keep_flat
from chatter_monitor.service.monitor import Monitor
from chatter_monitor.service.recorder import open_recorder
from chatter_monitor.service.systemd import Notifier

PERIOD_S = 300.0
LIMIT = 0.05
READINGS = 100
QUOTA_GB = 0.02  # is reached within the first tenth


def resident_mb() -> float:
    """Memory of this process that lies in the machine's, in MB."""
    status = Path("/proc/self/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0]) / 1000


class Witness(Outlet):
    """Follows the verdicts for gaps and the health for losses; reads the memory in between.

    Parameters
    ----------
    reading_s : float
        Seconds of signal between two readings.
    """

    def __init__(self, reading_s: float) -> None:
        self.readings_mb: list[float] = []
        self.gaps = self.events = 0
        self.lost = 0
        self.samples = 0
        self._ends: dict[int, int] = {}
        self._reading_s = self._due_s = reading_s
        self._lost_before: int | None = None  # until the device was open

    def frame(self, frame: OdpFrame, odp: Odp) -> None:
        """Nothing: the verdict tells as much."""

    def message(self, message: Announcement) -> None:
        """Follow."""
        match message:
            case Verdict():
                self.gaps += self._ends.get(message.channel, message.sample0) != message.sample0
                self._ends[message.channel] = message.sample1
            case Event():
                self.events += 1
            case Health():
                self._lost_before = message.lost if self._lost_before is None else self._lost_before
                self.lost, self.samples = message.lost - self._lost_before, message.samples_in
                if message.t >= self._due_s:
                    self._due_s += self._reading_s
                    self.readings_mb.append(resident_mb())

    def close(self) -> None:
        """Nothing to give back."""

    def report(self, name: str) -> bool:
        """Print what was seen; tell whether it is what is promised."""
        tenths = [float(np.median(part)) for part in np.array_split(self.readings_mb, 10)]
        growth, largest = (value / tenths[1] - 1.0 for value in (tenths[-1], max(self.readings_mb)))
        print(f"{name}: {self.samples} samples a channel, {self.events} events, {self.lost} lost, {self.gaps} gaps")
        print(f"  resident MB, median of each tenth: {', '.join(f'{tenth:.1f}' for tenth in tenths)}")
        print(f"  from the second to the last {100 * growth:+.1f} %; the largest {100 * largest:+.1f} %")
        kept = bool(abs(growth) <= LIMIT and not self.lost and not self.gaps)
        print(f"  target: within {100 * LIMIT:.0f} %, nothing lost: {'met' if kept else 'NOT met'}")
        return kept


def shift(channels: int) -> NDArray[np.float32]:
    """One period: all of the cut, then its stable beginning again and again.

    So the first event, whose recording takes memory for good, is over before the reference is taken.
    """
    whole = cut(channels)
    stable = whole[: round(5 * RATE_HZ)]
    again = np.tile(stable, (round((PERIOD_S * RATE_HZ - len(whole)) / len(stable)), 1))
    return np.concatenate([whole, again])


def fast(hours: float, folder: Path) -> bool:
    """Work through a shift as fast as possible."""
    keep_flat()
    period = shift(1).astype(np.float64)
    length = round(hours * 3600 * RATE_HZ)
    source = Synthetic(lambda index: period[index % len(period)], RATE_HZ, length=length, block_samples=4096)
    settings = Settings()
    clock = Clock(RATE_HZ, datetime.now(UTC))
    witness = Witness(length / RATE_HZ / READINGS)
    store = EventWriter(folder / "events", QUOTA_GB * 1e9)
    began = time.perf_counter()
    with (
        Publisher(PublishSettings(bind=f"ipc://{folder}/publish"), clock=clock, machine="shift") as publisher,
        Metrics("127.0.0.1:0", machine="shift", clock=time.monotonic) as metrics,
        open_recorder(settings, store, 1, RATE_HZ, utc_of=clock.utc_of, patient=True) as recorder,
    ):
        monitor = Monitor(
            settings,
            source,
            [publisher, metrics, recorder, witness],
            counts=source,
            source_rate_hz=RATE_HZ,
            session="shift",
            clock=time.monotonic,
        )
        for _ in monitor.run():
            pass
    faster = hours * 3600 / (time.perf_counter() - began)
    complete = witness.samples == length
    return witness.report(f"{hours:g} h, {faster:.0f} times real time") and complete


def paced(minutes: float, folder: Path) -> bool:
    """Listen at real time, for so many minutes."""
    config = folder / "machine.toml"
    channels = list(range(CHANNELS))
    config.write_text(
        f'[input]\nchannels = {channels}\n[publish]\nbind = "ipc://{folder}/publish"\n'
        f'[metrics]\nbind = "127.0.0.1:0"\n[recorder]\ndirectory = "{folder}/events"\nquota_gb = {QUOTA_GB}\n'
    )
    witness = Witness(minutes * 60 / READINGS)
    logging.disable()  # the story of each cut
    opener = Clockwork(shift(CHANNELS))
    daemon = Daemon([config], notifier=Notifier(None), console=Console(stderr=True), opener=opener, witnesses=[witness])
    endpoint = load([config]).publish.bind
    role = [sys.executable, "-m", "benchmarks.memory", "--subscribe", endpoint]
    subscriber = subprocess.Popen(role, stdout=subprocess.PIPE, text=True)
    threading.Timer(minutes * 60, os.kill, (os.getpid(), signal.SIGTERM)).start()
    daemon.run()
    missed, _ = subscriber.communicate(timeout=60)
    print(f"subscriber of everything in another process: {missed.strip()}")
    return witness.report(f"{minutes:g} min at real time, {CHANNELS} channels") and missed.startswith("0 ")


def subscribe(endpoint: str) -> None:
    """Receive everything until the monitor has finished; print what was missed."""
    received: Counter[str] = Counter()
    with Subscriber(endpoint) as subscriber:
        for message in subscriber:
            received[message.topic.partition(".")[0]] += 1
            if isinstance(message.body, Health) and message.body.state == "finished":
                break
        missed = sum(subscriber.lost.values())
    print(f"{missed} missed of {', '.join(f'{count} {kind}' for kind, count in received.items())}")


def main() -> None:
    """Measure and print; exit code 1 if a promise is not kept."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=8.0, help="of the shift; 0: leave it out")
    parser.add_argument("--minutes", type=float, default=0.0, help="of listening at real time; 0: leave it out")
    parser.add_argument("--subscribe", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.subscribe:
        return subscribe(arguments.subscribe)
    kept = []
    for amount, run in ((arguments.hours, fast), (arguments.minutes, paced)):
        if amount > 0:
            with tempfile.TemporaryDirectory() as folder:
                kept.append(run(amount, Path(folder)))
    sys.exit(0 if all(kept) else 1)


if __name__ == "__main__":
    main()
