"""The MQTT bridge and a real broker, heard by the broker's own client."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import socket
import subprocess
from collections import defaultdict
from pathlib import Path

import pytest

from chatter_monitor.outlets.mqtt import Broker, MqttLink
from chatter_monitor.outlets.wire import Header
from tests.bridging import PATIENCE_S, Bridge, Feed, verdict, wait_until
from tests.system.components import need

pytestmark = pytest.mark.system

ROOT = "chatter-monitor/lathe-3"
HEADER = Header(
    schema="chatter-monitor/verdict/1",
    session="s",
    seq=0,
    sample0=0,
    fs=12800.0,
    utc="2026-01-01T00:00:00+00:00",
    machine="lathe-3",
)


class Mosquitto:
    """A broker that can be stopped and started again on its port; sessions of its clients survive that."""

    def __init__(self, folder: Path, *settings: str) -> None:
        need(mosquitto="mosquitto mosquitto-clients")
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.port = free.getsockname()[1]
        self.address = f"localhost:{self.port}"
        self._config = folder / "mosquitto.conf"
        lines = (f"listener {self.port} 127.0.0.1", "persistence true", f"persistence_location {folder}/", "user root")
        self._config.write_text("\n".join((*lines, *(settings or ("allow_anonymous true",)))) + "\n")
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        program = shutil.which("mosquitto", path=os.environ["PATH"] + ":/usr/sbin")
        self._process = subprocess.Popen([program, "-c", self._config], stderr=subprocess.DEVNULL)
        wait_until(self._answers, "the broker")

    def _answers(self) -> bool:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", self.port)):
            return True
        return False

    def stop(self) -> None:
        if self._process is not None:
            self._process.terminate()
            self._process.wait(PATIENCE_S)
            self._process = None


class Listener:
    """mosquitto_sub on all topics, with a session that outlives the broker."""

    def __init__(self, folder: Path, broker: Mosquitto) -> None:
        self._log = folder / "heard"
        command = ["mosquitto_sub", "-h", "127.0.0.1", "-p", str(broker.port), "-t", "#", "-v", "-q", "1"]
        with self._log.open("wb") as heard:
            self.process = subprocess.Popen([*command, "-c", "-i", "listener"], stdout=heard)
        self._publish(broker, "listener/is/there")

    def _publish(self, broker: Mosquitto, topic: str) -> None:
        """Make sure that it listens: what is retained reaches it whenever it subscribes."""
        command = ["mosquitto_pub", "-h", "127.0.0.1", "-p", str(broker.port), "-t", topic, "-m", "{}", "-r"]
        subprocess.run(command, check=True, timeout=PATIENCE_S)
        wait_until(lambda: topic in self.heard(), "the listener")

    def heard(self) -> dict[str, list[dict]]:
        """Messages by topic, in their order."""
        messages = defaultdict(list)
        for line in self._log.read_text().splitlines(keepends=True):
            topic, _, text = line.partition(" ")
            if line.endswith("\n"):  # else it is still being written
                messages[topic].append(json.loads(text))
        return messages

    def numbers(self, topic: str) -> list[int]:
        """Numbers of the messages on a topic."""
        return [message["number"] for message in self.heard()[f"{ROOT}/{topic}"]]

    def states(self) -> list[dict]:
        return self.heard()[f"{ROOT}/state"]


@pytest.fixture
def broker(tmp_path):
    mosquitto = Mosquitto(tmp_path)
    try:
        mosquitto.start()
        yield mosquitto
    finally:
        mosquitto.stop()


@pytest.fixture
def listener(tmp_path, broker):
    listener = Listener(tmp_path, broker)
    try:
        yield listener
    finally:
        listener.process.kill()
        listener.process.wait()


@pytest.fixture
def monitor():
    with Feed() as feed:
        yield feed


def bridge_to(broker: Mosquitto, monitor: Feed, log: Path, *options: object) -> Bridge:
    arguments = ("--broker", broker.address, "--connect", monitor.endpoint, "--every", "0")
    return Bridge(log, "mqtt", *arguments, *options)


def test_nothing_is_lost_while_the_broker_is_away(tmp_path, broker, listener, monitor):
    """What is published in ten seconds without a broker arrives when it is back, in order and whole."""
    with bridge_to(broker, monitor, tmp_path / "log") as bridge:
        monitor.wait_for_subscriber()
        monitor.interval()
        wait_until(lambda: listener.numbers("verdict/0") == [0], "the first verdict")
        broker.stop()
        bridge.wait_for("is gone; messages wait for it")
        for _ in range(200):
            monitor.interval()
        monitor.event()
        broker.start()
        for _ in range(20):
            monitor.interval()
        wait_until(lambda: max(listener.numbers("verdict/0")) == 220, "the last verdict")
        wait_until(lambda: listener.numbers("health")[-1:] == [10], "the last health")
    assert sorted(set(listener.numbers("verdict/0"))) == list(range(221))
    assert sorted(set(listener.numbers("health"))) == list(range(11))
    assert set(listener.numbers("event")) == {0}
    first = listener.heard()[f"{ROOT}/verdict/0"][0]
    assert (first["type"], first["state"], first["machine"]) == ("verdict", "stable", "lathe-3")
    assert first["utc"] == "2026-01-01T00:00:00.000000+00:00"
    # The bridge was killed, which the broker tells in its place.
    wait_until(lambda: listener.states()[-1:] == [{"online": False}], "the last will")


def test_birth_and_death(tmp_path, broker, listener, monitor):
    """Online while the monitor is heard, offline when it ends and when the bridge is told to stop."""
    online = {"online": True, "lost": 0, "dropped": 0}
    offline = {"online": False, "lost": 0, "dropped": 0}
    with bridge_to(broker, monitor, tmp_path / "log") as bridge:
        monitor.wait_for_subscriber()
        monitor.interval()
        wait_until(lambda: listener.states()[-1:] == [online], "birth")
        monitor.finish()
        wait_until(lambda: listener.states()[-1:] == [offline], "the end of the monitor")
        monitor.interval()
        wait_until(lambda: listener.states()[-1:] == [online], "its return")
        bridge.process.send_signal(signal.SIGTERM)
        assert bridge.process.wait(PATIENCE_S) == 0
        wait_until(lambda: listener.states()[-1:] == [{"online": False}], "the farewell")
    assert "never acknowledged" not in bridge.said()


def test_the_buffer_is_bounded_and_counted(broker, listener):
    """Without a broker the buffer keeps the first messages, as many as it may; the rest is counted, and told."""
    broker.stop()
    told: list[str] = []
    with MqttLink(Broker(broker.address, "chatter-monitor", 10), "lathe-3", told.append) as link:
        for number in range(50):
            link.send(HEADER, verdict(number))
        link.tell(online=True)
        assert (link.dropped, link.waiting) == (40, 10)
        broker.start()
        wait_until(lambda: listener.numbers("verdict/0") == list(range(10)), "what was kept")
        wait_until(lambda: {"online": True, "lost": 0, "dropped": 40} in listener.states(), "the count")
        link.send(HEADER, verdict(50))
        wait_until(lambda: listener.numbers("verdict/0")[-1] == 50, "the next one")
    assert any("cannot be reached" in line for line in told)


@pytest.fixture
def guarded(tmp_path):
    """A broker with a certificate of its own and a user with a password."""
    need(openssl="openssl", mosquitto="mosquitto mosquitto-clients")
    request = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=localhost"]
    for name in ("broker", "stranger"):
        files = ["-keyout", tmp_path / f"{name}.key", "-out", tmp_path / f"{name}.pem"]
        alternative = ["-addext", "subjectAltName=DNS:localhost"]
        subprocess.run([*request, *alternative, *files], check=True, capture_output=True, timeout=PATIENCE_S)
    for name, password in (("right", "sesame"), ("wrong", "guess")):
        (tmp_path / name).write_text(password + "\n")
        (tmp_path / name).chmod(0o600)
    users = tmp_path / "users"
    subprocess.run(["mosquitto_passwd", "-b", "-c", users, "bridge", "sesame"], check=True, timeout=PATIENCE_S)
    certificate = (f"certfile {tmp_path}/broker.pem", f"keyfile {tmp_path}/broker.key")
    mosquitto = Mosquitto(tmp_path, "allow_anonymous false", f"password_file {users}", *certificate)
    try:
        mosquitto.start()
        yield mosquitto
    finally:
        mosquitto.stop()


def test_tls_and_password(tmp_path, guarded):
    """Over TLS with the right password the bridge is let in, with a wrong one it ends; a stranger is not spoken to."""
    login = ("--username", "bridge", "--tls", "--ca")
    for name, options, outcome in (
        ("let in", (*login, tmp_path / "broker.pem", "--password-file", tmp_path / "right"), "connected to the broker"),
        ("refused", (*login, tmp_path / "broker.pem", "--password-file", tmp_path / "wrong"), "got 'localhost"),
        ("stranger", (*login, tmp_path / "stranger.pem", "--password-file", tmp_path / "right"), "is not trusted"),
    ):
        with Feed() as monitor, bridge_to(guarded, monitor, tmp_path / f"{name}.log", *options) as bridge:
            monitor.wait_for_subscriber()
            monitor.interval()
            bridge.wait_for(outcome)
            if name == "refused":
                assert bridge.process.wait(PATIENCE_S) == 2
                assert "Not authorized" in bridge.said()
            assert "sesame" not in bridge.said()
