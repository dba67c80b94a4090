"""Every example in the README and in docs/ works as it stands."""

from __future__ import annotations

import shlex
import socket
import subprocess
import sys
from pathlib import Path

import pytest
import soundfile

from chatter_monitor.config import load
from chatter_monitor.outlets.wire import DEFAULT_ENDPOINT
from chatter_monitor.physics.model_file import read_model
from tests.pages import PAGES, ROOT, Block, Reader, blocks, examples, held_to

README = ROOT / "README.md"
TUTORIAL = ROOT / "docs" / "tutorial.md"

# Marks, and the test that holds blocks with them. What is not marked is output, or cannot be run in a test.
MARKS = {
    "sh": "below",
    "toml": "below",
    "python": "below; those in ELSEWHERE in tests/outlets/test_control.py and tests/service/archive/test_replaying.py",
    "yaml": "the schema of control.md, in tests/outlets/test_control.py",
    "ini": "drop-ins of the service, in tests/system/test_systemd.py",
}
ELSEWHERE = ("control.md", "archives.md")  # programs that need more than a monitor that publishes
CALCULATES = ROOT / "docs" / "mathematics.md"
LISTENERS = [block for page in PAGES if page.name not in ELSEWHERE and page != CALCULATES for block in blocks(page)]
ALL = [block for page in PAGES for block in blocks(page) if block.mark not in ("prose", "<!--")]


def marked(mark: str) -> list[Block]:
    return [block for block in ALL if block.mark == mark]


def named(block: Block) -> str:
    return f"{block.page}:{block.line}"


def test_every_block_is_of_a_kind_that_some_test_runs() -> None:
    """Nobody marks a block with a language that no test looks at."""
    directives = [block for block in ALL if block.mark.startswith("{")]
    assert {block.mark for block in ALL if block.mark and block not in directives} == set(MARKS)
    assert {named(block).split(":")[0] for block in marked("sh")} == {
        "README.md",
        "tutorial.md",
        "subscribing.md",
        "diagnose.md",
    }


@pytest.mark.timeout(900)
def test_the_readme_keeps_its_promises(tmp_path: Path) -> None:
    """The README's commands work in their order on a recording `cut.wav`, and print what it shows."""
    samples, rate = soundfile.read(ROOT / "replay_data" / "bar_turning.flac", stop=12800)
    soundfile.write(tmp_path / "cut.wav", samples, rate)
    ran = Reader(tmp_path).follow(README)
    assert ran[0].startswith("make test")  # which sets everything up; `make demo` has a place of its own
    assert "make demo" in ran
    assert len(ran) > 10


@pytest.mark.timeout(900)
def test_the_tutorial_gives_what_it_says(tmp_path: Path) -> None:
    """Whoever types the tutorial from its top gets what it shows."""
    ran = "\n".join(Reader(tmp_path).follow(TUTORIAL))
    for step in ("make setup", "replay", "events report", "diagnose"):
        assert step in ran
    assert (tmp_path / "out/event.html").stat().st_size > 10_000
    assert (tmp_path / "out/diagnosis/report.html").stat().st_size > 10_000


@pytest.mark.timeout(900)
def test_the_worked_example_of_a_diagnosis_gives_what_it_says(tmp_path: Path) -> None:
    """The commands of docs/diagnose.md name the hidden effect, and print what the page shows."""
    ran = "\n".join(Reader(tmp_path).follow(ROOT / "docs" / "diagnose.md"))
    assert "simulate" in ran
    assert "diagnose" in ran
    assert (tmp_path / "out/diagnosis/model.toml").read_text(encoding="utf-8").count("clearance") == 1


def test_the_certificates_of_the_page_are_made(tmp_path: Path) -> None:
    """The commands of docs/subscribing.md make both certificates, and put the client on the list."""
    Reader(tmp_path).follow(ROOT / "docs" / "subscribing.md")
    assert (tmp_path / "out/keys/allowed/logger.key").exists()
    assert (tmp_path / "out/keys/server.key_secret").exists()


def test_the_mathematics_calculates_what_it_shows(tmp_path: Path) -> None:
    """The printed equation (24) gives what the page says of it, and so does the corrected one."""
    assert len(Reader(tmp_path).follow(CALCULATES)) > 10


def test_the_readme_begins_with_the_two_commands() -> None:
    """`make demo` and `make test` come first, and set everything up."""
    first, *_ = examples(README)
    assert [shlex.split(line, comments=True) for line in first.block.text.splitlines()] == [
        ["make", "demo"],
        ["make", "test"],
    ]
    recipes = subprocess.run(
        ["make", "--dry-run", "--always-make", "demo", "test"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    setup, demo = recipes.stdout.index("pip install"), recipes.stdout.index("chatter-monitor replay")
    assert setup < demo < recipes.stdout.index("-m pytest")


@pytest.mark.parametrize("block", marked("toml"), ids=named)
def test_every_configuration_can_be_loaded(tmp_path: Path, block: Block) -> None:
    """A TOML block is a machine configuration, or a model where it has a mode."""
    file = tmp_path / "example.toml"
    file.write_text(block.text)
    if "[[mode]]" in block.text:
        read_model(file)
    else:
        load([file])


@pytest.mark.timeout(900)  # kernels may have to be compiled first
@pytest.mark.parametrize("block", [block for block in LISTENERS if block.mark == "python"], ids=named)
def test_every_program_hears_a_replay(tmp_path: Path, block: Block) -> None:
    """A Python block runs as it stands, but for the port, and prints something while a recording is replayed."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = f"tcp://127.0.0.1:{taken.getsockname()[1]}"
    config = tmp_path / "machine.toml"
    config.write_text(f'[publish]\nbind = "{endpoint}"\n')
    code = block.text.replace(DEFAULT_ENDPOINT, endpoint).replace(
        "Subscriber(topics", f'Subscriber("{endpoint}", topics'
    )
    recording = ROOT / "replay_data" / "stable_turning.flac"
    replay = ["replay", str(recording), "--config", str(config), "--publish", "--wait-subscriber", "60"]
    reader = subprocess.Popen([sys.executable, "-u", "-c", code], stdout=subprocess.PIPE, text=True)
    monitor = subprocess.Popen([sys.executable, "-m", "chatter_monitor", *replay], stdout=subprocess.DEVNULL)
    try:
        assert reader.stdout is not None
        assert reader.stdout.readline() != ""
    finally:
        for process in (monitor, reader):
            process.kill()
            process.wait()
        reader.stdout.close()


@pytest.mark.parametrize(
    "printed",
    [
        "Chatter at 400 Hz\n  --------------------##\np = 1e-100\n",
        "chatter at 327 Hz\n  --------------------##\np = 1e-100\n",
        "Chatter at 327 Hz\n  ----------------------\np = 1e-100\n",
        "Chatter at 327 Hz\n  --------------------##\np = 1e-2\n",
        "Chatter at 327 Hz\n  --------------------##\n",
    ],
)
def test_what_differs_is_noticed(printed: str) -> None:
    """Another number, word, sign in the lane, order of magnitude, or a line less is no longer what the page shows."""
    shown = "Chatter at 327 Hz\n  --------------------##\np = 2e-100\n"
    held_to("Chatter at 328 Hz\n --------------------## \np = 1e-100\n", shown, "here")
    with pytest.raises(AssertionError, match="here"):
        held_to(printed, shown, "here")
