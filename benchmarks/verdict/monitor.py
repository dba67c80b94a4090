"""The one place where the benchmark meets the monitor: a cut in, a verdict for every interval out."""

from __future__ import annotations

import time
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.verdict.cut import RATE_HZ, Cut
from chatter_monitor.acquisition.source import Source
from chatter_monitor.acquisition.synthetic import Synthetic
from chatter_monitor.config import Settings, load
from chatter_monitor.outlets.control import Command, SetSpindle
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.records import Announcement, Block, Event, Odp, OdpFrame, Verdict
from chatter_monitor.service.ahead import FrontEndsAhead
from chatter_monitor.service.front_ends import FrontEnds
from chatter_monitor.service.monitor import Monitor
from chatter_monitor.service.replay import FAST_BLOCK_SAMPLES

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Opinions:
    """What the monitor said of a cut; arrays of shape (intervals,).

    Attributes
    ----------
    state : ndarray of str
        As in the verdict message.
    confidence : ndarray
        Likewise.
    score : ndarray
        How much speaks for self-excitation: its probability as in the message, 0 where that is unknown.
    """

    state: NDArray[np.str_]
    confidence: Floats
    score: Floats

    @classmethod
    def of(cls, verdicts: list[Verdict]) -> Opinions:
        """Gather those of verdicts, one for each interval."""
        return cls(
            np.array([v.state for v in verdicts]),
            np.array([v.confidence for v in verdicts]),
            np.array([v.chatter_probability or 0.0 for v in verdicts]),
        )


@dataclass(frozen=True, eq=False)
class Passage:
    """A piece of a long recording: samples, what is being done, and nominal speed and teeth if they are announced."""

    samples: Floats
    doing: str
    announced: tuple[float, int] | None


@dataclass(frozen=True)
class Remarks:
    """What the monitor said of a piece of a passage.

    Attributes
    ----------
    doing : str
        Of the passage.
    states : list of str
        Of its intervals.
    events : int
        Events that ended.
    until_s : float
        How far the recording has been heard.
    generating_s : float
        Seconds spent on making passages so far, not on listening.
    """

    doing: str
    states: list[str]
    events: int
    until_s: float
    generating_s: float


def stale(cut: Cut) -> tuple[float, int]:
    """Speed and teeth of a job before, which nobody told is over: a tenth or more off the cut's, always the same."""
    rng = np.random.default_rng(zlib.crc32(cut.name.encode()))
    while True:
        rpm, teeth = float(np.exp(rng.uniform(*np.log((600.0, 9000.0))))), int(rng.integers(1, 7))
        if abs(rpm / cut.nominal_rpm - 1.0) >= 0.1:
            return rpm, teeth


def listen(cut: Cut, told: tuple[float, int] | None) -> Opinions:
    """Run the monitor over a cut, told a spindle speed (rpm) and teeth, or neither."""
    kept = _Kept()
    source = Synthetic.from_array(cut.samples, RATE_HZ, block_samples=FAST_BLOCK_SAMPLES)
    options = {} if told is None else {"spindle": {"speed_rpm": told[0], "teeth": told[1]}}
    for _ in _monitor(load([], options), source, kept).run():
        pass
    if len(kept.verdicts) != len(cut.truth):
        raise RuntimeError(f"{len(kept.verdicts)} verdicts for {len(cut.truth)} intervals of {cut.name}")
    return Opinions.of(kept.verdicts)


def watch(passages: Iterable[Passage], *, announce: bool, ahead: bool = False) -> Iterator[Remarks]:
    """Run the monitor over a long recording, with a process ahead or not; yields what it said of piece after piece."""
    source, kept = _Stream(passages), _Kept()
    for end in _hear(source, kept, announce=announce, ahead=ahead):
        doing = source.taken.popleft().doing
        states = [verdict.state for verdict in kept.verdicts]
        yield Remarks(doing, states, len(kept.events), end / RATE_HZ, source.generating_s)
        kept.verdicts.clear()
        kept.events.clear()


def events_of(passages: Iterable[Passage]) -> list[Event]:
    """Run the monitor over a recording with the speeds told, for its events with their advice."""
    source, kept = _Stream(passages), _Kept()
    for _ in _hear(source, kept, announce=True):
        source.taken.popleft()
    return kept.events


def _hear(source: _Stream, kept: _Kept, *, announce: bool, ahead: bool = False) -> Iterator[int]:
    """Run the monitor; yields how many samples it has heard, block after block."""

    def commands() -> list[SetSpindle]:
        told = source.taken[-1].announced if announce else None
        return [] if told is None else [SetSpindle(rpm=told[0], teeth=told[1])]

    settings = Settings()
    with ExitStack() as stack:
        front_ends = None
        if ahead:
            front_ends = stack.enter_context(FrontEndsAhead(settings, source.channels, RATE_HZ, FAST_BLOCK_SAMPLES))
        yield from _monitor(settings, source, kept, commands, front_ends).run()


def _monitor(
    settings: Settings,
    source: Source,
    kept: _Kept,
    commands: Callable[[], Iterable[Command]] = lambda: (),
    front_ends: FrontEnds | None = None,
) -> Monitor:
    return Monitor(
        settings,
        source,
        [kept],
        counts=_NothingCounted(),
        source_rate_hz=RATE_HZ,
        session="benchmark",
        clock=time.perf_counter,
        commands=commands,
        front_ends=front_ends,
    )


class _Kept(Outlet):
    """Keeps verdicts and events."""

    def __init__(self) -> None:
        self.verdicts: list[Verdict] = []
        self.events: list[Event] = []

    def frame(self, frame: OdpFrame, odp: Odp) -> None:
        """Leave it."""

    def message(self, message: Announcement) -> None:
        """Keep it, if it is one."""
        if isinstance(message, Verdict):
            self.verdicts.append(message)
        elif isinstance(message, Event):
            self.events.append(message)

    def close(self) -> None:
        """Nothing to let go of."""


class _Stream(Source):
    """Passages, made when they are asked for, in blocks as of a replay."""

    sample_rate_hz, channels, length = RATE_HZ, 1, None

    def __init__(self, passages: Iterable[Passage]) -> None:
        self._passages = iter(passages)
        self.taken: deque[Passage] = deque()  # of which nothing has been told yet
        self.generating_s = 0.0

    def blocks(self) -> Iterator[Block]:
        """Yield the blocks; a speed is announced with the first one of a passage."""
        first = 0
        while True:
            began = time.perf_counter()
            passage = next(self._passages, None)
            self.generating_s += time.perf_counter() - began
            if passage is None:
                return
            for begin in range(0, len(passage.samples), FAST_BLOCK_SAMPLES):
                samples = passage.samples[begin : begin + FAST_BLOCK_SAMPLES]
                self.taken.append(Passage(samples, passage.doing, passage.announced if begin == 0 else None))
                yield Block(first, samples[:, np.newaxis], RATE_HZ)
                first += len(samples)

    def close(self) -> None:
        """Nothing to give back."""


class _NothingCounted:
    """A source that loses and clips nothing on its way."""

    clipped_samples = 0
    non_finite_samples = 0
