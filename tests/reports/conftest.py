"""A recorded event and the JSON lines of the replay that it comes from."""

from __future__ import annotations

import contextlib
import io

import pytest

from chatter_monitor.config import load
from chatter_monitor.outlets.event_store import EventStore
from chatter_monitor.service.replay import Replay
from tests.replaying import REPLAY_DATA


@pytest.fixture(scope="session")
def replayed(tmp_path_factory):
    """Directory with ``bar.jsonl`` and the store ``events`` of a replay of chatter on a lathe."""
    folder = tmp_path_factory.mktemp("replayed")
    settings = load([], {"machine": {"name": "lathe <3>"}, "spindle": {"speed_rpm": 1685.0}})
    with contextlib.redirect_stdout(io.StringIO()):
        Replay(
            file=REPLAY_DATA / "bar_turning.flac",
            settings=settings,
            jsonl=folder / "bar.jsonl",
            record=folder / "events",
        ).run(as_json=True)
    return folder


@pytest.fixture(scope="session")
def entry(replayed):
    """The recorded event."""
    [entry] = EventStore(replayed / "events").entries()
    return entry
