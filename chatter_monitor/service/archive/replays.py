"""Replaying every recording of an archive."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from chatter_monitor.acquisition.recording import Recording
from chatter_monitor.acquisition.resample import Resampled
from chatter_monitor.config import Settings, decisive_tables, load
from chatter_monitor.outlets.event_files import recorded_event
from chatter_monitor.outlets.message_tables import TABLES, MessageTables
from chatter_monitor.outlets.timeline import Timeline
from chatter_monitor.records import Event
from chatter_monitor.reports import archive as telling
from chatter_monitor.reports.archive import Summary
from chatter_monitor.service.archive.dataset import Place
from chatter_monitor.service.archive.kind import Kind, Tables
from chatter_monitor.service.monitor import Monitor
from chatter_monitor.service.replay import FAST_BLOCK_SAMPLES


@dataclass(frozen=True)
class Replays(Kind[Summary]):
    """What all recordings are replayed with.

    Attributes
    ----------
    configuration : dict
        What the machine configuration says, without its defaults.
    """

    configuration: Tables

    doing, done = "replaying", "replayed"
    tables = tuple(TABLES)
    summary = Summary
    telling = telling

    def decisive(self, file: Path | None = None) -> Tables:
        """Settings that verdicts depend on; a recorded event has its own beside it."""
        return decisive_tables(self._settings(file))

    def do(self, file: Path, place: Place[Summary]) -> Summary:
        """Monitor it as fast as it goes."""
        settings, event = self._settings(file), recorded_event(file)
        with Recording(
            file,
            channels=settings.input.channels,
            full_scale_per_unit=settings.input.full_scale_per_unit,
            block_samples=FAST_BLOCK_SAMPLES,
        ) as recording:
            timeline = Timeline(recording.channels)
            with MessageTables({table: place.file(table) for table in TABLES}) as tables:
                monitor = Monitor(
                    settings,
                    Resampled(recording, settings.tracker.sample_rate_hz),
                    [tables, timeline],
                    counts=recording,
                    source_rate_hz=event.source_rate_hz if event else recording.sample_rate_hz,
                    session=file.stem,
                    clock=lambda: 0.0,  # nobody asks for latencies
                )
                for _ in monitor.run():
                    pass
            whole = timeline.summary(file, recording.missing_samples)
        worst = min(whole.events, key=_damping, default=None)
        seconds = {
            f"{state}_s": sum(channel.get(state, 0.0) for channel in whole.seconds_in)
            for channel in whole.seconds_in
            for state in channel
        }
        return Summary(
            key=place.key,
            machine=settings.machine.name,
            duration_s=whole.duration_s,
            channels=whole.channels,
            events=len(whole.events),
            peak_frequency_hz=worst.peak_frequency_hz if worst else None,
            min_damping_ratio=worst.min_damping_ratio if worst else None,
            samples_lost=whole.samples_lost,
            samples_missing=whole.samples_missing,
            samples_clipped=whole.samples_clipped,
            samples_non_finite=whole.samples_non_finite,
            **seconds,
        )

    def _settings(self, file: Path | None) -> Settings:
        beside = [file.with_suffix(".json")] if file is not None and recorded_event(file) is not None else []
        return load(beside, self.configuration)


def _damping(event: Event) -> float:
    """Least damping of an event, for the order of events: of those without any that was heard the last."""
    return math.inf if event.min_damping_ratio is None else event.min_damping_ratio
