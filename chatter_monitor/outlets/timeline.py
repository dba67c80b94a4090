"""What happened when, for a person: a table of stretches, a strip of colours, a few numbers."""

from __future__ import annotations

import statistics
from array import array
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
from rich.console import Console
from rich.table import Table
from rich.text import Text

from chatter_monitor.outlets.look import SEVERITY, STATES, hertz, percent, vibration
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.records import Announcement, Event, Health, Mismatch, Odp, OdpFrame, State, Verdict
from chatter_monitor.verdict.reasons import DOUBTED

# Shorter stretches are shown with the one before: a table that a person reads has few rows. Alarms are never hidden,
# nor is loss, which must not read as whatever surrounds it.
SHORTEST_SHOWN_S = 0.25
ALWAYS_SHOWN: tuple[State, ...] = ("self_excited", "unknown")
STRIP_CELLS = 100  # at most


def _numbers() -> array[float]:
    return array("d")


@dataclass
class Stretch:
    """Consecutive intervals of one state."""

    state: State
    t0: float
    t1: float
    frequency_hz: array[float] = field(default_factory=_numbers)
    damping_ratio: array[float] = field(default_factory=_numbers)
    half_width: array[float] = field(default_factory=_numbers)
    confidence: array[float] = field(default_factory=_numbers)

    @property
    def duration_s(self) -> float:
        """Length of the stretch."""
        return self.t1 - self.t0

    def add(self, verdict: Verdict) -> None:
        """Append the next interval."""
        self.t1 = verdict.t1
        self.confidence.append(verdict.confidence)
        if verdict.frequency_hz is not None:
            self.frequency_hz.append(verdict.frequency_hz)
        if verdict.damping_ratio is not None and verdict.damping_ratio_ci95:
            self.damping_ratio.append(verdict.damping_ratio)
            self.half_width.append((verdict.damping_ratio_ci95[1] - verdict.damping_ratio_ci95[0]) / 2)


class Summary(msgspec.Struct, frozen=True, kw_only=True):
    """Totals of a replay, for ``--json``."""

    recording: str
    duration_s: float
    channels: int
    seconds_in: list[dict[str, float]]
    events: list[Event]
    mismatches: list[Mismatch]
    samples_lost: int
    samples_missing: int
    samples_clipped: int
    samples_non_finite: int


class Timeline(Outlet):
    """Collects stretches per channel; their medians take 32 bytes of each interval, 2 MB in an hour.

    Parameters
    ----------
    channels : int
        How many there are.
    """

    def __init__(self, channels: int) -> None:
        self._stretches: list[list[Stretch]] = [[] for _ in range(channels)]
        self._seconds: list[dict[str, float]] = [{} for _ in range(channels)]
        self._doubted_s = [0.0] * channels
        self.events: list[Event] = []
        self._health: Health | None = None
        self.mismatches: list[Mismatch] = []

    def frame(self, frame: OdpFrame, odp: Odp) -> None:
        """Nothing: the verdicts tell the story."""

    def message(self, message: Announcement) -> None:
        """Take a verdict, an event or the state of health."""
        match message:
            case Verdict():
                self._add(message)
            case Event():
                self.events.append(message)
            case Mismatch():
                self.mismatches.append(message)
            case Health():
                self._health = message

    def close(self) -> None:
        """Nothing to give back."""

    def _add(self, verdict: Verdict) -> None:
        seconds = self._seconds[verdict.channel]
        seconds[verdict.state] = seconds.get(verdict.state, 0.0) + verdict.t1 - verdict.t0
        if DOUBTED in verdict.reasons:
            self._doubted_s[verdict.channel] += verdict.t1 - verdict.t0
        stretches = self._stretches[verdict.channel]
        if not stretches or stretches[-1].state != verdict.state:
            stretches.append(Stretch(verdict.state, verdict.t0, verdict.t0))
            self._absorb_short(stretches)
        stretches[-1].add(verdict)

    def _absorb_short(self, stretches: list[Stretch]) -> None:
        """When a new stretch begins, let the one before disappear if it was too short to show."""
        if len(stretches) < 3:
            return
        before, short, new = stretches[-3:]
        if short.duration_s >= SHORTEST_SHOWN_S or short.state in ALWAYS_SHOWN:
            return
        if before.state == new.state:
            before.t1 = short.t1
            del stretches[-2:]
            return
        if before.state in ALWAYS_SHOWN:  # they are as long as they were
            new.t0 = short.t0
        else:
            before.t1 = short.t1
        del stretches[-2]

    def summary(self, recording: Path, samples_missing: int) -> Summary:
        """Totals so far."""
        health = self._health
        return Summary(
            recording=str(recording),
            duration_s=health.t if health else 0.0,
            channels=len(self._stretches),
            seconds_in=[{state: round(s, 3) for state, s in seconds.items()} for seconds in self._seconds],
            events=self.events,
            mismatches=self.mismatches,
            samples_lost=health.lost if health else 0,
            samples_missing=samples_missing,
            samples_clipped=health.clipped if health else 0,
            samples_non_finite=health.non_finite if health else 0,
        )

    def show(self, console: Console, summary: Summary) -> None:
        """Print strip, table and totals of every channel."""
        for channel, stretches in enumerate(self._stretches):
            title = summary.recording if summary.channels == 1 else f"{summary.recording}, channel {channel}"
            console.print(Text(title, style="bold"))
            if not stretches:
                console.print("  nothing to show")
                continue
            console.print(self._strip(stretches, min(STRIP_CELLS, console.width - 14)))
            console.print(self._table(stretches))
            for event in self.events:
                if event.channel == channel:
                    what = "Alarm, withdrawn," if event.withdrawn else "Chatter"
                    console.print(
                        f"  {what} from {event.onset_s:.2f} s to {event.end_s:.2f} s {vibration(event)}.",
                        style="bold" if event.withdrawn else "bold red",
                        highlight=False,
                    )
                    if event.remedy:  # what it assumes is in the event
                        change = event.remedy.partition(". ")[0]
                        console.print(f"  Change: {change}.", highlight=False, soft_wrap=True)
            for mismatch in self.mismatches:
                if mismatch.channel == channel:
                    console.print(f"  At {mismatch.t:.1f} s: {mismatch.summary}", highlight=False, soft_wrap=True)
            if self._doubted_s[channel]:
                console.print(f"  For {self._doubted_s[channel]:.1f} s {DOUBTED}.", style="magenta", highlight=False)
            totals = ", ".join(f"{STATES[s].word} {t:.1f} s" for s, t in sorted(summary.seconds_in[channel].items()))  # type: ignore[index]
            console.print(f"  {summary.duration_s:.1f} s in all: {totals}.", highlight=False, soft_wrap=True)
        for count, what in (
            (summary.samples_missing, "promised by the file's header are not there"),
            (summary.samples_lost, "were lost"),
            (summary.samples_clipped, "are clipped: turn the sensor's gain down"),
            (summary.samples_non_finite, "are not numbers"),
        ):
            if count:
                console.print(f"  {count} samples {what}.", style="magenta", highlight=False)

    @staticmethod
    def _strip(stretches: list[Stretch], width: int) -> Text:
        """Cells of equal time, each showing the worst of what happened in it."""
        begin, end = stretches[0].t0, stretches[-1].t1
        cells: list[State] = ["idle"] * width
        for stretch in stretches:
            first = int((stretch.t0 - begin) / (end - begin) * width)
            last = int((stretch.t1 - begin) / (end - begin) * width - 1e-9)
            for cell in range(first, min(last, width - 1) + 1):
                cells[cell] = max(cells[cell], stretch.state, key=SEVERITY.index)
        strip = Text("  ")
        for state in cells:
            strip.append(STATES[state].letter, style=STATES[state].style)
        return strip.append(f"  {begin:.0f}-{end:.0f} s", style="grey50")

    @staticmethod
    def _table(stretches: list[Stretch]) -> Table:
        table = Table(box=None, padding=(0, 2), header_style="grey50")
        for heading in ("from", "to", "frequency", "damping", "sure"):
            table.add_column(heading, justify="right")
        table.add_column("state")
        for stretch in stretches:
            damped = "-"
            if stretch.damping_ratio:
                half_width = 100.0 * statistics.median(stretch.half_width)
                damped = f"{100.0 * statistics.median(stretch.damping_ratio):.2f} ± {half_width:.2f} %"
            table.add_row(
                f"{stretch.t0:.2f} s",
                f"{stretch.t1:.2f} s",
                hertz(statistics.median(stretch.frequency_hz)) if stretch.frequency_hz else "-",
                damped,
                percent(statistics.median(stretch.confidence)) if stretch.confidence else "-",
                Text(STATES[stretch.state].word, style=STATES[stretch.state].style),
            )
        return table
