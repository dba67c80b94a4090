"""A sound device that a test holds in its hands, and a clock that it moves."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable

import numpy as np

from chatter_monitor.acquisition.portaudio import Choice, Deliver, Device, Opener, Stream
from chatter_monitor.errors import EnvironmentFault

WAIT_S = 200.0


class Clock:
    """Seconds that pass when the test says so."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


class Opened(Stream):
    """A device that has been opened."""

    def __init__(self, rate_hz: float, deliver: Deliver, ended: Callable[[], None]) -> None:
        self.rate_hz = rate_hz
        self.end = ended
        self.closed = threading.Event()
        self.hangs = threading.Event()  # set to let `close` hang until it is cleared
        self._deliver = deliver

    def deliver(self, samples: np.ndarray, *, overflow: bool = False) -> None:
        """Deliver samples, shape (n,) or (n, channels), as PortAudio's thread would."""
        columns = np.asarray(samples, dtype=np.float32)
        self._deliver(columns[:, np.newaxis] if columns.ndim == 1 else columns, overflow)

    def close(self) -> None:
        while self.hangs.is_set():
            time.sleep(0.001)
        self.closed.set()


class FakeDevices(Opener):
    """Devices that are there, or not, as the test says.

    Attributes
    ----------
    rate_hz, channels : float, int
        What the next device is opened with.
    absent : str or None
        Why there is no device at the moment.
    attempts : int
        How often a device was looked for.
    """

    def __init__(self, rate_hz: float = 12_800.0, channels: int = 1) -> None:
        self.rate_hz = rate_hz
        self.channels = channels
        self.absent: str | None = None
        self.attempts = 0
        self._opened: queue.Queue[Opened] = queue.Queue()

    def choose(self) -> Choice:
        self.attempts += 1
        if self.absent is not None:
            raise EnvironmentFault(self.absent)
        return Choice(Device(0, "fake", "test", self.channels, True), self.rate_hz, self.channels)

    def open(self, choice: Choice, deliver: Deliver, ended: Callable[[], None]) -> Stream:
        opened = Opened(choice.sample_rate_hz, deliver, ended)
        self._opened.put(opened)
        return opened

    def opened(self) -> Opened:
        """Wait for the next device to be opened."""
        return self._opened.get(timeout=WAIT_S)


class PlayingDevices(FakeDevices):
    """Devices that play a signal again and again, at the speed of life, 10 ms at a time, while they are open.

    Parameters
    ----------
    signal : ndarray, shape (n,) or (n, channels)
        What they play; nothing for devices that deliver nothing.
    rate_hz : float
        Its rate.
    """

    def __init__(self, signal: np.ndarray, rate_hz: float = 12_800.0) -> None:
        super().__init__(rate_hz, channels=signal.shape[1] if signal.ndim == 2 else 1)
        self.quiet = threading.Event()  # set to let them deliver nothing
        self._signal = signal

    def open(self, choice: Choice, deliver: Deliver, ended: Callable[[], None]) -> Stream:
        opened = super().open(choice, deliver, ended)
        assert isinstance(opened, Opened)
        threading.Thread(target=self._play, args=[opened], daemon=True).start()
        return opened

    def _play(self, opened: Opened) -> None:
        began_s = time.monotonic()
        piece = round(0.01 * opened.rate_hz)
        delivered = 0
        while not opened.closed.wait(0.002) and len(self._signal):
            while delivered + piece <= (time.monotonic() - began_s) * opened.rate_hz and not self.quiet.is_set():
                opened.deliver(np.take(self._signal, range(delivered, delivered + piece), axis=0, mode="wrap"))
                delivered += piece


def eventually(what: Callable[[], bool]) -> None:
    """Wait until something is so; it is an error if it never is."""
    deadline_s = time.monotonic() + WAIT_S
    while not what():
        assert time.monotonic() < deadline_s, "it never came to that"
        time.sleep(0.001)
