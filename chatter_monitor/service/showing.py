"""The dashboard at work: on what a monitor publishes, on a recording, on a diagnosis."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from datetime import datetime
from pathlib import Path

from chatter_monitor.acquisition.recording import Recording
from chatter_monitor.config import Settings
from chatter_monitor.outlets.dashboard.diagnosis import draw_diagnosis
from chatter_monitor.outlets.dashboard.drawing import Drawing
from chatter_monitor.outlets.dashboard.place import Place, Shown, open_place
from chatter_monitor.outlets.dashboard.screen import Screen
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.outlets.wire import Received
from chatter_monitor.records import Announcement, Odp, OdpFrame, SignalFrame
from chatter_monitor.service.replay import Replay
from chatter_monitor.service.told import until_told

# What the dashboard subscribes to.
TOPICS = ("odp", "signal", "verdict", "event", "health", "mismatch")
SHORTEST_SPAN_S, LONGEST_SPAN_S = 5.0, 60.0
PATIENCE_S = 0.2

Say = Callable[[str], None]


def show_live(receive: Callable[[float], Received | None], place: Place, endpoint: str, say: Say) -> None:
    """Draw what a monitor publishes, until the viewer is closed or the process is told to stop.

    Parameters
    ----------
    receive : callable
        Next message, or None if there is none within so many seconds.
    place : Place
        Where to draw.
    endpoint : str
        Where the messages come from, for people.
    say : callable
        Told in a line what to know.
    """
    with until_told() as told, open_place(place, endpoint, "wall") as shown:
        if shown.address is not None:
            say(f"showing {endpoint} at {shown.address}")
        screen = Screen(shown.stream)
        silent_s = 0.0
        while shown.watched() and not told():
            message = receive(PATIENCE_S)
            if message is not None:
                draw(screen, message)
                silent_s = -1.0
            elif silent_s >= 0.0 and (silent_s := silent_s + PATIENCE_S) > 3.0:
                say(f"nothing comes from {endpoint} yet; waiting for a monitor")
                silent_s = -1.0
        screen.close()


def draw(screen: Screen, message: Received) -> None:
    """Draw a message; its header says what time it is."""
    header, body = message.header, message.body
    screen.set_zero(datetime.fromisoformat(header.utc).timestamp() - header.sample0 / header.fs)
    match body:
        case OdpFrame():
            screen.odp(body)
        case SignalFrame():
            screen.signal(body)
        case _:
            screen.message(body)


def show_recording(file: Path, settings: Settings, place: Place, say: Say) -> None:
    """Replay a recording onto the dashboard; with a viewer, wait until it is closed."""
    with Recording(file) as recording:
        seconds = LONGEST_SPAN_S if recording.length is None else recording.length / recording.sample_rate_hz
    span_s = min(max(seconds, SHORTEST_SPAN_S), LONGEST_SPAN_S)
    with until_told() as told, open_place(place, file.name, "recording") as shown:
        with suppress(_Told), Drawing(Screen(shown.stream, span_s)) as drawing:
            Replay(file=file, settings=settings, witnesses=(drawing, _Leaving(told))).run()
        _stay(shown, str(file), say, told)


def show_diagnosis(directory: Path, place: Place, say: Say) -> None:
    """Show a diagnosis; with a viewer, wait until it is closed."""
    with until_told() as told, open_place(place, f"diagnosis {directory.name}", "recording") as shown:
        draw_diagnosis(shown.stream, directory)
        shown.stream.close()
        _stay(shown, str(directory), say, told)


def _stay(shown: Shown, what: str, say: Say, told: Callable[[], bool]) -> None:
    """Serve the viewers until the one that was opened is closed, or the process is told to stop."""
    if shown.address is None or told():
        return
    say(f"showing {what} at {shown.address}")
    while shown.watched() and not told():
        time.sleep(PATIENCE_S)


class _Told(Exception):
    """The process was told to stop."""


class _Leaving(Outlet):
    """Ends a replay at its next interval once the process was told to stop.

    A signal handler that raised would not do: what it raises is lost where Python runs inside of a C library, such as
    the loader of the compiled kernels.
    """

    def __init__(self, told: Callable[[], bool]) -> None:
        self._told = told

    def frame(self, frame: OdpFrame, odp: Odp) -> None:  # noqa: ARG002  only its coming matters
        """Leave, if told to."""
        if self._told():
            raise _Told

    def message(self, message: Announcement) -> None:  # noqa: ARG002  frames come as often
        """Need nothing."""
        return

    def close(self) -> None:
        """Hold nothing."""
        return
