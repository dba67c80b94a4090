"""The daemon with a device of the test's: ready, fed, told to stop, told to read its configuration again."""

from __future__ import annotations

import logging
import os
import signal
import socket
import threading
import time
from itertools import pairwise

import pytest
from rich.console import Console

from chatter_monitor.client import Subscriber
from chatter_monitor.errors import EnvironmentFault
from chatter_monitor.records import Health, Verdict
from chatter_monitor.service.daemon import Daemon
from chatter_monitor.service.systemd import Notifier
from tests.fake_card import PlayingDevices, eventually
from tests.signals import RATE_HZ, vibration

CUT = 0.1 * vibration(8 * round(RATE_HZ), [(400, 0.03)])


class Manager:
    """The service manager's side of the notification socket."""

    def __init__(self, directory):
        self.path = str(directory / "notify")
        self.told = []
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(self.path)
        self._socket.settimeout(0.05)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def _listen(self):
        while not self._ended.is_set():
            try:
                self.told += self._socket.recv(4096).decode().split("\n")
            except TimeoutError:
                continue

    def close(self):
        self._ended.set()
        self._thread.join()
        self._socket.close()

    def count(self, what):
        return sum(told.startswith(what) for told in list(self.told))


class Acting:
    """The main thread is the daemon's; what happens to it, and what it publishes, is seen to from here."""

    def __init__(self, directory, devices, manager, tables=""):
        self.directory = directory
        self.devices = devices
        self.manager = manager
        self.config = directory / "machine.toml"
        self.write(tables)
        self.messages = []
        self.stopped_s = None
        self._failure = None

    def write(self, tables):
        self.config.write_text(
            f'[publish]\nbind = "ipc://{self.directory}/published"\n'
            f'[recorder]\ndirectory = "{self.directory}/events"\n{tables}'
        )

    def run(self, act):
        """Run the daemon while `act` happens in another thread; then stop it."""

        def listen():
            with Subscriber(f"ipc://{self.directory}/published") as subscriber:
                while not done.is_set():
                    received = subscriber.receive(0.05)
                    if received is not None:
                        self.messages.append(received.body)

        def act_and_stop():
            try:
                act(self)
            except BaseException as failure:
                self._failure = failure
            self.stopped_s = time.monotonic()
            if not done.is_set():
                os.kill(os.getpid(), signal.SIGTERM)

        done = threading.Event()
        threads = [threading.Thread(target=listen), threading.Thread(target=act_and_stop)]
        notifier = Notifier(self.manager.path, watchdog_s=0.2)
        daemon = Daemon([self.config], notifier=notifier, console=Console(quiet=True), opener=self.devices)
        for thread in threads:
            thread.start()
        try:
            daemon.run()
        finally:
            done.set()
            self.stop_took_s = time.monotonic() - (self.stopped_s or time.monotonic())
            for thread in threads:
                thread.join(30.0)
            notifier.close()
        if self._failure is not None:
            raise self._failure

    def of(self, kind):
        return [message for message in list(self.messages) if isinstance(message, kind)]


@pytest.fixture
def manager(tmp_path):
    manager = Manager(tmp_path)
    yield manager
    manager.close()


@pytest.fixture
def acting(tmp_path, manager):
    return Acting(tmp_path, PlayingDevices(CUT), manager)


def test_ready_after_the_first_tracked_block(acting, manager):
    """READY waits for samples, not for an open device; then the watchdog is fed; in the end stopping is announced."""

    def act(acting):
        eventually(lambda: manager.count("STATUS=Waiting for device") > 0)
        acting.devices.opened()
        assert manager.count("READY=1") == 0
        acting.devices.quiet.clear()
        eventually(lambda: manager.count("READY=1") == 1)
        eventually(lambda: manager.count("WATCHDOG=1") > 2)
        eventually(lambda: manager.count("STATUS=Hearing 'fake' at 12.8 kHz. channel 0: stable") > 0)

    acting.devices.quiet.set()
    acting.run(act)
    assert manager.count("READY=1") == 1
    assert manager.told.index("READY=1") < manager.told.index("STOPPING=1")
    assert acting.stop_took_s < 2.0


def test_the_last_messages_come_out(acting):
    """On SIGTERM the frames under way are given out, and the last health message says that it is finished."""
    acting.run(lambda acting: eventually(lambda: len(acting.of(Verdict)) > 20))
    last = acting.of(Health)[-1]
    verdicts = acting.of(Verdict)
    assert last.state == "finished"
    assert last.lost == 0
    assert verdicts[-1].sample1 == last.samples_in
    assert all(one.sample1 == other.sample0 for one, other in pairwise(verdicts))


def test_a_starving_watchdog(acting, manager, caplog):
    """Deaf for longer than give_up_s, the watchdog is not fed any more, until samples come again."""
    acting.write("[input]\ngive_up_s = 1.5\n")

    def act(acting):
        device = acting.devices.opened()
        eventually(lambda: manager.count("READY=1") == 1)
        acting.devices.absent = "it is not plugged in"
        device.end()
        eventually(lambda: "giving up" in caplog.text)
        fed = manager.count("WATCHDOG=1")
        healths = len(acting.of(Health))
        eventually(lambda: len(acting.of(Health)) >= healths + 2)  # it goes on telling
        assert manager.count("WATCHDOG=1") <= fed + 1  # that may have been on its way
        acting.devices.absent = None
        eventually(lambda: manager.count("WATCHDOG=1") > fed + 1)

    with caplog.at_level(logging.INFO, "chatter_monitor"):
        acting.run(act)
    deaf = [health for health in acting.of(Health) if health.state == "not_hearing"]
    assert any("it is not plugged in" in reason for reason in deaf[-1].reasons)
    unknown = [verdict for verdict in acting.of(Verdict) if "gap" in verdict.flags]
    assert {verdict.state for verdict in unknown} == {"unknown"}
    assert sum(any("it is not plugged in" in reason for reason in verdict.reasons) for verdict in unknown) > 20


def test_without_a_device_at_the_start(acting, manager):
    """A daemon that finds no device says why every second, is not ready, and begins when there is one."""
    acting.devices.absent = "it is not plugged in"

    def act(acting):
        eventually(lambda: len(acting.of(Health)) >= 2)
        assert {health.state for health in acting.of(Health)} == {"not_hearing"}
        assert manager.count("READY=1") == 0
        acting.devices.absent = None
        eventually(lambda: acting.of(Health)[-1].state == "hearing")

    acting.run(act)
    assert manager.count("READY=1") == 1


def test_reading_the_configuration_again(acting, manager, caplog):
    """SIGHUP changes thresholds and spindle at once, keeps what it had when the file is bad, says what must wait."""

    def hang_up(tables):
        acting.write(tables)
        before = manager.count("RELOADING=1")
        os.kill(os.getpid(), signal.SIGHUP)
        eventually(lambda: manager.count("RELOADING=1") > before)

    at_once = "[verdict]\nalarm_probability = 1e-12\ncalm_probability = 1e-12\n"

    def newest_state():
        return acting.of(Verdict)[-1].state

    def newest_reasons():
        return "; ".join(acting.of(Health)[-1].reasons)

    def act(acting):
        eventually(lambda: len(acting.of(Verdict)) > 20)
        assert newest_state() == "stable"
        hang_up(at_once)
        eventually(lambda: newest_state() == "self_excited")
        hang_up("[spindle]\nspeed_rpm = 4000.0\nteeth = 2\n")
        eventually(lambda: newest_state() == "stable" and acting.of(Verdict)[-1].order is not None)
        hang_up(at_once)
        eventually(lambda: newest_state() == "self_excited" and acting.of(Verdict)[-1].order is None)
        hang_up("[verdict]\nchatter_dumping = 0.003\n")
        eventually(lambda: "unknown key [verdict] chatter_dumping" in newest_reasons())
        assert newest_state() == "self_excited"
        hang_up('[input]\ndevice = "other"\n[machine]\nname = "renamed"\n')
        eventually(lambda: "[machine], [input] of the configuration changed" in newest_reasons())
        eventually(lambda: manager.count("READY=1") == 6)

    with caplog.at_level(logging.INFO, "chatter_monitor"):
        acting.run(act)
    assert "configuration read again; changed: [verdict]" in caplog.text
    assert "the old configuration stays: unknown key [verdict] chatter_dumping" in caplog.text
    assert "which needs a restart" in caplog.text


def test_an_error_of_the_card_ends_the_daemon(acting):
    """An error that nobody foresaw, in whatever thread, comes out of `run`, and with that ends the process."""

    def choose():
        raise ZeroDivisionError("somewhere")

    acting.devices.choose = choose
    with pytest.raises(ZeroDivisionError):
        acting.run(lambda _: time.sleep(5.0))


def test_a_taken_port_is_told_before_anything_else(acting):
    """A socket that cannot be bound ends the start with a remedy; no device has been looked for."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        acting.config.write_text(f'[publish]\nbind = "tcp://127.0.0.1:{taken.getsockname()[1]}"\n')
        daemon = Daemon([acting.config], notifier=Notifier(None), console=Console(quiet=True), opener=acting.devices)
        with pytest.raises(EnvironmentFault, match="cannot bind"):
            daemon.run()
    assert acting.devices.attempts == 0
