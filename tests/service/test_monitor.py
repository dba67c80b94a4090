"""Losses on the way from a source to the messages."""

from __future__ import annotations

import time

import msgspec
import numpy as np
import pytest

from chatter_monitor.acquisition.source import Source
from chatter_monitor.config import Settings
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.records import Block, Flag
from chatter_monitor.service.monitor import Monitor
from tests.signals import RATE_HZ, vibration

SIGNAL = np.stack([vibration(25_600, [(400, 0.03)], seed) for seed in (1, 2)], axis=1)
LOST = range(10_000, 11_000)


class Lossy(Source):
    """Two channels that lose the samples `LOST`; clipping on channel 1 afterwards."""

    sample_rate_hz, channels, length = RATE_HZ, 2, None
    clipped_samples, non_finite_samples = 7, 0

    def __init__(self, block_samples):
        self._block_samples = block_samples

    def blocks(self):
        end = 0
        stretches = [(0, LOST.start, ()), (LOST.stop, 20_000, ()), (20_000, 25_600, (Flag.NONE, Flag.CLIPPED))]
        for begin, stop, flags in stretches:
            for first in range(begin, stop, self._block_samples):
                samples = SIGNAL[first : min(stop, first + self._block_samples)]
                yield Block(first, samples, RATE_HZ, lost=first - end, flags=flags)
                end = first + len(samples)

    def close(self):
        pass


class Kept(Outlet):
    """Keeps the messages."""

    def __init__(self):
        self.messages = []

    def frame(self, frame, odp):  # noqa: ARG002
        self.messages.append(odp)

    def message(self, message):
        self.messages.append(message)

    def close(self):
        pass


def monitored(block_samples):
    source, kept = Lossy(block_samples), Kept()
    about = {"counts": source, "source_rate_hz": RATE_HZ, "session": "lossy", "clock": time.perf_counter}
    done = list(Monitor(Settings(), source, [kept], **about).run())
    assert done[-1] == len(SIGNAL)
    return [msgspec.to_builtins(message) for message in kept.messages]


@pytest.fixture(scope="module")
def messages():
    return monitored(4096)


def verdicts(messages, channel):
    return [message for message in messages if message["type"] == "verdict" and message["channel"] == channel]


def test_loss_is_unknown_where_it_lies(messages):
    """Exactly the intervals that a gap touches are unknown under its flag, in every channel; their samples count."""
    for channel in (0, 1):
        of_channel = verdicts(messages, channel)
        assert [(v["sample0"], v["sample1"]) for v in of_channel] == [(i, i + 640) for i in range(0, 25_600, 640)]
        assert [i for i, v in enumerate(of_channel) if "gap" in v["flags"]] == [15, 16, 17]
        assert [i for i, v in enumerate(of_channel) if v["state"] == "unknown"] == [0, 15, 16, 17]


def test_flags_belong_to_their_channel(messages):
    """Clipping of one channel does not stand on the other."""
    clipped = [[i for i, v in enumerate(verdicts(messages, c)) if "clipped" in v["flags"]] for c in (0, 1)]
    assert clipped == [[], list(range(31, 40))]


@pytest.mark.parametrize("block_samples", [100, 640, 25_600])
def test_blocks_of_any_size_give_the_same_messages(messages, block_samples):
    """Whatever the blocks, ODPs and verdicts are the same in the same order for each channel."""
    others = monitored(block_samples)
    for channel in (0, 1):
        of_channel, expected = (
            [m for m in each if m["type"] != "health" and m.get("channel") == channel] for each in (others, messages)
        )
        assert of_channel == expected


def test_health_counts_what_was_lost(messages):
    """Health, once a second and at the end, tells samples in, samples lost and clipped, and the loss in words."""
    health = [message for message in messages if message["type"] == "health"]
    assert [(h["t"], h["state"]) for h in health] == [(1.0, "hearing"), (2.0, "hearing"), (2.0, "finished")]
    assert (health[-1]["samples_in"], health[-1]["lost"], health[-1]["clipped"]) == (24_600, 1000, 7)
    assert health[-1]["reasons"] == ["1000 samples lost"]


def test_settings_reach_the_judges():
    """A stable cut is an alarm where the threshold says so."""
    settings = Settings()
    eager = msgspec.structs.replace(settings, verdict=msgspec.structs.replace(settings.verdict, chatter_damping=0.5))
    source, kept = Lossy(4096), Kept()
    about = {"counts": source, "source_rate_hz": RATE_HZ, "session": "x", "clock": time.perf_counter}
    list(Monitor(eager, source, [kept], **about).run())
    found = verdicts([msgspec.to_builtins(message) for message in kept.messages], 0)
    assert sum(v["state"] == "self_excited" for v in found) > 20
