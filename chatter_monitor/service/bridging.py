"""Bridges: what a monitor publishes, in a plant's language. Processes of their own; the monitor notices nothing."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Protocol

from chatter_monitor.errors import InputError
from chatter_monitor.outlets.mqtt import Broker, MqttLink
from chatter_monitor.outlets.shdr import ShdrAdapter
from chatter_monitor.outlets.thinning import Thinning
from chatter_monitor.outlets.wire import Received
from chatter_monitor.records import Health
from chatter_monitor.service.told import until_told

# What a bridge subscribes to.
TOPICS = ("verdict", "event", "mismatch", "health")
PATIENCE_S = 0.1  # also the longest that an agent waits for its answer
SILENT_S = 5.0  # health comes every second

Say = Callable[[str], None]


class Monitor(Protocol):
    """What a bridge needs of a subscriber."""

    @property
    def lost(self) -> Mapping[str, int]: ...  # noqa: D102

    def receive(self, timeout_s: float) -> Received | None: ...  # noqa: D102


def bridge_mqtt(monitor: Monitor, broker: Broker, every_s: float, say: Say) -> None:
    """Send what a monitor publishes to an MQTT broker, until the process is told to stop.

    The machine's name, and with it the topics, are those of the first message.

    Parameters
    ----------
    monitor : Monitor
        A subscriber of `TOPICS`.
    broker : Broker
        Where to send it.
    every_s : float
        How often a state that stays the same is told.
    say : callable
        Told in a line what to know.

    Raises
    ------
    InputError
        If the broker does not let us in.
    EnvironmentFault
        If paho-mqtt is not installed.
    """
    thinning, presence = Thinning(every_s), _Presence(say)
    with until_told() as told:
        while (first := monitor.receive(PATIENCE_S)) is None:
            presence.heard(None)
            if told():
                return
        with MqttLink(broker, first.header.machine, say) as link:
            received: Received | None = first
            while not told():
                if received is not None and (message := thinning.passed(received.body)) is not None:
                    link.send(received.header, message)
                link.tell(online=presence.heard(received), lost=sum(monitor.lost.values()))
                if link.refused is not None:
                    raise InputError(f"the broker does not let us in: {link.refused}", got=broker.address)
                received = monitor.receive(PATIENCE_S)


def bridge_mtconnect(monitor: Monitor, bind: str, every_s: float, say: Say) -> None:
    """Answer MTConnect agents with what a monitor publishes, until the process is told to stop.

    Parameters
    ----------
    monitor : Monitor
        A subscriber of `TOPICS`.
    bind : str
        Host and port where agents connect.
    every_s : float
        How often the values of a state that stays the same are told.
    say : callable
        Told in a line what to know.

    Raises
    ------
    InputError
        If `bind` is no address.
    EnvironmentFault
        If it cannot be bound.
    """
    thinning, presence = Thinning(every_s), _Presence(say)
    with until_told() as told, ShdrAdapter(bind) as adapter:
        say(f"MTConnect agents may connect to {adapter.address}")
        adapter.unavailable(_now())
        while not told():
            received = monitor.receive(PATIENCE_S)
            if received is not None and (message := thinning.passed(received.body)) is not None:
                adapter.send(received.header, message)
            if not presence.heard(received):
                adapter.unavailable(_now())
            adapter.serve()


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="microseconds")


class _Presence:
    """Whether the monitor is heard: something came in the last seconds, and it was no farewell."""

    def __init__(self, say: Say) -> None:
        self._say = say
        self._newest_s = time.monotonic()
        self._heard: bool | None = None

    def heard(self, received: Received | None) -> bool:
        """Take the newest message, None where there is none."""
        now_s = time.monotonic()
        if received is not None:
            self._newest_s = now_s
            self._tell(not (isinstance(received.body, Health) and received.body.state == "finished"))
        elif now_s - self._newest_s > SILENT_S:
            self._tell(False)
        return self._heard is True

    def _tell(self, heard: bool) -> None:
        if heard != self._heard:
            silent = "nothing comes yet; waiting for a monitor" if self._heard is None else "the monitor is silent"
            self._say("the monitor is heard" if heard else silent)
        self._heard = heard
