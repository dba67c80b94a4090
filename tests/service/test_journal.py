"""What stands in the journal."""

from __future__ import annotations

import logging
import os

import pytest

from chatter_monitor.service.journal import Story, journal
from tests.messages import event, health, verdict

LOG = logging.getLogger("chatter_monitor.test")


def written(environment_of):
    """What is written to a pipe that stands for standard error."""
    read, write = os.pipe()
    with journal(environment_of(os.fstat(write)), write):
        LOG.info("hearing\n%s", "well")
        LOG.warning("trouble")
        LOG.error("worse")
    os.close(write)
    with os.fdopen(read) as pipe:
        return pipe.read().splitlines()


def test_lines_for_the_journal():
    """Where standard error is the journal's stream, each record is one line with its priority, without a time."""
    assert written(lambda status: {"JOURNAL_STREAM": f"{status.st_dev}:{status.st_ino}"}) == [
        "<6>hearing well",
        "<4>trouble",
        "<3>worse",
    ]


@pytest.mark.parametrize("stream", [{}, {"JOURNAL_STREAM": "8:12345"}])
def test_lines_for_a_person(stream):
    """Elsewhere, also where the journal's stream has been redirected, each line has time and level."""
    lines = written(lambda _: stream)
    assert [line[9:] for line in lines] == ["INFO hearing well", "WARNING trouble", "ERROR worse"]


def test_lines_on_a_terminal():
    """On a terminal a line first clears what the status line has written."""
    master, slave = os.openpty()
    with journal({}, slave):
        LOG.info("hearing")
    text = os.read(master, 4096).decode()
    os.close(master)
    os.close(slave)
    assert text.startswith("\r\x1b[2K")
    assert text.endswith("INFO hearing\r\n")


def told(caplog, *messages):
    story = Story()
    with caplog.at_level(logging.INFO, "chatter_monitor"):
        for message in messages:
            story.message(message)
    return [record.getMessage() for record in caplog.records]


def test_a_problem_is_told_once(caplog):
    """A reason whose numbers grow is told when it comes and when it is over, and so is another one."""

    def deaf(*reasons):
        return health(state="not_hearing", reasons=list(reasons))

    assert told(
        caplog,
        health(),
        deaf("nothing heard for 0.6 s: frozen"),
        deaf("nothing heard for 1.6 s: frozen", "10 samples lost"),
        deaf("nothing heard for 2.6 s: gone", "20 samples lost"),
        health(reasons=["30 samples lost", "mark at 3.00 s: tool 5"]),
        health(),
    ) == [
        "nothing heard for 0.6 s: frozen",
        "nothing heard for 2.6 s: gone",
        "30 samples lost",
        "mark at 3.00 s: tool 5",
        "over: nothing heard for 2.6 s: gone",
        "over: 30 samples lost",
    ]


def test_an_alarm_that_is_withdrawn_was_no_chatter(caplog):
    """It ends with other words."""
    alarm = verdict(state="self_excited", reasons=["damping 0.11 % at 898 Hz"])
    over = event(id="a-0-0001", end_s=2.5, peak_frequency_hz=898.0, min_damping_ratio=1e-3, withdrawn=True)
    assert told(caplog, alarm, over)[1:] == [
        "channel 0: the alarm is withdrawn after 1.50 s, event a-0-0001: at 898 Hz, least damping 0.10 %"
    ]


def test_chatter_is_told_when_it_begins_and_ends(caplog):
    """An alarm is told once, with its reasons, a moment of deafness in it or not; its end with what it came to."""
    stable, deaf = verdict(), verdict(state="unknown")
    alarm = verdict(state="self_excited", reasons=["damping 0.11 % at 898 Hz"])
    over = event(id="a-0-0001", end_s=2.5, peak_frequency_hz=898.0, min_damping_ratio=1e-3)
    assert told(caplog, stable, alarm, alarm, deaf, alarm, over, stable, alarm) == [
        "channel 0: CHATTER: damping 0.11 % at 898 Hz",
        "channel 0: chatter is over after 1.50 s, event a-0-0001: at 898 Hz, least damping 0.10 %",
        "channel 0: CHATTER: damping 0.11 % at 898 Hz",
    ]
