"""The documentation in a real browser: nobody is asked for anything, and nothing sticks out at any width."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.system.browser import WIDTHS, Browser
from tests.system.components import need
from tests.test_documentation import DOCS, build

pytestmark = [pytest.mark.system, pytest.mark.timeout(600)]

PAGES = ("mathematics", "configuration")  # formulas with their font, and the longest table


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built documentation."""
    out = tmp_path_factory.mktemp("documentation") / "pages"
    done = build(DOCS, out)
    assert done.returncode == 0, done.stderr
    return out


def test_nobody_is_asked_for_anything(pages: Path, tmp_path: Path) -> None:
    """Reading the pages leads to no console message and to no request over the network."""
    need(chromium="chromium")
    browser = Browser(tmp_path)
    for name in PAGES:
        assert browser.complaints(pages / f"{name}.html") == []
        assert browser.hosts(pages / f"{name}.html") == set()


@pytest.mark.parametrize("width", WIDTHS)
def test_nothing_sticks_out(pages: Path, tmp_path: Path, width: int) -> None:
    """On a phone and on a screen each page is as wide as the window and its pictures are there."""
    need(chromium="chromium")
    browser = Browser(tmp_path)
    for name in PAGES:
        wide, high, complete = browser.measured(pages / f"{name}.html", width)
        assert wide <= width, name
        assert high > 600
        assert complete
