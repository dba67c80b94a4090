"""A small archive, and files that are made to hold up or kill whoever reads them."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import soundfile
from fsspec import AbstractFileSystem

from tests.signals import onset

RATE_HZ = 12_800
NAMES = ("monday/a.wav", "monday/b.wav", "tuesday/c.wav", "tuesday/d.wav")


def make(folder: Path) -> None:
    """Write 2 s of chatter, of another frequency in each file."""
    for number, name in enumerate(NAMES):
        write(folder / name, 700.0 + 100.0 * number)


def write(path: Path, frequency_hz: float) -> None:
    """Write 2 s in which chatter begins after one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    soundfile.write(path, onset(2 * RATE_HZ, RATE_HZ, frequency_hz), RATE_HZ)


class Deadly(AbstractFileSystem):
    """A file system that kills who opens a file."""

    def open(self, *_arguments, **_options):
        os.kill(os.getpid(), signal.SIGKILL)
