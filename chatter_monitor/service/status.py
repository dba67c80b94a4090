"""How it goes, in a sentence: for systemd's status and for whoever looks at a terminal."""

from __future__ import annotations

import time
from collections.abc import Callable

from rich.console import Console
from rich.live import Live
from rich.text import Text

from chatter_monitor.outlets.look import SEVERITY, STATES
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.records import Announcement, Health, Odp, OdpFrame, State, Verdict

REFRESH_S = 0.25


class Status(Outlet):
    """Keeps the newest messages, and makes a sentence of them.

    Parameters
    ----------
    device : callable
        What is heard, for a person.
    """

    def __init__(self, device: Callable[[], str]) -> None:
        self._device = device
        self._verdicts: dict[int, Verdict] = {}
        self._health: Health | None = None

    def frame(self, frame: OdpFrame, odp: Odp) -> None:
        """Nothing: the verdict has the numbers that matter."""

    def message(self, message: Announcement) -> None:
        """Take the newest message of its kind."""
        match message:
            case Verdict():
                self._verdicts[message.channel] = message
            case Health():
                self._health = message

    def close(self) -> None:
        """Nothing to give back."""

    def sentence(self) -> str:
        """Whether it hears, and what."""
        health = self._health
        if health is None:
            return f"Waiting for {self._device()}."
        reasons = "; ".join(health.reasons)
        if health.state == "not_hearing":
            return f"NOT HEARING: {reasons}."
        heard = "; ".join(_words(verdict) for _, verdict in sorted(self._verdicts.items()))
        parts = [f"Hearing {self._device()}", heard, f"Beware: {reasons}" if reasons else ""]
        return " ".join(f"{part}." for part in parts if part)

    def line(self) -> Text:
        """The sentence in the colour of its worst news."""
        health = self._health
        deaf = health is None or health.state != "hearing"
        states: list[State] = ["unknown"] if deaf else [verdict.state for verdict in self._verdicts.values()]
        style = STATES[max(states, key=SEVERITY.index)].style if states else ""
        return Text(self.sentence(), style=style, overflow="ellipsis", no_wrap=True)


def _words(verdict: Verdict) -> str:
    words = f"channel {verdict.channel}: {STATES[verdict.state].word}"
    if verdict.frequency_hz is not None:
        words += f", {verdict.frequency_hz:.0f} Hz"
    if verdict.damping_ratio is not None:
        words += f", damping {100 * verdict.damping_ratio:.2f} %"
    return words


class StatusLine:
    """The sentence on a terminal, kept up to date; nothing where there is no terminal. A context manager.

    Parameters
    ----------
    status : Status
        What to show.
    console : Console
        Where.
    clock : callable
        Seconds on a steady clock.
    """

    def __init__(self, status: Status, console: Console, clock: Callable[[], float] = time.monotonic) -> None:
        self._status = status
        self._clock = clock
        self._due_s = clock()
        self._live = Live(console=console, auto_refresh=False, transient=True) if console.is_terminal else None

    def refresh(self) -> None:
        """Show what is new; at most a few times a second."""
        if self._live is not None and (now_s := self._clock()) >= self._due_s:
            self._due_s = now_s + REFRESH_S
            self._live.update(self._status.line(), refresh=True)

    def __enter__(self) -> StatusLine:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()
