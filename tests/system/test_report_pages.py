"""The reports in a real browser: no complaint, no request to anybody, and nothing that sticks out at any width."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.reports.archive import archive_page
from chatter_monitor.service.diagnosing import diagnose_file
from chatter_monitor.service.modelling import simulate_to_file
from chatter_monitor.service.reporting import report_event, report_shift
from tests.reports.conftest import entry, replayed  # noqa: F401  fixtures
from tests.reports.test_archive import BROKEN, DONE
from tests.system.browser import WIDTHS, Browser
from tests.system.components import need

pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]

MODEL = '[sensor]\nquantity = "velocity"\n[[mode]]\nfrequency_hz = 412.0\ndamping_ratio = 0.02\n'


@pytest.fixture
def browser(tmp_path):
    """Debian's chromium."""
    need(chromium="chromium")
    return Browser(tmp_path)


@pytest.fixture(scope="module")
def pages(replayed, entry, tmp_path_factory):  # noqa: F811
    """Reports of an event, of a shift, of a diagnosis and of an archive."""
    folder = tmp_path_factory.mktemp("pages")
    report_event(entry, folder / "event.html")
    report_shift(replayed / "bar.jsonl", folder / "shift.html")
    (folder / "model.toml").write_text(MODEL)
    simulate_to_file(folder / "model.toml", 4.0, 1, folder / "cut.wav", 12_800)
    diagnose_file(folder / "cut.wav", folder / "model.toml", folder)
    (folder / "archive.html").write_text(archive_page("Archive", DONE, BROKEN))
    return [folder / "event.html", folder / "shift.html", folder / "report.html", folder / "archive.html"]


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
