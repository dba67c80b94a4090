"""A sound device that is kept open: found, opened, watched, closed and opened again, in a thread of its own.

PortAudio is not safe to be called from several threads, and its calls hang while a device or sound server is frozen. So
one thread makes them all, and hangs in them, and nobody else does.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.acquisition.portaudio import Choice, Opener
from chatter_monitor.acquisition.ring import Ring
from chatter_monitor.errors import EnvironmentFault

RING_S = 4.0  # what the worker may fall behind before samples are lost
CLOSE_TIMEOUT_S = 0.5  # for a device that hangs, at the end


@dataclass(frozen=True, slots=True)
class Patience:
    """How long to wait for what.

    Attributes
    ----------
    tick_s : float
        How often to look whether something has happened, and how often blocks come while nothing is heard.
    frozen_s : float
        A device that has delivered nothing for so long is frozen, whatever it says.
    reopen_s : tuple of float
        Before the first attempt to open it again, the second, ...; the last for all that follow.
    """

    tick_s: float = 0.05
    frozen_s: float = 0.5
    reopen_s: tuple[float, ...] = (0.1, 0.2, 0.5, 1.0)


PATIENCE = Patience()


@dataclass(eq=False)
class Capture:
    """A device that has been opened, until it is over.

    Attributes
    ----------
    choice : Choice
        What was opened.
    ring : Ring
        What it delivers.
    latest_s : float
        When it delivered last; when it was opened, at first.
    delivered : bool
        Whether it has delivered anything.
    over : Event
        Set when it has ended by itself, and when the worker gives it up.
    why : str
        Why it is over.
    """

    choice: Choice
    ring: Ring
    latest_s: float
    delivered: bool = False
    over: threading.Event = field(default_factory=threading.Event)
    why: str = ""

    def end(self, why: str) -> None:
        """Say that it is over; the first reason counts."""
        if not self.over.is_set():
            self.why = why
            self.over.set()


class Capturing:
    """The thread that keeps a device open.

    It owns the device; what it hands over is a `Capture` for each time that the device has been opened.

    Parameters
    ----------
    opener : Opener
        Devices.
    clock : callable
        Seconds on a clock that never jumps.
    sleep : callable, optional
        Waits for some seconds between two attempts; by default until the end comes, at most.
    patience : Patience
        How long to wait for what.

    Attributes
    ----------
    trouble : str or None
        Why the device could not be opened the last time; None since it could.
    """

    def __init__(
        self,
        opener: Opener,
        clock: Callable[[], float],
        sleep: Callable[[float], object] | None,
        patience: Patience,
    ) -> None:
        self.trouble: str | None = None
        self._opener = opener
        self._clock = clock
        self._patience = patience
        # No SimpleQueue: its `get` waits for ever if a signal comes whose handler outlasts the timeout (CPython 3.11),
        # and a busy daemon without a device did not end on SIGTERM.
        self._opened: queue.Queue[Capture] = queue.Queue()
        self._stopping = threading.Event()
        self._sleep = sleep or self._stopping.wait
        self._death: BaseException | None = None
        self._thread = threading.Thread(target=self._keep_open, name="sound-card", daemon=True)

    def start(self) -> None:
        """Begin to look for the device."""
        self._thread.start()

    def opened(self) -> Capture | None:
        """Device that has been opened since the last call; None if there is none within a tick. For the worker.

        Raises
        ------
        Exception
            Whatever the thread has died of.
        """
        if self._death is not None:
            raise self._death
        try:
            return self._opened.get(timeout=self._patience.tick_s)
        except queue.Empty:
            return None

    def stop(self) -> None:
        """Close the device; one that hangs is left to the end of the process."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(CLOSE_TIMEOUT_S)

    def _keep_open(self) -> None:
        try:
            failures = 0
            while not self._stopping.is_set():
                capture = self._open_and_wait()
                if capture is not None and capture.delivered:
                    failures = 0
                waits = self._patience.reopen_s
                self._sleep(waits[min(failures, len(waits) - 1)])
                failures += 1
        except BaseException as death:
            self._death = death

    def _open_and_wait(self) -> Capture | None:
        """Open the device, wait until it is over, close it; None if it does not open."""
        try:
            choice = self._opener.choose()
            ring = Ring(round(RING_S * choice.sample_rate_hz), choice.channels, choice.sample_rate_hz)
            capture = Capture(choice, ring, self._clock())

            def deliver(samples: NDArray[np.float32], overflow: bool) -> None:
                capture.latest_s = now_s = self._clock()
                capture.delivered = True
                ring.write(samples, now_s, overflow=overflow)

            stream = self._opener.open(choice, deliver, lambda: capture.end(f"{choice.device.name!r} has gone away"))
        except EnvironmentFault as fault:
            self.trouble = str(fault)
            return None
        self.trouble = None
        capture.latest_s = self._clock()
        self._opened.put(capture)
        while not (capture.over.wait(self._patience.tick_s) or self._stopping.is_set()):
            pass
        stream.close()
        return capture
