"""Where recordings are found, and how they come to a worker."""

from __future__ import annotations

import json
import os
import pickle
import zipfile

import fsspec
import pytest

from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.service.archive.recordings import find


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Files of all sorts; the test stands beside them."""
    for name in ("b.wav", "day/a.FLAC", "day/notes.txt", "day/a.json", ".part/c.wav", "e[1].wav"):
        path = tmp_path / "cuts" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(name)
    monkeypatch.chdir(tmp_path)
    return tmp_path / "cuts"


def names(*asked):
    return [recording.name for recording in find(asked)]


def test_a_folder():
    """A folder means the sound files in it and below, but for hidden ones."""
    assert names("cuts") == ["cuts/b.wav", "cuts/day/a.FLAC", "cuts/e[1].wav"]
    assert names("cuts/") == names("cuts")


def test_names_are_as_asked(folder):
    """A recording is called as it was asked for: relative, absolute, or as a URL."""
    assert names("cuts/day") == ["cuts/day/a.FLAC"]
    assert names("./cuts/day") == ["cuts/day/a.FLAC"]
    assert names(str(folder / "day")) == [str(folder / "day/a.FLAC")]
    assert names(f"file://{folder}/day") == [f"file://{folder}/day/a.FLAC"]


def test_a_glob():
    """A glob means what it matches, whatever it is called; a file whose name looks like a glob is itself."""
    assert names("cuts/*.wav") == ["cuts/b.wav", "cuts/e[1].wav"]
    assert names("cuts/**/a*") == ["cuts/day/a.FLAC", "cuts/day/a.json"]
    assert names("cuts/e[1].wav") == ["cuts/e[1].wav"]


def test_each_once():
    """A recording that is asked for twice is found once."""
    assert names("cuts/b.wav", "cuts", "cuts/*.wav") == names("cuts")


@pytest.mark.parametrize("asked", ["absent.wav", "cuts/*.mp3", "cuts/day/notes", "file:///absent"])
def test_nothing_there(asked):
    """What leads to no recording is the user's input, told as it was given."""
    with pytest.raises(InputError, match="there is no recording") as caught:
        find(["cuts", asked])
    assert caught.value.got == asked


def test_places_that_cannot_be_reached():
    """An unknown kind of URL is the user's input; one whose plugin is not installed is the environment's fault."""
    with pytest.raises(InputError, match="no place for recordings"):
        find(["nowhere://cuts"])
    with pytest.raises(EnvironmentFault, match="s3fs"):
        find(["s3://bucket/cuts"])


def fetched(recording):
    """Contents of the local file and of the JSON beside it, as another process has them."""
    there = pickle.loads(pickle.dumps(recording))  # noqa: S301  our own
    with there.fetched() as file:
        beside = file.with_suffix(".json")
        return file.name, file.read_text(), beside.read_text() if beside.exists() else None


def test_local_files_are_read_in_place(folder):
    """A local recording is not copied."""
    (recording,) = find(["cuts/b.wav"])
    with recording.fetched() as file:
        assert file == folder / "b.wav"
    assert file.exists()


def test_inside_an_archive_of_files(tmp_path):
    """Recordings in a ZIP file are found and fetched with the JSON beside them, and the copies go again."""
    with zipfile.ZipFile(tmp_path / "cuts.zip", "w") as archive:
        archive.writestr("day/a.wav", "sound")
        archive.writestr("day/a.json", json.dumps({"speed": 1}))
        archive.writestr("day/b.wav", "more")
    first, second = find(["zip://day/*.wav::cuts.zip"])
    assert (first.name, second.name) == ("zip://day/a.wav::cuts.zip", "zip://day/b.wav::cuts.zip")
    assert fetched(first) == ("a.wav", "sound", '{"speed": 1}')
    assert fetched(second) == ("b.wav", "more", None)
    with first.fetched() as file:
        pass
    assert not file.exists()
    assert not os.path.exists(file.parent)


def test_in_memory():
    """Any file system that fsspec knows will do; a file that goes away meanwhile is told by its name."""
    memory = fsspec.filesystem("memory")
    memory.pipe("/archive/cut.wav", b"sound")
    try:
        (recording,) = find(["memory://archive"])
        assert recording.name == "memory:///archive/cut.wav"
        assert fetched(recording) == ("cut.wav", "sound", None)
    finally:
        memory.rm("/archive", recursive=True)
    with pytest.raises(InputError, match="no such recording") as caught, recording.fetched():
        pass
    assert caught.value.got == recording.name
