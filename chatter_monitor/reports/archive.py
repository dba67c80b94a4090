"""What an archive of recordings comes to: which of them chatter, how long, and which could not be replayed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from chatter_monitor.outlets.look import STATES, damping, hertz
from chatter_monitor.records import State
from chatter_monitor.reports.page import Link, answer, hex_colour, numbers, page, picture, table, text
from chatter_monitor.reports.shift import CUTTING, duration

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HEADINGS: Sequence[str] = (
    "recording",
    "length",
    "forced",
    "near chatter",
    "chatter",
    "events",
    "frequency",
    "least damping",
)
LISTED = 200
DRAWN = 40


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """What a recording of an archive comes to.

    Attributes
    ----------
    key : str
        Of the recording's content, what was asked of it, and the program.
    """

    key: str


class Summary(Row, frozen=True, kw_only=True):
    """What a recording comes to that has been replayed; seconds are added up over its channels.

    Attributes
    ----------
    peak_frequency_hz, min_damping_ratio : float or None
        Of the event with the least damping; None without an event.
    """

    machine: str
    duration_s: float
    channels: int
    idle_s: float = 0.0
    stable_s: float = 0.0
    forced_s: float = 0.0
    approaching_s: float = 0.0
    self_excited_s: float = 0.0
    unknown_s: float = 0.0
    events: int = 0
    peak_frequency_hz: float | None = None
    min_damping_ratio: float | None = None
    samples_lost: int = 0
    samples_missing: int = 0
    samples_clipped: int = 0
    samples_non_finite: int = 0

    def seconds(self, state: State) -> float:
        """Seconds in a state."""
        return float(getattr(self, f"{state}_s"))


def worst_first(done: Mapping[str, Summary]) -> list[tuple[str, Summary]]:
    """Recordings in the order in which a person should look at them."""
    return sorted(done.items(), key=lambda item: (-item[1].self_excited_s, -item[1].approaching_s, item[0]))


def row(name: str, summary: Summary) -> tuple[str, ...]:
    """What is said about a recording, under `HEADINGS`."""
    return (
        name,
        duration(summary.duration_s),
        *(duration(summary.seconds(state)) for state in ("forced", "approaching", "self_excited")),
        str(summary.events),
        hertz(summary.peak_frequency_hz),
        damping(summary.min_damping_ratio),
    )


def strikes(summary: Summary) -> bool:
    """Whether a person should look at the recording."""
    return summary.events > 0


def sentence(done: Mapping[str, Summary], broken: Mapping[str, str]) -> str:
    """Sum of it in words."""
    chatters = sum(map(strikes, done.values()))
    told = f"{chatters} of {len(done)} recordings chatter"
    return f"{told}; {len(broken)} could not be replayed." if broken else f"{told}."


def archive_page(title: str, done: Mapping[str, Summary], broken: Mapping[str, str]) -> str:
    """HTML page of an archive.

    Parameters
    ----------
    title : str
        What the page is called.
    done : mapping
        Summary of every recording that could be replayed.
    broken : mapping
        What is wrong with every other one.
    """
    seconds = {state: sum(summary.seconds(state) for summary in done.values()) for state in STATES}
    chatter = any(map(strikes, done.values()))
    state: State = "self_excited" if chatter else "unknown" if broken else "stable"
    parts = [
        f"<h1>{text(title)}</h1>",
        answer("Chatter:" if chatter else "No chatter:", sentence(done, broken), STATES[state].colour),
        numbers(
            [
                ("recordings", str(len(done))),
                ("listened to", duration(sum(seconds.values()))),
                ("cutting", duration(sum(seconds[state] for state in CUTTING))),
                ("of it forced", duration(seconds["forced"])),
                ("of it near chatter", duration(seconds["approaching"])),
                ("of it chatter", duration(seconds["self_excited"])),
                ("nothing can be said", duration(seconds["unknown"])),
                ("could not be replayed", str(len(broken))),
            ]
        ),
    ]
    worst = worst_first(done)
    if worst:
        drawn = worst[:DRAWN]
        which = "" if len(worst) == len(drawn) else f", the {len(drawn)} worst"
        parts.append(picture(_figure(drawn), f"Share of time in each state{which}."))
        parts += ["<h2>Recordings</h2>", *listed(HEADINGS, [row(*item) for item in worst])]
    if broken:
        parts += ["<h2>Could not be replayed</h2>", *listed(("recording", "why"), sorted(broken.items()))]
    return page(title, parts)


def listed(headings: Sequence[str], rows: Sequence[Sequence[str | Link]]) -> list[str]:
    """Table of at most `LISTED` rows, and how many more there are."""
    shown, rest = table(headings, rows[:LISTED]), len(rows) - LISTED
    return [shown, f"<p>And {rest} more, which the data set has.</p>"] if rest > 0 else [shown]


def _figure(drawn: Sequence[tuple[str, Summary]]) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.6, 0.9 + 0.19 * len(drawn)), layout="constrained")
    axes = figure.subplots()
    whole = np.array([sum(summary.seconds(state) for state in STATES) or 1.0 for _, summary in drawn])
    left, places = np.zeros(len(drawn)), np.arange(len(drawn))
    for state, look in STATES.items():
        share = 100.0 * np.array([summary.seconds(state) for _, summary in drawn]) / whole
        if share.any():
            axes.barh(places, share, 0.8, left, color=hex_colour(look.colour), lw=0, label=look.word)
            left += share
    axes.tick_params(labelsize="x-small")
    axes.set_xlabel("share / %", fontsize="small")
    axes.set(xlim=(0.0, 100.0), ylim=(len(drawn) - 0.5, -0.5))
    # A name may hold what mathematics is written with; its end tells recordings apart.
    axes.set_yticks(places, [name[-32:].replace("$", r"\$") for name, _ in drawn])
    figure.legend(loc="outside upper left", ncols=6, frameon=False, fontsize="x-small", columnspacing=1.0)
    return figure
