"""The MTConnect adapter, met by a client that speaks SHDR as an agent does."""

from __future__ import annotations

import socket

import pytest

from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.outlets.shdr import ShdrAdapter
from chatter_monitor.outlets.wire import Header
from tests.bridging import PATIENCE_S, Bridge, Feed, verdict


class Agent:
    """What an agent does: connect, ask whether somebody is there, read lines."""

    def __init__(self, address: str) -> None:
        host, _, port = address.rpartition(":")
        self._socket = socket.create_connection((host, int(port)), timeout=PATIENCE_S)
        self._file = self._socket.makefile("r", encoding="utf-8", newline="\n")

    def say(self, words: str) -> None:
        self._socket.sendall(words.encode())

    def line(self) -> str:
        try:
            return self._file.readline().removesuffix("\n")
        except ConnectionResetError:  # it left without reading all that was said
            return ""

    def until(self, last: str) -> list[str]:
        """Lines up to one that ends like this, without their times."""
        lines = []
        while not lines or not lines[-1].endswith(last):
            line = self.line()
            assert line, f"the adapter left before {last}, after {lines}"
            lines.append(line.partition("|")[2] if "|" in line else line)
        return lines

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._file.close()
        self._socket.close()


@pytest.fixture
def monitor():
    with Feed() as feed:
        yield feed


@pytest.fixture
def bridge(monitor, tmp_path):
    """The bridge, with a monitor that has published nothing yet; every message goes on."""
    arguments = ("mtconnect", "--bind", "127.0.0.1:0", "--connect", monitor.endpoint, "--every", "0")
    with Bridge(tmp_path / "log", *arguments) as bridge:
        bridge.wait_for("may connect to 127.0.0.1:")
        monitor.wait_for_subscriber()
        yield bridge


@pytest.fixture
def address(bridge):
    return bridge.said().split("may connect to ")[1].split()[0]


def test_a_life_of_a_monitor(monitor, address):
    """Unavailable before it, its verdicts and health while it runs, unavailable when it ends; a ping has its answer."""
    with Agent(address) as agent:
        assert agent.until("hearing|UNAVAILABLE||||") == ["avail|UNAVAILABLE", "hearing|UNAVAILABLE||||"]
        agent.say("* PI")
        agent.say("NG\r\n* SOMETHING\n* PING\n")
        assert [agent.line(), agent.line()] == ["* PONG 10000", "* PONG 10000"]
        monitor.interval("stable")
        assert agent.until("probability_0|2") == [
            "avail|AVAILABLE",
            "state_0|stable",
            "chatter_0|NORMAL|stable|||",
            "frequency_0|900",
            "damping_0|2",
            "confidence_0|90",
            "probability_0|2",
        ]
        monitor.interval("approaching")
        assert agent.line() == "2026-01-01T00:00:00.050000Z|state_0|approaching"
        assert agent.line() == "2026-01-01T00:00:00.050000Z|chatter_0|WARNING|approaching|||so it is / really"
        monitor.interval("self_excited")
        assert agent.until("really") == ["state_0|self_excited", "chatter_0|FAULT|self_excited|||so it is / really"]
        monitor.interval("unknown")
        assert agent.until("probability_0|UNAVAILABLE") == [
            "state_0|unknown",
            "chatter_0|UNAVAILABLE||||",
            "frequency_0|UNAVAILABLE",
            "damping_0|UNAVAILABLE",
            "probability_0|UNAVAILABLE",
        ]
        for _ in range(16):
            monitor.interval("stable")
        assert "hearing|NORMAL|hearing|||" in agent.until("hearing|||")
        monitor.finish()
        gone = agent.until("probability_0|UNAVAILABLE")
        assert {line.split("|")[1] for line in gone[-8:]} == {"UNAVAILABLE"}
        assert {"avail|UNAVAILABLE", "chatter_0|UNAVAILABLE||||"} <= set(gone)


def test_agents_come_and_go(monitor, bridge, address):
    """Several agents are told the same; one that connects later is told everything; none harms another by leaving."""
    monitor.interval("stable")
    with Agent(address) as first:
        first.until("probability_0|2")
        with Agent(address) as second, Agent(address) as third:
            lines = second.until("probability_0|2")
            assert {line.split("|")[0] for line in lines} >= {"avail", "hearing", "state_0", "chatter_0", "damping_0"}
            third.say("x" * 5000)  # no line at all
            third.until("probability_0|2")
            assert third.line() == ""
        monitor.interval("self_excited")
        assert first.until("really")[-1].startswith("chatter_0|FAULT")
    with Agent(address) as fourth:
        assert "chatter_0|FAULT|self_excited|||so it is / really" in fourth.until("probability_0|2")
    bridge.process.terminate()
    assert bridge.process.wait(PATIENCE_S) == 0


def test_an_agent_that_does_not_listen():
    """An agent whose queue is full is let go, rather than waited for."""
    header = Header(
        schema="chatter-monitor/verdict/1", session="s", seq=0, sample0=0, fs=12800.0, utc="2026", machine="m"
    )
    with ShdrAdapter("127.0.0.1:0") as adapter, Agent(adapter.address) as agent:
        adapter.unavailable("2026")
        adapter.serve()
        for number in range(200_000):
            adapter.send(header, verdict(number, "stable" if number % 2 else "forced"))
            if not adapter.agents:
                break
        assert adapter.agents == 0
        assert agent.line() == "2026|avail|UNAVAILABLE"


def test_places_that_cannot_be():
    """What is no address is the user's input; a port that another program holds is the environment's fault."""
    with pytest.raises(InputError, match="no address"):
        ShdrAdapter("7878")
    with socket.create_server(("127.0.0.1", 0)) as other, pytest.raises(EnvironmentFault, match="MTConnect"):
        ShdrAdapter(f"127.0.0.1:{other.getsockname()[1]}")
