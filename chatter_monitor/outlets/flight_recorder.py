"""Flight recorder: when it chatters, the signal from before the onset until after the end goes to the disk."""

from __future__ import annotations

import math
import queue
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import msgspec

from chatter_monitor.errors import ChatterMonitorError
from chatter_monitor.outlets.event_files import Origin, Stretch, write
from chatter_monitor.outlets.event_store import EventWriter
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.records import Announcement, Block, Event, Health, Mismatch, Odp, OdpFrame, Verdict
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.tracking.tracker import INTERVAL_S

# Recordings that wait for the disk. A disk that does not keep up with that many is broken or full.
WAITING = 4
# How long closing waits for a disk that hangs, in a daemon that has to stop.
CLOSE_TIMEOUT_S = 5.0

Seconds = Annotated[float, msgspec.Meta(ge=0)]


class RecorderSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What to keep of an event, see docs/events.md: the table ``[recorder]`` of a machine configuration.

    Attributes
    ----------
    directory : str
        Where recordings of events go.
    pre_s, post_s : float
        How much is kept from before an event and from after it.
    quota_gb : float
        Room that all recordings together may take; the oldest that are not protected go first.
    max_s : float
        How much is kept from the onset on, at most. Bounds memory and files when it chatters for long.
    """

    directory: Annotated[str, msgspec.Meta(min_length=1)] = "/var/lib/chatter-monitor"
    pre_s: Seconds = 5.0
    post_s: Seconds = 5.0
    quota_gb: Annotated[float, msgspec.Meta(gt=0)] = 5.0
    max_s: Annotated[float, msgspec.Meta(gt=0)] = 60.0


@dataclass(eq=False)
class _Take:
    """A recording that is being collected.

    Attributes
    ----------
    origin : Origin
        Where it comes from, with the spindle speed at the onset.
    frames, verdicts : list of OdpFrame, of Verdict
        So far.
    limit : int
        Sample at which it ends at the latest.
    end : int
        Sample at which it ends as far as is known.
    event : Event or None
        What it is the recording of; None while that goes on.
    truncated : bool
        Whether the limit cuts it.
    blocks : list of Block or None
        The samples, when all of them have come.
    """

    origin: Origin
    frames: list[OdpFrame]
    verdicts: list[Verdict]
    limit: int
    end: int
    event: Event | None = None
    truncated: bool = False
    blocks: list[Block] | None = None


@dataclass(eq=False)
class _Channel:
    """What the recorder remembers of a channel.

    Attributes
    ----------
    history, said : deque of OdpFrame, of Verdict
        The frames before the current one, as many as are kept from before an onset, and the verdicts on them.
    frame : OdpFrame or None
        The current one.
    alarmed : bool
        Whether an event is under way.
    takes : list of _Take
        Under way, or waiting for their event to end: at most one has no event yet.
    """

    history: deque[OdpFrame]
    said: deque[Verdict]
    frame: OdpFrame | None = None
    alarmed: bool = False
    takes: list[_Take] = field(default_factory=list)


class FlightRecorder(Outlet):
    """Keeps the samples of all channels and the ODPs and verdicts of one around each event of that channel.

    Every event has a recording of its own. Where events of several channels overlap, so do their recordings: the
    samples are in each of them, the ODPs, which take most of the room, are not.

    The thread that delivers (the monitor's) owns the object: it copies blocks, remembers as much as may be needed, and
    hands whole stretches to a queue. A thread of the recorder's own takes them out and owns the store and its files.
    What the two share is that queue, and `_trouble`, `recorded` and `failed`, which that thread sets and anyone may
    read.
    Delivering never waits for the disk: a stretch that finds the queue full is lost and counted, unless the recorder is
    patient. Memory is bounded: `pre_s` of history, and for each event that is collected or waits at most
    `pre_s` + `max_s`.

    Parameters
    ----------
    settings : RecorderSettings
        How much to keep.
    store : EventWriter
        Where to keep it; handed over to the writer thread, which opens and closes it.
    origin : Origin
        What the recordings say about where they come from.
    utc_of : callable
        Time of a sample, ISO 8601.
    patient : bool
        Whether delivering waits for the disk instead of losing recordings: right for a replay, not for a daemon.
    write_event : callable
        `event_files.write`.

    Attributes
    ----------
    lost : int
        Recordings that were lost because the disk did not keep up.
    recorded, failed : int
        Recordings that are safely on the disk, and that could not be written.
    """

    def __init__(
        self,
        settings: RecorderSettings,
        store: EventWriter,
        origin: Origin,
        *,
        utc_of: Callable[[int], str],
        patient: bool = False,
        write_event: Callable[[Path, str, Stretch, str], None] = write,
    ) -> None:
        self.lost = 0
        self.recorded = 0
        self.failed = 0
        self._store = store
        self._origin = origin
        self._utc_of = utc_of
        self._patient = patient
        self._write_event = write_event
        self._post = round(settings.post_s * origin.sample_rate_hz)
        self._max = round(settings.max_s * origin.sample_rate_hz)
        frames_before = math.ceil(round(settings.pre_s / INTERVAL_S, 6))
        self._channels = [
            _Channel(deque(maxlen=frames_before), deque(maxlen=frames_before)) for _ in range(origin.channels)
        ]
        self._blocks: deque[Block] = deque()
        self._trouble: str | None = None
        self._queue: queue.Queue[Stretch | None] = queue.Queue(WAITING)
        self._writer = threading.Thread(target=self._write_all, name="flight-recorder", daemon=True)
        self._writer.start()

    def block(self, block: Block) -> None:
        """Remember a copy of the samples, and forget those that are not needed any more."""
        self._blocks.append(
            Block(block.first_sample, block.samples.copy(), block.sample_rate_hz, block.lost, block.flags)
        )
        needed = min(self._needed_from(channel) for channel in self._channels)
        while self._blocks and _end_of(self._blocks[0]) <= needed:
            self._blocks.popleft()

    def frame(self, frame: OdpFrame, odp: Odp) -> None:  # noqa: ARG002  every sample is kept, not the summary
        """Remember the frame; the verdict on it comes next."""
        channel = self._channels[frame.channel]
        if channel.frame is not None:
            channel.history.append(channel.frame)
        channel.frame = frame
        for take in channel.takes:
            if take.blocks is None:
                take.frames.append(frame)

    def message(self, message: Announcement) -> None:
        """Begin a recording with an alarm, and end it some time after its event."""
        if isinstance(message, Health | Mismatch):
            return
        channel = self._channels[message.channel]
        if isinstance(message, Event):
            self._end(channel, message)
        else:
            self._hear(channel, message)
        self._hand_over(channel)

    def spindle(self, spindle: SpindleSettings) -> None:
        """Let recordings of events that begin from now on say so."""
        settings = {**self._origin.settings, "spindle": msgspec.to_builtins(spindle)}
        self._origin = replace(self._origin, settings=settings)

    def problems(self) -> list[str]:
        """What is wrong with recording, for the health message."""
        problems = []
        if self._trouble is not None:
            problems.append(f"events are not recorded: {self._trouble}")
        if self.failed:
            problems.append(f"{self.failed} recordings of events could not be written")
        if self.lost:
            problems.append(f"{self.lost} recordings of events lost, because the disk does not keep up")
        return problems

    def close(self) -> None:
        """Keep what has come of the events that are known, and wait for the disk, bounded unless patient."""
        for channel in self._channels:
            for take in channel.takes:
                if take.event is not None and channel.frame is not None:
                    take.end = min(take.end, channel.frame.first_sample + len(channel.frame))
            self._hand_over(channel)
            channel.takes.clear()
        if self._writer.is_alive():
            try:
                self._queue.put(None, timeout=None if self._patient else CLOSE_TIMEOUT_S)
                self._writer.join(timeout=None if self._patient else CLOSE_TIMEOUT_S)
            except queue.Full:
                pass  # the disk hangs; what it has not taken by now is lost, and what it has taken is whole

    def _hear(self, channel: _Channel, verdict: Verdict) -> None:
        for take in channel.takes:
            take.verdicts.append(verdict)
        if verdict.state == "self_excited":
            if not channel.alarmed and channel.frame is not None:
                self._begin(channel, channel.frame, verdict)
        elif verdict.state != "unknown":  # which neither goes on nor ends, as in verdict.event_log
            channel.alarmed = False
        channel.said.append(verdict)

    def _begin(self, channel: _Channel, frame: OdpFrame, verdict: Verdict) -> None:
        limit = frame.first_sample + self._max
        # One whose alarm ended without an event has nothing to tell.
        channel.takes = [take for take in channel.takes if take.event is not None]
        frames, verdicts = [*channel.history, frame], [*channel.said, verdict]
        channel.takes.append(_Take(self._origin, frames, verdicts, limit, end=limit))
        channel.alarmed = True

    def _end(self, channel: _Channel, event: Event) -> None:
        channel.alarmed = False
        for take in channel.takes:
            if take.event is None:
                wanted = round(event.end_s * self._origin.sample_rate_hz) + self._post
                take.event = event
                take.truncated = wanted > take.limit
                take.end = min(wanted, take.limit)

    def _hand_over(self, channel: _Channel) -> None:
        """Give the writer what is complete."""
        for take in list(channel.takes):
            first, end = take.frames[0].first_sample, take.frames[-1].first_sample + len(take.frames[-1])
            if take.blocks is None and end >= take.end:
                take.blocks = [b for b in self._blocks if b.first_sample < end and _end_of(b) > first]
            if take.blocks is not None and take.event is not None:
                channel.takes.remove(take)
                frames = [frame for frame in take.frames if frame.first_sample < take.end]
                verdicts = [verdict for verdict in take.verdicts if verdict.sample0 < take.end]
                self._submit(Stretch(take.event, take.origin, frames, verdicts, take.blocks, take.truncated))

    def _submit(self, stretch: Stretch) -> None:
        try:
            self._queue.put(stretch, block=self._patient)
        except queue.Full:
            self.lost += 1

    def _needed_from(self, channel: _Channel) -> int:
        """First sample that this channel may still need: that of a recording, or of the history."""
        frames = [take.frames[0] for take in channel.takes if take.blocks is None]
        frames += [channel.history[0]] if channel.history else []
        frames += [channel.frame] if channel.frame is not None else []
        return min((frame.first_sample for frame in frames), default=0)

    def _write_all(self) -> None:
        """Work of the writer thread, which owns the store."""
        self._attempt(self._store.open)
        while (stretch := self._queue.get()) is not None:
            if self._attempt(partial(self._write, stretch)):
                self.recorded += 1
            else:
                self.failed += 1
            del stretch  # or it would be kept until the next event, which may be weeks away
        self._store.close()

    def _write(self, stretch: Stretch) -> None:
        utc = self._utc_of(stretch.first_sample)
        self._store.add(stretch.event.id, lambda folder, name: self._write_event(folder, name, stretch, utc))

    def _attempt(self, action: Callable[[], None]) -> bool:
        """Do something with the disk; what goes wrong is told, and monitoring goes on."""
        try:
            action()
        except ChatterMonitorError as error:
            self._trouble = str(error)
        except OSError as error:
            self._trouble = error.strerror or str(error)
        except Exception as error:  # a bug here must not make the thread die unnoticed
            self._trouble = f"{type(error).__name__}: {error}"
        else:
            self._trouble = None
            return True
        return False


def _end_of(block: Block) -> int:
    """Index after the last sample."""
    return block.first_sample + len(block.samples)
