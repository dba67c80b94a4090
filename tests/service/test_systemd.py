"""What systemd is told, read from a real socket."""

from __future__ import annotations

import logging
import socket
import time
import uuid

import pytest

from chatter_monitor.errors import EnvironmentFault
from chatter_monitor.service.systemd import Notifier


@pytest.fixture
def manager(tmp_path):
    """Service manager's end of the notification socket, and its address."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(1.0)
        yield manager, str(tmp_path / "notify")


def test_every_message_is_one_datagram_of_assignments(manager):
    """Ready, watchdog, status, reloading and stopping arrive in order in the words of sd_notify(3)."""
    server, address = manager
    with Notifier(address) as notifier:
        notifier.ready("listening to lathe-3")
        notifier.watchdog()
        notifier.status("stable at 898 Hz, 5 ± 1 %")
        notifier.reloading(1_234_567)
        notifier.ready()
        notifier.stopping("asked to")
    assert [server.recv(4096).decode() for _ in range(6)] == [
        "READY=1\nSTATUS=listening to lathe-3",
        "WATCHDOG=1",
        "STATUS=stable at 898 Hz, 5 ± 1 %",
        "RELOADING=1\nMONOTONIC_USEC=1234567",
        "READY=1",
        "STOPPING=1\nSTATUS=asked to",
    ]


def test_a_status_is_one_line(manager):
    """A line break in a status cannot become an assignment."""
    server, address = manager
    with Notifier(address) as notifier:
        notifier.status("device lost:\nWATCHDOG=trigger\n")
    assert server.recv(4096) == b"STATUS=device lost: WATCHDOG=trigger"


def test_an_abstract_name_works():
    """An address that begins with @ is a name in the abstract namespace."""
    name = f"chatter-monitor-{uuid.uuid4()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as server:
        server.bind("\0" + name)
        server.settimeout(1.0)
        with Notifier("@" + name) as notifier:
            notifier.ready()
        assert server.recv(4096) == b"READY=1"


@pytest.mark.parametrize("environment", [{}, {"NOTIFY_SOCKET": ""}])
def test_without_systemd_nothing_happens(environment, caplog):
    """Where nobody asked, messages go nowhere and no watchdog waits for food."""
    with Notifier.from_environment(environment, pid=7) as notifier:
        notifier.ready()
        notifier.watchdog()
        notifier.stopping()
        assert notifier.watchdog_s is None
    assert not caplog.records


def test_the_environment_tells_address_and_watchdog(manager):
    """NOTIFY_SOCKET is where messages go; WATCHDOG_USEC counts unless it is for another process."""
    server, address = manager
    environment = {"NOTIFY_SOCKET": address, "WATCHDOG_USEC": "2500000"}
    with Notifier.from_environment(environment, pid=7) as notifier:
        notifier.watchdog()
        assert notifier.watchdog_s == 2.5
    assert server.recv(4096) == b"WATCHDOG=1"
    for pid, expected in (("7", 2.5), ("8", None)):
        with Notifier.from_environment(environment | {"WATCHDOG_PID": pid}, pid=7) as notifier:
            assert notifier.watchdog_s == expected


@pytest.mark.parametrize(
    "environment",
    [{"NOTIFY_SOCKET": "vsock:2:1234"}, {"NOTIFY_SOCKET": "x"}, {"WATCHDOG_USEC": "0"}, {"WATCHDOG_USEC": "1s"}],
)
def test_nonsense_in_the_environment_is_refused(environment):
    """Values that systemd does not give are an environment fault that names the variable and what it held."""
    with pytest.raises(EnvironmentFault) as caught:
        Notifier.from_environment(environment, pid=7)
    name, value = next(iter(environment.items()))
    assert name in str(caught.value)
    assert value in str(caught.value)


def test_a_manager_that_is_gone_or_stuck_does_not_stop_the_monitor(manager, caplog):
    """Neither a full socket nor a missing one raises or holds it up for a second; both are logged."""
    server, address = manager
    with Notifier(address) as notifier, caplog.at_level(logging.WARNING):
        sent = 0
        while not caplog.records:
            began = time.monotonic()
            notifier.watchdog()
            held_up_s = time.monotonic() - began
            sent += 1
            assert sent < 10_000
        server.close()
        notifier.watchdog()
    assert len(caplog.records) == 2
    assert held_up_s < 1.0
