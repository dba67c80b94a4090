"""Passes that chatter, and the same passes again: what was heard in one is not to hide the chatter of the next.

Each run is a pause, a pass of a simulated cut that begins calm and turns to chatter, air, the same pass again and air,
in a room as `benchmarks.verdict.shift` makes them, with the speed told in the pause or never. Of the second pass more
is known, so no less of its chatter is to be told.

Or, with ``--at-once``, two passes of its calm part, and one of what it is a second after it turned to chatter: a tool
that chatters from the first contact on.

Run: python -m benchmarks.verdict.next_passes [--at-once] [--cuts 100] [--seed 1] [--split report|development]
    [--first N] [--cache DIR]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.verdict.cache import cached_cuts
from benchmarks.verdict.cut import INTERVAL_S, INTERVAL_SAMPLES, Cut, Label
from benchmarks.verdict.generator import Split
from benchmarks.verdict.labels import SETTLING_S
from benchmarks.verdict.monitor import Passage, watch
from benchmarks.verdict.shift import TONES, air, choose_library, enter_and_leave, in_room, level_and_room

# Whole intervals of a cut that are left out; it is calm for so many more before it chatters.
SETTLING = round(SETTLING_S / INTERVAL_S)
CALM = round(2.0 / INTERVAL_S)
# So many after it has turned to chatter, that is there.
GROWN = round(1.0 / INTERVAL_S)
PAUSE_S, AIR_S = 6.0, 5.0

Floats = NDArray[np.float64]
Labels = NDArray[np.int64]


@dataclass(frozen=True)
class Run:
    """What was said of passes of one cut: truth of each, shape (intervals,), and states."""

    cut: Cut
    told: bool
    truth: list[Labels]
    passes: list[list[str]]

    def told_of(self, number: int) -> int:
        """Self-excited intervals of a pass that are in alarm."""
        return self._alarms(number, (Label.SELF_EXCITED,))

    def false_in(self, number: int) -> int:
        """Others that are."""
        return self._alarms(number, (Label.OTHER, Label.FORCED))

    def self_excited(self, number: int) -> int:
        """How many intervals of a pass are."""
        return int(np.sum(self.truth[number] == Label.SELF_EXCITED))

    def _alarms(self, number: int, labels: tuple[Label, ...]) -> int:
        alarm = np.array(self.passes[number]) == "self_excited"
        return int(np.sum(alarm & np.isin(self.truth[number], labels)))


def _calm(cut: Cut) -> int:
    """Intervals of a cut that turns to chatter before it does; none where it never does."""
    chatters = np.flatnonzero(np.isin(cut.truth.label[SETTLING:], (Label.SELF_EXCITED, Label.UNSCORED)))
    return int(chatters[0]) if (cut.truth.label[SETTLING:] == Label.SELF_EXCITED).any() else 0


def again(cut: Cut) -> list[slice]:
    """The whole of a cut, twice, as intervals."""
    whole = slice(SETTLING, len(cut.truth))
    return [whole, whole]


def at_once(cut: Cut) -> list[slice]:
    """Its calm part, twice, and what has chattered for a while."""
    calm = _calm_part(cut)
    chatters = SETTLING + int(np.flatnonzero(cut.truth.label[SETTLING:] == Label.SELF_EXCITED)[0])
    return [calm, calm, slice(chatters + GROWN, len(cut.truth))]


def library(
    size: int, cache: Path | None, split: Split, first: int, plan: Callable[[Cut], list[slice]] = again
) -> list[Cut]:
    """Return cuts of a split, from one on, that begin calm and turn to chatter, but for those of the room.

    And for those of which a plan leaves less than a second in a pass.
    """
    turns = (c for c in cached_cuts(split, 8 * size, cache, first) if c.family not in TONES and _calm(c) >= CALM)
    lasting = (c for c in turns if all(passed.stop - passed.start >= GROWN for passed in plan(c)))
    return list(islice(lasting, size))


def job(cut: Cut, passes: list[slice], rng: np.random.Generator) -> list[Passage]:
    """Return a pause and passes with air after each, whole intervals each; a pass is called by its number."""
    # as loud as other cuts are while it is calm
    level, room = level_and_room(rng, _samples(cut, _calm_part(cut)))
    parts = [("pause", air(rng, (PAUSE_S, PAUSE_S), blows=False))]
    for number, intervals in enumerate(passes):
        parts.append((str(number), enter_and_leave(rng, level * _samples(cut, intervals))))
        parts.append(("air", air(rng, (AIR_S, AIR_S), blows=False)))
    return in_room(rng, room, parts, (cut.nominal_rpm, cut.teeth))


def _calm_part(cut: Cut) -> slice:
    """What comes before it chatters, as intervals."""
    return slice(SETTLING, SETTLING + _calm(cut))


def _samples(cut: Cut, intervals: slice) -> Floats:
    """Those of whole intervals."""
    return cut.samples[intervals.start * INTERVAL_SAMPLES : intervals.stop * INTERVAL_SAMPLES]


def runs(cuts: list[Cut], seed: int, plan: Callable[[Cut], list[slice]] = again) -> Iterator[Run]:
    """Hear the passes of each cut, with the speed told and without."""
    for number, cut in enumerate(cuts):
        passes = plan(cut)
        passages = job(cut, passes, np.random.default_rng([12, seed, number]))
        truth = [cut.truth.label[intervals] for intervals in passes]
        for told in (True, False):
            heard: list[list[str]] = [[] for _ in truth]
            for remarks in watch(passages, announce=told):
                if remarks.doing.isdecimal():
                    heard[int(remarks.doing)] += remarks.states
            if [len(states) for states in heard] != [len(labels) for labels in truth]:
                raise RuntimeError(f"not one verdict for each of the intervals of {cut.name}")
            yield Run(cut, told, truth, heard)


def main() -> None:
    """Listen, and count."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.verdict.next_passes", description=__doc__)
    parser.add_argument("--cuts", type=int, default=100, help="how many cuts that turn to chatter")
    parser.add_argument("--at-once", action="store_true", help="calm passes, and one that chatters from its beginning")
    choose_library(parser)
    given = parser.parse_args()
    plan = at_once if given.at_once else again
    cuts = library(given.cuts, given.cache, given.split, given.first, plan)
    every = runs(cuts, given.seed, plan)
    heard = list(track(every, "next passes", total=2 * len(cuts), console=Console(stderr=True)))
    table = Table("speed", "pass", "cuts", "never told", "intervals", "recalled", "false alarms")
    for told in (True, False):
        of_these = [run for run in heard if run.told == told]
        for number in range(len(of_these[0].truth)):
            found = [run.told_of(number) for run in of_these if run.self_excited(number)]
            intervals = sum(run.self_excited(number) for run in of_these)
            false = sum(run.false_in(number) for run in of_these)
            never, recalled = (found.count(0), f"{100 * sum(found) / intervals:.1f} %") if intervals else ("", "")
            cells = number + 1, len(found) or len(of_these), never, intervals, recalled, false
            table.add_row("told" if told else "unknown", *map(str, cells))
    console = Console()
    console.print(table)
    for run in heard:
        first, last = run.told_of(0), run.told_of(-1)
        if first - last > 0.1 * run.self_excited(0):
            speed = "told" if run.told else "unknown"
            console.print(
                f"{first - last} of {run.self_excited(0)} intervals less in the last pass: {run.cut.name}, {speed}"
            )


if __name__ == "__main__":
    main()
