"""Constants of confidence, from cuts of the development split: ``python -m benchmarks.verdict.probability``.

For each of the grounds the share of chatter is a logistic function of how sure the vibrations are, of how loud the cut
is, and of how far its strongest line has risen (`verdict.probability`). Where it does not chatter, a warning is wrong
if it is forced: that share is proportional to how likely it seems to be (`verdict.opinion`). All cuts are heard twice,
with the spindle's speed known and without.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from scipy.optimize import minimize

from benchmarks.verdict.cache import cached_cuts
from benchmarks.verdict.cut import INTERVAL_SAMPLES, RATE_HZ, Cut, Label
from benchmarks.verdict.labels import UNSTABLE_DAMPING
from benchmarks.verdict.train import evidence_of
from chatter_monitor.verdict.judge import Judge
from chatter_monitor.verdict.opinion import forced_by
from chatter_monitor.verdict.probability import Fit, Grounds
from chatter_monitor.verdict.settings import JudgeSettings


class Example(NamedTuple):
    """One interval: its measures, whether it chatters, how likely it seems to be forced, and whether it is."""

    measures: tuple[float, float, float]
    chatters: bool
    seems_forced: float
    forced: bool


def examples(cut: Cut, *, speed_known: bool) -> Iterator[tuple[Grounds, Example]]:
    """Intervals of cutting whose truth is known, each with the grounds of its verdict.

    That it chatters is true from the crossing on, if only later it has to be recognised.
    """
    judge, truth = Judge(JudgeSettings()), cut.truth
    chatters = (truth.label == Label.SELF_EXCITED) | (truth.damping_ratio < UNSTABLE_DAMPING)
    is_known = (truth.label != Label.UNSCORED) | chatters
    for i, seen in enumerate(evidence_of(cut, speed_known=speed_known)):
        judge.verdict(seen, i * INTERVAL_SAMPLES, INTERVAL_SAMPLES, RATE_HZ)
        signs = judge.memory.signs
        if signs is not None and is_known[i]:
            seems_forced, forced = forced_by(judge.memory.forced_share), truth.label[i] == Label.FORCED
            yield signs.grounds, Example(signs.measures, bool(chatters[i]), seems_forced, bool(forced))


def fit(x: NDArray[np.float64], chatters: NDArray[np.bool_]) -> Fit:
    """Most likely weights; `x` of shape (intervals, 3), `chatters` of shape (intervals,)."""
    columns = np.column_stack([x, np.ones(len(x))])

    def loss(weights: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
        odds = columns @ weights
        value = np.mean(np.logaddexp(0.0, odds) - chatters * odds)
        return float(value), columns.T @ (1.0 / (1.0 + np.exp(-odds)) - chatters) / len(x)

    return Fit(*minimize(loss, np.zeros(columns.shape[1]), jac=True, method="BFGS").x)


def wrong_where_forced(warned: list[Example]) -> float:
    """Share of warnings without chatter that are wrong, over how likely it seems that they are, by least squares."""
    seems, forced = np.array([(each.seems_forced, each.forced) for each in warned if not each.chatters], float).T
    return float(seems @ forced / (seems @ seems))


def main() -> None:
    """Fit and print them."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.verdict.probability", description=__doc__)
    parser.add_argument("--cuts", type=int, default=600)
    parser.add_argument("--cache", type=Path, help="directory that keeps the cuts")
    chosen = parser.parse_args()
    console = Console()
    found: dict[Grounds, list[Example]] = {grounds: [] for grounds in get_args(Grounds)}
    cuts = cached_cuts("development", chosen.cuts, chosen.cache)
    for cut in track(cuts, total=chosen.cuts, description="cuts", console=Console(stderr=True)):
        for speed_known in (True, False):
            for grounds, example in examples(cut, speed_known=speed_known):
                found[grounds].append(example)
    for grounds, seen in found.items():
        x, chatters = (np.array(part) for part in zip(*((each.measures, each.chatters) for each in seen), strict=True))
        weights = ", ".join(f"{weight:.3f}" for weight in fit(x, chatters))
        console.print(f"{grounds.upper()} = Fit({weights})  # {len(x)} intervals, {np.mean(chatters):.1%} chatter")
    wrong = wrong_where_forced(found["warning"] + found["surge"])
    console.print(f"WRONG_WHERE_FORCED = {wrong:.2f}")


if __name__ == "__main__":
    main()
