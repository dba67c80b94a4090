"""Front ends in a process of their own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import msgspec
import numpy as np
import pytest
import soundfile

from chatter_monitor.acquisition.source import Source
from chatter_monitor.config import Settings
from chatter_monitor.errors import EnvironmentFault
from chatter_monitor.outlets.control import Mark, SetSpindle
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.records import Block, Flag
from chatter_monitor.service import replay as service
from chatter_monitor.service.ahead import FrontEndsAhead
from chatter_monitor.service.monitor import Monitor
from tests.replaying import REPLAY_DATA, replay
from tests.signals import RATE_HZ, vibration

BLOCK = 4096
BLOCKS = 30


def teeth(rotation_hz: float) -> np.ndarray:
    """Three teeth and a mode, in two channels."""
    samples = BLOCK * BLOCKS
    angle = 2 * np.pi * rotation_hz * np.arange(samples) / RATE_HZ
    comb = sum(np.cos(3 * k * angle) / k for k in range(1, 6))
    return np.stack([comb + vibration(samples, [(800, 0.02)], seed) for seed in (1, 2)], axis=1)


SIGNAL = teeth(25.0)


class Eventful(Source):
    """Two channels that lose some samples and clip others; the first of its blocks is long."""

    sample_rate_hz, channels, length = RATE_HZ, 2, None
    clipped_samples = non_finite_samples = 0

    def __init__(self):
        self.told = []

    def blocks(self):
        end = 0
        for number, first in enumerate(range(0, len(SIGNAL), BLOCK)):
            if number in (1, 2):
                continue  # in the first block
            samples = SIGNAL[first : first + (3 * BLOCK if number == 0 else BLOCK)]
            if number == 12:
                first, samples = first + 2000, samples[2000:]
            if number == 20:
                self.clipped_samples = 5
                self.told = [SetSpindle(rpm=1500.0, teeth=3), Mark(text="now")]
            flags = (Flag.NONE, Flag.CLIPPED) if number == 20 else ()
            yield Block(first, samples, RATE_HZ, lost=first - end, flags=flags)
            end = first + len(samples)

    def commands(self):
        told, self.told = self.told, []
        return told

    def close(self):
        pass


class Kept(Outlet):
    """Keeps every bit of what it is told, but for how long that took."""

    def __init__(self):
        self.story = []

    def block(self, block):
        self.story.append(("block", block.first_sample))

    def spindle(self, spindle):
        self.story.append(spindle)

    def turning(self, channel, orders):
        spectrum = b"" if orders.spectrum is None else orders.spectrum.tobytes()
        self.story.append((channel, repr(orders), spectrum))

    def frame(self, frame, odp):
        arrays = (frame.frequency_hz, frame.damping_sd, frame.status, frame.signal, frame.hold)
        self.story.append((odp, [(a.tobytes(), a.dtype, a.shape, a.strides, a.flags.writeable) for a in arrays]))

    def message(self, message):
        told = msgspec.to_builtins(message)
        self.story.append({name: value for name, value in told.items() if not name.startswith("latency")})

    def close(self):
        pass


def story(front_ends=None):
    source, kept = Eventful(), Kept()
    about = {"counts": source, "source_rate_hz": RATE_HZ, "session": "x", "clock": time.perf_counter}
    for _ in Monitor(Settings(), source, [kept], commands=source.commands, front_ends=front_ends, **about).run():
        pass
    return kept.story


@pytest.fixture(scope="module")
def here():
    return story()


@pytest.mark.parametrize("block_samples", [BLOCK, 3 * BLOCK, 64])
def test_every_bit_is_the_same(here, block_samples):
    """Gaps, flags, commands and counts, in the same order, whether the blocks fit into the shared memory or not."""
    with FrontEndsAhead(Settings(), 2, RATE_HZ, block_samples) as front_ends:
        assert story(front_ends) == here
    states = {each["state"] for each in here if isinstance(each, dict) and each["type"] == "verdict"}
    assert {"forced", "unknown"} <= states


def test_a_process_that_dies_is_an_error():
    """Whoever waits for it is told so, and does not wait for ever."""
    front_ends = FrontEndsAhead(Settings(), 2, RATE_HZ, BLOCK)
    os.kill(front_ends._worker._process.pid, signal.SIGKILL)
    with front_ends, pytest.raises(EnvironmentFault, match="exit code -9"):
        story(front_ends)


def test_a_long_recording_is_replayed_by_two_processes(tmp_path, monkeypatch):
    """What it says is what one says."""
    used = []

    class Counted(FrontEndsAhead):
        def __init__(self, *about):
            used.append(about)
            super().__init__(*about)

    monkeypatch.setattr(service, "FrontEndsAhead", Counted)
    one = replay(REPLAY_DATA / "bar_turning.flac", tmp_path)
    assert not used
    monkeypatch.setattr(service, "LONG_S", 10.0)
    monkeypatch.setattr(service, "processors", lambda: 1)
    replay(REPLAY_DATA / "bar_turning.flac", tmp_path)
    assert not used
    monkeypatch.setattr(service, "processors", lambda: 2)
    two = replay(REPLAY_DATA / "bar_turning.flac", tmp_path)
    assert len(used) == 1
    assert (two.of("verdict"), two.of("odp"), two.of("event")) == (one.of("verdict"), one.of("odp"), one.of("event"))
    assert two.alarms()


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("long") / "long.wav"
    soundfile.write(path, np.tile(0.1 * SIGNAL, (200, 1)), round(RATE_HZ))
    return path


def children_of(process) -> list[str]:
    """Commands of the processes that it has started."""
    found = []
    for child in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split():
        with suppress(FileNotFoundError):  # it has just ended
            found.append(Path(f"/proc/{child}/cmdline").read_text())
    return found


@pytest.mark.parametrize("moment", ["the second one starts", "both are at work"])
def test_control_c_ends_both_without_a_word(recording, tmp_path, moment):
    """Whenever it comes."""
    said = tmp_path / "said.jsonl"
    command = [sys.executable, "-m", "chatter_monitor", "replay", recording, "--json", "--jsonl", said]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, start_new_session=True, **pipes) as process:
        while not any("spawn_main" in child for child in children_of(process)):
            time.sleep(0.01)
        while moment == "both are at work" and not (said.exists() and said.stat().st_size):
            time.sleep(0.01)
        os.killpg(process.pid, signal.SIGINT)
        out, err = process.communicate(timeout=20)  # as long as anyone has the pipes
        assert (process.returncode, out, err.strip()) == (130, b"", b"")
