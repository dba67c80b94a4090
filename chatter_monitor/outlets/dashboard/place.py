"""Where the views go: a file, or a viewer on this machine."""

from __future__ import annotations

import os
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

import rerun as rr
import rerun_cli

from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.outlets.dashboard.stream import Clock, Stream

LOOPBACK = "127.0.0.1"
# The program itself: what `python -m rerun` starts would outlive it.
VIEWER = str(Path(rerun_cli.__file__).parent / "rerun")

# A viewer that has not gone by then is killed: it has nothing to lose.
VIEWER_LEAVES_S = 5.0

Viewer = Literal["window", "browser", "none"]


@dataclass(frozen=True, slots=True)
class Place:
    """Where to show, or to save.

    Attributes
    ----------
    save : Path or None
        Write a file instead of showing anything.
    viewer : "window", "browser" or "none"
        Open a viewer, or leave it to the user to open one at the address that is printed.
    port : int
        Port on this machine's loopback where viewers get the data; 0 for any free one.
    memory_limit : str
        Data kept for viewers that connect later or scroll back; the oldest go first. The viewer's own limit as well.
    """

    save: Path | None = None
    viewer: Viewer = "window"
    port: int = 0
    memory_limit: str = "500MB"


class Shown:
    """A stream that goes somewhere.

    Attributes
    ----------
    stream : Stream
        To log to.
    address : str or None
        Where a viewer finds it; None for a file.
    """

    def __init__(self, stream: Stream, address: str | None, viewer: subprocess.Popen[bytes] | None) -> None:
        self.stream = stream
        self.address = address
        self._viewer = viewer

    def watched(self) -> bool:
        """Whether the viewer that was opened is still there; true where none was."""
        return self._viewer is None or self._viewer.poll() is None

    def close(self) -> None:
        """Close the viewer that was opened."""
        if self._viewer is not None and self._viewer.poll() is None:
            self._viewer.terminate()
            try:
                self._viewer.wait(VIEWER_LEAVES_S)
            except subprocess.TimeoutExpired:
                self._viewer.kill()
                self._viewer.wait()


@contextmanager
def open_place(place: Place, name: str, clock: Clock) -> Iterator[Shown]:
    """Open a file or a viewer.

    Parameters
    ----------
    place : Place
        Which.
    name : str
        What the viewer calls the recording.
    clock : "wall" or "recording"
        What times count from.

    Raises
    ------
    InputError
        If the file cannot be written or the memory limit is none.
    EnvironmentFault
        If the port is taken, or there is no screen for a window.
    """
    stream = Stream(name, clock)
    if place.save is not None:
        _set_sink(stream, rr.FileSink, place.save, got=str(place.save))
        try:
            yield Shown(stream, None, None)
        finally:
            stream.recording.disconnect()  # completes the file
        return
    if place.viewer == "window" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise EnvironmentFault(
            "there is no screen for the viewer's window",
            remedy="--browser shows it in a browser, --save X.rrd writes it to a file.",
        )
    port = _free_port(place.port)
    uri = f"rerun+http://{LOOPBACK}:{port}/proxy"
    # Viewers that come later get the newest data first: who opens a dashboard wants to see the present.
    _set_sink(
        stream,
        rr.GrpcServerSink,
        LOOPBACK,
        port,
        server_memory_limit=place.memory_limit,
        newest_first=clock == "wall",
        got=place.memory_limit,
    )
    shown = _viewer(stream, place, uri)
    try:
        yield shown
    finally:
        shown.close()


def _viewer(stream: Stream, place: Place, uri: str) -> Shown:
    common = [VIEWER, "--bind", LOOPBACK, "--memory-limit", place.memory_limit]
    if place.viewer == "none":
        return Shown(stream, uri, None)
    if place.viewer == "window":
        command = [*common, "--port", "auto", "--hide-welcome-screen", uri]
        return Shown(stream, uri, _start(command))
    port = _free_port(0)
    command = [*common, "--web-viewer", "--web-viewer-port", str(port), uri]
    return Shown(stream, f"http://{LOOPBACK}:{port}/?url={quote(uri, safe='')}", _start(command))


def _start(command: list[str]) -> subprocess.Popen[bytes]:
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)  # noqa: S603  our own viewer


def _set_sink(stream: Stream, kind: Any, *arguments: Any, got: str, **options: Any) -> None:
    """Send the stream to a sink."""
    try:
        stream.recording.set_sinks(kind(*arguments, **options))
    except (RuntimeError, OSError) as error:
        raise InputError(f"the dashboard cannot be opened: {error}", got=got) from error


def _free_port(port: int) -> int:
    """The port, or a free one for 0."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((LOOPBACK, port))
        except OSError as error:
            raise EnvironmentFault(
                f"the dashboard's port cannot be used: {error.strerror}", got=port, remedy="Choose another --port."
            ) from error
        return int(probe.getsockname()[1])
