"""The publisher."""

from __future__ import annotations

import json
import os
import runpy
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import pytest

from chatter_monitor.client import Subscriber
from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.outlets import publisher as publisher_module
from chatter_monitor.outlets.publisher import Clock, Publisher, PublishSettings
from chatter_monitor.outlets.wire import OdpHeader

WAIT_S = 200.0
SCRIPT = Path(__file__).with_name("subscriber_process.py")
_script = runpy.run_path(str(SCRIPT))  # the same fingerprint on both sides
LAST, digest = _script["LAST"], _script["digest"]


@contextmanager
def subscriber_process(publisher: Publisher, report: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Subscribe to everything from another process."""
    with subprocess.Popen([sys.executable, SCRIPT, publisher.endpoint, report]) as process:
        try:
            assert publisher.wait_for_subscriber(WAIT_S)
            yield process
        finally:
            process.kill()


def resident_bytes() -> int:
    """Memory of this process."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def publish_timed(publisher: Publisher, interval, count: int) -> float:
    """Publish the same interval many times and return the seconds that it took."""
    start = time.perf_counter()
    for _ in range(count):
        publisher.frame(*interval)
        publisher.digest()
    return time.perf_counter() - start


def test_another_process_receives_everything(publisher, tmp_path, make_interval, messages):
    """A subscriber in another process gets every message of a stream, in order, with gapless seq and equal bits."""
    sent = []
    topics = ["verdict.0", "verdict.1", "event", "event", "health", "health"]

    def send_frame(**about):
        frame, odp = make_interval(**about)
        publisher.frame(frame, odp)
        publisher.digest()
        sent.append([f"odp.{frame.channel}", digest(frame)])

    with subscriber_process(publisher, tmp_path / "report.json") as process:
        for i in range(300):
            send_frame(first_sample=640 * i, channel=0)
            send_frame(first_sample=640 * i, channel=1, lost=i % 3)
            publisher.message(messages[i % 6])
            sent.append([topics[i % 6], digest(messages[i % 6])])
        send_frame(first_sample=640 * 300, lost=LAST)
        assert process.wait(WAIT_S) == 0
    report = json.loads((tmp_path / "report.json").read_text())
    assert [[topic, fingerprint] for topic, _, fingerprint in report["received"]] == sent
    for wanted in {topic for topic, _ in sent}:
        seqs = [seq for topic, seq, _ in report["received"] if topic == wanted]
        assert seqs == list(range(len(seqs)))
    assert not any(report["lost"].values())
    assert report["restarts"] == report["malformed"] == publisher.dropped == 0


def test_a_stopped_subscriber_delays_nobody(tmp_path, clock, make_interval):
    """With a stopped subscriber publishing goes on as with none, in bounded memory; once resumed it sees its losses."""
    interval = make_interval()
    count = 6000  # 130 MB, of which 50 messages may wait here and some MB in the kernel
    settings = PublishSettings(bind="tcp://127.0.0.1:0", high_water_mark=50)
    report = tmp_path / "report.json"
    with Publisher(settings, clock=clock, machine="lathe-3") as publisher:
        alone_s = publish_timed(publisher, interval, count)
        assert publisher.dropped == 0
        with subscriber_process(publisher, report) as process:
            process.send_signal(signal.SIGSTOP)
            before = resident_bytes()
            stopped_s = publish_timed(publisher, interval, count)
            assert resident_bytes() - before < 30e6
            assert 1 <= publisher.dropped < count
            process.send_signal(signal.SIGCONT)
            deadline = time.monotonic() + WAIT_S
            last = make_interval(lost=LAST)
            sent = 2 * count
            while process.poll() is None and time.monotonic() < deadline:
                publisher.frame(*last)
                publisher.digest()
                sent += 1
                time.sleep(0.005)
            assert process.wait(WAIT_S) == 0
    assert stopped_s < 20 * alone_s + 1.0
    outcome = json.loads(report.read_text())
    received = [seq for _, seq, _ in outcome["received"]]
    assert count <= received[0] < received[-1] < sent
    assert outcome["lost"]["odp.0"] == received[-1] - received[0] + 1 - len(received) > 0


def test_a_full_queue_costs_only_its_own_subscriber(tmp_path, clock, make_interval):
    """While one subscriber is stopped and its queue full, another one receives every message."""
    settings = PublishSettings(bind="tcp://127.0.0.1:0", high_water_mark=10)
    interval = make_interval()
    with (
        Publisher(settings, clock=clock, machine="lathe-3") as publisher,
        subscriber_process(publisher, tmp_path / "report.json") as process,
    ):
        process.send_signal(signal.SIGSTOP)
        publish_timed(publisher, interval, 6000)  # more than the kernel takes
        assert publisher.dropped > 0
        with Subscriber(publisher.endpoint) as reader:
            while reader.receive(0.01) is None:  # until it is connected
                publisher.frame(*interval)
                publisher.digest()
            for _ in range(100):
                publisher.frame(*interval)
                publisher.digest()
                assert reader.receive(WAIT_S) is not None
            assert reader.lost == {"odp.0": 0}


def test_closing_brings_out_the_last_messages(clock, make_interval):
    """What was published right before closing still reaches a connected subscriber."""
    interval = make_interval()
    publisher = Publisher(PublishSettings(bind="tcp://127.0.0.1:0"), clock=clock, machine="lathe-3")
    with Subscriber(publisher.endpoint) as subscriber:
        assert publisher.wait_for_subscriber(WAIT_S)
        for _ in range(1000):
            publisher.frame(*interval)
            publisher.digest()
        publisher.close()
        publisher.close()  # as a second call may come from a context manager
        assert [subscriber.receive(WAIT_S).header.seq for _ in range(1000)] == list(range(1000))


def test_closing_is_bounded(tmp_path, clock, make_interval, monkeypatch):
    """A subscriber that takes nothing cannot keep the publisher from closing."""
    monkeypatch.setattr(publisher_module, "LINGER_MS", 200)
    publisher = Publisher(PublishSettings(bind="tcp://127.0.0.1:0"), clock=clock, machine="lathe-3")
    with subscriber_process(publisher, tmp_path / "report.json") as process:
        process.send_signal(signal.SIGSTOP)
        publish_timed(publisher, make_interval(), 2000)
        start = time.monotonic()
        publisher.close()
        assert time.monotonic() - start < 10.0


def test_waiting_for_a_subscriber(publisher):
    """Waiting tells whether somebody subscribed, and forgets those who left."""
    assert not publisher.wait_for_subscriber(0.01)
    with Subscriber(publisher.endpoint, topics=("health",)):
        assert publisher.wait_for_subscriber(WAIT_S)
    deadline = time.monotonic() + WAIT_S
    while publisher.wait_for_subscriber(0.0) and time.monotonic() < deadline:
        time.sleep(0.005)
    assert not publisher.wait_for_subscriber(0.0)


def test_headers_place_messages_on_the_sample_index_and_in_utc(make_interval, messages):
    """Every header has the first sample of what the message is about, and the UTC of it, from one anchor."""
    anchor = Clock(12_800.0, datetime(2026, 3, 1, 9, 30, tzinfo=timezone(timedelta(hours=1))), sample=12_800)
    settings = PublishSettings(bind="tcp://127.0.0.1:0")
    with (
        Publisher(settings, clock=anchor, machine="lathe-3") as publisher,
        Subscriber(publisher.endpoint) as subscriber,
    ):
        assert publisher.wait_for_subscriber(WAIT_S)
        publisher.frame(*make_interval(first_sample=12_801))
        publisher.digest()
        for message in (messages[0], messages[2], messages[4]):
            publisher.message(message)
        headers = [subscriber.receive(WAIT_S).header for _ in range(4)]
    assert [header.sample0 for header in headers] == [12_801, 15_360, 15_360, 25_600]
    assert headers[0].utc == "2026-03-01T08:30:00.000078+00:00"
    for header in headers:
        second = (header.sample0 - 12_800) / 12_800
        off = datetime.fromisoformat(header.utc) - datetime(2026, 3, 1, 8, 30, tzinfo=UTC)
        assert abs(off.total_seconds() - second) <= 1e-6
    assert {(header.fs, header.machine) for header in headers} == {(12_800.0, "lathe-3")}
    assert [header.schema for header in headers] == [
        f"chatter-monitor/{kind}/1" for kind in ("odp", "verdict", "event", "health")
    ]


def test_the_summary_travels_in_the_header(publisher, make_interval):
    """The header of a frame carries the 20 Hz message, and what the frame knows beside its arrays."""
    frame, odp = make_interval(lost=12)
    with Subscriber(publisher.endpoint) as subscriber:
        assert publisher.wait_for_subscriber(WAIT_S)
        publisher.frame(frame, odp)
        publisher.digest()
        header = subscriber.receive(WAIT_S).header
    assert isinstance(header, OdpHeader)
    assert (header.odp, header.rms, header.lost, header.flags) == (odp, frame.rms, 12, ["gap"])


@pytest.mark.parametrize(
    "bind",
    [
        "tcp://*:5557",
        "tcp://0.0.0.0:5557",
        "tcp://[::]:5557",
        "tcp://192.0.2.7:5557",
        "tcp://[2001:db8::1]:5557",
        "tcp://eth0:5557",
        "tcp://127.0.0.1.example.org:5557",
    ],
)
def test_the_network_is_refused(bind):
    """Without certificates, whatever another machine could reach is refused, with the two commands that make them."""
    with pytest.raises(InputError, match=r"refused without encryption.*keys new.*keys allow") as caught:
        PublishSettings(bind=bind)
    assert bind in str(caught.value)


@pytest.mark.parametrize(
    "bind",
    [
        "",
        "5557",
        "127.0.0.1:5557",
        "tcp://127.0.0.1",
        "tcp://127.0.0.1:",
        "tcp://127.0.0.1:65536",
        "tcp://127.0.0.1:http",
        "tcp://::1:5557",
        "tcp://127.0.0.1:1;127.0.0.1:2",
        "udp://127.0.0.1:5557",
        "inproc://monitor",  # no other process could subscribe
        "ipc://",
        "ipc://*",
    ],
)
def test_malformed_endpoints_are_refused(bind):
    """What is no endpoint is the user's error, with an example of what is."""
    with pytest.raises(InputError, match=r"no endpoint.*tcp://"):
        PublishSettings(bind=bind)


@pytest.mark.parametrize(
    "bind", ["tcp://127.0.0.1:5557", "tcp://127.8.9.1:5557", "tcp://localhost:*", "tcp://[::1]:0", "ipc:///run/c.sock"]
)
def test_what_only_this_machine_reaches_is_allowed(bind):
    """Loopback addresses and local sockets are allowed."""
    assert PublishSettings(bind=bind).bind == bind


def test_an_unbounded_queue_is_refused():
    """ZeroMQ takes a high-water mark of 0 for none at all."""
    with pytest.raises(InputError, match="got 0; allowed: >= 1"):
        PublishSettings(high_water_mark=0)


def test_port_in_use(clock):
    """A port that another program holds is a fault of the environment, and is named."""
    with socket.create_server(("127.0.0.1", 0)) as other:
        bind = f"tcp://127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(EnvironmentFault, match="in use") as caught:
            Publisher(PublishSettings(bind=bind), clock=clock, machine="lathe-3")
    assert bind in str(caught.value)


def test_the_port_is_free_after_closing(clock):
    """A monitor that is restarted can bind to the port it had."""
    settings = PublishSettings(bind="tcp://127.0.0.1:0")
    with Publisher(settings, clock=clock, machine="lathe-3") as first:
        endpoint = first.endpoint
    with Publisher(PublishSettings(bind=endpoint), clock=clock, machine="lathe-3") as second:
        assert second.endpoint == endpoint


def test_local_socket(tmp_path, clock, messages):
    """Publishing works over a local socket, also over one that a run before left behind."""
    path = tmp_path / "c.sock"
    with socket.socket(socket.AF_UNIX) as stale:
        stale.bind(str(path))
    settings = PublishSettings(bind=f"ipc://{path}")
    with Publisher(settings, clock=clock, machine="lathe-3") as publisher, Subscriber(publisher.endpoint) as subscriber:
        assert publisher.wait_for_subscriber(WAIT_S)
        publisher.message(messages[0])
        assert subscriber.receive(WAIT_S).body == messages[0]


def test_a_file_is_never_replaced_by_a_socket(tmp_path, clock):
    """ZeroMQ would delete a file to bind in its place: the publisher refuses."""
    path = tmp_path / "precious"
    path.write_text("data")
    with pytest.raises(InputError, match="not a socket"):
        Publisher(PublishSettings(bind=f"ipc://{path}"), clock=clock, machine="lathe-3")
    assert path.read_text() == "data"
