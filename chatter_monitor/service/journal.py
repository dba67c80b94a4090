"""What the daemon tells its owner: one line for each thing that changes, on standard error, for the journal."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from chatter_monitor.outlets.look import vibration
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.records import Announcement, Event, Health, Mismatch, Odp, OdpFrame, Verdict

# Priorities of syslog(3), which journald reads from the start of a line.
PRIORITIES = {logging.DEBUG: 7, logging.INFO: 6, logging.WARNING: 4, logging.ERROR: 3, logging.CRITICAL: 2}

CLEAR_LINE = "\r\x1b[2K"

_log = logging.getLogger(__name__)


class _Lines(logging.Formatter):
    """One line for each record: with its priority for the journal, which knows the time; with the time for others.

    On a terminal it takes the place of the status line, which comes again below it.
    """

    def __init__(self, *, for_journal: bool, on_terminal: bool) -> None:
        super().__init__("%(message)s" if for_journal else "%(asctime)s %(levelname)s %(message)s", "%H:%M:%S")
        self._for_journal = for_journal
        self._on_terminal = on_terminal

    def format(self, record: logging.LogRecord) -> str:
        """Text of the line."""
        text = " ".join(super().format(record).split())
        if self._for_journal:
            return f"<{PRIORITIES.get(record.levelno, 6)}>{text}"
        return f"{CLEAR_LINE}{text}" if self._on_terminal else text


@contextmanager
def journal(environment: Mapping[str, str], descriptor: int = 2) -> Iterator[None]:
    """Send what the program logs to a file descriptor, standard error by default.

    The descriptor is duplicated, because sounddevice silences standard error for moments.
    """
    status = os.fstat(descriptor)
    for_journal = environment.get("JOURNAL_STREAM") == f"{status.st_dev}:{status.st_ino}"
    logger = logging.getLogger("chatter_monitor")
    with os.fdopen(os.dup(descriptor), "w", encoding="utf-8", errors="backslashreplace") as stream:
        handler = logging.StreamHandler(stream)
        handler.setFormatter(_Lines(for_journal=for_journal, on_terminal=os.isatty(descriptor)))
        level = logger.level
        logger.addHandler(handler)
        logger.setLevel(logging.INFO)
        try:
            yield
        finally:
            logger.removeHandler(handler)
            logger.setLevel(level)


class Story(Outlet):
    """Tells the journal when problems come, and when it chatters; the sound card itself tells when it hears again."""

    def __init__(self) -> None:
        self._problems: dict[str, str] = {}  # as they were told, by their words without the numbers
        self._alarmed: set[int] = set()
        self._mismatches: dict[int, tuple[str, str | None, str | None]] = {}

    def frame(self, frame: OdpFrame, odp: Odp) -> None:
        """Nothing: it would be 20 lines a second."""

    def message(self, message: Announcement) -> None:
        """Tell what is new."""
        match message:
            case Verdict():
                self._verdict(message)
            case Event():
                self._alarmed.discard(message.channel)
                _log.warning(
                    "channel %d: %s after %.2f s, event %s: %s",
                    message.channel,
                    "the alarm is withdrawn" if message.withdrawn else "chatter is over",
                    message.end_s - message.onset_s,
                    message.id,
                    vibration(message),
                )
            case Mismatch():
                self._mismatch(message)
            case Health():
                self._health(message)

    def _mismatch(self, mismatch: Mismatch) -> None:
        """Tell when simulation and signal begin to differ otherwise than before, and when they agree again."""
        told = mismatch.outcome, mismatch.effect, mismatch.sense
        if self._mismatches.get(mismatch.channel) != told:
            self._mismatches[mismatch.channel] = told
            level = logging.INFO if mismatch.outcome == "none" else logging.WARNING
            _log.log(level, "channel %d: %s", mismatch.channel, mismatch.summary)

    def close(self) -> None:
        """Nothing to give back."""

    def _verdict(self, verdict: Verdict) -> None:
        if verdict.state != "self_excited":
            if verdict.state != "unknown":
                self._alarmed.discard(verdict.channel)
            return
        if verdict.channel not in self._alarmed:
            self._alarmed.add(verdict.channel)
            _log.warning("channel %d: CHATTER: %s", verdict.channel, "; ".join(verdict.reasons))

    def _health(self, health: Health) -> None:
        if health.state == "finished":
            return
        known, self._problems = self._problems, {}
        for reason in health.reasons:
            if reason.startswith("mark at"):
                _log.info("%s", reason)
                continue
            if health.state != "hearing" and reason.endswith("samples lost"):
                continue  # of course; how many is told when it is over
            problem = re.sub(r"\d[\d.]*", "#", reason)  # numbers in it grow, and that is no news
            self._problems[problem] = known.get(problem, reason)
            if problem not in known:
                _log.warning("%s", reason)
        if health.state == "hearing":
            for problem, reason in known.items():
                if problem not in self._problems:
                    _log.info("over: %s", reason)
