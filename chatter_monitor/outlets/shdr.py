"""An MTConnect adapter: the newest verdict of each channel in SHDR, the lines that MTConnect agents read.

SHDR ("simple hierarchical data representation") is what the adapter of an MTConnect agent speaks over TCP: lines of
``time|key|value``, of a condition ``time|key|level|native code|native severity|qualifier|text``, and ``* PING`` from
the agent, which ``* PONG <ms>`` answers. It is described with the reference agent of the MTConnect Institute
(cppagent, README, "Adapter Agent Protocol").
"""

from __future__ import annotations

import selectors
import socket
from types import TracebackType
from typing import Self

from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.outlets.address import host_and_port
from chatter_monitor.outlets.wire import Header
from chatter_monitor.records import Announcement, Health, State, Verdict

HEARTBEAT_MS = 10_000
UNAVAILABLE = "UNAVAILABLE"
LONGEST_LINE = 1024

# Level of the condition `chatter` in each state, "unknown" included: what cannot be told never reads as normal.
LEVELS: dict[State, str] = {
    "idle": "NORMAL",
    "stable": "NORMAL",
    "forced": "NORMAL",
    "approaching": "WARNING",
    "self_excited": "FAULT",
    "unknown": UNAVAILABLE,
}


CONDITIONS = ("hearing", "chatter")


class ShdrAdapter:
    """Holds the newest values, tells an agent that connects all of them, and from then on what changes.

    Of channel c: the condition ``chatter_c``, the event ``state_c``, the samples ``frequency_c`` in hertz and
    ``damping_c``, ``confidence_c`` and ``probability_c``, that it chatters, in percent. Of the monitor: the event
    ``avail``, the condition ``hearing``.
    One thread owns it.

    Parameters
    ----------
    bind : str
        Host and port where agents connect; port 0 for any free one.

    Attributes
    ----------
    address : str
        Host and port that were found.

    Raises
    ------
    InputError
        If `bind` is no address.
    EnvironmentFault
        If it cannot be bound.
    """

    def __init__(self, bind: str) -> None:
        host, port = host_and_port(bind) or ("", None)
        if port is None:
            raise InputError("this is no address to bind to", got=bind, allowed="such as 127.0.0.1:7878")
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            self._server = socket.create_server((host, port), family=family)
        except OSError as error:
            raise EnvironmentFault(
                f"cannot answer MTConnect agents: {error.strerror}",
                got=bind,
                remedy="Another program may hold the port; choose another one with --bind.",
            ) from error
        self._server.setblocking(False)
        self.address = f"{bind.rpartition(':')[0]}:{self._server.getsockname()[1]}"
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._server, selectors.EVENT_READ)
        self._heard: dict[socket.socket, bytes] = {}  # of each agent, the beginning of its next line
        self._values: dict[str, str] = {}
        self._since: dict[str, str] = {}

    @property
    def agents(self) -> int:
        """Agents that are connected."""
        return len(self._heard)

    def send(self, header: Header, message: Announcement) -> None:
        """Tell what is new in a message. Events bring nothing: a condition tells itself that it has ended."""
        match message:
            case Verdict():
                self._tell(header.utc, {"avail": "AVAILABLE"} | _of_verdict(message))
            case Health():
                level = "NORMAL" if message.state == "hearing" else "FAULT"
                hearing = _condition(level, message.state, "; ".join(message.reasons))
                self._tell(header.utc, {"avail": "AVAILABLE", "hearing": hearing})

    def unavailable(self, utc: str) -> None:
        """Tell that from now on nothing is known."""
        self._tell(utc, dict.fromkeys(("avail", "hearing", *self._values), UNAVAILABLE))

    def serve(self) -> None:
        """Let agents in, answer those that ask whether we are there; returns at once."""
        for key, _ in self._selector.select(0):
            if key.fileobj is self._server:
                agent, _ = self._server.accept()
                agent.setblocking(False)
                self._selector.register(agent, selectors.EVENT_READ)
                self._heard[agent] = b""
                self._write(agent, "".join(self._line(name) for name in self._values))
            elif isinstance(key.fileobj, socket.socket):
                self._read(key.fileobj)

    def close(self) -> None:
        """Let go of the agents and of the port."""
        for agent in list(self._heard):
            self._drop(agent)
        self._selector.close()
        self._server.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def _tell(self, utc: str, values: dict[str, str]) -> None:
        news = {name: value for name, value in values.items() if self._values.get(name) != value}
        self._values |= news
        self._since |= dict.fromkeys(news, utc.replace("+00:00", "Z"))
        lines = "".join(self._line(name) for name in news)
        for agent in list(self._heard) if lines else ():
            self._write(agent, lines)

    def _line(self, name: str) -> str:
        value = self._values[name]
        if value == UNAVAILABLE and name.startswith(CONDITIONS):
            value = _condition(UNAVAILABLE)
        return f"{self._since[name]}|{name}|{value}\n"

    def _read(self, agent: socket.socket) -> None:
        try:
            data = agent.recv(4096)
        except OSError:
            data = b""
        *lines, self._heard[agent] = (self._heard[agent] + data).split(b"\n")
        if not data or len(self._heard[agent]) > LONGEST_LINE:
            self._drop(agent)
            return
        for line in lines:
            if line.strip() == b"* PING":
                self._write(agent, f"* PONG {HEARTBEAT_MS}\n")

    def _write(self, agent: socket.socket, lines: str) -> None:
        try:
            agent.sendall(lines.encode())
        except OSError:  # it is gone, or does not listen: when it comes again it is told everything
            self._drop(agent)

    def _drop(self, agent: socket.socket) -> None:
        if self._heard.pop(agent, None) is not None:
            self._selector.unregister(agent)
            agent.close()


def _of_verdict(verdict: Verdict) -> dict[str, str]:
    """Values of a channel."""
    level = LEVELS[verdict.state]
    text = "" if level == "NORMAL" else "; ".join(verdict.reasons)
    values = {
        "state": verdict.state,
        "chatter": UNAVAILABLE if level == UNAVAILABLE else _condition(level, verdict.state, text),
        "frequency": _number(verdict.frequency_hz, 1.0),
        "damping": _number(verdict.damping_ratio, 100.0),
        "confidence": _number(verdict.confidence, 100.0),
        "probability": _number(verdict.chatter_probability, 100.0),
    }
    return {f"{name}_{verdict.channel}": value for name, value in values.items()}


def _condition(level: str, code: str = "", text: str = "") -> str:
    """Level, native code, native severity, qualifier, text; bars and line breaks would end it early."""
    return f"{level}|{code}|||{' '.join(text.replace('|', '/').split())}"


def _number(value: float | None, factor: float) -> str:
    return UNAVAILABLE if value is None else f"{factor * value:.6g}"
