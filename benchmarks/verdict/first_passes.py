"""First passes: the monitor begins to listen while nothing is cut, and the first tool enters; every alarm is false.

What it does not know then is that this is a room, with a pump or without, and not a cut. Each run is a pause, a pass of
a stable simulated cut in a room, as `benchmarks.verdict.shift` makes them, and a moment of air, with the speed told in
the pause or never.

Run: python -m benchmarks.verdict.first_passes [--cuts 150] [--rooms 2] [--seed 1] [--slowly]
    [--split report|development] [--first N] [--cache DIR]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.verdict.cut import Cut
from benchmarks.verdict.monitor import Passage, watch
from benchmarks.verdict.shift import (
    FADE_S,
    air,
    choose_entry,
    choose_library,
    in_room,
    level_and_room,
    library,
    one_pass,
)

PAUSE_S, AFTER_S = (4.0, 8.0), (1.0, 1.5)


@dataclass(frozen=True)
class Run:
    """A first pass and what was said of it."""

    cut: Cut
    pump: bool
    told: bool
    states: list[str]

    @property
    def alarms(self) -> int:
        """Intervals in alarm."""
        return self.states.count("self_excited")


def first_pass(cut: Cut, rng: np.random.Generator, fade_s: tuple[float, float] = FADE_S) -> tuple[list[Passage], bool]:
    """A pause, a pass and the air after it; and whether a pump hums all along."""
    level, room = level_and_room(rng, cut.samples)
    pause = air(rng, PAUSE_S, blows=False)
    parts = (pause, one_pass(rng, cut, level, fade_s), air(rng, AFTER_S, blows=False))
    named = zip(("pause", cut.name, "air"), parts, strict=True)
    return in_room(rng, room, named, (cut.nominal_rpm, cut.teeth)), room.pump_hz is not None


def runs(cuts: list[Cut], rooms: int, seed: int, fade_s: tuple[float, float] = FADE_S) -> Iterator[Run]:
    """Hear the first pass of each cut in so many rooms, with the speed told and without."""
    for number, cut in enumerate(cuts):
        for room in range(rooms):
            passages, pump = first_pass(cut, np.random.default_rng([11, seed, number, room]), fade_s)
            for told in (True, False):
                heard = watch(passages, announce=told)
                yield Run(cut, pump, told, [state for remarks in heard for state in remarks.states])


def main() -> None:
    """Listen, and count."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.verdict.first_passes", description=__doc__)
    parser.add_argument("--cuts", type=int, default=150, help="how many stable cuts")
    parser.add_argument("--rooms", type=int, default=2, help="that each is heard in")
    choose_entry(parser)
    choose_library(parser)
    given = parser.parse_args()
    cuts = library(given.cuts, given.cache, given.split, given.first)
    every = runs(cuts, given.rooms, given.seed, given.fade_s)
    total = 2 * given.rooms * len(cuts)
    heard = list(track(every, "first passes", total=total, console=Console(stderr=True)))
    table = Table("speed", "room", "passes", "with alarms", "intervals", "in alarm")
    for told in (True, False):
        for pump in (False, True):
            of_these = [run for run in heard if run.told == told and run.pump == pump]
            alarmed = sum(run.alarms > 0 for run in of_these)
            intervals = sum(len(run.states) for run in of_these), sum(run.alarms for run in of_these)
            names = "told" if told else "unknown", "with a pump" if pump else "noise alone"
            table.add_row(*names, *map(str, (len(of_these), alarmed, *intervals)))
    console = Console()
    console.print(table)
    for run in heard:
        if run.alarms:
            console.print(
                f"{run.alarms} intervals: {run.cut.name}, speed {'told' if run.told else 'unknown'}"
                f"{', with a pump' if run.pump else ''}"
            )


if __name__ == "__main__":
    main()
