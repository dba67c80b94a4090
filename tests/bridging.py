"""A monitor that says what a test wants, and a bridge to it in a process of its own."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Self

from chatter_monitor.outlets.publisher import Clock, Publisher, PublishSettings
from chatter_monitor.records import State, Verdict
from tests import messages
from tests.messages import INTERVAL, RATE_HZ

PATIENCE_S = 200.0


def wait_until(condition: Callable[[], bool], what: str = "it") -> None:
    """Wait for what has to come, however slow the machine is."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, f"{what} never came"
        time.sleep(0.01)


def verdict(number: int, state: State = "stable") -> Verdict:
    """Verdict on the interval of that number."""
    return messages.verdict(
        number,
        state,
        frequency_hz=None if state in ("idle", "unknown") else 900.0,
        damping_ratio=None if state in ("idle", "unknown") else 0.02,
        confidence=0.9,
        chatter_probability=None if state == "unknown" else 0.02,
        reasons=["so it is | really"],
    )


class Feed:
    """A publisher as the daemon has it, and how far it has come."""

    def __init__(self) -> None:
        clock = Clock(RATE_HZ, datetime(2026, 1, 1, tzinfo=UTC))
        self._publisher = Publisher(PublishSettings(bind="tcp://127.0.0.1:0"), clock=clock, machine="lathe-3")
        self.endpoint = self._publisher.endpoint
        self.intervals = 0
        self.seconds = 0

    def wait_for_subscriber(self) -> None:
        assert self._publisher.wait_for_subscriber(PATIENCE_S)

    def interval(self, state: State = "stable") -> None:
        """Publish the next verdict, and once a second how the monitor is."""
        self._publisher.message(verdict(self.intervals, state))
        self.intervals += 1
        if self.intervals % (RATE_HZ // INTERVAL) == 0:
            self.seconds += 1
            self._publisher.message(messages.health(t=float(self.seconds)))

    def event(self) -> None:
        self._publisher.message(messages.event())

    def finish(self) -> None:
        self._publisher.message(messages.health(t=float(self.seconds), state="finished"))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._publisher.close()


class Bridge:
    """`chatter-monitor bridge` as a process; what it says goes to a file."""

    def __init__(self, log: Path, *arguments: object) -> None:
        self._log = log
        command = [sys.executable, "-m", "chatter_monitor", "bridge", *map(str, arguments)]
        with log.open("wb") as told:
            self.process = subprocess.Popen(command, stdout=told, stderr=told)

    def said(self) -> str:
        return self._log.read_text()

    def wait_for(self, words: str) -> None:
        wait_until(lambda: words in self.said(), words)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.process.kill()
        self.process.wait()
