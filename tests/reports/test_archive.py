"""The page of an archive."""

from __future__ import annotations

from chatter_monitor.reports.archive import LISTED, Summary, archive_page, row, worst_first

DONE = {
    "cuts/calm.wav": Summary(key="a", machine="lathe-3", duration_s=10.0, channels=1, stable_s=9.0, idle_s=1.0),
    "cuts/a_name_that_is_longer_than_a_phone_is_wide_and_has_no_space.wav": Summary(
        key="b",
        machine="lathe-3",
        duration_s=300.0,
        channels=1,
        stable_s=200.0,
        approaching_s=5.0,
        self_excited_s=95.0,
        events=2,
        peak_frequency_hz=899.6,
        min_damping_ratio=-0.00204,
    ),
    "cuts/near.wav": Summary(
        key="c", machine="lathe-3", duration_s=10.0, channels=1, forced_s=8.0, approaching_s=1.0, unknown_s=1.0
    ),
}
BROKEN = {"cuts/<b>$x$.wav": "the recording is not a sound file"}


def test_the_worst_comes_first():
    """Chatter before what is near it, before the rest; each with its numbers, and a dash where there are none."""
    order = [name for name, _ in worst_first(DONE)]
    assert [name.split("/")[1][:4] for name in order] == ["a_na", "near", "calm"]
    assert row(order[0], DONE[order[0]])[1:] == ("5.0 min", "0.0 s", "5.0 s", "95.0 s", "2", "900 Hz", "-0.20 %")
    assert row("calm", DONE["cuts/calm.wav"])[-2:] == ("-", "-")


def test_what_the_page_says():
    """How many chatter, how many could not be replayed and why; names are text, whatever is in them."""
    page = archive_page("Archive: results", DONE, BROKEN)
    assert "1 of 3 recordings chatter; 1 could not be replayed." in page
    assert "the recording is not a sound file" in page
    assert "<b>" not in page.split("Could not be replayed")[1]
    assert "&lt;b&gt;$x$.wav" in page
    for total in ("3", "5.3 min", "95.0 s"):
        assert f"<b>{total}</b>" in page


def test_nothing_but_broken_ones():
    """Without a single result it says that nothing is known, not that all is well."""
    page = archive_page("Archive", {}, BROKEN)
    assert "0 of 0 recordings chatter; 1 could not be replayed." in page
    assert "<h2>Recordings</h2>" not in page


def test_a_name_that_looks_like_mathematics():
    """The picture shows a name as it is, dollars included."""
    assert "<img" in archive_page("Archive", {"$\\frac$.wav": DONE["cuts/calm.wav"]}, {})


def test_many_recordings():
    """The table ends somewhere, and says how many are left out."""
    many = {f"cuts/{number:04d}.wav": DONE["cuts/calm.wav"] for number in range(LISTED + 7)}
    page = archive_page("Archive", many, {})
    assert "And 7 more, which the data set has." in page
    assert page.count("cuts/0") == LISTED
