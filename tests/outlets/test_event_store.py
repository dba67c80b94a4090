"""The directory of recorded events: quota, protection, names, leftovers, and being killed at any moment."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import soundfile

from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.outlets.event_files import read, recorded_event
from chatter_monitor.outlets.event_store import EventStore, EventWriter
from tests.outlets.recorder_feed import signal


@pytest.fixture
def store(tmp_path):
    """A store with room for 1000 bytes."""
    store = EventWriter(tmp_path / "events", 1000)
    yield store
    store.close()


def add(store, name, size=300, age_s=0.0):
    """Add a recording of `size` bytes that was completed some time ago."""
    name = store.add(name, lambda folder, name: (folder / f"{name}.json").write_bytes(b"x" * size))
    path = store.directory / name / f"{name}.json"
    written = path.stat().st_mtime - age_s
    os.utime(path, (written, written))
    return name


def names(store):
    return [entry.id for entry in store.entries()]


def hidden(store):
    return sorted(path.name for path in store.directory.iterdir() if path.name.startswith("."))


def test_the_oldest_goes_first(store):
    """When the quota is reached the oldest recordings go, as many as it takes, and the listing is by age."""
    for name, age_s in [("b", 20), ("a", 30), ("c", 10)]:
        add(store, name, age_s=age_s)
    assert names(store) == ["a", "b", "c"]
    add(store, "d", size=600)
    assert names(store) == ["c", "d"]
    assert hidden(store) == [".lock"]


def test_protected_recordings_stay(store):
    """The quota takes the oldest that is not protected, until protection is taken back."""
    for name, age_s in [("a", 30), ("b", 20), ("c", 10)]:
        add(store, name, age_s=age_s)
    store.protect(store.find("a"))
    add(store, "d")
    assert names(store) == ["a", "c", "d"]
    assert [entry.protected for entry in store.entries()] == [True, False, False]
    store.protect(store.find("a"), protected=False)
    add(store, "e")
    assert names(store) == ["c", "d", "e"]


def test_a_quota_that_leaves_no_room(store):
    """What cannot fit, being too large or because of protected ones, is refused, and nothing else goes for it."""
    add(store, "a", size=600, age_s=20)
    add(store, "b", size=300, age_s=10)
    with pytest.raises(EnvironmentFault, match="quota of recorded events leaves no room"):
        add(store, "large", size=1001)
    store.protect(store.find("a"))
    with pytest.raises(EnvironmentFault, match="are protected"):
        add(store, "c", size=500)
    assert names(store) == ["a", "b"]
    assert hidden(store) == [".lock"]


def test_nothing_incomplete_is_listed(store):
    """While it is written, and when writing fails, a recording is not there, nor is what else lies in the directory."""
    add(store, "a")
    (store.directory / "notes.txt").write_text("of the operator")
    (store.directory / "other").mkdir()

    def write(folder, name):
        (folder / f"{name}.json").touch()
        assert names(store) == ["a"]
        raise RuntimeError

    with pytest.raises(RuntimeError):
        store.add("b", write)
    assert names(store) == ["a"]
    assert hidden(store) == [".lock"]


def test_no_name_is_taken_twice(store):
    """A recording whose name is taken gets another one; the earlier one stays as it was."""
    assert [add(store, "cut-0-0001", size=size) for size in (100, 200, 300)] == [
        "cut-0-0001",
        "cut-0-0001-2",
        "cut-0-0001-3",
    ]
    assert [entry.size_bytes for entry in sorted(store.entries(), key=lambda entry: entry.id)] == [100, 200, 300]


@pytest.mark.parametrize(
    ("wanted", "name"),
    [
        (".hidden-0-0001", "hidden-0-0001"),
        ("../../up-0-0001", "_.._up-0-0001"),
        ("a b\n[red]\x00-0-0001", "a_b_red_-0-0001"),
        ("größe-0-0001", "gr_e-0-0001"),
        ("x" * 300 + "-0-0001", "x" * 93 + "-0-0001"),
        ("..", "event"),
    ],
)
def test_a_name_is_the_name_of_one_visible_folder(store, wanted, name):
    """Whatever the name of the file that was replayed, the recording lies in the directory and is listed."""
    assert add(store, wanted) == name
    assert names(store) == [name]


@pytest.mark.parametrize("name", ["..", ".lock", "", "a/../a", "absent"])
def test_only_what_is_listed_is_found(store, name):
    """An id is looked up among those that are listed, so none leads out of the directory."""
    add(store, "a")
    with pytest.raises(InputError, match="no recorded event of that name"):
        store.find(name)


def test_leftovers_of_a_crash_go(store, tmp_path):
    """What a killed recorder left half-written or half-removed goes when the next one starts; the rest stays."""
    add(store, "a")
    store.close()
    for leftover in (".part-b", ".removed-c"):
        (store.directory / leftover).mkdir()
        (store.directory / leftover / "b.json").touch()
    again = EventWriter(tmp_path / "events", 1000)
    again.open()
    assert names(again) == ["a"]
    assert hidden(again) == [".lock"]
    again.close()


def test_one_recorder_at_a_time(store, tmp_path):
    """A second recorder would take the first one's unfinished recording for a leftover; it is refused."""
    store.open()
    second = EventWriter(tmp_path / "events", 1000)
    with pytest.raises(InputError, match="another recorder uses it"):
        second.open()
    store.close()
    second.open()
    second.close()


def test_a_directory_that_vanishes_is_made_again(store):
    """If somebody removes the directory, one recording is lost, and the next one has a directory."""
    add(store, "a")
    (store.directory / ".lock").unlink()
    store.remove(store.find("a"))
    store.directory.rmdir()
    with pytest.raises(FileNotFoundError):
        add(store, "b")
    add(store, "c")
    assert names(store) == ["c"]


def test_removing_what_is_gone_already(store):
    """Two who tidy up at the same time do not disturb each other."""
    add(store, "a")
    entry = store.find("a")
    store.remove(entry)
    store.remove(entry)
    assert names(store) == []


def recorder_process(directory: Path) -> subprocess.Popen[str]:
    script = Path(__file__).with_name("recorder_process.py")
    root = Path(__file__).parents[2]
    return subprocess.Popen(
        [sys.executable, script, directory],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=root,
        env={**os.environ, "PYTHONPATH": str(root)},
    )


def check_whole(folder: Path) -> None:
    """Every file of a recorded event is there and holds what it should."""
    recorded = read(folder / f"{folder.name}.json")
    assert recorded_event(folder / (recorded.recording or "")) == recorded
    samples, _ = soundfile.read(folder / (recorded.recording or ""), always_2d=True)
    first, end = recorded.first_sample, recorded.first_sample + recorded.samples
    np.testing.assert_array_equal(samples, signal(first, end))
    np.testing.assert_array_equal(pq.read_table(folder / recorded.odp)["sample"], np.arange(first, end))


@pytest.mark.slow
def test_killed_at_any_moment(tmp_path):
    """SIGKILL at 60 random moments: what is listed is whole, and what was complete is there but for the oldest.

    The quota makes recordings go as well as come; a protected one is there to the end. On a slow machine there are more
    moments, until as many recordings have been complete.
    """
    store = EventStore(tmp_path / "events")
    rng = np.random.default_rng(1)
    complete: list[str] = []
    protected: set[str] = set()
    whole: set[str] = set()
    kills_while_writing = 0
    with recorder_process(store.directory) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        for kills in range(400):
            if kills >= 60 and len(complete) > 60 and kills_while_writing > 20:
                break
            process.stdin.write(f"{rng.uniform(0.0, 0.15)}\n")
            process.stdin.flush()
            complete += json.loads(process.stdout.readline())
            listed = names(store)
            for name in set(listed) - whole:
                check_whole(store.directory / name)
                whole.add(name)
            kills_while_writing += len(hidden(store)) > 1
            gone = [index for index, name in enumerate(complete) if name not in listed]
            oldest = min((index for index, name in enumerate(complete) if name in set(listed) - protected), default=0)
            assert all(index < oldest for index in gone)
            assert protected <= set(listed)
            if listed and not protected:
                store.protect(store.find(listed[0]))
                protected.add(listed[0])
        process.stdin.close()
    assert process.returncode == 0
    assert len(complete) > 60
    assert len(names(store)) < len(complete) / 2  # the quota was at work
    assert kills_while_writing > 20
