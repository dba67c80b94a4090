"""What is advised when a milling cut chatters, followed in the simulator of `benchmarks.verdict.milling`.

Cuts that chatter are heard with their speed told; the event that is longest advises, and the same cut is milled as deep
at the speeds that are advised. Whether it chatters there is told by its twin with next to no noise, in the last half of
some seconds. So it is at speeds at which teeth pass in step with the chatter (60 f / (N k), the nearest first), and at
speeds drawn from between half and twice the present one.

Run: python -m benchmarks.verdict.milling_remedies [--cuts 60] [--first 300]
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.verdict.milling import DEEPER, Mill, chatters_at, draw, limit, passages, simulate
from benchmarks.verdict.monitor import events_of
from benchmarks.verdict.remedies import ADVISED, ANY, IN_STEP, LEAST_S, in_step, longest
from chatter_monitor.records import Event
from chatter_monitor.verdict.advice import USUAL_RANGE

# Speeds that are drawn for each cut, from this seed on.
DRAWN, SEED = 5, 13


@dataclass(frozen=True)
class Remedy:
    """Whether a cut is stable at the speeds that are advised, at those in step with its chatter, and at those drawn."""

    advised: list[bool]
    in_step: list[bool]
    drawn: list[bool]


def remedy_of(mill: Mill) -> Remedy | None:
    """What is advised for a cut that chatters; None where no alarm told so."""
    event = _chatter(mill)
    if event is None:
        return None
    depth, told_rpm = mill.over * limit(mill), 60.0 * mill.told_hz

    def is_stable(rpm: float) -> bool:
        return not chatters_at(mill, depth, mill.rotation_hz * rpm / told_rpm)

    ratios = np.exp(np.random.default_rng([SEED, mill.seed]).uniform(*np.log(USUAL_RANGE), DRAWN))
    return Remedy(
        [is_stable(speed.spindle_rpm) for speed in event.advice],
        [is_stable(speed.spindle_rpm) for speed in in_step(event.peak_frequency_hz, mill.teeth, told_rpm)],
        [is_stable(told_rpm * ratio) for ratio in ratios],
    )


def _chatter(mill: Mill) -> Event | None:
    """The longest alarm that begins as the cut gets deeper, or later."""
    events = events_of(passages(mill, simulate(mill)[0]))
    return longest(event for event in events if event.onset_s >= DEEPER)


def table_of(remedies: list[Remedy]) -> Table:
    """Rules, and how often the cut is stable at the speeds that they give, in all and where one is advised."""
    table = Table("speed", "given for", "stable at the first", "at one of three", "where one is advised")
    advised = [remedy for remedy in remedies if remedy.advised]
    rows = (
        (ADVISED, lambda remedy: remedy.advised),
        (IN_STEP, lambda remedy: remedy.in_step),
        (ANY, lambda remedy: remedy.drawn),
    )
    for rule, stable in rows:
        given, there = ([stable(each) for each in these if stable(each)] for these in (remedies, advised))
        # of those that are drawn none is the first
        first, where = (np.mean([np.mean(each if rule == ANY else each[:1]) for each in of]) for of in (given, there))
        one = "" if rule == ANY else f"{np.mean([any(each) for each in given]):.0%}"
        table.add_row(rule, f"{len(given)} of {len(remedies)}", f"{first:.0%}", one, f"{where:.0%}")
    table.caption = f"a speed is advised for {len(advised)}"
    return table


def main() -> None:
    """Mill, listen, and mill again."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.verdict.milling_remedies", description=__doc__)
    parser.add_argument("--cuts", type=int, default=60, help="how many cuts, of which three in five chatter")
    parser.add_argument("--first", type=int, default=300, help="seed of the first (default %(default)s)")
    given = parser.parse_args()
    mills = [mill for mill in map(draw, range(given.first, given.first + given.cuts)) if mill.chatters]
    followed = [remedy_of(mill) for mill in track(mills, "milling remedies", console=Console(stderr=True))]
    remedies = [remedy for remedy in followed if remedy is not None]
    console = Console()
    console.print(
        f"{len(remedies)} cuts that chatter with an alarm of {LEAST_S} s about it, {len(mills) - len(remedies)} without"
    )
    console.print(table_of(remedies))


if __name__ == "__main__":
    main()
