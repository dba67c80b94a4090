"""`chatter-monitor dashboard` as a user meets it: on a monitor, a recording, an event, a diagnosis, without rerun."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tests.replaying import REPLAY_DATA
from tests.rrd import Rrd

PROGRAM = [sys.executable, "-m", "chatter_monitor"]
WAIT_S = 200.0

# A module that is None in sys.modules cannot be imported: as if it were not installed.
WITHOUT_RERUN = (
    "import sys; sys.modules['rerun'] = None; sys.argv[0] = 'chatter-monitor'; "
    "from chatter_monitor.__main__ import main; main()"
)


@pytest.fixture(scope="module")
def excerpt(tmp_path_factory):
    """Six seconds around the onset of chatter."""
    samples, rate = soundfile.read(REPLAY_DATA / "bar_turning.flac")
    path = tmp_path_factory.mktemp("excerpt") / "onset.wav"
    soundfile.write(path, samples[5 * rate : 11 * rate], rate)
    return path


@pytest.fixture
def monitor_config(tmp_path):
    """Configuration with a free port; the port, too."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp://127.0.0.1:{probe.getsockname()[1]}"
    path = tmp_path / "machine.toml"
    path.write_text(f'[publish]\nbind = "{endpoint}"\n[spindle]\nspeed_rpm = 1685.0\n')
    return path


def states(rrd):
    """States of the lane, in their order."""
    return [state[0] for _, state in rrd.rows("/verdict/channel_0", "StateChange:state")]


def test_without_rerun_it_says_how_to_get_it():
    """Exit code 3 and one line with the command to install it, where rerun is missing."""
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_RERUN, "dashboard"], capture_output=True, text=True, timeout=WAIT_S
    )
    assert done.returncode == 3
    assert len(done.stderr.splitlines()) == 1
    assert "pip install 'chatter-monitor[dashboard]'" in done.stderr


def test_the_monitor_runs_without_rerun(excerpt, tmp_path):
    """A replay that publishes, writes and records works where rerun is missing."""
    outputs = ["--jsonl", tmp_path / "out.jsonl", "--record", tmp_path / "events", "--json"]
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_RERUN, "replay", excerpt, "--spindle-rpm", "1685", *outputs],
        capture_output=True,
        timeout=WAIT_S,
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["events"]


def test_the_program_does_not_load_rerun_for_anything_else(excerpt):
    """After a whole replay rerun has not been imported, although it is installed."""
    code = (
        "import sys; from chatter_monitor.config import load; from chatter_monitor.service.replay import Replay; "
        "from pathlib import Path; Replay(file=Path(sys.argv[1]), settings=load([])).run(as_json=True); "
        "import chatter_monitor.client, chatter_monitor.cli, chatter_monitor.service.daemon; "
        "sys.exit('rerun' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code, excerpt], check=True, capture_output=True, timeout=WAIT_S)


def test_a_running_monitor_is_drawn(excerpt, monitor_config, tmp_path):
    """The file that follows a replay at real time has its verdicts, at the wall time at which they were published."""
    path, jsonl = tmp_path / "live.rrd", tmp_path / "out.jsonl"
    began = time.time()
    with subprocess.Popen([*PROGRAM, "dashboard", "--config", monitor_config, "--save", path]) as dashboard:
        replay = [*PROGRAM, "replay", excerpt, "--config", monitor_config, "--pace", "real"]
        outputs = ["--publish", "--wait-subscriber", "30", "--jsonl", jsonl, "--json"]
        subprocess.run([*replay, *outputs], check=True, capture_output=True, timeout=WAIT_S)
        time.sleep(0.5)  # for the last messages to be drawn
        dashboard.send_signal(signal.SIGTERM)
        assert dashboard.wait(WAIT_S) == 0
    rrd = Rrd(path)
    said = [json.loads(line) for line in jsonl.read_text().splitlines()]
    verdicts = [message for message in said if message["type"] == "verdict"]
    assert "self_excited" in states(rrd)
    assert states(rrd)[-2] == verdicts[-1]["state"]
    times, frequency = rrd.series("/channel_0/frequency/verdict")
    assert began < times[0] < times[-1] < time.time()
    np.testing.assert_allclose(np.diff(times), 0.05, atol=1e-4)
    expected = [v["frequency_hz"] if v["frequency_hz"] is not None else np.nan for v in verdicts]
    np.testing.assert_allclose(frequency[:, 0], expected)
    assert len(rrd.series("/channel_0/waveform")[0]) == 1200  # the signal came over the socket, too
    assert any("/spectrogram/strip/" in entity for entity in rrd.entities)


@pytest.mark.slow
def test_the_monitor_does_not_notice_that_a_dashboard_is_killed(excerpt, monitor_config, tmp_path):
    """Killed and started again during a replay, dashboards draw; the replay says the same as without any."""
    alone, watched = tmp_path / "alone.jsonl", tmp_path / "watched.jsonl"
    replay = [*PROGRAM, "replay", excerpt, "--config", monitor_config, "--json"]
    subprocess.run([*replay, "--jsonl", alone], check=True, capture_output=True, timeout=WAIT_S)
    start = [*PROGRAM, "dashboard", "--config", monitor_config, "--save"]
    with subprocess.Popen([*start, tmp_path / "first.rrd"]) as first:
        options = ["--pace", "real", "--publish", "--wait-subscriber", "30", "--jsonl", watched]
        with subprocess.Popen([*replay, *options], stdout=subprocess.DEVNULL) as replaying:
            time.sleep(2.0)
            first.kill()
            with subprocess.Popen([*start, tmp_path / "second.rrd"]) as second:
                assert replaying.wait(WAIT_S) == 0
                time.sleep(0.5)
                second.terminate()
                assert second.wait(WAIT_S) == 0

    def verdicts(path):
        lines = [json.loads(line) for line in path.read_text().splitlines()]
        return [line for line in lines if line["type"] in ("verdict", "event", "odp")]

    assert verdicts(watched) == verdicts(alone)
    second_rrd = Rrd(tmp_path / "second.rrd")
    assert len(second_rrd.series("/channel_0/waveform")[0]) > 200


def test_a_recorded_event_is_shown_with_its_settings(excerpt, tmp_path, run):
    """`--event` finds the recording in the store and draws its chatter."""
    store = tmp_path / "events"
    code, _, errors = run("replay", excerpt, "--spindle-rpm", 1685, "--record", store, "--json")
    assert code == 0, errors
    [event] = [path.name for path in store.iterdir() if not path.name.startswith(".")]
    path = tmp_path / "event.rrd"
    code, _, errors = run("dashboard", "--event", event, "--directory", store, "--save", path)
    assert code == 0, errors
    assert "self_excited" in states(Rrd(path))


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["--recording", "absent.wav", "--save", "x.rrd"], 2, "absent.wav"),
        (["--recording", REPLAY_DATA / "bar_turning.flac", "--save", "absent/x.rrd"], 2, "absent/x.rrd"),
        (["--recording", REPLAY_DATA / "bar_turning.flac", "--no-viewer", "--memory-limit", "much"], 2, "much"),
        (["--event", "nobody", "--directory", "."], 2, "nobody"),
        (["--diagnosis", ".", "--save", "x.rrd"], 2, "diagnose --out"),
        (["--connect", "nonsense", "--save", "x.rrd"], 2, "nonsense"),
        (["--connect", "tcp://127.0.0.1:1", "--diagnosis", "."], 2, "one of"),
        (["--recording", REPLAY_DATA / "bar_turning.flac"], 3, "--save"),
    ],
)
def test_errors_speak(arguments, code, words, run, tmp_path, monkeypatch):
    """What cannot be shown ends with its exit code and says what was wrong."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    given, _, errors = run("dashboard", *arguments)
    assert given == code
    assert words in errors


def listening(port):
    """Addresses at which somebody listens to a port, as the kernel writes them: in hexadecimal, reversed."""
    lines = [line.split() for name in ("tcp", "tcp6") for line in Path("/proc/net", name).read_text().splitlines()[1:]]
    sockets = [(address.split(":"), state) for _, address, _, state, *_ in lines]
    return [host for (host, at), state in sockets if int(at, 16) == port and state == "0A"]


def test_viewers_are_served_on_the_loopback_only(excerpt):
    """While it serves, the port is open at 127.0.0.1 and at no other address, and SIGTERM ends it."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [*PROGRAM, "dashboard", "--recording", excerpt, "--no-viewer", "--port", str(port)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as dashboard:
        said = next(line for line in dashboard.stderr if line.startswith("showing"))
        assert f"rerun+http://127.0.0.1:{port}/proxy" in said
        assert listening(port) == ["0100007F"]
        with socket.create_connection(("127.0.0.1", port), 5.0):
            pass
        dashboard.terminate()
        assert dashboard.wait(WAIT_S) == 0


def children(process):
    """Processes that a process has started and that still run."""
    listed = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return [int(pid) for pid in listed]


def alive(pid):
    """Whether a process runs (and is not only remembered)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_a_viewer_ends_with_its_dashboard(tmp_path):
    """Terminated while it still replays, the dashboard takes the viewer that it has opened along."""
    command = [*PROGRAM, "dashboard", "--recording", REPLAY_DATA / "bar_turning.flac", "--browser"]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL, cwd=tmp_path) as dashboard:
        deadline = time.monotonic() + WAIT_S
        while not (started := children(dashboard)) and time.monotonic() < deadline:
            time.sleep(0.05)
        assert started
        dashboard.terminate()
        assert dashboard.wait(WAIT_S) == 0
        assert not any(alive(pid) for pid in started)
