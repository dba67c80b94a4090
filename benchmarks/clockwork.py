"""A sound device that is none: four sensors of a machine at 12.8 kHz, 128 samples at a time, as the clock goes."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray

from chatter_monitor.acquisition.portaudio import Choice, Deliver, Device, Opener, Stream

RATE_HZ = 12_800.0
BLOCK = 128
CHANNELS = 4
RECORDING = Path(__file__).resolve().parents[1] / "replay_data" / "bar_turning.flac"


def cut(channels: int = CHANNELS) -> NDArray[np.float32]:
    """Simulated cut in and out of chatter, 20 s; each channel hears it at another level, with noise of its own."""
    samples, _ = soundfile.read(RECORDING, dtype="float32")
    rng = np.random.default_rng(5)
    noise = 1e-3 * rng.standard_normal((len(samples), channels), dtype=np.float32)
    return samples[:, np.newaxis] * np.linspace(1.0, 0.4, channels, dtype=np.float32) + noise


class Clockwork(Opener):
    """Delivers a signal again and again, at its rate, from a thread of its own, as PortAudio does."""

    def __init__(self, samples: NDArray[np.float32]) -> None:
        self._samples = samples[: len(samples) // BLOCK * BLOCK]

    def choose(self) -> Choice:
        """Choose the only device that there is."""
        channels = self._samples.shape[1]
        return Choice(Device(0, "clockwork", "none", channels, default=True), RATE_HZ, channels)

    def open(self, choice: Choice, deliver: Deliver, ended: Callable[[], None]) -> Stream:  # noqa: ARG002  never ends
        """Begin to deliver."""
        return _Delivery(self._samples, deliver)


class _Delivery(Stream):
    def __init__(self, samples: NDArray[np.float32], deliver: Deliver) -> None:
        self._samples = samples
        self._deliver = deliver
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="clockwork", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Deliver no more."""
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        began_s = time.monotonic()
        position = 0
        while not self._over.is_set():
            due_s = began_s + (position + BLOCK) / RATE_HZ
            while (wait_s := due_s - time.monotonic()) > 0:
                time.sleep(wait_s)
            start = position % len(self._samples)
            self._deliver(self._samples[start : start + BLOCK], False)
            position += BLOCK
