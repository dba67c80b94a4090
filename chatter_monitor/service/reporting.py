"""Reports from files: an event of the store, a shift from JSON lines or from the store."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np

from chatter_monitor.acquisition.recording import Recording
from chatter_monitor.acquisition.source import Source
from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.outlets.event_files import read, read_verdicts
from chatter_monitor.outlets.event_store import Entry, EventStore
from chatter_monitor.records import Event, Flag, Health, Odp, Verdict
from chatter_monitor.reports.event import event_page
from chatter_monitor.reports.shift import Shift, shift_page

_DECODER = msgspec.json.Decoder(Verdict | Event | Health | Odp)
# Lines that a shift is made of; most others, the ODPs, need not be parsed.
_WANTED = (b'{"type":"verdict"', b'{"type":"event"')


def report_event(entry: Entry, out: Path) -> None:
    """Write the report of a recorded event: what was said of it, and what there was to hear.

    Raises
    ------
    InputError
        If the event cannot be read.
    EnvironmentFault
        If the report cannot be written.
    """
    recorded = read(entry.json)
    verdicts = read_verdicts(entry.path / recorded.verdicts)
    file = entry.path / str(recorded.recording)
    with Recording(file, full_scale_per_unit=recorded.full_scale_per_unit) as recording:
        samples = _samples(recording, recorded.channel)
    _write(out, event_page(recorded, verdicts, samples))


def report_shift(source: Path, out: Path) -> Shift:
    """Write the report of a shift.

    Parameters
    ----------
    source : Path
        JSON lines of `replay --jsonl`, or of a subscriber; or a directory of recorded events.
    out : Path
        HTML file to write.

    Raises
    ------
    InputError
        If there is nothing to report on.
    EnvironmentFault
        If the report cannot be written.
    """
    shift = Shift()
    if source.is_dir():
        machines = set()
        for entry in EventStore(source).entries():
            recorded = read(entry.json)
            machines.add(recorded.machine)
            shift.event(recorded, recorded.onset_utc[:19].replace("T", " ") + " UTC")
        title = f"Recorded events of {', '.join(sorted(machines)) or 'a machine'}"
    else:
        for message in _messages(source):
            if isinstance(message, Verdict):
                shift.verdict(message)
            else:
                shift.event(message)
        if not shift.seconds:
            raise InputError("there are no verdicts in the file", got=str(source), allowed="JSON lines of --jsonl")
        title = f"Shift: {source.stem}"
    _write(out, shift_page(shift, title, f"from {source.name}"))
    return shift


def _messages(path: Path) -> Iterator[Verdict | Event]:
    try:
        with path.open("rb") as file:
            for number, line in enumerate(file, 1):
                if line.startswith(_WANTED):
                    try:
                        message = _DECODER.decode(line)
                    except msgspec.DecodeError as error:
                        what = f"line {number} of the JSON lines cannot be read: {error}"
                        raise InputError(what, got=str(path)) from error
                    if isinstance(message, Verdict | Event):
                        yield message
    except OSError as error:
        raise InputError(f"the JSON lines cannot be read: {error.strerror}", got=str(path)) from error


def _samples(source: Source, channel: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """All samples of a channel, NaN where they are placeholders."""
    pieces = []
    for block in source.blocks():
        missing = bool(block.flags) and bool(block.flags[channel] & Flag.NON_FINITE)
        pieces.append(np.full(len(block.samples), np.nan) if missing else block.samples[:, channel])
    return np.concatenate(pieces)


def _write(path: Path, page: str) -> None:
    try:
        path.write_text(page, encoding="utf-8")
    except OSError as error:
        raise EnvironmentFault(f"the report cannot be written: {error.strerror}", got=str(path)) from error
