"""The flight recorder of a monitor, set up from the machine configuration."""

from __future__ import annotations

from collections.abc import Callable

from chatter_monitor.config import Settings, decisive_tables
from chatter_monitor.outlets.event_files import Origin
from chatter_monitor.outlets.event_store import EventWriter
from chatter_monitor.outlets.flight_recorder import FlightRecorder


def open_recorder(
    settings: Settings,
    store: EventWriter,
    channels: int,
    source_rate_hz: float,
    *,
    utc_of: Callable[[int], str],
    patient: bool,
) -> FlightRecorder:
    """Flight recorder for a source.

    Parameters
    ----------
    settings : Settings
        The machine configuration.
    store : EventWriter
        Where to record, handed over.
    channels : int
        Channels of the source.
    source_rate_hz : float
        Rate at which the signal was sampled before it was converted.
    utc_of : callable
        Time of a sample, ISO 8601.
    patient : bool
        Whether to wait for the disk rather than lose a recording.
    """
    tables = decisive_tables(settings)
    tables["input"]["channels"] = None  # a recording has the channels that were selected, and no others
    origin = Origin(
        settings=tables,
        sample_rate_hz=settings.tracker.sample_rate_hz,
        source_rate_hz=source_rate_hz,
        channels=channels,
        modes=settings.tracker.modes,
        machine=settings.machine.name,
        full_scale_per_unit=settings.input.full_scale_per_unit,
    )
    return FlightRecorder(settings.recorder, store, origin, utc_of=utc_of, patient=patient)
