"""What a shift comes to: time in each state, events, damping and margin over the day."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from chatter_monitor.outlets.look import GREY, SKY_BLUE, STATES, damping, hertz, vibration
from chatter_monitor.records import Event, State, Verdict
from chatter_monitor.reports.page import answer, hex_colour, numbers, page, picture, table, text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CUTTING: tuple[State, ...] = ("stable", "forced", "approaching", "self_excited")
SHORTEST_BIN_S = 1.0
MOST_BINS = 512
LISTED_EVENTS = 200


@dataclass
class Bin:
    """What happened in a stretch of time, over all channels: seconds by state, and the least of what was left."""

    seconds: dict[State, float] = field(default_factory=dict)
    damping: float = np.inf
    margin_percent: float = np.inf

    def add(self, other: Bin) -> None:
        """Take in the stretch that follows."""
        for state, seconds in other.seconds.items():
            self.seconds[state] = self.seconds.get(state, 0.0) + seconds
        self.damping = min(self.damping, other.damping)
        self.margin_percent = min(self.margin_percent, other.margin_percent)


@dataclass(frozen=True)
class ListedEvent:
    """An event and when it was, in words."""

    when: str
    event: Event


class Shift:
    """Adds up a shift in a memory that does not grow with its length, but for the events.

    Attributes
    ----------
    events : list of ListedEvent
        In the order in which they came.
    seconds : dict
        Seconds in each state, by channel.
    """

    def __init__(self) -> None:
        self.events: list[ListedEvent] = []
        self.seconds: dict[int, dict[State, float]] = {}
        self.bins: list[Bin] = []
        self.bin_s = SHORTEST_BIN_S

    def verdict(self, verdict: Verdict) -> None:
        """Take a verdict."""
        seconds = self.seconds.setdefault(verdict.channel, {})
        lasted = verdict.t1 - verdict.t0
        seconds[verdict.state] = seconds.get(verdict.state, 0.0) + lasted
        index = int(verdict.t0 / self.bin_s)
        while index >= MOST_BINS:
            self._halve()
            index = int(verdict.t0 / self.bin_s)
        while len(self.bins) <= index:
            self.bins.append(Bin())
        this = Bin({verdict.state: lasted})
        if verdict.state in CUTTING:
            this.damping = np.inf if verdict.damping_ratio is None else verdict.damping_ratio
            this.margin_percent = np.inf if verdict.margin_percent is None else verdict.margin_percent
        self.bins[index].add(this)

    def event(self, event: Event, when: str | None = None) -> None:
        """Take an event; `when` is in seconds of the signal unless somebody knows better."""
        self.events.append(ListedEvent(when or clock(event.onset_s), event))

    def _halve(self) -> None:
        """Make two bins one."""
        for first, second in zip(self.bins[::2], self.bins[1::2], strict=False):
            first.add(second)
        self.bins = self.bins[::2]
        self.bin_s *= 2.0


def clock(seconds: float) -> str:
    """Time since the beginning: h:mm:ss."""
    whole = int(seconds)
    return f"{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def duration(seconds: float) -> str:
    """Length of time as a person would say it."""
    return f"{seconds:.1f} s" if seconds < 120.0 else f"{seconds / 60.0:.1f} min"


def shift_page(shift: Shift, title: str, source: str) -> str:
    """HTML page of a shift.

    Parameters
    ----------
    shift : Shift
        What it comes to.
    title, source : str
        What the page is called, and where its numbers come from.
    """
    chatter = [listed for listed in shift.events if not listed.event.withdrawn]
    chattered = sum(e.event.end_s - e.event.onset_s for e in chatter)
    heading = [f"<h1>{text(title)}</h1>", f'<p class="soft">{text(source)}</p>']
    heading.append(_answer(shift, chatter, chattered))
    parts = [*heading]
    for channel, seconds in sorted(shift.seconds.items()):
        cutting = sum(seconds.get(state, 0.0) for state in CUTTING)
        if len(shift.seconds) > 1:
            parts.append(f"<h2>Channel {channel}</h2>")
        parts.append(
            numbers(
                [
                    ("listened to", duration(sum(seconds.values()))),
                    ("cutting", duration(cutting)),
                    ("of it forced", duration(seconds.get("forced", 0.0))),
                    ("of it near chatter", duration(seconds.get("approaching", 0.0))),
                    ("of it chatter", duration(seconds.get("self_excited", 0.0))),
                    ("nothing can be said", duration(seconds.get("unknown", 0.0))),
                ]
            )
        )
    if not shift.seconds:
        parts.append(numbers([("events", str(len(shift.events))), ("chatter", duration(chattered))]))
        parts.append(
            '<p class="soft">Recorded events tell nothing of the time between them: how long was cut, and '
            "how much damping was left, is known from JSON lines (--jsonl).</p>"
        )
    if shift.bins:
        parts.append(
            picture(
                _figure(shift),
                "What was heard, and the least damping ratio and margin in each stretch of time while it was cutting.",
            )
        )
    parts += ["<h2>Events</h2>", *_events(shift.events)]
    return page(title, parts)


def _answer(shift: Shift, chatter: Sequence[ListedEvent], chattered: float) -> str:
    count = len(chatter)
    if count:
        worst = max(chatter, key=lambda e: e.event.end_s - e.event.onset_s)
        events = "1 event" if count == 1 else f"{count} events"
        told = f"{duration(chattered)} in {events}; the longest began at {worst.when} and was {vibration(worst.event)}."
        return answer("Chatter:", told, STATES["self_excited"].colour)
    if any(seconds.get("unknown", 0.0) > 0.1 * sum(seconds.values()) for seconds in shift.seconds.values()):
        told = "but for much of the time nothing could be said."
        return answer("No chatter was heard,", told, STATES["unknown"].colour)
    told = f"Alarms that were withdrawn: {len(shift.events)}." if shift.events else ""
    return answer("No chatter.", told, STATES["stable"].colour)


def _try(event: Event) -> str:
    if event.withdrawn:
        return "nothing: withdrawn"
    return ", ".join(f"{advice.spindle_rpm:.0f} rpm" for advice in event.advice) or "less depth of cut"


def _events(events: Iterable[ListedEvent]) -> list[str]:
    rows = [
        (
            listed.when,
            str(listed.event.channel),
            duration(listed.event.end_s - listed.event.onset_s),
            hertz(listed.event.peak_frequency_hz),
            damping(listed.event.min_damping_ratio),
            _try(listed.event),
        )
        for listed in events
    ]
    if not rows:
        return ["<p>None.</p>"]
    shown = table(("began", "channel", "lasted", "frequency", "least damping", "try"), rows[:LISTED_EVENTS])
    rest = len(rows) - LISTED_EVENTS
    return [shown, f"<p>And {rest} more.</p>"] if rest > 0 else [shown]


def _figure(shift: Shift) -> Figure:
    from matplotlib.figure import Figure

    whole_s = shift.bin_s * len(shift.bins)
    unit, per = ("h", 3600.0) if whole_s > 7200.0 else ("min", 60.0) if whole_s > 120.0 else ("s", 1.0)
    begin = np.arange(len(shift.bins)) * shift.bin_s / per
    width = shift.bin_s / per
    figure = Figure(figsize=(6.6, 5.8), layout="constrained")
    lane, damping, margin = figure.subplots(3, 1, sharex=True, height_ratios=[1.1, 2.0, 1.6])
    below = np.zeros(len(shift.bins))
    for state, look in STATES.items():
        share = np.array([100.0 * b.seconds.get(state, 0.0) / (sum(b.seconds.values()) or 1.0) for b in shift.bins])
        if share.any():
            lane.bar(begin, share, width, below, align="edge", color=hex_colour(look.colour), lw=0, label=look.word)
            below += share
    lane.set(ylabel="share / %", ylim=(0.0, 100.0), xlim=(0.0, whole_s / per))
    lane.legend(
        loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=6, frameon=False, fontsize="x-small", columnspacing=1.0
    )
    middle = begin + 0.5 * width
    least, left = (
        np.where(np.isfinite(values), values, np.nan)  # the line breaks where nothing is known
        for values in ([100.0 * b.damping for b in shift.bins], [b.margin_percent for b in shift.bins])
    )
    damping.plot(middle, least, ".-", lw=0.6, ms=3, color=hex_colour(SKY_BLUE))
    damping.axhline(0.0, color=hex_colour(STATES["self_excited"].colour), lw=1.2)
    damping.set(ylabel="least damping / %", ylim=(-2.0, 8.0))
    if np.isfinite(left).any():
        margin.plot(middle, left, ".-", lw=0.6, ms=3, color=hex_colour(GREY))
    else:
        margin.text(0.5, 0.5, "not known: it needs the spindle's speed", ha="center", transform=margin.transAxes)
    margin.set(ylabel="least margin / %", ylim=(0.0, 100.0), xlabel=f"time / {unit}")
    return figure
