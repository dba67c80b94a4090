"""Starts flight recorders that record one event after the other, and kills each after as many seconds as it is told.

Recorders are forked from this process, which has imported and used everything: starting Python sixty times would take
minutes. One line of standard input is the delay of one recorder; the answer is a line of JSON with the names
of the recordings that it has reported as complete.
"""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from collections.abc import Callable, Iterable
from itertools import count
from pathlib import Path
from tempfile import TemporaryDirectory

from chatter_monitor.outlets.event_store import EventWriter
from chatter_monitor.outlets.flight_recorder import FlightRecorder, RecorderSettings
from tests.outlets.recorder_feed import CLOCK, feed, origin

QUOTA_BYTES = 1_500_000  # about seven recordings


class Reporting(EventWriter):
    """Reports into a pipe what is complete."""

    def __init__(self, directory: Path, pipe: int) -> None:
        super().__init__(directory, QUOTA_BYTES)
        self._pipe = pipe

    def add(self, wanted_name: str, write: Callable[[Path, str], None]) -> str:
        """Add, then report."""
        name = super().add(wanted_name, write)
        os.write(self._pipe, f"{name}\n".encode())
        return name


def record(store: EventWriter, session: int, events: Iterable[int]) -> None:
    """Record events one after the other."""
    settings = RecorderSettings(pre_s=0.1, post_s=0.1)
    with FlightRecorder(settings, store, origin(), utc_of=CLOCK.utc_of, patient=True) as recorder:
        for event in events:
            feed(recorder, "---###---", session=f"{session:03d}-{event:04d}")


def main() -> None:
    """Serve the delays that come on standard input."""
    directory = Path(sys.argv[1])
    with TemporaryDirectory() as elsewhere:  # the first recording takes ten times as long as those that follow
        record(EventWriter(Path(elsewhere), QUOTA_BYTES), 0, [0])
    for session, line in enumerate(sys.stdin):
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(reading)
            record(Reporting(directory, writing), session, count())
        os.close(writing)
        time.sleep(float(line))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        with os.fdopen(reading) as reported:
            print(json.dumps(reported.read().split()), flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
