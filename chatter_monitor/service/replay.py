"""The main job on a recording: open it, send it through the monitor, show what happened."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import msgspec
from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.table import Column
from rich.text import Text

from chatter_monitor.acquisition.pace import Paced
from chatter_monitor.acquisition.recording import Recording
from chatter_monitor.acquisition.resample import Resampled
from chatter_monitor.acquisition.source import Source
from chatter_monitor.config import Settings
from chatter_monitor.errors import EnvironmentFault
from chatter_monitor.outlets.control import Control
from chatter_monitor.outlets.event_files import recorded_event
from chatter_monitor.outlets.event_store import EventWriter
from chatter_monitor.outlets.json_lines import JsonLines
from chatter_monitor.outlets.odp_table import OdpTable
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.outlets.publisher import Clock, Publisher
from chatter_monitor.outlets.timeline import Timeline
from chatter_monitor.service.ahead import FrontEndsAhead
from chatter_monitor.service.compiling import what_takes_long
from chatter_monitor.service.front_ends import FrontEnds
from chatter_monitor.service.monitor import Monitor, warm_up
from chatter_monitor.service.processors import processors
from chatter_monitor.service.recorder import open_recorder
from chatter_monitor.service.status import Status

# At real time short enough for a verdict to follow its interval at once; at full speed long enough to waste nothing
# between blocks.
REAL_BLOCK_SAMPLES = 256
FAST_BLOCK_SAMPLES = 32768
# To start another process takes a second or two: what a replay of some minutes takes.
LONG_S = 300.0


@dataclass(frozen=True)
class Replay:
    """What to replay and where the results go.

    Attributes
    ----------
    file : Path
        The recording.
    settings : Settings
        The machine configuration.
    real_time : bool
        At the pace of the recording instead of as fast as possible.
    publish : bool
        Over ZeroMQ as well.
    wait_subscriber_s : float
        How long to wait for a first subscriber before starting.
    jsonl, odp_table : Path or None
        Files to write.
    record : Path or None
        Directory to record events in.
    witnesses : sequence of Outlet
        Further outlets, which the caller opens and closes.
    """

    file: Path
    settings: Settings
    real_time: bool = False
    publish: bool = False
    wait_subscriber_s: float = 0.0
    jsonl: Path | None = None
    odp_table: Path | None = None
    record: Path | None = None
    witnesses: Sequence[Outlet] = ()

    def run(self, *, as_json: bool = False) -> None:
        """Replay, then print the timeline (or a JSON summary) on standard output.

        Raises
        ------
        InputError
            If the recording or an output file cannot be used.
        EnvironmentFault
            If the port to publish on is taken or the disk is full.
        """
        settings = self.settings
        rate_hz = settings.tracker.sample_rate_hz
        event = recorded_event(self.file)
        clock = Clock(rate_hz, datetime.fromisoformat(event.utc) if event else datetime.now(UTC))
        with ExitStack() as stack:
            recording = stack.enter_context(self._recording())
            source_rate_hz = event.source_rate_hz if event else recording.sample_rate_hz
            source: Source = Resampled(recording, rate_hz)
            if self.real_time:
                source = Paced(source, time.monotonic, time.sleep)
            timeline = Timeline(source.channels)
            status = Status(lambda: self.file.name)
            outlets: list[Outlet] = [timeline, status, *self.witnesses]
            if self.jsonl is not None:
                outlets.append(stack.enter_context(JsonLines(self.jsonl)))
            if self.odp_table is not None:
                modes, machine = settings.tracker.modes, settings.machine.name
                table = OdpTable(self.odp_table, modes=modes, sample_rate_hz=rate_hz, machine=machine)
                outlets.append(stack.enter_context(table))
            control = self._control()
            if control is not None:
                outlets.append(stack.enter_context(control))
            publisher = stack.enter_context(self._publisher(clock)) if self.publish else None
            if publisher is not None:
                outlets.append(publisher)
                publisher.wait_for_subscriber(self.wait_subscriber_s)
            recorder = None
            if self.record is not None:
                store = EventWriter(self.record, settings.recorder.quota_gb * 1e9)
                store.open()  # what is wrong with it is better known before than after the replay
                recorder = open_recorder(
                    settings, store, source.channels, source_rate_hz, utc_of=clock.utc_of, patient=True
                )
                outlets.append(stack.enter_context(recorder))
            if self.real_time:
                warm_up(settings, source_rate_hz)
            with _progress(source.length, status) as advance:
                monitor = Monitor(
                    settings,
                    source,
                    outlets,
                    counts=recording,
                    source_rate_hz=source_rate_hz,
                    session=self.file.stem,
                    clock=time.perf_counter,
                    dropped=lambda: 0 if publisher is None else publisher.dropped,
                    commands=lambda: () if control is None else control.commands(),
                    front_ends=self._front_ends(source, source_rate_hz, stack),
                )
                for done in monitor.run():
                    advance(done)
        summary = timeline.summary(self.file, recording.missing_samples)
        if as_json:
            sys.stdout.write(msgspec.json.encode(summary).decode() + "\n")
        else:
            timeline.show(Console(), summary)
            if recorder is not None:
                Console().print(
                    f"Recorded in {self.record}: {recorder.recorded} event{'' if recorder.recorded == 1 else 's'}.",
                    markup=False,
                    soft_wrap=True,
                )
        if recorder is not None and recorder.problems():
            raise EnvironmentFault("; ".join(recorder.problems()), got=str(self.record))

    def _front_ends(self, source: Source, source_rate_hz: float, stack: ExitStack) -> FrontEnds | None:
        """In a process of their own, where that saves time."""
        rate_hz = source.sample_rate_hz
        is_long = source.length is not None and source.length > LONG_S * rate_hz
        if self.real_time or not is_long or processors() == 1:
            return None
        block_samples = round(FAST_BLOCK_SAMPLES * max(1.0, rate_hz / source_rate_hz))
        return stack.enter_context(FrontEndsAhead(self.settings, source.channels, source_rate_hz, block_samples))

    def _control(self) -> Control | None:
        """Control socket, if it is configured and somebody can use it: at full speed the recording is over too soon."""
        endpoint = self.settings.control.bind
        if endpoint is None or not self.real_time:
            return None
        return Control(endpoint, machine=self.settings.machine.name, spindle=self.settings.spindle)

    def _recording(self) -> Recording:
        selected = self.settings.input
        return Recording(
            self.file,
            channels=selected.channels,
            full_scale_per_unit=selected.full_scale_per_unit,
            block_samples=REAL_BLOCK_SAMPLES if self.real_time else FAST_BLOCK_SAMPLES,
        )

    def _publisher(self, clock: Clock) -> Publisher:
        return Publisher(self.settings.publish, clock=clock, machine=self.settings.machine.name)


class _Advance:
    """Moves a progress bar to a sample."""

    def __init__(self, progress: Progress, total: int | None) -> None:
        self._progress = progress
        self._task = progress.add_task("replay", total=total)

    def __call__(self, done: int) -> None:
        self._progress.update(self._task, completed=done)


class _Heard(ProgressColumn):
    """What is heard at the moment."""

    def __init__(self, status: Status) -> None:
        super().__init__(Column(no_wrap=True, overflow="ellipsis", ratio=1))
        self._status = status

    def render(self, task: Task) -> Text:  # noqa: ARG002  there is one
        """The sentence in the colour of its worst news."""
        return self._status.line()


@contextmanager
def _progress(total: int | None, status: Status) -> Iterator[_Advance]:
    """Progress and what is heard, on standard error, only where a person looks at it.

    It says so when kernels must be compiled first.
    """
    console = Console(stderr=True)
    if (first := what_takes_long()) is not None:
        console.print(f"{first.capitalize()}.")
    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %"))
    with Progress(
        *columns,
        TimeRemainingColumn(),
        _Heard(status),
        expand=True,
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as p:
        yield _Advance(p, total)
