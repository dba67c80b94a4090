"""The wiring: blocks of a source through trackers and judges to the outlets, in one thread."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import msgspec
import numpy as np

from chatter_monitor.acquisition.source import Source
from chatter_monitor.config import Settings
from chatter_monitor.outlets.control import Command, Mark, SetSpindle
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.records import Announcement, Health, Mode, Odp, OdpFrame
from chatter_monitor.service.front_ends import FrontEnds, FrontEndsHere, Taken
from chatter_monitor.service.watching import Watching
from chatter_monitor.tracking.channel import BackEnd, Channel, Observation
from chatter_monitor.tracking.front_end import Tracked
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.tracking.tracker import INTERVAL_S
from chatter_monitor.verdict.advice import advise
from chatter_monitor.verdict.event_log import EventLog
from chatter_monitor.verdict.evidence import weigh
from chatter_monitor.verdict.judge import Judge
from chatter_monitor.verdict.settings import JudgeSettings

# The count of lost samples stays; what is said about it in words is news for a minute.
LOSS_SHOWN_S = 60.0


class SampleCounts(Protocol):
    """What an input has counted so far, over all channels."""

    @property
    def clipped_samples(self) -> int: ...  # noqa: D102

    @property
    def non_finite_samples(self) -> int: ...  # noqa: D102


@dataclass
class Tally:
    """What went through, for health messages and the summary."""

    samples: int = 0
    lost: int = 0
    lost_at_s: float = 0.0
    latencies_s: list[float] = field(default_factory=list)


def odp_message(frame: OdpFrame) -> Odp:
    """Summary of a frame: its last sample."""
    modes = []
    rows = (frame.frequency_hz[-1], frame.damping_ratio[-1], frame.damping_sd[-1], frame.share)
    for frequency, damping, sd, share in zip(*(row.tolist() for row in rows), strict=True):
        if math.isfinite(frequency):
            modes.append(Mode(frequency, damping, (damping - 1.96 * sd, damping + 1.96 * sd), share))
        else:
            modes.append(Mode(None, None, None, share))
    return Odp(channel=frame.channel, t=(frame.first_sample + len(frame) - 1) / frame.sample_rate_hz, modes=modes)


def warm_up(settings: Settings, source_rate_hz: float) -> None:
    """Load the compiled kernels: better before the first sample of a live source than after it; else it is a waste.

    What turns at a given speed is looked for, found, and taken out, a margin is fitted to the rest, and another speed
    is advised.
    """
    rate_hz, seconds, rotation_hz = settings.tracker.sample_rate_hz, 4.0, 30.0
    spindle = SpindleSettings(speed_rpm=60.0 * rotation_hz)
    channel = Channel(settings.tracker, settings.orders, spindle, source_rate_hz=source_rate_hz)
    judge = Judge(settings.verdict, interval_s=INTERVAL_S)
    angle = 2.0 * np.pi * rotation_hz * np.arange(round(seconds * rate_hz)) / rate_hz
    comb = sum(np.cos(order * angle) for order in range(1, 9))
    for observation in channel.process(0, comb + np.random.default_rng(0).standard_normal(len(angle))):
        frame = observation.odp
        judge.verdict(weigh(observation, spindle), frame.first_sample, len(frame), rate_hz)
    advise(10.7 * rotation_hz, spindle)


class Monitor:
    """Everything between a source and the outlets. One thread owns it and them.

    Parameters
    ----------
    settings : Settings
        The machine configuration.
    source : Source
        Blocks at the tracker's rate.
    outlets : sequence of Outlet
        Who takes the results.
    counts : SampleCounts
        Where clipped and non-finite samples are counted.
    source_rate_hz : float
        Rate at which the signal was sampled before it was converted.
    session : str
        Start of the events' names.
    clock : callable
        Seconds on a steady clock, for latencies.
    dropped : callable
        Publications dropped so far.
    commands : callable
        Commands that have come since the last call; they are carried out between two blocks.
    front_ends : FrontEnds, optional
        Of all channels; in this process if it is not given.

    Attributes
    ----------
    trouble : str or None
        What else is wrong, for the health message.
    """

    def __init__(
        self,
        settings: Settings,
        source: Source,
        outlets: Sequence[Outlet],
        *,
        counts: SampleCounts,
        source_rate_hz: float,
        session: str,
        clock: Callable[[], float],
        dropped: Callable[[], int] = lambda: 0,
        commands: Callable[[], Iterable[Command]] = lambda: (),
        front_ends: FrontEnds | None = None,
    ) -> None:
        self._source = source
        self._outlets = outlets
        self._counts = counts
        self._clock = clock
        self._dropped = dropped
        self._commands = commands
        self._marks: list[str] = []
        self.trouble: str | None = None
        self._front_ends = front_ends or FrontEndsHere(settings, source.channels, source_rate_hz)
        self._back_ends = [
            BackEnd(settings.tracker.sample_rate_hz, settings.spindle, c) for c in range(source.channels)
        ]
        self._judges = [Judge(settings.verdict, c, interval_s=INTERVAL_S) for c in range(source.channels)]
        self._events = EventLog(session, settings.spindle)
        self._told = settings.spindle  # with the newest block that was taken
        self._news: SpindleSettings | None = None  # for the next one
        self._spindle = settings.spindle  # of the intervals that are judged
        self._watching = None
        if settings.model.file is not None:
            self._watching = Watching(
                settings.model, settings.spindle, source.channels, settings.tracker.sample_rate_hz
            )
        self._tally = Tally()

    def run(self) -> Iterator[int]:
        """Work through the source; yields the number of samples done after each block.

        Outlets are closed by whoever opened them.
        """
        end = 0
        health_due = self._source.sample_rate_hz
        hearing = self._source.condition().hearing
        taken = None
        for taken, tracked in self._front_ends.through(self._taken()):
            block = taken.block
            self._marks += taken.marks
            if taken.spindle is not None:
                self._set_spindle(taken.spindle)
            end = block.first_sample + len(block.samples)
            self._tally.samples += len(block.samples)
            if block.lost:
                self._tally.lost += block.lost
                self._tally.lost_at_s = block.first_sample / self._source.sample_rate_hz
            for outlet in self._outlets:
                outlet.block(block)
            self._deliver(tracked)
            if len(block.samples):
                since_s = taken.taken_s if block.arrived_s is None else block.arrived_s
                self._tally.latencies_s.append(self._clock() - since_s)
            self._digest()
            while end >= health_due:
                self._send(self._health(health_due / self._source.sample_rate_hz, taken, finished=False))
                health_due += self._source.sample_rate_hz
            if hearing != (hearing := self._source.condition().hearing):  # is news that does not wait for the second
                self._send(self._health(end / self._source.sample_rate_hz, taken, finished=False))
            yield end
        self._deliver(self._front_ends.finish())
        self._digest()
        for number in range(len(self._back_ends)):
            event = self._events.finish(number)
            if event is not None:
                self._send(event)
        self._send(self._health(end / self._source.sample_rate_hz, taken, finished=True))

    def _taken(self) -> Iterator[Taken]:
        """Take block by block from the source, each with the commands that have come before it."""
        for block in self._source.blocks():
            taken_s = self._clock()
            marks = []
            for command in self._commands():
                match command:
                    case SetSpindle():
                        self._news = msgspec.structs.replace(self._told, speed_rpm=command.rpm, teeth=command.teeth)
                    case Mark():
                        marks.append(
                            f"mark at {block.first_sample / self._source.sample_rate_hz:.2f} s: {command.text}"
                        )
            news, self._news = self._news, None
            self._told = news or self._told
            counts = self._counts.clipped_samples, self._counts.non_finite_samples
            yield Taken(block, news, tuple(marks), *counts, taken_s)

    def reconfigure(self, verdict: JudgeSettings, spindle: SpindleSettings | None) -> None:
        """Judge by other thresholds from the next interval on, and by another spindle if there is one."""
        for judge in self._judges:
            judge.set_thresholds(verdict)
        if spindle is not None:
            self._told = self._news = spindle

    def _set_spindle(self, spindle: SpindleSettings) -> None:
        if not spindle.turns_as(self._spindle):
            for judge in self._judges:
                judge.begin_job()
        self._spindle = spindle
        self._events.set_spindle(spindle)
        for back_end in self._back_ends:
            back_end.set_spindle(spindle)
        if self._watching is not None:
            self._watching.set_spindle(spindle)
        for outlet in self._outlets:
            outlet.spindle(spindle)

    def _deliver(self, tracked: Iterable[list[Tracked]]) -> None:
        """Tell of the intervals that have ended, channel by channel."""
        for back_end, of_channel in zip(self._back_ends, tracked, strict=True):
            self._judge([*back_end.observe(of_channel)])

    def _judge(self, observations: list[Observation]) -> None:
        """Judge intervals of a channel, and hand them to the outlets."""
        for observation, evidence in [(seen, weigh(seen, self._spindle)) for seen in observations]:
            frame = observation.odp
            judge = self._judges[frame.channel]
            verdict = judge.verdict(evidence, frame.first_sample, len(frame), frame.sample_rate_hz)
            if verdict.state == "unknown" and not (condition := self._source.condition()).hearing:
                verdict = msgspec.structs.replace(verdict, reasons=[*verdict.reasons, *condition.problems])
            odp = odp_message(frame)
            for outlet in self._outlets:
                outlet.turning(frame.channel, observation.orders)
                outlet.frame(frame, odp)
            self._send(verdict)
            event = self._events.follow(verdict)
            if event is not None:
                self._send(event)
            if self._watching is not None:
                self._watching.hear(frame)

    def _digest(self) -> None:
        """Do what nobody waits for, now that all verdicts are out."""
        self._front_ends.digest()
        for back_end in self._back_ends:
            back_end.digest()
        for mismatch in self._watching.digest() if self._watching is not None else ():
            self._send(mismatch)
        for outlet in self._outlets:
            outlet.digest()

    def _send(self, message: Announcement) -> None:
        for outlet in self._outlets:
            outlet.message(message)

    def _health(self, t: float, taken: Taken | None, *, finished: bool) -> Health:
        tally = self._tally
        latencies_ms = 1000.0 * np.array(tally.latencies_s) if tally.latencies_s else None
        tally.latencies_s = []
        condition = self._source.condition()
        reasons = [*condition.problems]
        if tally.lost and t - tally.lost_at_s < LOSS_SHOWN_S:
            reasons.append(f"{tally.lost} samples lost")
        reasons += [problem for outlet in self._outlets for problem in outlet.problems()]
        reasons += [self.trouble] if self.trouble is not None else []
        reasons += self._marks
        self._marks = []
        return Health(
            t=t,
            state="finished" if finished else "hearing" if condition.hearing else "not_hearing",
            samples_in=tally.samples,
            lost=tally.lost,
            overflows=condition.overflows,
            clipped=0 if taken is None else taken.clipped,
            non_finite=0 if taken is None else taken.non_finite,
            publications_dropped=self._dropped(),
            ring_fill=condition.ring_fill,
            latency_ms_p50=None if latencies_ms is None else float(np.percentile(latencies_ms, 50)),
            latency_ms_p99=None if latencies_ms is None else float(np.percentile(latencies_ms, 99)),
            clock_ppm=condition.clock_ppm,
            reasons=reasons,
        )
