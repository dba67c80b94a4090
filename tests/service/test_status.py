"""The sentence that says how it goes, and where it is shown."""

from __future__ import annotations

import contextlib
import io
import os
import pty
import re
import subprocess
import sys

import pytest
import soundfile
from rich.console import Console

from chatter_monitor.service.status import REFRESH_S, Status, StatusLine
from tests.messages import health, verdict
from tests.replaying import REPLAY_DATA

LINE = verdict(state="self_excited", frequency_hz=898.4, damping_ratio=0.0011)


def status(*messages):
    status = Status(lambda: "'mic' at 48 kHz")
    for message in messages:
        status.message(message)
    return status


def test_the_sentence():
    """It says whether the monitor hears and what, or why it does not; the newest message of each channel counts."""
    assert status().sentence() == "Waiting for 'mic' at 48 kHz."
    assert status(health()).sentence() == "Hearing 'mic' at 48 kHz."
    other = verdict(channel=1)
    assert status(other, verdict(), health(), LINE).sentence() == (
        "Hearing 'mic' at 48 kHz. channel 0: CHATTER, 898 Hz, damping 0.11 %; channel 1: stable."
    )
    undamped = verdict(state="self_excited", frequency_hz=898.0)
    assert status(undamped, health()).sentence().endswith("channel 0: CHATTER, 898 Hz.")
    wrong = health(reasons=["12 samples lost"])
    assert status(verdict(), wrong).sentence().endswith("channel 0: stable. Beware: 12 samples lost.")
    deaf = health(state="not_hearing", reasons=["nothing heard for 2.0 s: gone"])
    assert status(verdict(), deaf).sentence() == "NOT HEARING: nothing heard for 2.0 s: gone."


def test_the_colour_is_that_of_the_worst_news():
    """An alarm on one of the channels colours the line, and deafness does."""
    assert status(verdict(channel=1), LINE, health()).line().style == "bold red"
    assert status(LINE, verdict(channel=1, state="unknown"), health()).line().style == "bold red"
    assert status(verdict(), health()).line().style == "green"
    assert status(verdict(), health(state="not_hearing")).line().style == "magenta"


def shown(*, terminal):
    now = {"s": 0.0}
    out = io.StringIO()
    console = Console(file=out, force_terminal=terminal, width=100)
    one = status(verdict(), health())
    with StatusLine(one, console, clock=lambda: now["s"]) as line:
        line.refresh()
        one.message(LINE)
        line.refresh()  # too soon
        assert "CHATTER" not in out.getvalue()
        now["s"] += REFRESH_S
        line.refresh()
    return out.getvalue()


def test_the_line_is_on_terminals_only():
    """On a terminal the sentence is kept up to date a few times a second; elsewhere nothing is written."""
    assert "stable" in shown(terminal=True)
    assert "CHATTER" in shown(terminal=True)
    assert shown(terminal=False) == ""


@pytest.mark.parametrize("terminal", [True, False])
def test_a_replay_says_what_it_hears_on_a_terminal_only(tmp_path, terminal):
    """Where a person looks, the alarm stands in its colour beside the progress; into a pipe nothing is written."""
    excerpt = tmp_path / "onset.wav"
    samples, rate = soundfile.read(REPLAY_DATA / "bar_turning.flac")
    soundfile.write(excerpt, samples[6 * rate : 9 * rate], rate)
    seen, end = pty.openpty() if terminal else os.pipe()
    command = [sys.executable, "-m", "chatter_monitor", "replay", str(excerpt), "--json", "--pace", "real"]
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "140"}
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=end, env=environment) as process:
        os.close(end)
        said = b""
        with contextlib.suppress(OSError):  # how a terminal ends whose program has gone
            while piece := os.read(seen, 65536):
                said += piece
        assert process.wait(200) == 0
    os.close(seen)
    if terminal:
        assert re.search(rb"\x1b\[1;31m[^\x1b]*CHATTER, 3\d\d Hz", said)
    else:
        assert said == b""
