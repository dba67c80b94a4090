"""The service as `make install-service` leaves it, on a machine that boots: real systemd, real sound server."""

from __future__ import annotations

import json
import re
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import soundfile
import soxr

from tests.system import debian
from tests.system.components import need, need_root
from tests.system.machine import Machine

pytestmark = [pytest.mark.system, pytest.mark.timeout(900)]

UNIT = "chatter-monitor"
UNIT_FILE = debian.ROOT / "config" / "chatter-monitor.service"
PROGRAM = "/opt/chatter-monitor/bin/chatter-monitor"
CONFIG = "/etc/chatter-monitor/machine.toml"
PACKAGES = ("systemd-sysv", "dbus", "make", "python3", "pulseaudio", "pulseaudio-utils", "libasound2-plugins")
GIVE_UP_S, WATCHDOG_S = 3, 5

CONFIGURED = f"""
[machine]
name = "lathe-3"
[input]
give_up_s = {GIVE_UP_S}
[control]
bind = "ipc:///run/chatter-monitor/control"
[metrics]
bind = "127.0.0.1:9464"
"""

# Sooner than the unit says, for the tests; what they show does not depend on it.
DROP_IN = f"[Service]\nWatchdogSec={WATCHDOG_S}\nRestartSec=1\n"

SOUND_SERVER = """
[Service]
User=pulse
RuntimeDirectory=sound
Environment=HOME=/run/sound XDG_RUNTIME_DIR=/run/sound
ExecStart=/usr/bin/pulseaudio -n --daemonize=no --exit-idle-time=-1 --use-pid-file=no \
 -L "module-native-protocol-tcp listen=127.0.0.1 auth-anonymous=1" \
 -L "module-null-sink sink_name=cm rate=48000 channels=2 format=float32le norewinds=1" -L module-always-sink
Restart=always
[Install]
WantedBy=multi-user.target
"""
PLAYER = """
[Service]
ExecStart=/bin/sh -c 'while sleep 0.1; do paplay --server=tcp:127.0.0.1 --device=cm /srv/cut.wav; done'
[Install]
WantedBy=multi-user.target
"""
ASOUND = 'pcm.!default { type pulse server "tcp:127.0.0.1" device "cm.monitor" }\n'


def cut(path: Path) -> None:
    """The demonstration as the sound server plays it, over and over.

    Eleven seconds are stable between one chatter and the next: whoever begins to listen in the midst of it, where it
    cannot be told from a forced line, sees the next one grow.
    """
    samples, rate_hz = soundfile.read(debian.ROOT / "replay_data" / "bar_turning.flac")
    played = soxr.resample(samples, rate_hz, 48_000)
    soundfile.write(path, np.stack([played, played], axis=1), 48_000, subtype="FLOAT")


def install(tree: Path) -> str:
    """Run `make install-service` in a tree."""
    source, wheels = debian.put_source(tree), debian.wheels()
    return debian.inside(
        tree,
        *("make", "--silent", "-C", str(source), "install-service"),
        environment={"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(wheels), "DEBIAN_FRONTEND": "noninteractive"},
        read_only=(wheels,),
    )


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """A machine with a sound server, and the service installed and configured, not booted."""
    need(systemd_nspawn="systemd-container", debootstrap="debootstrap", nsenter="util-linux")
    need_root()
    tree = tmp_path_factory.mktemp("machine") / "root"
    debian.copy(debian.with_packages(*PACKAGES), tree)
    assert "systemctl enable --now chatter-monitor" in install(tree)
    cut(tree / "srv" / "cut.wav")
    (tree / "etc/asound.conf").write_text(ASOUND)
    (tree / CONFIG[1:]).write_text(CONFIGURED)
    for name, text in (("sound-server", SOUND_SERVER), ("player", PLAYER)):
        (tree / f"etc/systemd/system/{name}.service").write_text(text)
    drop_ins = tree / f"etc/systemd/system/{UNIT}.service.d"
    drop_ins.mkdir()
    (drop_ins / "test.conf").write_text(DROP_IN)
    return tree


@pytest.fixture(scope="module")
def machine(tree, tmp_path_factory):
    """The machine, booted, with the sound server playing."""
    with Machine(tree, tmp_path_factory.mktemp("console") / "log") as machine:
        machine.run("systemctl", "enable", "--now", "sound-server", "player")
        yield machine


@pytest.fixture
def running(machine):
    """The machine with the service started anew; after a failed test its journal is in the report."""
    machine.run("systemctl", "restart", UNIT)
    yield machine
    sys.stdout.write(machine.journal(UNIT)[-6000:])


LISTEN = ("/opt/chatter-monitor/bin/python", "/usr/src/chatter-monitor/tests/system/listen.py")


def listen(machine, seconds, state="none", *keys):
    """Verdicts that a subscriber on the machine receives."""
    return json.loads(machine.run(*LISTEN, str(seconds), state, *keys).splitlines()[-1])


def wait_for(condition, timeout_s):
    """Seconds until a condition holds."""
    began = time.monotonic()
    while not condition():
        assert time.monotonic() - began < timeout_s, f"not within {timeout_s} s"
        time.sleep(0.1)
    return time.monotonic() - began


def send(machine, signal, pid):
    """Send a signal to a process of the machine, which has no kill but the shell's."""
    machine.run("sh", "-c", f"kill -{signal} {pid}")


def main_pid(machine):
    return machine.show(UNIT, "MainPID")["MainPID"]


def restarts(machine):
    return int(machine.show(UNIT, "NRestarts")["NRestarts"])


def test_the_unit_exposes_little():
    """`systemd-analyze security` finds at most 2.0, and `verify` nothing but that the program is not installed here."""
    need(systemd_analyze="systemd")
    analyze = ("systemd-analyze", "--no-pager")
    exposed = debian.run(*analyze, "security", "--offline=true", "--threshold=20", UNIT_FILE)
    level = re.search(r"exposure level for .*: ([\d.]+)", exposed)
    assert level is not None
    assert float(level[1]) <= 2.0


def test_a_second_installation_keeps_the_configuration(tree):
    """Installing again over an installed service succeeds and leaves an edited configuration as it is."""
    before = (tree / CONFIG[1:]).stat()
    install(tree)
    after = (tree / CONFIG[1:]).stat()
    assert (tree / CONFIG[1:]).read_text() == CONFIGURED
    assert (after.st_mtime_ns, after.st_mode) == (before.st_mtime_ns, before.st_mode)
    example = (tree / "etc/chatter-monitor/machine.toml.example").read_text()
    assert example == (debian.ROOT / "config/machine.toml").read_text()


def test_what_is_installed_is_in_order(machine):
    """The unit verifies without a word, and neither program nor configuration can be changed by the service's user."""
    assert machine.run("systemd-analyze", "verify", f"/etc/systemd/system/{UNIT}.service") == ""
    writable = machine.run(
        *(
            "runuser",
            "-u",
            "chatter-monitor",
            "--",
            "find",
            "/opt/chatter-monitor",
            "/etc/chatter-monitor",
            "/etc/systemd",
        ),
        *("-writable", "-not", "-type", "l"),
    )
    assert writable == ""


def test_ready_means_that_verdicts_come(running):
    """`systemctl start` returns when samples are tracked; a subscriber then gets verdicts at once, and the chatter."""
    assert running.show(UNIT, "ActiveState", "SubState", "NRestarts") == {
        "ActiveState": "active",
        "SubState": "running",
        "NRestarts": "0",
    }
    received = listen(running, 45, "self_excited")
    assert received["first_s"] < 1.5
    assert received["states"][-1] == "self_excited"
    assert received["frequency_hz"] == pytest.approx(327, abs=3)
    assert sum(received["lost"].values()) == 0
    status = running.show(UNIT, "StatusText")["StatusText"]
    assert status.startswith("Hearing 'default' at ")


def test_health_check_and_metrics_answer(running):
    """`doctor --running` says that it hears; Prometheus finds samples that are younger than a second."""
    assert "it hears" in running.run(PROGRAM, "doctor", "--running", "--config", CONFIG)
    fetch = "import urllib.request as r; print(r.urlopen('http://127.0.0.1:9464/metrics').read().decode())"
    metrics = running.run("python3", "-c", fetch)
    age = re.search(r"^chatter_monitor_last_sample_age_seconds (\S+)$", metrics, re.MULTILINE)
    assert age is not None
    assert float(age[1]) < 1.0
    assert 'chatter_monitor_health_state{state="hearing"} 1.0' in metrics


def test_the_process_is_confined(running):
    """No capability, no new privileges, system calls filtered; the system is read-only but for its own directories."""
    status = running.run("cat", f"/proc/{main_pid(running)}/status")
    fields = dict(line.split(":\t", 1) for line in status.splitlines() if ":\t" in line)
    assert int(fields["CapEff"], 16) == int(fields["CapBnd"], 16) == 0
    assert fields["NoNewPrivs"] == "1"
    assert fields["Seccomp"] == "2"
    assert fields["Uid"].split()[1] == running.run("id", "-u", "chatter-monitor").strip()
    mounts = running.run("cat", f"/proc/{main_pid(running)}/mounts").splitlines()
    options = {line.split()[1]: line.split()[3].split(",") for line in mounts}
    assert "ro" in options["/"]
    for own in ("/var/lib/chatter-monitor", "/var/cache/chatter-monitor", "/run/chatter-monitor"):
        assert "rw" in options[own]
    assert int(fields["VmHWM"].split()[0]) < 500_000  # kB: half of MemoryMax at most


def test_groups_of_sound_cards_are_reached(machine):
    """What only root and the group audio may read, the sandbox of the unit can: its user namespace keeps the group."""
    machine.put("/srv/card", "heard")
    machine.run("chown", "root:audio", "/srv/card")
    machine.run("chmod", "0640", "/srv/card")
    sandbox = [
        line
        for line in UNIT_FILE.read_text().splitlines()
        if re.match("(User|Group|Supple|PrivateU|Capab|Protect)", line)
    ]
    properties = [f"--property={line}" for line in sandbox]
    run = ("systemd-run", "--quiet", "--pipe", "--wait")
    assert machine.run(*run, *properties, "cat", "/srv/card").strip() == "heard"
    without = [line for line in properties if "audio" not in line]
    assert "denied" in machine.run(*run, *without, "cat", "/srv/card", check=False)


def test_a_hanging_daemon_is_replaced(running):
    """The watchdog kills a daemon that stands still and starts it again; verdicts come again, the journal tells."""
    before, count = main_pid(running), restarts(running)
    send(running, "STOP", before)
    wait_for(lambda: restarts(running) > count, WATCHDOG_S + 10)
    wait_for(lambda: running.show(UNIT, "SubState")["SubState"] == "running", 30)
    assert main_pid(running) != before
    assert listen(running, 5)["states"]
    journal = running.journal(UNIT)
    for told in (f"Watchdog timeout (limit {WATCHDOG_S}s)", "Scheduled restart job", "Started "):
        assert told in journal


def test_deaf_beyond_healing_is_restarted(running):
    """With a sound server that stays frozen the daemon says so and is replaced; it hears when the server is back."""
    count, server = restarts(running), running.show("sound-server", "MainPID")["MainPID"]
    subscriber = running.start(*LISTEN, "12", "none")
    assert subscriber.stdout is not None
    assert subscriber.stdout.readline() == "listening\n"
    send(running, "STOP", server)
    try:
        wait_for(lambda: "NOT HEARING" in running.show(UNIT, "StatusText")["StatusText"], GIVE_UP_S)
        wait_for(lambda: restarts(running) > count, GIVE_UP_S + WATCHDOG_S + 15)
        assert running.show(UNIT, "SubState")["SubState"] != "running"  # ready is who hears
        printed, _ = subscriber.communicate(timeout=200)
        states = json.loads(printed)["states"]
        assert states.count("unknown") > 20 * (GIVE_UP_S - 1)  # 20 in a second
        assert states[-1] == "unknown"
    finally:
        send(running, "CONT", server)
    wait_for(lambda: running.show(UNIT, "SubState")["SubState"] == "running", 30)
    assert listen(running, 45, "self_excited")["states"][-1] == "self_excited"
    journal = running.journal(UNIT)
    assert re.search(r"frozen: it delivers nothing(.|\n)*Watchdog timeout(.|\n)*Started", journal)


def test_stopping_is_clean_and_quick(running):
    """`systemctl stop` takes less than 2 s, ends with success, and leaves no process; the journal tells it."""
    began = time.monotonic()
    running.run("systemctl", "stop", UNIT)
    assert time.monotonic() - began < 2.0
    assert running.show(UNIT, "Result", "ExecMainStatus", "ActiveState") == {
        "Result": "success",
        "ExecMainStatus": "0",
        "ActiveState": "inactive",
    }
    assert "stopping on SIGTERM" in running.journal(UNIT)


def test_reloading_takes_a_good_configuration_and_refuses_a_bad_one(running):
    """`systemctl reload` keeps the process; an unknown key is told in the journal and the old settings stay."""
    before = main_pid(running)
    try:
        running.put(CONFIG, CONFIGURED + "[verdict]\ncertainty = 0.95\n")
        running.run("systemctl", "reload", UNIT)
        wait_for(lambda: "configuration read again; changed: [verdict]" in running.journal(UNIT), 5)
        running.put(CONFIG, CONFIGURED + "[verdict]\ncertain = 0.95\n")
        running.run("systemctl", "reload", UNIT)
        wait_for(lambda: "Did you mean 'certainty'?" in running.journal(UNIT), 5)
    finally:
        running.put(CONFIG, CONFIGURED)
    assert main_pid(running) == before
    assert listen(running, 2)["states"]


def test_a_wrong_configuration_does_not_loop(machine):
    """With a configuration that is wrong the service fails once, with the remedy in the journal, and stays down."""
    try:
        machine.put(CONFIG, "[metrics]\nbind = '0.0.0.0:9464'\n")
        machine.run("systemctl", "restart", UNIT, check=False)
        assert machine.show(UNIT, "ActiveState", "ExecMainStatus") == {"ActiveState": "failed", "ExecMainStatus": "2"}
        assert "refused on the network" in machine.journal(UNIT)
    finally:
        machine.put(CONFIG, CONFIGURED)
        machine.run("systemctl", "reset-failed", UNIT)


def test_real_time_scheduling_is_possible(running):
    """With the drop-in that the document gives, every thread of the monitor runs ahead of ordinary ones."""
    document = (debian.ROOT / "docs/service.md").read_text()
    drop_in = re.search(r"```ini\n(\[Service\]\nCPUSched.*?)```", document, re.DOTALL)
    assert drop_in is not None
    place = f"/etc/systemd/system/{UNIT}.service.d/real-time.conf"
    try:
        running.put(place, drop_in[1])
        running.run("systemctl", "daemon-reload")
        running.run("systemctl", "restart", UNIT)
        threads = f"/proc/{main_pid(running)}/task"
        ask = (
            f"import os; print({{os.sched_getscheduler(int(t)) for t in os.listdir('{threads}')}} == {{os.SCHED_FIFO}})"
        )
        assert running.run("python3", "-c", ask).strip() == "True"
        assert listen(running, 2)["states"]
    finally:
        running.run("rm", "-f", place)
        running.run("systemctl", "daemon-reload")


def test_root_keeps_the_secret_certificate(running):
    """The monitor encrypts with a certificate that only root can read: allowed clients hear verdicts, no others do."""
    keys = "/etc/chatter-monitor/keys"
    running.run(PROGRAM, "keys", "new", "server", "--directory", keys)
    running.run(PROGRAM, "keys", "new", "client", "--directory", "/root/keys")
    running.run(PROGRAM, "keys", "allow", "/root/keys/client.key", "--directory", keys)
    encrypted = f"""[publish]
server_key = "/run/credentials/{UNIT}.service/server.key_secret"
allowed_clients = "{keys}/allowed"
"""
    try:
        running.put(CONFIG, CONFIGURED + encrypted)
        running.run("systemctl", "restart", UNIT)
        assert listen(running, 3, "none", f"{keys}/server.key", "/root/keys/client.key_secret")["states"]
        assert not listen(running, 2)["states"]
        assert "it hears" in running.run(PROGRAM, "doctor", "--running", "--config", CONFIG)
    finally:
        running.put(CONFIG, CONFIGURED)
