"""Feeds a flight recorder as the monitor would, without tracker and judge: every value tells where it belongs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.outlets.event_files import Origin
from chatter_monitor.outlets.flight_recorder import FlightRecorder
from chatter_monitor.outlets.publisher import Clock
from chatter_monitor.records import Block, Event, Odp, OdpFrame, State, Verdict
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.verdict.event_log import EventLog
from tests import messages

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
    return OdpFrame(
        channel, interval * INTERVAL, RATE_HZ, *floats, status, np.array([0.5, 0.4]), signal=np.zeros(INTERVAL), rms=0.1
    )


def verdict(interval: int, state: State, channel: int = 0) -> Verdict:
    return messages.verdict(interval, state, channel, frequency_hz=900.0, damping_ratio=0.001)


Change = Callable[[Block], Block]


class Feed:
    """Blocks, then the intervals that they complete, channel after channel.

    Parameters
    ----------
    recorder : FlightRecorder
        What is fed.
    channels : int
        Of the signal.
    size : int
        Samples in a block.
    session : str
        Start of the events' names.
    change : callable, optional
        What happens to a block on its way.
    lost : range
        Samples that do not arrive.
    """

    def __init__(
        self,
        recorder: FlightRecorder,
        channels: int = 1,
        *,
        size: int = INTERVAL,
        session: str = "cut",
        change: Change = lambda block: block,
        lost: range = range(0),
    ) -> None:
        self._recorder = recorder
        self._channels = channels
        self._size = size
        self._change = change
        self._lost = lost
        self._log = EventLog(session, SpindleSettings())
        self._interval = 0
        self.events: list[Event] = []

    def run(self, *states: str) -> None:
        """Go on with intervals of which one string for each channel says what they are.

        ``#`` is chatter, ``?`` unknown, ``-`` stable.
        """
        begin, done = self._interval, [self._interval] * self._channels
        self._interval += len(states[0])
        for block in self._blocks(begin * INTERVAL, self._interval * INTERVAL):
            self._recorder.block(self._change(block))
            end = (block.first_sample + len(block.samples)) // INTERVAL
            for channel in range(self._channels):
                for interval in range(done[channel], end):
                    self._deliver(interval, channel, states[channel][interval - begin])
                done[channel] = end

    def finish(self) -> None:
        """End what is under way."""
        for channel in range(self._channels):
            self._tell(self._log.finish(channel))

    def _blocks(self, begin: int, end: int) -> Iterator[Block]:
        stretches = [(begin, end)]
        if self._lost:
            stretches = [(begin, self._lost.start), (self._lost.stop, end)]
        position = begin
        for first, stop in stretches:
            for start in range(first, stop, self._size):
                samples = signal(start, min(start + self._size, stop), self._channels)
                yield Block(start, samples, RATE_HZ, lost=start - position)
                position = start + len(samples)

    def _deliver(self, interval: int, channel: int, letter: str) -> None:
        states: dict[str, State] = {"#": "self_excited", "?": "unknown", "-": "stable"}
        of_interval = verdict(interval, states[letter], channel)
        self._recorder.frame(frame(interval, channel), Odp(channel=channel, t=of_interval.t1, modes=[]))
        self._recorder.message(of_interval)
        self._tell(self._log.follow(of_interval))

    def _tell(self, event: Event | None) -> None:
        if event is not None:
            self._recorder.message(event)
            self.events.append(event)


def feed(recorder: FlightRecorder, *states: str, size: int = INTERVAL, session: str = "cut") -> list[Event]:
    """Feed a whole signal whose intervals are as `states` say; returns the events."""
    whole = Feed(recorder, len(states), size=size, session=session)
    whole.run(*states)
    whole.finish()
    return whole.events
