"""The reports in a real browser: no complaint, no request to anybody, and nothing that sticks out at any width."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from PIL import Image

from chatter_monitor.service.reporting import report_event, report_shift
from tests.reports.conftest import entry, replayed  # noqa: F401  fixtures
from tests.system.components import need

pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]

OPTIONS = ["--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--allow-file-access-from-files"]
OPTIONS += ["--disable-background-networking", "--disable-component-update", "--no-first-run"]
WIDTHS = (390, 1280)
OWN = "not an origin"  # initiator of what the browser asks for itself

# A browser's window cannot be as narrow as a phone, but a frame in it can. What is wider than its frame sticks out.
FRAME = """<!doctype html><body style="margin:0"><iframe id=f src="{page}" width={width} height=2600 style="border:0"
onload="const d=this.contentDocument.documentElement;document.title=d.scrollWidth+' '+d.scrollHeight+' '+
[...this.contentDocument.images].every(i=>i.complete&&i.naturalWidth>0)"></iframe>"""


class Browser:
    """Opens pages, each time anew."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def _run(self, page: Path, *options: object) -> subprocess.CompletedProcess[str]:
        command = [
            "chromium",
            *OPTIONS,
            f"--user-data-dir={self._folder / 'profile'}",
            *map(str, options),
            page.as_uri(),
        ]
        return subprocess.run(command, capture_output=True, text=True, timeout=100, check=True)

    def complaints(self, page: Path) -> list[str]:
        """What the page says on the console."""
        done = self._run(page, "--enable-logging=stderr", "--virtual-time-budget=2000", "--dump-dom")
        return [line for line in done.stderr.splitlines() if "CONSOLE" in line]

    def hosts(self, page: Path) -> set[str]:
        """Hosts that the page, not the browser for its own ends, asks for anything."""
        log = self._folder / "net.json"
        self._run(page, f"--log-net-log={log}", "--virtual-time-budget=2000", "--dump-dom")
        requests = [event.get("params", {}) for event in json.loads(log.read_text())["events"]]
        urls = {r["url"] for r in requests if "url" in r and r.get("initiator", OWN) != OWN}
        return {urlsplit(url).hostname for url in urls if not url.startswith(("file:", "data:"))}

    def measured(self, page: Path, width: int) -> tuple[int, int, bool]:
        """Width and height that the page takes in a frame of a width, and whether all its pictures are there."""
        frame = self._framed(page, width)
        title = self._run(frame, "--virtual-time-budget=4000", "--dump-dom").stdout.split("<title>")[1].split("<")[0]
        wide, high, complete = title.split()
        return int(wide), int(high), complete == "true"

    def picture(self, page: Path, width: int, path: Path) -> np.ndarray:
        """Picture of the page in a frame of a width."""
        size = f"--window-size={max(width, 500)},2600"
        self._run(self._framed(page, width), size, f"--screenshot={path}")
        with Image.open(path) as picture:
            return np.asarray(picture.convert("RGB")).astype(int)[:, :width]

    def _framed(self, page: Path, width: int) -> Path:
        frame = self._folder / f"frame_{width}.html"
        frame.write_text(FRAME.format(page=page.as_uri(), width=width))
        return frame


@pytest.fixture
def browser(tmp_path):
    """Debian's chromium."""
    need(chromium="chromium")
    return Browser(tmp_path)


@pytest.fixture(scope="module")
def pages(replayed, entry, tmp_path_factory):  # noqa: F811
    """Both reports."""
    folder = tmp_path_factory.mktemp("pages")
    report_event(entry, folder / "event.html")
    report_shift(replayed / "bar.jsonl", folder / "shift.html")
    return [folder / "event.html", folder / "shift.html"]


def test_the_browser_notices(browser, tmp_path):
    """The checks below can fail: a script's error, a picture from elsewhere and a wide table are all noticed."""
    page = tmp_path / "bad.html"
    page.write_text(
        "<!doctype html><title>x</title><script>nonsense()</script><img src='http://example.invalid/x.png'>"
        "<div style='width:900px'>wide</div>"
    )
    assert any("nonsense is not defined" in line for line in browser.complaints(page))
    assert "example.invalid" in browser.hosts(page)
    wide, _, complete = browser.measured(page, 390)
    assert wide >= 900
    assert not complete


def test_nobody_is_asked_for_anything(pages, browser):
    """Opening a report leads to no console message and to no request over the network."""
    for page in pages:
        assert browser.complaints(page) == []
        assert browser.hosts(page) == set()


@pytest.mark.parametrize("width", WIDTHS)
def test_nothing_sticks_out(pages, browser, tmp_path, width):
    """On a phone and on a screen the page is as wide as the window, its pictures are shown and it is not blank."""
    for page in pages:
        wide, high, complete = browser.measured(page, width)
        assert wide <= width
        assert high > 600
        assert complete
        pixels = browser.picture(page, width, tmp_path / f"{page.stem}_{width}.png")
        dark = np.abs(pixels - 255).max(axis=2) > 60
        assert dark.mean() > 0.02
        inked = np.flatnonzero(dark.any(axis=0))
        assert inked[0] >= 8  # room on both sides
        assert inked[-1] <= width - 8
