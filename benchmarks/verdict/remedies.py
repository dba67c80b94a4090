"""What is advised when a cut chatters: whether it would be stable at these speeds, by its characteristic roots.

Cuts of the benchmark that chatter are heard with their speed told, which is 1 to 3 % off. The event that is longest
advises, and who follows sets the speeds on the same display. By the roots of the very cut, with all its modes and its
teeth, its limit there is compared with the depth that it has in the event. So are speeds that are advised where only
the range of the spindle is known; the textbook's, at which teeth pass in step with the chatter (60 f / (N k), the
nearest first); all speeds between half and twice the present one; and the best of them.

Run: python -m benchmarks.verdict.remedies [--cuts 300] [--split report|development] [--first N] [--cache DIR]
"""

from __future__ import annotations

import argparse
import math
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.verdict.cache import cached_cuts
from benchmarks.verdict.cut import Cut, Label
from benchmarks.verdict.generator import recipe_of
from benchmarks.verdict.monitor import Passage, events_of
from benchmarks.verdict.recipe import Recipe
from benchmarks.verdict.roots import critical_kappa
from benchmarks.verdict.shift import choose_cuts
from chatter_monitor.physics.lobes import recommended_speeds
from chatter_monitor.records import Advice, Event
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.verdict.advice import MOST_SPEEDS, USUAL_RANGE, advise

# Speeds of the range that the limit is looked at.
SPEEDS = 41
# An event is chatter where it is true of so much of it; shorter ones advise too little to be followed.
TRUE, LEAST_S = 0.5, 0.5
ADVISED, UNTOLD, IN_STEP, ANY, BEST = RULES = (
    "advised, speed told",
    "advised, range known",
    "in step with the chatter",
    "any speed",
    "the best speed",
)
SAME = 1.02  # limits that differ by less are the same


@dataclass(frozen=True)
class Remedy:
    """What each rule says of a cut that chatters.

    Attributes
    ----------
    present : float
        Limit over depth at the present speed, below one.
    limits : dict of str to list of float
        The same at the speeds that each rule gives, in their order.
    said : list of int
        In how many of ten such cuts the speeds that are advised are said to be stable.
    """

    present: float
    limits: dict[str, list[float]]
    said: list[int]


def remedy_of(cut: Cut, recipe: Recipe) -> Remedy | None:
    """What is advised for a cut; None where no alarm told that it chatters."""
    event = _chatter(cut)
    if event is None:
        return None
    inside = (cut.truth.start_s >= event.onset_s) & (cut.truth.start_s < event.end_s)
    depth = float(np.median(cut.truth.kappa[inside]))
    present, teeth, told = recipe.rpm.values[0], cut.teeth, cut.nominal_rpm
    harmonics = recipe.engagement.harmonics()

    def limit(rpm: float) -> float:
        return critical_kappa(recipe.modes, 60.0 / (teeth * rpm), harmonics) / depth

    low, high = (bound * told for bound in USUAL_RANGE)
    untold = advise(event.peak_frequency_hz, SpindleSettings(None, teeth, low, high))
    over_truth = told / present
    limits = {
        rule: [limit(speed.spindle_rpm / over_truth) for speed in speeds]
        for rule, speeds in (
            (ADVISED, event.advice),
            (UNTOLD, untold.speeds),
            (IN_STEP, in_step(event.peak_frequency_hz, teeth, told)),
        )
    }
    limits[ANY] = [limit(rpm / over_truth) for rpm in np.geomspace(low, high, SPEEDS)]
    limits[BEST] = [max(limits[ANY])]
    said = [int(tenths) for tenths in re.findall(r"stable in (\d+) of 10", event.remedy)]
    return Remedy(limit(present), limits, said)


def in_step(chatter_hz: float, teeth: int, told_rpm: float) -> list[Advice]:
    """Speeds at which teeth pass in step with the chatter, the nearest first, as many as are advised at most."""
    reach = (bound * told_rpm for bound in USUAL_RANGE)
    speeds = recommended_speeds(chatter_hz, teeth, *reach).speeds
    return sorted(speeds, key=lambda speed: abs(math.log(speed.spindle_rpm / told_rpm)))[:MOST_SPEEDS]


def longest(events: Iterable[Event]) -> Event | None:
    """The longest of these that was not withdrawn, if it is long enough."""
    lasting = (event for event in events if not event.withdrawn and event.end_s - event.onset_s >= LEAST_S)
    return max(lasting, key=lambda event: event.end_s - event.onset_s, default=None)


def _chatter(cut: Cut) -> Event | None:
    """The longest alarm about a cut that is true."""
    chatters, start_s = cut.truth.label == Label.SELF_EXCITED, cut.truth.start_s
    events = events_of([Passage(cut.samples, "cut", (cut.nominal_rpm, cut.teeth))])
    return longest(e for e in events if chatters[(start_s >= e.onset_s) & (start_s < e.end_s)].mean() >= TRUE)


def table_of(remedies: list[Remedy]) -> Table:
    """Rules, and what their speeds come to."""
    table = Table(
        "speed", "given for", "stable at the first", "at one of three", "limit below now's", "limit over now's"
    )
    for rule in RULES:
        given = [remedy for remedy in remedies if remedy.limits[rule]]
        first = [remedy.limits[rule] if rule == ANY else remedy.limits[rule][:1] for remedy in given]
        gains = [np.array(at) / remedy.present for at, remedy in zip(first, given, strict=True)]
        stable = np.mean([np.mean(np.array(at) > 1.0) for at in first])
        one = np.mean([max(remedy.limits[rule]) > 1.0 for remedy in given])
        worse = np.mean([np.mean(gain < 1.0 / SAME) for gain in gains])
        of_three = "" if rule in (ANY, BEST) else f"{one:.0%}"
        over = f"{np.median([np.median(gain) for gain in gains]):.2f}"
        table.add_row(rule, f"{len(given)} of {len(remedies)}", f"{stable:.0%}", of_three, f"{worse:.0%}", over)
    return table


def main() -> None:
    """Listen, ask, and look where the lobes are."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.verdict.remedies", description=__doc__)
    parser.add_argument("--cuts", type=int, default=300, help="how many cuts, of which a third turns to chatter")
    choose_cuts(parser)
    given = parser.parse_args()
    remedies, untold, numbered = [], 0, enumerate(cached_cuts(given.split, given.cuts, given.cache, given.first))
    for i, cut in track(numbered, "remedies", total=given.cuts, console=Console(stderr=True)):
        if (cut.truth.label == Label.SELF_EXCITED).any():
            remedy = remedy_of(cut, recipe_of(given.split, given.first + i))
            untold += remedy is None
            remedies += [] if remedy is None else [remedy]
    console = Console()
    console.print(f"{len(remedies)} cuts that chatter with an alarm of {LEAST_S} s about it, {untold} without")
    console.print(table_of(remedies))
    right, said = Counter[int](), Counter[int]()
    for remedy in remedies:
        for tenths, over in zip(remedy.said, remedy.limits[ADVISED], strict=True):
            said[tenths] += 1
            right[tenths] += over > 1.0
    for tenths in sorted(said):
        console.print(f"said to be stable in {tenths} of 10: {right[tenths]} of {said[tenths]} are")


if __name__ == "__main__":
    main()
