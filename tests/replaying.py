"""The main job as the tests run it: a file in, messages and a summary out."""

from __future__ import annotations

import contextlib
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from chatter_monitor.config import load
from chatter_monitor.service.replay import Replay

REPLAY_DATA = Path(__file__).parents[1] / "replay_data"


@dataclass(frozen=True)
class Outcome:
    """What came out: every message of the JSON lines, in order, and the summary."""

    messages: list[dict[str, Any]]
    summary: dict[str, Any]

    def of(self, kind: str, channel: int | None = None) -> list[dict[str, Any]]:
        """Messages of one kind, of one channel if it is given."""
        return [m for m in self.messages if m["type"] == kind and channel in (None, m.get("channel"))]

    def states(self, channel: int = 0) -> list[str]:
        """State of every interval."""
        return [verdict["state"] for verdict in self.of("verdict", channel)]

    def alarms(self, channel: int = 0) -> list[dict[str, Any]]:
        """Intervals of alarm."""
        return [verdict for verdict in self.of("verdict", channel) if verdict["state"] == "self_excited"]


def parse(line: str) -> dict[str, Any]:
    """Parse JSON as the standard has it: without NaN and infinity."""

    def refuse(token: str) -> None:
        raise ValueError(f"{token} is not JSON")

    message: dict[str, Any] = json.loads(line, parse_constant=refuse)
    return message


def replay(file: Path, directory: Path, *, odp_table: Path | None = None, **tables: dict[str, Any]) -> Outcome:
    """Replay a file at full speed; `tables` are those of a machine configuration."""
    jsonl = directory / "replayed.jsonl"
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        Replay(file=file, settings=load([], tables), jsonl=jsonl, odp_table=odp_table).run(as_json=True)
    return Outcome([parse(line) for line in jsonl.read_text().splitlines()], parse(out.getvalue()))


def truth_of(name: str) -> dict[str, Any]:
    """Sidecar of a recording in `REPLAY_DATA`."""
    truth: dict[str, Any] = json.loads((REPLAY_DATA / f"{name}.json").read_text())
    return truth
