"""What the diagnoses of an archive come to: in which recordings physics is missing, and which."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence

import msgspec

from chatter_monitor.discrepancy.report import Verdict
from chatter_monitor.outlets.look import STATES
from chatter_monitor.reports.archive import Row, listed
from chatter_monitor.reports.page import Link, answer, numbers, page, text

HEADINGS: Sequence[str] = ("recording", "answer", "evidence", "next", "its evidence")
# Those that should be looked at first are first.
VERDICTS: tuple[Verdict, ...] = ("missing_physics", "unknown", "parameters", "none")
WORDS: dict[Verdict, str] = {
    "missing_physics": "missing physics",
    "unknown": "unknown",
    "parameters": "other parameters",
    "none": "as simulated",
}


class Diagnosed(Row, frozen=True, kw_only=True):
    """What the diagnosis of a recording comes to; the folder of its pages is called after the key.

    Attributes
    ----------
    effects, senses : list
        What is missing, strongest first.
    evidence_nats : float
        For all of it together.
    gain_nats : float
        On stretches that no fit has seen.
    runner_up, runner_up_nats : str, float or None
        The next best explanation of what is missing.
    sentence : str
        The answer in words.
    page : str
        Path of its page, from the directory of the results.
    """

    verdict: Verdict
    effects: list[str]
    senses: list[str | None]
    evidence_nats: float
    gain_nats: float
    runner_up: str | None
    runner_up_nats: float | None
    sentence: str
    warnings: list[str]
    page: str

    @property
    def answer(self) -> str:
        """What is missing, or why nothing is named, in a word or two."""
        terms = zip(self.effects, self.senses, strict=True)
        named = " + ".join(name if sense is None else f"{name} ({sense})" for name, sense in terms)
        return named if named and self.verdict == "missing_physics" else WORDS[self.verdict]


class Parameter(msgspec.Struct, frozen=True, kw_only=True):
    """A parameter of an effect that was found, with its 95 % interval."""

    effect: str
    name: str
    value: float
    low: float
    high: float
    unit: str


def worst_first(done: Mapping[str, Diagnosed]) -> list[tuple[str, Diagnosed]]:
    """Recordings in the order in which a person should look at them."""
    return sorted(done.items(), key=lambda item: (VERDICTS.index(item[1].verdict), -item[1].evidence_nats, item[0]))


def row(name: str, summary: Diagnosed) -> tuple[str, ...]:
    """What is said about a recording, under `HEADINGS`."""
    if not strikes(summary):
        return name, summary.answer, "-", "-", "-"
    next_nats = "-" if summary.runner_up_nats is None else f"{summary.runner_up_nats:.1f} nats"
    return name, summary.answer, f"{summary.evidence_nats:.1f} nats", summary.runner_up or "-", next_nats


def strikes(summary: Diagnosed) -> bool:
    """Whether a person should look at the recording."""
    return summary.verdict == "missing_physics"


def sentence(done: Mapping[str, Diagnosed], broken: Mapping[str, str]) -> str:
    """Sum of it in words."""
    missing = sum(map(strikes, done.values()))
    told = f"Physics missing in {missing} of {len(done)} recordings"
    return f"{told}; {len(broken)} could not be diagnosed." if broken else f"{told}."


def archive_page(title: str, done: Mapping[str, Diagnosed], broken: Mapping[str, str]) -> str:
    """HTML page of the diagnoses of an archive; arguments as of `reports.archive.archive_page`."""
    verdicts = Counter(summary.verdict for summary in done.values())
    effects = Counter(summary.answer for summary in done.values() if strikes(summary))
    missing = verdicts["missing_physics"] > 0
    state = STATES["self_excited" if missing else "unknown" if broken or verdicts["unknown"] else "stable"]
    worst = worst_first(done)
    parts = [
        f"<h1>{text(title)}</h1>",
        answer("Found:" if missing else "Nothing named:", sentence(done, broken), state.colour),
        numbers(
            [
                ("recordings", str(len(done))),
                *((WORDS[verdict], str(verdicts[verdict])) for verdict in VERDICTS),
                ("could not be diagnosed", str(len(broken))),
            ]
        ),
    ]
    if effects:
        counted = [(effect, str(count)) for effect, count in effects.most_common()]
        parts += ["<h2>What is missing</h2>", *listed(("effect", "recordings"), counted)]
    if worst:
        parts += ["<h2>Recordings</h2>", *listed(HEADINGS, [row(*item) for item in worst])]
        words = [(Link(name, summary.page), summary.sentence) for name, summary in worst]
        parts += ["<h2>In words</h2>", *listed(("report", "answer"), words)]
    if broken:
        parts += ["<h2>Could not be diagnosed</h2>", *listed(("recording", "why"), sorted(broken.items()))]
    return page(title, parts)
