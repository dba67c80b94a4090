"""Asks a running monitor how it goes, over the sockets that it has anyway."""

from __future__ import annotations

import time
from typing import Any

import msgspec
import zmq

from chatter_monitor.errors import EnvironmentFault
from chatter_monitor.outlets.control import AskStatus, ControlSettings, StatusReply
from chatter_monitor.outlets.publisher import PublishSettings
from chatter_monitor.outlets.wire import encode
from chatter_monitor.records import Health

WAIT_S = 3.0  # health comes every second


def newest_health(publish: PublishSettings, control: ControlSettings, wait_s: float) -> Health:
    """Health of the monitor that runs with this configuration, not older than a second.

    Parameters
    ----------
    publish, control : PublishSettings, ControlSettings
        Where it publishes, and where it answers; the latter is asked where what is published is encrypted.
    wait_s : float
        For how long to wait.

    Raises
    ------
    EnvironmentFault
        If it does not answer, or nobody without a certificate could ask.
    """
    if publish.server_key is None:
        return _published(_reachable(publish.bind), wait_s)
    if control.bind is None:
        raise EnvironmentFault(
            "the monitor publishes to certificates only, and has no control socket to be asked at",
            remedy='Set one: [control] bind = "ipc:///run/chatter-monitor/control".',
        )
    return _asked(control.bind, wait_s)


def _published(endpoint: str, wait_s: float) -> Health:
    """Take the next health message that is published."""
    with zmq.Context() as context, context.socket(zmq.SUB) as socket:
        _prepare(socket, endpoint, wait_s)
        socket.setsockopt(zmq.SUBSCRIBE, b"health")
        socket.connect(endpoint)
        try:
            _, _, body = socket.recv_multipart()
        except zmq.Again:
            raise _silent(endpoint, wait_s) from None
        return msgspec.json.decode(body, type=Health)


def _asked(endpoint: str, wait_s: float) -> Health:
    """Ask until the answer is newer than the first one: a worker that is stuck leaves the last one standing."""
    deadline_s = time.monotonic() + wait_s
    first: Health | None = None
    with zmq.Context() as context, context.socket(zmq.REQ) as socket:
        _prepare(socket, endpoint, wait_s)
        socket.connect(endpoint)
        while time.monotonic() < deadline_s:
            socket.send(encode(AskStatus()))
            try:
                health = msgspec.json.decode(socket.recv(), type=StatusReply).status.health
            except zmq.Again:
                break
            if first is not None and health is not None and health.t > first.t:
                return health
            first = first or health
            time.sleep(0.2)
    raise _silent(endpoint, wait_s)


def _prepare(socket: zmq.Socket[Any], endpoint: str, wait_s: float) -> None:
    socket.linger = 0
    socket.rcvtimeo = round(1000 * wait_s)
    socket.ipv6 = "[" in endpoint


def _reachable(endpoint: str) -> str:
    """Where to connect to reach what is bound to all addresses."""
    return endpoint.replace("//*:", "//127.0.0.1:").replace("//0.0.0.0:", "//127.0.0.1:")


def _silent(endpoint: str, wait_s: float) -> EnvironmentFault:
    return EnvironmentFault(
        f"no monitor has said anything for {wait_s:g} s",
        got=endpoint,
        remedy="Does it run, and with this configuration? `systemctl status chatter-monitor` tells.",
    )
