"""The README keeps its promises."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import soundfile

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
PROGRAM = ".venv/bin/chatter-monitor"


def sh_lines() -> list[str]:
    """Lines of the README's shell blocks, without comments."""
    blocks = re.findall(r"```sh\n(.*?)```", README, flags=re.DOTALL)
    return [line.split("#")[0].strip() for block in blocks for line in block.splitlines() if line.split("#")[0].strip()]


def run(arguments: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "chatter_monitor", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=100)


def test_the_first_block_is_the_two_commands() -> None:
    """`make demo` and `make test` come first, and the Makefile sets everything up for them."""
    assert sh_lines()[:2] == ["make demo", "make test"]
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in ("demo", "test"):
        assert re.search(rf"^{target}: \$\(READY\)$", makefile, flags=re.MULTILINE)
    assert "pip install" in makefile.split("$(READY): ")[1]


def test_the_demo_prints_what_the_readme_shows() -> None:
    """The timeline in the README is the one that `make demo` prints; processors may differ in the last digits."""
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    command = re.search(r"^demo: .*\n\t\$\(BIN\)/chatter-monitor (.*)$", makefile, flags=re.MULTILINE)
    shown = re.search(r"<!-- output: make demo -->\n```\n(.*?)```", README, flags=re.DOTALL)
    assert command is not None
    assert shown is not None
    printed = run(shlex.split(command[1]), ROOT)
    assert printed.returncode == 0, printed.stderr
    number = re.compile(r"-?\d+\.?\d*")
    for line, expected in zip(printed.stdout.splitlines(), shown[1].splitlines(), strict=True):
        if "#" in expected:  # the lane
            assert set(line) == set(expected)
            continue
        assert number.sub("0", line).split() == number.sub("0", expected).split()
        values = [float(value) for value in number.findall(line)]
        assert values == pytest.approx([float(value) for value in number.findall(expected)], rel=0.05, abs=0.11)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    samples, rate = soundfile.read(ROOT / "replay_data" / "bar_turning.flac", stop=12800)
    soundfile.write(tmp_path / "cut.wav", samples, rate)
    (tmp_path / "config").symlink_to(ROOT / "config")
    return tmp_path


def test_every_command_of_the_readme_works(folder: Path) -> None:
    """The commands run as they stand, one after the other, in a folder with a recording."""
    commands = [line for line in sh_lines() if line.startswith(PROGRAM)]
    assert len(commands) >= 6
    for command in commands:
        done = run(shlex.split(command.removeprefix(PROGRAM)), folder)
        assert done.returncode == 0, f"{command}\n{done.stderr}"
        assert done.stdout
    assert {"out.jsonl", "out.parquet", "bar.wav", "bar.json", "bar"} <= {path.name for path in folder.iterdir()}


def test_links_lead_somewhere() -> None:
    """Every relative link of the README exists."""
    for target in re.findall(r"\]\((?!http)([^)#]+)\)", README):
        assert (ROOT / target).exists(), target
