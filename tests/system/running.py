"""A daemon in a process of its own, and everything that it publishes, with the time at which it came."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

from chatter_monitor.client import Received, Subscriber
from chatter_monitor.records import Health, OdpFrame, Verdict

WAIT_S = 240.0  # kernels may have to be compiled first


class Taken(NamedTuple):
    """A message with its time on the steady clock."""

    at_s: float
    message: Received


class Running:
    """`chatter-monitor run` and a subscriber to it.

    Parameters
    ----------
    directory : Path
        For its configuration, socket, journal and recordings.
    environment : mapping
        That it runs in.
    tables : str
        Further tables of its configuration, TOML.
    """

    def __init__(self, directory: Path, environment: Mapping[str, str], tables: str = "") -> None:
        endpoint = f"ipc://{directory}/published"
        config = directory / "machine.toml"
        config.write_text(
            f'[publish]\nbind = "{endpoint}"\n'
            f'[recorder]\ndirectory = "{directory}/events"\npre_s = 1.0\npost_s = 0.5\n{tables}'
        )
        self.config = config
        self.journal = directory / "journal.txt"
        self.events = directory / "events"
        self.taken: list[Taken] = []
        with self.journal.open("wb") as journal:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "chatter_monitor", "run", "--config", config],
                env=environment,
                stdout=subprocess.DEVNULL,
                stderr=journal,
            )
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._listen, args=[endpoint])
        self._thread.start()

    def _listen(self, endpoint: str) -> None:
        with Subscriber(endpoint, high_water_mark=100_000) as subscriber:
            while not self._stopping.is_set():
                received = subscriber.receive(0.1)
                if received is not None:
                    self.taken.append(Taken(time.monotonic(), received))

    def until(self, what: Callable[[Taken], bool], *, since_s: float = 0.0, wait_s: float = WAIT_S) -> Taken:
        """Wait for the first message since a time that is like this."""
        deadline_s = time.monotonic() + wait_s
        seen = 0
        while time.monotonic() < deadline_s:
            while seen < len(self.taken):
                taken = self.taken[seen]
                seen += 1
                if taken.at_s >= since_s and what(taken):
                    return taken
            assert self.process.poll() is None, f"the daemon has ended:\n{self.journal.read_text()}"
            time.sleep(0.01)
        raise AssertionError(f"it has not come within {wait_s} s; the journal:\n{self.journal.read_text()}")

    def verdicts(self) -> list[Verdict]:
        """All verdicts so far."""
        return [taken.message.body for taken in self.taken if isinstance(taken.message.body, Verdict)]

    def frames(self) -> list[OdpFrame]:
        """All frames so far."""
        return [taken.message.body for taken in self.taken if isinstance(taken.message.body, OdpFrame)]

    def stop(self) -> float:
        """Have it stop as the service manager would; returns the seconds that it took."""
        began_s = time.monotonic()
        self.process.terminate()
        code = self.process.wait(30.0)
        took_s = time.monotonic() - began_s
        assert code == 0, self.journal.read_text()
        return took_s

    def close(self) -> None:
        """End everything."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self._stopping.set()
        self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()


def hears(taken: Taken) -> bool:
    """Whether it is a health message of a monitor that hears."""
    return isinstance(taken.message.body, Health) and taken.message.body.state == "hearing"


def deaf(taken: Taken) -> bool:
    """Whether it is a health message of a monitor that does not hear."""
    return isinstance(taken.message.body, Health) and taken.message.body.state == "not_hearing"


def known(taken: Taken) -> bool:
    """Whether it is a verdict that claims something."""
    return isinstance(taken.message.body, Verdict) and taken.message.body.state != "unknown"


def unknown(taken: Taken) -> bool:
    """Whether it is a verdict that claims nothing, for want of samples."""
    body = taken.message.body
    return isinstance(body, Verdict) and body.state == "unknown" and "gap" in body.flags


def silent(taken: Taken) -> bool:
    """Whether it is a verdict on a channel that has not changed for a second."""
    return isinstance(taken.message.body, Verdict) and "dead_channel" in taken.message.body.flags
