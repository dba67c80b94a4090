"""Passes that chatter, and the same passes again: what was heard in one is not to hide the chatter of the next.

Each run is a pause, a pass of a simulated cut that begins calm and turns to chatter, air, the same pass again and air,
in a room as `benchmarks.verdict.shift` makes them, with the speed told in the pause or never. Of the second pass more
is known, so no less of its chatter is to be told.

Run: python -m benchmarks.verdict.next_passes [--cuts 100] [--seed 1] [--split report|development] [--first N]
    [--cache DIR]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
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
PAUSE_S, AIR_S = 6.0, 5.0
NAMES = ("first", "second")
PASSES = len(NAMES)


@dataclass(frozen=True)
class Run:
    """What was said of passes of one cut: states of each, and truth, shape (intervals,)."""

    cut: Cut
    told: bool
    labels: NDArray[np.int64]
    passes: list[list[str]]

    def told_of(self, number: int) -> int:
        """Self-excited intervals of a pass that are in alarm."""
        return self._alarms(number, (Label.SELF_EXCITED,))

    def false_in(self, number: int) -> int:
        """Others that are."""
        return self._alarms(number, (Label.OTHER, Label.FORCED))

    @property
    def self_excited(self) -> int:
        """How many intervals of each pass are."""
        return int(np.sum(self.labels == Label.SELF_EXCITED))

    def _alarms(self, number: int, labels: tuple[Label, ...]) -> int:
        alarm = np.array(self.passes[number]) == "self_excited"
        return int(np.sum(alarm & np.isin(self.labels, labels)))


def library(size: int, cache: Path | None, split: Split, first: int) -> list[Cut]:
    """Return cuts of a split, from one on, that begin calm and turn to chatter, but for those of the room."""
    turns = (c for c in cached_cuts(split, 8 * size, cache, first) if c.family not in TONES and _calm(c) >= CALM)
    return list(islice(turns, size))


def _calm(cut: Cut) -> int:
    """Intervals of a cut that turns to chatter before it does; none where it never does."""
    chatters = np.flatnonzero(np.isin(cut.truth.label[SETTLING:], (Label.SELF_EXCITED, Label.UNSCORED)))
    return int(chatters[0]) if (cut.truth.label == Label.SELF_EXCITED).any() else 0


def job(cut: Cut, rng: np.random.Generator) -> list[Passage]:
    """Return a pause and passes with air after each, whole intervals each."""
    source = cut.samples[SETTLING * INTERVAL_SAMPLES :]
    # as loud as other cuts are while it is calm
    level, room = level_and_room(rng, source[: _calm(cut) * INTERVAL_SAMPLES])
    parts = [("pause", air(rng, (PAUSE_S, PAUSE_S), blows=False))]
    for name in NAMES:
        parts.append((name, enter_and_leave(rng, level * source)))
        parts.append(("air", air(rng, (AIR_S, AIR_S), blows=False)))
    return in_room(rng, room, parts, (cut.nominal_rpm, cut.teeth))


def runs(cuts: list[Cut], seed: int) -> Iterator[Run]:
    """Hear the passes of each cut, with the speed told and without."""
    for number, cut in enumerate(cuts):
        passages = job(cut, np.random.default_rng([12, seed, number]))
        labels = cut.truth.label[SETTLING:]
        for told in (True, False):
            heard: list[list[str]] = [[] for _ in range(PASSES)]
            for remarks in watch(passages, announce=told):
                if remarks.doing in NAMES:
                    heard[NAMES.index(remarks.doing)] += remarks.states
            if any(len(states) != len(labels) for states in heard):
                raise RuntimeError(f"not one verdict for each of {len(labels)} intervals of {cut.name}")
            yield Run(cut, told, labels, heard)


def main() -> None:
    """Listen, and count."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.verdict.next_passes", description=__doc__)
    parser.add_argument("--cuts", type=int, default=100, help="how many cuts that turn to chatter")
    choose_library(parser)
    given = parser.parse_args()
    cuts = library(given.cuts, given.cache, given.split, given.first)
    every = runs(cuts, given.seed)
    heard = list(track(every, "next passes", total=2 * len(cuts), console=Console(stderr=True)))
    table = Table("speed", "pass", "cuts", "never told", "intervals", "recalled", "false alarms")
    for told in (True, False):
        of_these = [run for run in heard if run.told == told]
        intervals = sum(run.self_excited for run in of_these)
        for number, name in enumerate(NAMES):
            found = [run.told_of(number) for run in of_these]
            false = sum(run.false_in(number) for run in of_these)
            counts = len(of_these), found.count(0), intervals
            recalled = f"{100 * sum(found) / intervals:.1f} %"
            table.add_row("told" if told else "unknown", name, *map(str, counts), recalled, str(false))
    console = Console()
    console.print(table)
    for run in heard:
        less = run.told_of(0) - run.told_of(1)
        if less > 0.1 * run.self_excited:
            speed = "told" if run.told else "unknown"
            console.print(
                f"{less} of {run.self_excited} intervals less in the second pass: {run.cut.name}, speed {speed}"
            )


if __name__ == "__main__":
    main()
