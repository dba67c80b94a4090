"""Examples in the pages: found, run as a reader would, and held to what the page shows.

A block marked ``sh`` is run, all blocks of a page in their order in one fresh directory; what cannot be run in a test
(as root, on a machine tool, for hours) stands in a block without a mark. A block without a mark that follows an ``sh``
or ``python`` block directly, or the comment ``<!-- output: COMMAND -->``, is what the block or the command prints.
"""

from __future__ import annotations

import itertools
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
from markdown_it import MarkdownIt

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]

OUTPUT_OF = re.compile(r"<!-- output: (.*) -->")
TIME_OF_DAY = re.compile(r"\d{4}-\d\d-\d\d[ T]\d\d:\d\d:\d\d")
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
LANE = re.compile(r"\s*[-?!#f.]{20,}\s")

# Nothing is set up anew, and the tests do not start themselves; else it is the project's Makefile that runs.
MAKE = """#!/bin/sh
if [ "$1" = test ]; then set -- --dry-run "$@"; fi
exec {make} --silent --no-print-directory -C {root} --old-file .venv/.ready BIN={programs} "$@"
"""
PROGRAM = """#!/bin/sh
exec {python} -m chatter_monitor "$@"
"""


class Block(NamedTuple):
    """A fenced block: the page's name, its line there, its mark, its text."""

    page: str
    line: int
    mark: str
    text: str


class Example(NamedTuple):
    """What to run, and what the page says that it prints; None where it says nothing."""

    block: Block
    shown: str | None


def blocks(page: Path) -> list[Block]:
    """Fenced blocks of a page, and its comments, whose mark is ``<!--``."""
    found = []
    for token in MarkdownIt().parse(page.read_text(encoding="utf-8")):
        if token.type in ("fence", "html_block", "heading_open", "paragraph_open"):
            mark = {"fence": token.info.strip(), "html_block": "<!--"}.get(token.type, "prose")
            found.append(Block(page.name, (token.map or [0])[0] + 1, mark, token.content))
    return found


def examples(page: Path) -> Iterator[Example]:
    """What a page has its reader run, with what it shows."""
    for block, following in itertools.pairwise([*blocks(page), Block(page.name, 0, "prose", "")]):
        printed = following.text if following.mark == "" else None
        if block.mark == "sh" or (block.mark == "python" and printed is not None):
            yield Example(block, printed)
        elif block.mark == "<!--" and (command := OUTPUT_OF.match(block.text)):
            assert printed is not None, f"{page.name}: nothing follows {block.text}"
            yield Example(block._replace(text=command[1] + "\n"), printed)


class Reader:
    """Somebody who types what stands in a page, in a directory with the project's recordings and machines.

    Parameters
    ----------
    folder : Path
        Fresh directory to work in.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        programs = folder / ".venv" / "bin"
        programs.mkdir(parents=True)
        for name, text in (("chatter-monitor", PROGRAM), ("make", MAKE)):
            (programs / name).write_text(
                text.format(python=sys.executable, make=shutil.which("make"), root=ROOT, programs=programs)
            )
            (programs / name).chmod(0o755)
        for name in ("replay_data", "config"):
            (folder / name).symlink_to(ROOT / name)
        self._environment = os.environ | {
            "PATH": f"{programs}:{os.environ['PATH']}",
            "PYTHONPATH": os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")])),
        }

    def run(self, text: str) -> str:
        """Run shell commands; they have to succeed. Returns what they print."""
        done = subprocess.run(
            ["bash", "-euo", "pipefail", "-c", text],
            cwd=self.folder,
            env=self._environment,
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
        assert done.returncode == 0, f"{text}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    def follow(self, page: Path) -> list[str]:
        """Run a page from its top and hold what comes to what it shows; returns what was run."""
        found = list(examples(page))
        alone = {example.block.text.strip() for example in found if example.block.mark == "<!--"}
        ran = []
        for block, shown in found:
            lines = block.text.splitlines()
            kept = [line for line in lines if block.mark == "<!--" or line.split("#")[0].strip() not in alone]
            text = "\n".join(kept)
            printed = self.run(
                f"{shlex.quote(sys.executable)} -c {shlex.quote(text)}" if block.mark == "python" else text
            )
            ran += kept
            if shown is not None:
                held_to(printed, shown, f"{block.page}, line {block.line}")
            for path in re.findall(r"--(?:out|save|jsonl|odp|record)[ =]([^\s#]+)", "\n".join(kept)):
                assert (self.folder / path).exists(), f"{block.page}, line {block.line}: no {path}"
        return ran


def held_to(printed: str, shown: str, where: str) -> None:
    """Fail unless a program printed what a page shows.

    Times of day may differ. Numbers may differ by 5 % or 0.11, as processors differ in the last digits and some of what
    is shown is a single digit; of a number like 1e-200 the exponent may. A lane of verdicts has the same signs. Words,
    names, and the number of lines may not differ, spaces may.
    """
    assert len(printed.splitlines()) == len(shown.splitlines()), f"{where}:\n{printed}"
    for line, expected in zip(printed.splitlines(), shown.splitlines(), strict=True):
        about = f"{where}: {line!r} where the page shows {expected!r}"
        if LANE.match(expected):
            assert set(line) == set(expected), about
            continue
        got, wanted = TIME_OF_DAY.sub("TIME", line), TIME_OF_DAY.sub("TIME", expected)
        assert NUMBER.sub("0", got).split() == NUMBER.sub("0", wanted).split(), about
        for one, other in zip(NUMBER.findall(got), NUMBER.findall(wanted), strict=True):
            if "e-" in other:
                one, other = one.partition("e")[2], other.partition("e")[2]
            assert float(one or "nan") == pytest.approx(float(other), rel=0.05, abs=0.11), about
