"""The container image: built by a real builder from the Dockerfile, and its program run as it would be."""

from __future__ import annotations

import json
import logging
import subprocess

import numpy as np
import pytest
import soundfile

from tests.system import debian
from tests.system.components import need, need_root

LOG = logging.getLogger(__name__)  # the image's size: pytest --log-cli-level=INFO

pytestmark = [pytest.mark.system, pytest.mark.timeout(1800)]

BASE = "localhost/debian:bookworm-slim"
IMAGE = "localhost/chatter-monitor:test"
RECORDING = debian.ROOT / "replay_data" / "bar_turning.flac"
TIMES = 2  # to be played one after the other: 40 s, in which a busy machine gets through a health check or two
# A port of this machine may be in use; a socket in the container is not.
CONFIGURED = '[publish]\nbind = "ipc:///var/lib/chatter-monitor/publish"\n'
OFFLINE = "[global]\nno-index = true\nfind-links = /wheels\n"


class Builder:
    """Buildah with a storage of its own."""

    def __init__(self, storage):
        self._command = ("buildah", "--root", storage / "root", "--runroot", storage / "run", "--storage-driver", "vfs")

    def __call__(self, *arguments):
        return debian.run(*self._command, *arguments, timeout_s=1800).strip()

    def start(self, *arguments):
        """Begin something that takes its time."""
        command = list(map(str, (*self._command, *arguments)))
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


@pytest.fixture(scope="module")
def buildah(tmp_path_factory):
    """The builder, with the image built on a Debian that stands in for the public one."""
    need(buildah="buildah", debootstrap="debootstrap")
    need_root()
    storage = tmp_path_factory.mktemp("storage")
    buildah = Builder(storage)
    base = buildah("from", "scratch")
    buildah("add", "--quiet", base, debian.base(), "/")
    buildah("commit", "--quiet", "--rm", base, BASE)
    (storage / "pip.conf").write_text(OFFLINE)
    volumes = ("-v", f"{storage / 'pip.conf'}:/etc/pip.conf:ro", "-v", f"{debian.wheels()}:/wheels:ro")
    isolation = ("--isolation", "chroot", "--network", "host", "--format", "docker", "--pull-never")
    buildah("bud", "--quiet", *isolation, *volumes, "-t", IMAGE, debian.ROOT)
    LOG.info("%s", buildah("images"))
    yield buildah
    buildah("rm", "--all")
    buildah("rmi", "--all", "--force")  # gigabytes


@pytest.fixture(scope="module")
def container(buildah, tmp_path_factory):
    """Run a command in a container, as `docker run` and `docker exec` with a configuration and a recording would."""
    name = buildah("from", "--pull-never", IMAGE)
    folder = tmp_path_factory.mktemp("container")
    (folder / "machine.toml").write_text(CONFIGURED)
    samples, rate_hz = soundfile.read(RECORDING, dtype="int16")
    soundfile.write(folder / "cut.wav", np.tile(samples, TIMES), rate_hz)
    files = {"machine.toml": "/etc/chatter-monitor/machine.toml", "cut.wav": "/data/cut.wav"}
    volumes = [word for name, place in files.items() for word in ("-v", f"{folder / name}:{place}:ro")]

    def run(*command):
        return buildah.start("run", "--isolation", "chroot", *volumes, name, "--", *command)

    return run


def about(buildah):
    """The image's configuration, as Docker reads it."""
    return json.loads(buildah("inspect", "--type", "image", IMAGE))["Docker"]["config"]


def outcome(process, timeout_s=60):
    """Exit code and words. On a busy machine the builder loses words now and then, so codes decide."""
    printed, _ = process.communicate(timeout=timeout_s)
    return process.returncode, printed


def health(buildah, container):
    """Exit code and words of the image's own health check."""
    kind, *command = about(buildah)["Healthcheck"]["Test"]
    assert kind == "CMD"
    return outcome(container(*command))


def test_the_image_runs_the_daemon_as_somebody_unprivileged(buildah, container):
    """Without arguments it is the daemon with the configuration; the user is not root and cannot change the program."""
    config = about(buildah)
    assert config["Entrypoint"] + config["Cmd"] == [
        *("chatter-monitor", "run", "--config", "/etc/chatter-monitor/machine.toml")
    ]
    own = "test $(id -u) -gt 0 && test -w /var/lib/chatter-monitor && ! test -w /opt/chatter-monitor"
    assert outcome(container("sh", "-c", own))[0] == 0


def test_the_image_holds_little_but_what_runs(container):
    """Neither compiler nor pip, package lists or the source stay in it, and it has less than 1.2 GB."""
    gone = "/usr/bin/gcc /src /var/lib/apt/lists/* /opt/chatter-monitor/bin/pip*"
    assert outcome(container("sh", "-c", f'test -z "$(ls -d {gone} 2>/dev/null)"'))[0] == 0
    assert outcome(container("sh", "-c", "test $(du -smx / 2>/dev/null | cut -f1) -lt 1200"))[0] == 0


def test_a_replay_in_the_container_passes_the_health_check(buildah, container):
    """The health check passes while a recording is replayed, paced and published, and neither before nor after."""
    assert health(buildah, container)[0] == 3
    config = ("--config", "/etc/chatter-monitor/machine.toml")
    command = ("chatter-monitor", "replay", "/data/cut.wav", "--pace", "real", "--publish", *config)
    replay = container("sh", "-c", f"{' '.join(command)} > timeline && grep -q CHATTER timeline")
    while (checked := health(buildah, container))[0] != 0:
        assert replay.poll() is None, (checked, outcome(replay))
    assert outcome(replay)[0] == 0
    assert health(buildah, container)[0] == 3


def test_a_daemon_without_a_sound_card_is_unhealthy(buildah, container):
    """Without a card the daemon runs on, its health check says that it does not hear, and SIGTERM ends it cleanly."""
    config = about(buildah)
    daemon = container("timeout", "--preserve-status", "40", *config["Entrypoint"], *config["Cmd"])
    while "does not hear" not in (checked := health(buildah, container))[1]:
        assert daemon.poll() is None, (checked, outcome(daemon))
    assert checked[0] == 3
    assert outcome(daemon)[0] == 0
