"""Recorded events for a person or a program: which there are, and what may go."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec

from chatter_monitor.errors import InputError
from chatter_monitor.outlets.event_files import RecordedEvent, read
from chatter_monitor.outlets.event_store import Entry, EventStore
from chatter_monitor.outlets.look import damping, hertz

DAY_S = 86_400.0
HEADINGS = ["id", "onset (UTC)", "ch", "chatter s", "Hz", "damping %", "kept s", "MB", ""]


def described(entry: Entry) -> dict[str, Any]:
    """Everything that is known of a recorded event, as JSON types; less if its description cannot be read."""
    recorded = _readable(entry)
    known: dict[str, Any] = {"id": entry.id} if recorded is None else msgspec.to_builtins(recorded)
    return known | {"path": str(entry.path), "size_bytes": entry.size_bytes, "protected": entry.protected}


def lines(store: EventStore) -> list[str]:
    """Table of the recorded events, oldest first, and what they come to."""
    entries = store.entries()
    if not entries:
        return [f"No recorded events in {store.directory}."]
    rows = [HEADINGS, *([entry.id, *_cells(entry), _remarks(entry)] for entry in entries)]
    widths = [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]
    table = [_line(row, widths) for row in rows]
    size_mb = sum(entry.size_bytes for entry in entries) / 1e6
    count = "1 recorded event" if len(entries) == 1 else f"{len(entries)} recorded events"
    return [*table, f"{count}, {size_mb:.1f} MB, in {store.directory}."]


def purgeable(entries: Sequence[Entry], *, now: float, older_than_days: float | None) -> list[Entry]:
    """Those that are not protected and were completed longer ago; all that are not protected if no age is given."""
    unprotected = [entry for entry in entries if not entry.protected]
    if older_than_days is None:
        return unprotected
    return [entry for entry in unprotected if now - entry.written > older_than_days * DAY_S]


def _line(row: Sequence[str], widths: Sequence[int]) -> str:
    """Words to the left, numbers to the right; never cut, because ids are there to be copied."""
    words = {0, 1, len(row) - 1}
    cells = (c.ljust(w) if i in words else c.rjust(w) for i, (c, w) in enumerate(zip(row, widths, strict=True)))
    return "  ".join(cells).rstrip()


def _cells(entry: Entry) -> list[str]:
    recorded = _readable(entry)
    if recorded is None:
        return ["?"] * (len(HEADINGS) - 2)
    return [
        recorded.onset_utc[:19].replace("T", " "),
        str(recorded.channel),
        f"{recorded.end_s - recorded.onset_s:.2f}",
        hertz(recorded.peak_frequency_hz).removesuffix(" Hz"),
        damping(recorded.min_damping_ratio).removesuffix(" %"),
        f"{recorded.samples / recorded.sample_rate_hz:.1f}",
        f"{entry.size_bytes / 1e6:.1f}",
    ]


def _remarks(entry: Entry) -> str:
    recorded = _readable(entry)
    remarks = ["protected"] if entry.protected else []
    if recorded is None:
        remarks.append("its JSON cannot be read")
    else:
        remarks += ["withdrawn"] if recorded.withdrawn else []
        remarks += ["truncated"] if recorded.truncated else []
        remarks += ["samples missing"] if recorded.missing_samples else []
    return ", ".join(remarks)


def _readable(entry: Entry) -> RecordedEvent | None:
    try:
        return read(entry.json)
    except InputError:
        return None
