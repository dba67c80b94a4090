"""The timeline that a person reads."""

from __future__ import annotations

import io
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest
from rich.console import Console

from chatter_monitor.outlets.look import SEVERITY, STATES
from chatter_monitor.outlets.timeline import STRIP_CELLS, Timeline
from chatter_monitor.verdict.reasons import DOUBTED
from tests.messages import event, health, verdict

INTERVAL_S = 0.05
STATE = {look.letter: state for state, look in STATES.items()}


def fill(timeline, strip, channel=0):
    """Intervals as in a strip of letters."""
    for i, letter in enumerate(strip):
        timeline.message(verdict(i, STATE[letter], channel, confidence=0.9))


def shown(timeline, missing=0, width=300):
    out = io.StringIO()
    summary = timeline.summary(Path("cut.flac"), missing)
    timeline.show(Console(file=out, width=width), summary)
    return out.getvalue().splitlines()


def rows(strip):
    """From, to and state of each row of the table."""
    timeline = Timeline(1)
    fill(timeline, strip)
    lines = shown(timeline)
    words = {look.word for look in STATES.values()}
    table = [line.split() for line in lines[3:] if line.split() and line.split()[-1] in words]
    return [(float(row[0]), float(row[2]), row[-1]) for row in table]


def test_a_stretch_is_a_row():
    """Consecutive intervals of one state are one row, from its first to its last moment."""
    assert rows("." * 10 + "-" * 20 + "!" * 10 + "#" * 10) == [
        (0.0, 0.5, "idle"),
        (0.5, 1.5, "stable"),
        (1.5, 2.0, "APPROACHING"),
        (2.0, 2.5, "CHATTER"),
    ]


def test_a_flicker_is_not_shown():
    """Less than a quarter of a second of another state disappears in what it interrupts."""
    assert rows("-" * 10 + "!!!!" + "-" * 10) == [(0.0, 1.2, "stable")]
    assert rows("-" * 10 + "!!!!!" + "-" * 10)[1] == (0.5, 0.75, "APPROACHING")


def test_between_two_others_a_flicker_belongs_to_the_one_before():
    """The table has no hole: what is too short to be shown lengthens the row before it."""
    assert rows("." * 10 + "!!" + "-" * 10) == [(0.0, 0.6, "idle"), (0.6, 1.1, "stable")]


def test_an_alarm_is_always_shown_and_as_long_as_it_was():
    """However short an alarm is, it has its row, and it grows by no flicker after it."""
    assert rows("-" * 10 + "#" + "-" * 10)[1] == (0.5, 0.55, "CHATTER")
    assert rows("-" * 10 + "#" * 10 + "!!" + "-" * 10)[1:] == [(0.5, 1.0, "CHATTER"), (1.0, 1.6, "stable")]


@pytest.mark.parametrize("strip", ["-!" * 50, "-#!?.f" * 20, "." * 30 + "!-" * 7 + "#" * 3 + "??--" * 3])
def test_the_table_covers_the_recording(strip):
    """Whatever happens the rows follow each other from the start to the end."""
    table = rows(strip)
    assert table[0][0] == 0.0
    assert table[-1][1] == pytest.approx(len(strip) * INTERVAL_S, abs=0.006)
    for before, after in pairwise(table):
        assert before[1] == after[0]


def test_a_row_tells_medians():
    """Frequency, damping, half width and confidence are medians of the intervals that have one; none is a dash."""
    timeline = Timeline(1)
    timeline.message(verdict(0, "unknown"))
    for i, damping in enumerate([0.001, 0.002, 0.009]):
        about = {"frequency_hz": 1000.0 + i, "damping_ratio": damping, "confidence": 0.8 + i / 20}
        timeline.message(verdict(i + 1, "self_excited", damping_ratio_ci95=(damping - 0.001, damping + 0.001), **about))
    timeline.message(verdict(4, "self_excited", frequency_hz=1003.0, confidence=0.9))
    unknown, chatter = shown(timeline)[3:5]
    assert unknown.split() == ["0.00", "s", "0.05", "s", "-", "-", "0", "%", "unknown"]
    assert chatter.split() == [
        *["0.05", "s", "0.25", "s", "1002", "Hz", "0.20", "±", "0.10", "%", "88", "%", "CHATTER"]
    ]


def test_the_strip_shows_the_worst_of_each_moment():
    """Each cell has the letter of the worst state in its time, so that one interval of alarm is seen in an hour."""
    timeline = Timeline(1)
    strip = ["-"] * 72_000
    strip[36_000] = "#"
    fill(timeline, "".join(strip))
    cells = shown(timeline)[1].split()[0]
    assert len(cells) == STRIP_CELLS
    assert cells == "-" * 50 + "#" + "-" * 49


def test_the_strip_fits_the_terminal():
    """On a narrow terminal the strip has fewer cells and still stands on one line."""
    timeline = Timeline(1)
    fill(timeline, "." * 100 + "-" * 100)
    lines = shown(timeline, width=40)
    assert lines[1].split()[0] == "." * 13 + "-" * 13
    assert all(len(line) <= 40 for line in lines[:2])


def test_severity_ranks_every_state():
    """Every state has a place among the others, a word and a letter of its own; the alarm is the worst."""
    assert set(SEVERITY) == set(STATES)
    assert len(STATE) == len(STATES)
    assert SEVERITY[-1] == "self_excited"


def test_summary_adds_up_what_was_heard():
    """Totals are those of the verdicts, flickers included, of the events and of the last health."""
    timeline = Timeline(2)
    fill(timeline, "-" * 10 + "!" + "-" * 9)
    fill(timeline, "?" * 20, channel=1)
    timeline.message(event(id="a"))
    timeline.message(health(t=0.5))
    timeline.message(health(t=1.0, lost=3, clipped=4, non_finite=5))
    summary = msgspec.to_builtins(timeline.summary(Path("cut.flac"), 6))
    assert summary["seconds_in"] == [{"stable": 0.95, "approaching": 0.05}, {"unknown": 1.0}]
    assert (summary["recording"], summary["duration_s"], summary["channels"]) == ("cut.flac", 1.0, 2)
    assert [event["id"] for event in summary["events"]] == ["a"]
    counts = [summary[f"samples_{name}"] for name in ("lost", "clipped", "non_finite", "missing")]
    assert counts == [3, 4, 5, 6]


def test_what_a_machinist_reads():
    """Each channel has its title, its events in a sentence and its totals; then come the samples that are not right."""
    timeline = Timeline(2)
    for channel in (0, 1):
        fill(timeline, "-" * 20, channel)
    about = {"onset_s": 0.5, "end_s": 0.9, "peak_frequency_hz": 1067.4, "min_damping_ratio": -0.0012}
    timeline.message(event(channel=1, **about))
    timeline.message(health(t=1.0, lost=3, clipped=4, non_finite=5))
    lines = shown(timeline, missing=6)
    first, second = lines.index("cut.flac, channel 0"), lines.index("cut.flac, channel 1")
    sentence = "  Chatter from 0.50 s to 0.90 s at 1067 Hz, least damping -0.12 %."
    assert sentence in lines[second:]
    assert sentence not in lines[first:second]
    assert lines.count("  1.0 s in all: stable 1.0 s.") == 2
    assert lines[-4:] == [
        "  6 samples promised by the file's header are not there.",
        "  3 samples were lost.",
        "  4 samples are clipped: turn the sensor's gain down.",
        "  5 samples are not numbers.",
    ]


def test_an_alarm_that_is_withdrawn_is_told_as_such():
    """Where an event is no chatter the sentence does not say so."""
    timeline = Timeline(1)
    fill(timeline, "-" * 20, 0)
    about = {"onset_s": 0.5, "end_s": 0.9, "peak_frequency_hz": 1067.4, "min_damping_ratio": -0.0012}
    timeline.message(event(withdrawn=True, **about))
    assert "  Alarm, withdrawn, from 0.50 s to 0.90 s at 1067 Hz, least damping -0.12 %." in shown(timeline)


def test_a_machinist_reads_what_to_change():
    """In a line of its own, however long; what that assumes is in the event."""
    timeline = Timeline(1)
    fill(timeline, "-" * 20, 0)
    timeline.message(event(remedy="3391 rpm (stable in 7 of 10 such cuts): between the lobes. Assumes much"))
    assert "  Change: 3391 rpm (stable in 7 of 10 such cuts): between the lobes." in shown(timeline)


def test_a_speed_that_is_not_believed_is_told_of():
    """In the channel that hears it, with how long."""
    timeline = Timeline(2)
    for channel in (0, 1):
        fill(timeline, "-" * 20, channel)
    for i in range(20, 25):
        timeline.message(verdict(i, "stable", 1, reasons=["no mode stands out", DOUBTED]))
    assert [line for line in shown(timeline) if "speed" in line] == [f"  For 0.2 s {DOUBTED}."]


def test_nothing_heard():
    """Without a single interval there is nothing to show, and no error."""
    assert shown(Timeline(1)) == ["cut.flac", "  nothing to show"]


def test_loss_is_always_shown():
    """However short, what nobody heard is not shown as the state around it, nor does it take in a flicker."""
    assert rows("-" * 10 + "?" + "-" * 10)[1] == (0.5, 0.55, "unknown")
    assert rows("-" * 10 + "?" + "!!" + "-" * 10)[1:] == [(0.5, 0.55, "unknown"), (0.55, 1.15, "stable")]


def test_flickers_leave_nothing_behind():
    """Thousands of flickers that are not shown make one row."""
    assert rows("-----!" * 2000 + "-") == [(0.0, 600.05, "stable")]
