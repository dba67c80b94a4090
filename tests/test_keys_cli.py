"""The commands that make certificates and allow clients."""

from __future__ import annotations

import json
import os
import stat

import pytest

from chatter_monitor.outlets.certificates import read_public, read_secret


@pytest.fixture
def run(run):
    """Run `chatter-monitor keys` in this process; returns exit code, standard output and standard error."""
    return lambda *arguments: run("keys", *arguments)


@pytest.fixture
def keys(tmp_path):
    """A directory for certificates that does not exist yet."""
    return tmp_path / "machines" / "keys"


@pytest.fixture
def open_umask():
    """A umask that takes nothing away: what is closed is closed by the program."""
    before = os.umask(0)
    yield
    os.umask(before)


def mode(path):
    return stat.S_IMODE(path.stat().st_mode)


@pytest.mark.usefixtures("open_umask")
def test_new_certificate(run, keys):
    """`keys new` makes both files in a directory that is its owner's, and tells where they go but no secret."""
    code, out, err = run("new", "server", "--directory", keys)
    assert (code, err) == (0, "")
    assert {path.name: mode(path) for path in keys.iterdir()} == {"server.key": 0o644, "server.key_secret": 0o600}
    assert mode(keys) == 0o700
    pair = read_secret(keys / "server.key_secret")
    assert read_public(keys / "server.key") == pair.public
    assert f"[publish] server_key = '{keys}/server.key_secret'" in out
    assert pair.secret.decode() not in out


def test_every_certificate_is_another(run, keys):
    """Two certificates have nothing in common."""
    for name in ("a", "b"):
        assert run("new", name, "--directory", keys)[0] == 0
    assert read_public(keys / "a.key") != read_public(keys / "b.key")


@pytest.mark.parametrize("left", ["server.key", "server.key_secret"])
def test_nothing_is_replaced(run, keys, left):
    """A certificate of the same name is kept, even if only one of its files is left."""
    keys.mkdir(parents=True)
    (keys / left).write_text("precious")
    code, out, err = run("new", "server", "--directory", keys)
    assert (code, out) == (2, "")
    assert "exists and is not replaced" in err
    assert {path.name: path.read_text() for path in keys.iterdir()} == {left: "precious"}


@pytest.mark.parametrize("name", ["", ".", "../server", "a/b", "-x", "a b", "a\n", "ä", "x" * 200])
def test_names_that_are_no_file_names(run, keys, name):
    """A name that would lead out of the directory, or be hard to type, is refused."""
    code, _, err = run("new", "--directory", keys, "--", name)
    assert code == 2
    assert "no name for a certificate" in err
    assert not keys.exists()


@pytest.mark.usefixtures("open_umask")
def test_allowing_a_client(run, keys, tmp_path):
    """`keys allow` puts the public key on the list, says what to configure, and may be repeated."""
    run("new", "alice", "--directory", tmp_path)
    for _ in range(2):
        code, out, err = run("allow", tmp_path / "alice.key", "--directory", keys)
        assert (code, err) == (0, "")
        assert f"[publish] allowed_clients = '{keys}/allowed'" in out
    assert read_public(keys / "allowed" / "alice.key") == read_public(tmp_path / "alice.key")
    assert mode(keys) == mode(keys / "allowed") == 0o700


def test_two_clients_of_one_name(run, keys, tmp_path):
    """A second client of the same name does not take the place of the first."""
    for owner in ("one", "two"):
        run("new", "alice", "--directory", tmp_path / owner)
    assert run("allow", tmp_path / "one" / "alice.key", "--directory", keys)[0] == 0
    code, _, err = run("allow", tmp_path / "two" / "alice.key", "--directory", keys)
    assert code == 2
    assert "another client of this name" in err
    assert read_public(keys / "allowed" / "alice.key") == read_public(tmp_path / "one" / "alice.key")


def test_what_cannot_be_allowed(run, keys, tmp_path):
    """A secret certificate, a file of another kind and a missing one are refused, and nothing is put on the list."""
    run("new", "alice", "--directory", tmp_path)
    (tmp_path / "text.key").write_text("hello")
    for name, reason in {
        "alice.key_secret": "is secret",
        "text.key": "no public-key",
        "absent.key": "No such file",
    }.items():
        code, out, err = run("allow", tmp_path / name, "--directory", keys)
        assert (code, out) == (2, "")
        assert reason in err
        assert str(tmp_path / name) in err
    assert not keys.exists()


def test_list(run, keys):
    """`keys list` shows names and public keys, for people and as JSON, and no secret."""
    assert "keys new NAME" in run("list", "--directory", keys)[1]
    for name in ("server", "alice"):
        run("new", name, "--directory", keys)
    run("allow", keys / "alice.key", "--directory", keys)
    public = {name: read_public(keys / f"{name}.key").decode() for name in ("alice", "server")}
    code, text, err = run("list", "--directory", keys)
    assert (code, err) == (0, "")
    assert [line.split() for line in text.splitlines()] == [
        ["own", "alice", public["alice"]],
        ["own", "server", public["server"]],
        ["allowed", "alice", public["alice"]],
    ]
    assert json.loads(run("list", "--directory", keys, "--json")[1]) == {
        "own": public,
        "allowed": {"alice": public["alice"]},
    }


def test_json(run, keys):
    """With --json the commands print the paths of their files."""
    new = json.loads(run("new", "alice", "--directory", keys, "--json")[1])
    assert new == {"public": f"{keys}/alice.key", "secret": f"{keys}/alice.key_secret"}
    assert json.loads(run("allow", new["public"], "--directory", keys, "--json")[1]) == {
        "allowed": f"{keys}/allowed/alice.key"
    }


@pytest.mark.parametrize("command", [["new", "alice"], ["allow", "server.key"]])
def test_a_directory_that_cannot_be_made(run, tmp_path, monkeypatch, command):
    """A path where there can be no directory is the user's error."""
    run("new", "server", "--directory", tmp_path)
    monkeypatch.chdir(tmp_path)
    code, _, err = run(*command, "--directory", tmp_path / "server.key" / "keys")
    assert code == 2
    assert "cannot be made" in err
