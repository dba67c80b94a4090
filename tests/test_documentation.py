"""The pages of docs/: they build, and a link that leads nowhere fails the build."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from chatter_monitor.config import Settings
from docs import configuration

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"


def build(source: Path, out: Path) -> subprocess.CompletedProcess[str]:
    """Build pages as `make docs` does."""
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    recipe = re.search(r"\$\(BIN\)/python (-m sphinx .*) docs build/docs$", makefile, flags=re.MULTILINE)
    assert recipe is not None
    options = recipe[1].replace("build/doctrees", str(out.with_suffix(".doctrees"))).split()
    command = [sys.executable, *options, "-c", str(DOCS), str(source), str(out)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


def test_the_pages_build_without_a_warning(tmp_path: Path) -> None:
    """`make docs` builds every page, and no link leads nowhere."""
    done = build(DOCS, tmp_path / "pages")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    pages = {page.relative_to(tmp_path / "pages") for page in (tmp_path / "pages").rglob("*.html")}
    assert {page.relative_to(DOCS).with_suffix(".html") for page in DOCS.rglob("*.md")} <= pages
    assert "What you see" in (tmp_path / "pages" / "readme.html").read_text()


def test_the_reference_of_the_configuration_is_fresh() -> None:
    """docs/configuration.md is what `make docs` makes of the settings classes, and has every key."""
    written = configuration.PAGE.read_text(encoding="utf-8")
    assert written == configuration.page(), "run `make docs` and commit docs/configuration.md"
    for table in msgspec.structs.fields(Settings):
        section = written.split(f"## [{table.name}]")[1].split("## [")[0]
        for key in msgspec.to_builtins(getattr(Settings(), table.name)):
            assert f"`{key}`" in section


LINKS_TO_NOTHING = [
    "[x](nowhere.md)",
    "[x](index.md#nowhere)",
    "[x](#nowhere)",
    "[x](../config/nowhere.toml)",
    "![x](nowhere.png)",
]


@pytest.mark.parametrize("link", LINKS_TO_NOTHING)
def test_a_broken_link_fails_the_build(tmp_path: Path, link: str) -> None:
    """A page, a heading, a file or a picture that is not there ends the build with the link's name."""
    done = build_page(tmp_path, link)
    assert done.returncode != 0
    assert "nowhere" in done.stderr


def test_links_that_lead_somewhere_do_not_fail_it(tmp_path: Path) -> None:
    """A page of links to itself, to a heading and to a file builds."""
    done = build_page(tmp_path, "[this](index.md), [that](index.md#page), [it](#page), [file](conf.toml)")
    assert done.returncode == 0, done.stderr


def build_page(folder: Path, text: str) -> subprocess.CompletedProcess[str]:
    """Build documentation of one page beside one file."""
    (folder / "docs").mkdir()
    (folder / "docs" / "conf.toml").touch()
    (folder / "docs" / "index.md").write_text(f"# Page\n\n{text}\n")
    return build(folder / "docs", folder / "out")
