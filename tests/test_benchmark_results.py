"""What the suite of benchmarks found, from its file to the page."""

from __future__ import annotations

import pytest

from benchmarks.results import FILE, Cost, Growth, Results, read, save
from docs import performance

FOUND = Results(
    date="2026-11-21",
    processor="a processor",
    cores=2,
    load=(0.5, 1.5),
    rounds=3,
    costs=[Cost("one recursion", 300.0, {"C yardstick": 150.0, "NumPy": 300_000.0})],
    growths=[
        Growth("chain", "channels", [1.0, 2.0, 4.0], [0.5, 1.0, 2.0], [5.0, 6.0, 8.0]),
        Growth("chain", "seconds of signal", [20.0, 40.0], [0.5, 1.0], [5.0, 5.0]),
    ],
)


def test_the_file_reads_back(tmp_path):
    """What was saved is what is read."""
    save(FOUND, tmp_path / "new" / "found.json")
    assert read(tmp_path / "new" / "found.json") == FOUND


@pytest.mark.parametrize(("power", "seconds"), [(1.0, [3.0, 6.0, 12.0]), (2.0, [1.0, 4.0, 16.0]), (0.0, [2.0] * 3)])
def test_the_exponent_is_that_of_the_power_law(power, seconds):
    """Cost that grows like a power of something has that power as its exponent."""
    assert Growth("chain", "channels", [1.0, 2.0, 4.0], seconds).exponent == pytest.approx(power, abs=1e-12)


def test_the_page_says_what_was_found():
    """Ratios, times real time, exponents and the load stand in the page; made again it stays the same."""
    page = performance.filled(performance.PAGE.read_text(encoding="utf-8"), FOUND)
    assert "| one recursion | 300 | 260 | 2 times C yardstick, 0.001 times NumPy |" in page
    assert "| chain | channels | 1, 4 | 0.5 to 2 | 1.00 | 5 to 8 |" in page
    assert "0.5 in the minute before it, 1.5 in its last" in page
    assert performance.filled(page, FOUND) == page


def test_a_page_without_a_place_is_refused():
    """A marker that got lost is an error, not a table that is no longer renewed."""
    with pytest.raises(ValueError, match="0 places for costs"):
        performance.filled("<!-- run -->\n<!-- end -->\n", FOUND)


def test_the_picture_is_drawn(tmp_path):
    """Growth and memory are drawn into a picture."""
    performance.draw(FOUND, tmp_path / "drawn.png")
    assert (tmp_path / "drawn.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.skipif(not FILE.exists(), reason="the suite has not been run: `make bench`")
def test_the_page_is_fresh():
    """docs/performance.md has the figures of docs/performance.json."""
    page = performance.PAGE.read_text(encoding="utf-8")
    assert page == performance.filled(page, read())
