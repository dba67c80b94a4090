"""Feeds a flight recorder as the monitor would, without tracker and judge: every value tells where it belongs."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.outlets.event_files import Origin
from chatter_monitor.outlets.flight_recorder import FlightRecorder
from chatter_monitor.outlets.publisher import Clock
from chatter_monitor.records import Block, Event, Flag, Odp, OdpFrame, State, Verdict
from chatter_monitor.verdict.judge import EventLog

RATE_HZ = 12_800.0
INTERVAL = 640
MODES = 2
CLOCK = Clock(RATE_HZ, datetime(2026, 3, 1, 8, 30, tzinfo=UTC))
SETTINGS = {"machine": {"name": "lathe-3"}, "spindle": {"speed_rpm": 1656.0, "teeth": 6}}


def origin(channels: int = 1, full_scale_per_unit: float = 1.0) -> Origin:
    return Origin(SETTINGS, RATE_HZ, 48_000.0, channels, MODES, "lathe-3", full_scale_per_unit)


def signal(begin: int, end: int, channels: int = 1) -> NDArray[np.float64]:
    """Samples that count up in steps of 24 bits, differently in each channel."""
    index = np.arange(begin, end)[:, np.newaxis]
    return ((index * channels + np.arange(channels)) % 2**23) / 2**23


def frame(interval: int, channel: int = 0) -> OdpFrame:
    """ODPs of noise that belongs to this interval and channel only."""
    rng = np.random.default_rng([interval, channel])
    floats = [rng.standard_normal((INTERVAL, MODES)).astype(np.float32) for _ in range(4)]
    status = rng.integers(0, 4, (INTERVAL, MODES)).astype(np.uint8)
    return OdpFrame(channel, interval * INTERVAL, RATE_HZ, *floats, status, np.array([0.5, 0.4]), rms=0.1)


def verdict(interval: int, state: State, channel: int = 0) -> Verdict:
    first, end = interval * INTERVAL, (interval + 1) * INTERVAL
    return Verdict(
        channel=channel,
        t0=first / RATE_HZ,
        t1=end / RATE_HZ,
        sample0=first,
        sample1=end,
        state=state,
        frequency_hz=900.0,
        damping_ratio=0.001,
    )


def blocks(samples: int, channels: int = 1, size: int = INTERVAL, lost: range = range(0)) -> Iterator[Block]:
    """Consecutive blocks of the signal, without the samples `lost`."""
    position = 0
    for begin, stop in ((0, lost.start), (lost.stop, samples)) if lost else ((0, samples),):
        for first in range(begin, stop, size):
            end = min(first + size, stop)
            yield Block(first, signal(first, end, channels), RATE_HZ, lost=first - position)
            position = end


class Feed:
    """Blocks, then the intervals that they complete, channel after channel; `states` says what each interval is.

    Parameters
    ----------
    recorder : FlightRecorder
        What is fed.
    states : list of str
        One letter for each interval, one string for each channel: ``#`` chatter, ``?`` unknown, ``-`` stable.
    session : str
        Start of the events' names.
    """

    def __init__(self, recorder: FlightRecorder, states: list[str], session: str = "cut") -> None:
        self._recorder = recorder
        self._states = states
        self._log = EventLog(session)
        self._delivered = [0] * len(states)
        self.events: list[Event] = []

    def run(self, incoming: Iterator[Block]) -> None:
        """Feed everything, and end what is under way."""
        for block in incoming:
            self._recorder.block(block)
            for channel in range(len(self._states)):
                self._intervals(channel, (block.first_sample + len(block.samples)) // INTERVAL)
        for channel in range(len(self._states)):
            self._tell(self._log.finish(channel))

    def _intervals(self, channel: int, end: int) -> None:
        letters: dict[str, State] = {"#": "self_excited", "?": "unknown", "-": "stable"}
        for interval in range(self._delivered[channel], end):
            of_interval = verdict(interval, letters[self._states[channel][interval]], channel)
            self._recorder.frame(frame(interval, channel), Odp(channel=channel, t=of_interval.t1, modes=[]))
            self._recorder.message(of_interval)
            self._tell(self._log.follow(of_interval))
        self._delivered[channel] = end

    def _tell(self, event: Event | None) -> None:
        if event is not None:
            self._recorder.message(event)
            self.events.append(event)


def feed(recorder: FlightRecorder, *states: str, size: int = INTERVAL, session: str = "cut") -> list[Event]:
    """Feed a signal whose intervals are as `states` say; returns the events."""
    feed = Feed(recorder, list(states), session)
    feed.run(blocks(len(states[0]) * INTERVAL, len(states), size))
    return feed.events


def under_flags(block: Block, *flags: Flag) -> Block:
    return Block(block.first_sample, block.samples, block.sample_rate_hz, block.lost, flags)
