"""What the doctor finds."""

from __future__ import annotations

import json
import socket
import threading
import time
from datetime import UTC, datetime

import numpy as np
import pytest

from chatter_monitor.config import load
from chatter_monitor.outlets.control import Control
from chatter_monitor.outlets.publisher import Clock, Publisher
from chatter_monitor.service import doctor
from tests.fake_card import FakeDevices, PlayingDevices
from tests.messages import health
from tests.signals import RATE_HZ

RNG = np.random.default_rng(1)


@pytest.fixture
def config(tmp_path):
    """A configuration whose ports are free and whose directory can be written."""

    def write(tables=""):
        path = tmp_path / "machine.toml"
        path.write_text(
            f'[publish]\nbind = "ipc://{tmp_path}/published"\n[recorder]\ndirectory = "{tmp_path}/events"\n{tables}'
        )
        return path

    return write


def examined(config, samples):
    return {finding.check: finding for finding in doctor.examine([config], lambda _: PlayingDevices(samples), 0.1)}


def noise(scale=0.1, channels=1):
    return scale * RNG.standard_normal((1280, channels))


@pytest.mark.parametrize(
    ("samples", "state", "words"),
    [
        (noise(), "ok", "hears -20 dBFS"),
        (np.clip(noise(1.0), -1, 1), "wrong", "clipped"),
        (np.zeros((1280, 1)), "wrong", "nothing changes on channel 0"),
        (noise(1e-6), "note", "very quiet"),
        (np.empty((0, 1)), "wrong", "delivers nothing"),
    ],
)
def test_what_the_device_hears(config, samples, state, words):
    """Level, clipping, silence and a device without samples are told from each other, with something to do."""
    finding = examined(config(), samples)["device"]
    assert finding.state == state
    assert words in finding.found
    assert state == "ok" or finding.remedy


def test_a_dead_channel_beside_a_live_one(config):
    """The channel that is dead is named."""
    samples = noise(channels=3)
    samples[:, 2] = 0.5
    finding = examined(config("[input]\nchannels = [0, 2]\n"), samples)["device"]
    assert "nothing changes on channel 2." in finding.found


def test_a_device_that_hangs(config, monkeypatch):
    """The doctor does not wait for ever."""
    monkeypatch.setattr(doctor, "PATIENCE_S", -0.9)

    class Hanging(FakeDevices):
        def choose(self):
            time.sleep(1.0)
            return super().choose()

    found = {finding.check: finding for finding in doctor.examine([config()], lambda _: Hanging(), 0.1)}
    assert found["device"].found == "it does not answer."


def test_what_is_around_it(config, tmp_path):
    """A bad configuration, a taken port and a directory without rights are wrong, each with its own line."""
    healthy = examined(config(), noise())
    assert {check: f.found for check, f in healthy.items() if f.state == "wrong"} == {}
    assert "unknown key [inpt]" in examined(config("[inpt]\n"), noise())["configuration"].found
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        found = examined(config(f'[metrics]\nbind = "127.0.0.1:{port}"\n'), noise())
    assert found["ports"].state == "wrong"
    assert str(port) in found["ports"].found
    (tmp_path / "file").touch()
    path = tmp_path / "other.toml"
    path.write_text(f'[recorder]\ndirectory = "{tmp_path}/file/events"\n')
    assert examined(path, noise())["recordings"].state == "wrong"


class Told(threading.Thread):
    """A monitor that publishes health messages."""

    def __init__(self, settings, state):
        super().__init__(daemon=True)
        self._settings = settings
        self._state = state
        self.ended = threading.Event()

    def run(self):
        clock = Clock(RATE_HZ, datetime.now(UTC))
        with Publisher(self._settings.publish, clock=clock, machine="m") as publisher:
            while not self.ended.wait(0.05):
                publisher.message(health(state=self._state, reasons=["the reason"]))


@pytest.mark.parametrize(("state", "code"), [("hearing", 0), ("not_hearing", 3)])
def test_the_health_check(run, config, state, code):
    """`doctor --running` is satisfied by a monitor that hears, and by no other."""
    path = config()
    monitor = Told(load([path]), state)
    monitor.start()
    try:
        exit_code, out, _ = run("doctor", "--running", "--config", path, "--json")
    finally:
        monitor.ended.set()
        monitor.join(10.0)
    assert exit_code == code
    answer = json.loads(out)
    assert answer["ok"] == (code == 0)
    assert "the reason" in answer["findings"][0]["found"]


def test_the_health_check_without_a_monitor(run, config):
    """Where nobody publishes the health check fails, and says where it has listened."""
    code, out, err = run("doctor", "--running", "--config", config())
    assert (code, err) == (3, "")
    assert out.startswith("WRONG  running monitor: no monitor has said anything")


def test_the_health_check_of_an_encrypted_monitor(tmp_path, run):
    """Where the publisher encrypts, the control socket is asked; an answer that stands still is none."""
    run("keys", "new", "server", "--directory", tmp_path)
    (tmp_path / "allowed").mkdir()
    keys = f'server_key = "{tmp_path}/server.key_secret"\nallowed_clients = "{tmp_path}/allowed"\n'
    path = tmp_path / "machine.toml"
    path.write_text(f'[publish]\n{keys}[control]\nbind = "ipc://{tmp_path}/control"\n')
    settings = load([path])
    with Control(settings.control.bind, machine="m", spindle=settings.spindle) as control:
        control.message(health())
        assert doctor.running(settings).state == "wrong"
        ended = threading.Event()

        def work():
            t = 1.0
            while not ended.wait(0.05):
                t += 1.0
                control.message(health(t=t))

        worker = threading.Thread(target=work)
        worker.start()
        found = doctor.running(settings)
        ended.set()
        worker.join()
    assert found.state == "ok"
    path.write_text(f"[publish]\n{keys}")
    assert "no control socket" in doctor.running(load([path])).found
