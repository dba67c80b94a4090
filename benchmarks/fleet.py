"""What a fleet of machines sends to one place: worked out from one machine, and measured on a simulated fleet.

One machine is a simulated cut in and out of chatter (``replay_data/bar_turning.flac``), one channel, over and over. Of
it are counted the messages and bytes of each way that leads to one place: over ZeroMQ, over MQTT, and what Prometheus
reads. Then as many machines as asked for, each the MQTT bridge's thinning and connection with a phase of its own, send
at the pace of life to a real mosquitto on this computer. What arrives at a client that listens to all topics is
compared with the sum, and the broker says how many bytes it received. Last, one bridge as a process beside a monitor.

Run: python -m benchmarks.fleet [--machines N] [--seconds S]
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import socket
import subprocess
import tempfile
import time
import urllib.request
import uuid
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import zmq
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from benchmarks.dashboard import PROGRAM, RATE_HZ, Kept, kept, later, publish, time_of
from chatter_monitor.outlets.metrics import Metrics
from chatter_monitor.outlets.mqtt import Broker, MqttLink, payload
from chatter_monitor.outlets.publisher import Clock, Publisher, PublishSettings
from chatter_monitor.outlets.thinning import Thinning
from chatter_monitor.outlets.wire import Header, topic_of
from chatter_monitor.records import Block, Event, Health, Verdict

EVERY_S = 1.0  # as `bridge mqtt` has it by default
SCRAPE_S = 15.0
STEP_S = 0.05
DAY_S = 86_400.0


def zeromq_rates(machine: Kept, seconds: float) -> dict[str, tuple[float, float]]:
    """Messages and bytes a second of each kind of topic, as a subscriber gets them."""
    counts: Counter[str] = Counter()
    sizes: Counter[str] = Counter()
    settings = PublishSettings(bind="tcp://127.0.0.1:0", high_water_mark=100_000)
    with (
        Publisher(settings, clock=Clock(RATE_HZ, datetime.now(UTC)), machine="lathe-001") as publisher,
        zmq.Context() as context,
        context.socket(zmq.SUB) as listener,
    ):
        listener.rcvhwm = 0
        for kind in ("odp", "verdict", "event", "health"):
            listener.subscribe(kind)
        listener.connect(publisher.endpoint)
        publisher.wait_for_subscriber(60.0)
        for _ in publish(machine, publisher, 0):
            pass
        while listener.poll(2000):
            parts = listener.recv_multipart()
            kind = parts[0].decode().partition(".")[0]
            counts[kind] += 1
            sizes[kind] += sum(map(len, parts))
    return {kind: (counts[kind] / seconds, sizes[kind] / seconds) for kind in counts}


def scrape_bytes(machine: Kept) -> int:
    """Bytes that Prometheus reads each time."""
    with Metrics("127.0.0.1:0", machine="lathe-001", clock=time.monotonic) as metrics:
        metrics.block(Block(0, np.zeros((1, 1)), RATE_HZ))
        for message in machine.messages:
            metrics.message(message)
        with urllib.request.urlopen(metrics.url) as answer:  # noqa: S310  our own, on loopback
            return len(answer.read())


def header_of(machine: str, utc: str) -> Header:
    """Header of a message that somebody else has published."""
    session = uuid.uuid4().hex
    return Header(schema="x/1", session=session, seq=0, sample0=0, fs=RATE_HZ, utc=utc, machine=machine)


def mqtt_rates(messages: list[Any], cycle_s: float) -> tuple[float, float]:
    """Messages and bytes a second, topics included, that a bridge sends: from the size of each message."""
    thinning, count, size = Thinning(EVERY_S), 0, 0
    for cycle in range(2):  # the second one counts, so that its beginning comes after an end
        for message in (later(message, cycle * cycle_s) for message in messages):
            if thinning.passed(message) is not None and cycle == 1:
                topic = f"chatter-monitor/lathe-001/{topic_of(message)}"
                header = header_of("lathe-001", datetime.now(UTC).isoformat(timespec="microseconds"))
                count += 1
                size += len(topic) + len(payload(header, message, 100))
    return count / cycle_s, size / cycle_s


class Machine:
    """A machine of the fleet: its messages over and over, thinned, to the broker."""

    def __init__(self, number: int, messages: list[Any], cycle_s: float, broker: Broker, start: datetime) -> None:
        self._messages = messages
        self._cycle_s = cycle_s
        self._phase_s = cycle_s * ((number * 0.618034) % 1.0)
        self._thinning = Thinning(EVERY_S)
        self._start = start - timedelta(seconds=self._phase_s)
        self._coming = self._endless()
        self._next = next(self._coming)
        while time_of(self._next) < self._phase_s:
            self._next = next(self._coming)
        self.name = f"lathe-{number:03d}"
        self.link = MqttLink(broker, self.name, lambda _: None)
        self.link.tell(online=True)
        self.sent = 0

    def _endless(self) -> Iterator[Verdict | Event | Health]:
        cycle = 0
        while True:
            for message in self._messages:
                yield later(message, cycle * self._cycle_s)
            cycle += 1

    def until(self, seconds: float) -> None:
        """Send what has come by then."""
        while time_of(self._next) - self._phase_s <= seconds:
            message = self._thinning.passed(self._next)
            if message is not None:
                utc = (self._start + timedelta(seconds=time_of(message))).isoformat()
                self.link.send(header_of(self.name, utc), message)
                self.sent += 1
            self._next = next(self._coming)


class Listener:
    """A client that listens to all machines: what came, and how late."""

    def __init__(self, port: int) -> None:
        self.messages = self.bytes = self.broker_bytes = 0
        self.delays_s: list[float] = []
        self._client = Client(CallbackAPIVersion.VERSION2)
        self._client.on_message = self._take
        self._client.on_connect = lambda client, *_: client.subscribe([("chatter-monitor/#", 1), ("$SYS/#", 0)])
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()

    def _take(self, _client: Client, _data: object, message: Any) -> None:
        if message.topic.startswith("$SYS"):
            if message.topic == "$SYS/broker/bytes/received":
                self.broker_bytes = int(message.payload)
            return
        if message.topic.endswith("/state"):
            return
        self.messages += 1
        self.bytes += len(message.topic) + len(message.payload)
        sent = datetime.fromisoformat(msgspec.json.decode(message.payload)["utc"])
        self.delays_s.append((datetime.now(UTC) - sent).total_seconds())

    def close(self) -> None:
        """Leave."""
        self._client.disconnect()
        self._client.loop_stop()


@contextmanager
def mosquitto() -> Iterator[tuple[subprocess.Popen[bytes], int]]:
    """A broker on a port of its own."""
    program = shutil.which("mosquitto", path=os.environ["PATH"] + ":/usr/sbin")
    if program is None:
        raise SystemExit("mosquitto is missing: apt-get install mosquitto")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with tempfile.NamedTemporaryFile("w", suffix=".conf") as config:
        config.write(f"listener {port} 127.0.0.1\nallow_anonymous true\nsys_interval 1\n")
        config.flush()
        process = subprocess.Popen([program, "-c", config.name], stderr=subprocess.DEVNULL)
        try:
            time.sleep(2.0)
            yield process, port
        finally:
            process.kill()
            process.wait()


def bridge_cost(machine: Kept) -> str:
    """What a bridge process takes beside a monitor of one channel that publishes at the pace of life."""
    settings = PublishSettings(bind="tcp://127.0.0.1:0")
    with (
        mosquitto() as (_, port),
        Publisher(settings, clock=Clock(RATE_HZ, datetime.now(UTC)), machine="x") as publisher,
    ):
        options = ["--broker", f"127.0.0.1:{port}", "--connect", publisher.endpoint]
        bridge = subprocess.Popen([*PROGRAM, "bridge", "mqtt", *options], stderr=subprocess.DEVNULL)
        try:
            publisher.wait_for_subscriber(60.0)
            began, busy_before = time.monotonic(), processor_s(bridge.pid)
            for now_s, _ in publish(machine, publisher, 0):
                time.sleep(max(0.0, began + now_s - time.monotonic()))
            busy = (processor_s(bridge.pid) - busy_before) / (time.monotonic() - began)
            return f"one bridge as a process: {100 * busy:.1f} % of a core, {resident_mb(bridge.pid):.0f} MB"
        finally:
            bridge.kill()
            bridge.wait()


def processor_s(pid: int) -> float:
    """Processor time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_mb(pid: int) -> float:
    """Resident memory of a process."""
    return int(Path(f"/proc/{pid}/status").read_text().split("VmRSS:")[1].split()[0]) / 1000.0


def row(name: str, messages: float, size: float) -> str:
    """Line of the table: messages and bytes a second, and bytes a day."""
    return f"{name:<44}{messages:12.1f}{size / 1000.0:12.2f}{size * DAY_S / 1e9:12.3f}"


def main() -> None:
    """Work out, measure, compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machines", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    machine = kept()
    messages = sorted(machine.messages, key=time_of)
    cycle_s = sum(len(block.samples) for block in machine.blocks) / RATE_HZ
    print(f"{'one machine, one channel':<44}{'messages/s':>12}{'kB/s':>12}{'GB/day':>12}")
    rates = zeromq_rates(machine, cycle_s)
    for kind, (count, size) in rates.items():
        print(row(f"ZeroMQ, {kind}", count, size))
    scrape = scrape_bytes(machine)
    print(row(f"Prometheus, {scrape} B every {SCRAPE_S:g} s", 1.0 / SCRAPE_S, scrape / SCRAPE_S))
    count, size = mqtt_rates(messages, cycle_s)
    print(row(f"MQTT, {size / count:.0f} B a message", count, size), flush=True)

    with ExitStack() as stack:
        process, port = stack.enter_context(mosquitto())
        listener = Listener(port)
        stack.callback(listener.close)
        broker = Broker(f"127.0.0.1:{port}", "chatter-monitor", 10_000)
        start = datetime.now(UTC) + timedelta(seconds=5.0)
        fleet = [Machine(n, messages, cycle_s, broker, start) for n in range(options.machines)]
        stack.callback(lambda: [m.link.close(1.0) for m in fleet])
        time.sleep(max(0.0, (start - datetime.now(UTC)).total_seconds()))
        bytes_before, busy_before = listener.broker_bytes, processor_s(process.pid)
        own_before = resource.getrusage(resource.RUSAGE_SELF)
        while (now_s := (datetime.now(UTC) - start).total_seconds()) < options.seconds:
            for m in fleet:
                m.until(now_s)
            time.sleep(STEP_S)
        own = resource.getrusage(resource.RUSAGE_SELF)
        deadline = time.monotonic() + 30.0
        while listener.messages < sum(m.sent for m in fleet) and time.monotonic() < deadline:
            time.sleep(0.1)
        time.sleep(2.5)  # the broker tells its counts once a second
        sent = sum(m.sent for m in fleet)
        wire = (listener.broker_bytes - bytes_before) / options.seconds
        busy = (processor_s(process.pid) - busy_before) / options.seconds
        memory = resident_mb(process.pid)
        dropped = sum(m.link.dropped for m in fleet)
        own_s = own.ru_utime + own.ru_stime - own_before.ru_utime - own_before.ru_stime
    print()
    print(f"{f'{options.machines} machines, {options.seconds:g} s':<44}{'messages/s':>12}{'kB/s':>12}{'GB/day':>12}")
    print(row("MQTT, worked out", options.machines * count, options.machines * size))
    print(row("MQTT, arrived", listener.messages / options.seconds, listener.bytes / options.seconds))
    print(row("MQTT, received by the broker, on the wire", listener.messages / options.seconds, wire))
    delays_ms = 1000.0 * np.array(listener.delays_s)
    print(
        f"sent {sent}, arrived {listener.messages}, dropped {dropped}; from the end of the interval to the listener "
        f"median {np.median(delays_ms):.0f} ms, 99 % {np.percentile(delays_ms, 99):.0f} ms"
    )
    print(
        f"broker: {100 * busy:.1f} % of a core, {memory:.0f} MB; all bridges and the listener, in this process: "
        f"{100 * own_s / options.seconds:.0f} % of a core; load {os.getloadavg()[0]:.1f}"
    )
    print(bridge_cost(machine))


if __name__ == "__main__":
    main()
