"""The command line: exit codes and what stands on standard error."""

from __future__ import annotations

import json
import re
import socket
import subprocess
import sys

import numpy as np
import pytest
import soundfile

from tests.signals import vibration


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """One second of a stable cut."""
    path = tmp_path_factory.mktemp("recording") / "cut.wav"
    soundfile.write(path, 0.1 * vibration(12_800, [(400, 0.03)]), 12_800)
    return path


def start(*arguments):
    """Run a program in a process of its own."""
    return subprocess.run([sys.executable, *arguments], capture_output=True, text=True, timeout=200, check=False)


def refused(run, code, *arguments):
    """Run something that fails; returns its only line on standard error."""
    exit_code, out, err = run(*arguments)
    assert (exit_code, out) == (code, "")
    (line,) = err.splitlines()
    assert line.startswith("chatter-monitor: ")
    return line


def test_files_that_are_no_recording(run, tmp_path):
    """What cannot be heard is the user's input: exit 2 and a line with the reason and the path."""
    (tmp_path / "text.wav").write_text("this is no sound")
    (tmp_path / "empty.wav").touch()
    soundfile.write(tmp_path / "header.wav", np.zeros(0), 12_800)
    for name, reason in {
        "text.wav": "not a sound file",
        "absent.wav": "No such file",
        ".": "Is a directory",
        "empty.wav": "holds no samples",
        "header.wav": "holds no samples",
    }.items():
        line = refused(run, 2, "replay", tmp_path / name)
        assert reason in line
        assert str(tmp_path / name) in line


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--pace", "slow"], "'slow' is not one of 'fast', 'real'"),
        (["--spindle-rpm", "quick"], "'quick' is not a valid float"),
        (["--spindle-rpm", "-5"], "[spindle] speed_rpm"),
        (["--spindle-rpm", "inf"], "a finite number"),
        (["--teeth", "0"], "[spindle] teeth"),
        (["--wait-subscriber", "-1"], "-1.0 is not in the range"),
        (["--loud"], "No such option"),
    ],
)
def test_options_that_mean_nothing(run, recording, options, reason):
    """A value that no option takes is refused in one line, whoever checks it."""
    assert reason in refused(run, 2, "replay", recording, *options)


def test_no_such_command(run):
    """An unknown command, or none where one is needed, is the user's input."""
    assert "No such command 'listen'" in refused(run, 2, "listen")
    assert "Missing argument 'FILE...'" in refused(run, 2, "replay")


def test_bad_configuration(run, recording, tmp_path):
    """An unknown key ends the run with the file and the nearest key, before anything is written."""
    config = tmp_path / "machine.toml"
    config.write_text("[tracker]\nmemory = 80\n")
    line = refused(run, 2, "replay", recording, "--config", config, "--jsonl", tmp_path / "out.jsonl")
    assert str(config) in line
    assert "memory_ms" in line
    assert not (tmp_path / "out.jsonl").exists()


@pytest.mark.parametrize("option", ["--jsonl", "--odp"])
@pytest.mark.parametrize("path", ["absent/out", "."])
def test_outputs_that_cannot_be_written(run, recording, tmp_path, option, path):
    """A file that cannot be created is the user's input."""
    assert "cannot be written" in refused(run, 2, "replay", recording, option, tmp_path / path)


def test_a_full_disk_is_not_the_users_fault(run, recording):
    """A disk that fills up during the run is a fault of the environment: exit 3."""
    assert "No space left on device" in refused(run, 3, "replay", recording, "--jsonl", "/dev/full")


def test_a_port_in_use(run, recording, tmp_path):
    """A port that another program holds is a fault of the environment, told with a remedy; no part of a file stays."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        bind = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        config = tmp_path / "machine.toml"
        config.write_text(f'[publish]\nbind = "{bind}"\n')
        options = ["--publish", "--config", config, "--odp", tmp_path / "out.parquet"]
        line = refused(run, 3, "replay", recording, *options)
    assert bind in line
    assert "[publish] bind" in line
    assert list(tmp_path.iterdir()) == [config]


def test_debug_shows_where_an_error_comes_from(run, tmp_path):
    """With --debug the error itself comes through, for a traceback."""
    with pytest.raises(Exception, match="cannot be opened"):
        run("replay", tmp_path / "absent.wav", "--debug")


def test_a_bug_is_called_a_bug(run, recording, monkeypatch):
    """What nobody foresaw ends with exit 1 and two lines that say what to do."""

    def broken(*_, **__):
        raise ZeroDivisionError("somewhere")

    monkeypatch.setattr("chatter_monitor.service.replay.Replay.run", broken)
    code, _, err = run("replay", recording)
    assert code == 1
    assert err.splitlines() == [
        "chatter-monitor: this is a bug: ZeroDivisionError: somewhere",
        "Run the same command with --debug and report what it prints.",
    ]


def test_interrupting_is_no_bug(run, recording, monkeypatch):
    """Control-C ends the program like any other, without a message of ours."""

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("chatter_monitor.service.replay.Replay.run", interrupted)
    code, _, err = run("replay", recording)
    assert code == 130
    assert "bug" not in err


def test_json_summary(run, recording):
    """With --json standard output is one JSON object with the totals of the run, and standard error is silent."""
    code, out, err = run("replay", recording, "--json")
    summary = json.loads(out)
    assert (code, err) == (0, "")
    assert (summary["recording"], summary["duration_s"], summary["channels"]) == (str(recording), 1.0, 1)
    assert sum(summary["seconds_in"][0].values()) == pytest.approx(1.0)
    assert summary["seconds_in"][0]["stable"] > 0.9
    assert summary["events"] == []


def test_timeline_for_people(run, recording):
    """Without --json standard output is the timeline of the recording, and nothing stands on standard error."""
    code, out, err = run("replay", recording)
    assert (code, err) == (0, "")
    assert "stable" in out
    assert re.search(r"\d+ Hz +\d+\.\d\d ± \d+\.\d\d %", out)
    assert "1.0 s in all" in out


def test_options_reach_the_judge(run, tmp_path):
    """With the speed of the command line a tooth passing harmonic is forced and has its order, without it has none."""
    path = tmp_path / "line.wav"
    noise = np.random.default_rng(1).standard_normal(25_600)
    line = np.sin(2 * np.pi * 993.6 * np.arange(25_600) / 12_800)
    soundfile.write(path, 0.3 * line + 0.003 * noise, 12_800)
    orders = []
    for options in (["--spindle-rpm", "1656", "--teeth", "6"], []):
        _, summary, _ = run("replay", path, "--json", "--jsonl", tmp_path / "out.jsonl", *options)
        assert json.loads(summary)["events"] == []
        messages = map(json.loads, (tmp_path / "out.jsonl").read_text().splitlines())
        states, ordered = zip(*((m["state"], m["order"]) for m in messages if m["type"] == "verdict"), strict=True)
        assert states[-10:] == ("forced",) * 10
        orders.append(ordered[-1])
    assert orders == [pytest.approx(36.0, abs=0.05), None]


def test_help_lists_the_commands(run):
    """--help and -h list the commands."""
    for option in ("--help", "-h"):
        code, out, err = run(option)
        assert (code, err) == (0, "")
        assert "replay" in out
    code, out, _ = run("replay", "--help")
    assert code == 0
    assert "--jsonl" in out


def test_the_package_runs_as_a_module():
    """`python -m chatter_monitor` is the command line, with its exit codes."""
    done = start("-m", "chatter_monitor", "--version")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("chatter-monitor, version ")
    done = start("-m", "chatter_monitor", "replay", "absent.wav")
    assert done.returncode == 2
    assert done.stderr.startswith("chatter-monitor: the recording cannot be opened")


def test_help_is_quick():
    """Asking for help imports no numba, scipy, pyarrow or soundfile."""
    program = (
        "import sys\n"
        "sys.argv = ['chatter-monitor', 'replay', '--help']\n"
        "from chatter_monitor.__main__ import main\n"
        "main()\n"
        "print('loaded:', sorted({'numba', 'scipy', 'pyarrow', 'soundfile', 'zmq'} & set(sys.modules)))"
    )
    done = start("-c", program)
    assert (done.returncode, done.stderr) == (0, "")
    assert "--jsonl" in done.stdout
    assert done.stdout.splitlines()[-1] == "loaded: []"


def test_the_daemon_refuses_what_is_wrong_at_once(run, tmp_path):
    """A bad configuration is the user's input, a taken port a fault of the environment: said at once."""
    config = tmp_path / "machine.toml"
    config.write_text("[input]\ndevices = 1\n")
    assert "Did you mean 'device'?" in refused(run, 2, "run", "--config", config)
    with socket.create_server(("127.0.0.1", 0)) as server:
        config.write_text(f'[publish]\nbind = "tcp://127.0.0.1:{server.getsockname()[1]}"\n')
        assert "[publish] bind" in refused(run, 3, "run", "--config", config)
