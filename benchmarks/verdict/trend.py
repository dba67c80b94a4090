"""Whether the trend of a line's damping tells more than what the monitor asks of the line already.

Each vibration of the development cuts is followed by its frequency, and a straight line is laid through the logarithm
of its damping ratio, what was heard long ago counting less: of the damping that its coherence stands for, and of the
mode's that the recursion has there. The trend is the slope over its standard deviation. Weights of growth
(`benchmarks.verdict.train`) are learned from the cuts with even numbers with the trend as a further measure, and
without; from the others comes how much of what grows is told, by the time since the true damping fell below zero, with
so many of the lines of noise, or of vibrations that rise near their limit, taken for growth as well.

Run: python -m benchmarks.verdict.trend [--cuts N] [--cache DIR]
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from benchmarks.verdict.cache import cached_cuts
from benchmarks.verdict.cut import INTERVAL_S, Cut
from benchmarks.verdict.train import GROWTH, MEASURES, NEAR, NOISE, classified, evidence_of, fit
from chatter_monitor.kernels.kinds import measures
from chatter_monitor.kernels.vibrations import FORGOTTEN, LINE_WIDTH_HZ, SAME_VIBRATION

Floats = NDArray[np.float64]

MEMORIES_S = (0.5, 1.0, 2.0)  # in which what was heard loses its weight
ENOUGH = 6  # intervals from which a slope is made
SPREAD = 0.14  # of the decimal logarithm of a damping ratio, besides that which is seen
LARGEST = 8.0  # standard deviations that are told apart
DAMPINGS = ("line", "mode")
AGES_S = (0.0, 0.1, 0.25, 0.5, 1.0, 3.0)
# Of lines of which class so many may be taken for growth.
FALSE = (("noise", NOISE, 0.001), ("near the limit", NEAR, 0.05), ("near the limit", NEAR, 0.01))


class Slope:
    """A straight line through values of the last intervals, newer ones weighing more; as sums over their ages."""

    def __init__(self, memory_s: float) -> None:
        self._fading = math.exp(-INTERVAL_S / memory_s)
        self._sums = np.zeros(6)  # of weights, ages, their squares, values, their squares, and ages times values

    def age(self) -> None:
        """Another interval has passed."""
        ones, ages, _, values, *_ = self._sums
        self._sums += np.array([0.0, ones, 2.0 * ages + ones, 0.0, 0.0, values])
        self._sums *= self._fading

    def add(self, value: float) -> None:
        """Take in the value of this interval."""
        self._sums += np.array([1.0, 0.0, 0.0, value, value**2, 0.0])

    @property
    def significance(self) -> float:
        """The slope over its standard deviation; positive where the values increase with time."""
        ones, ages, squares, values, value_squares, products = self._sums
        spread = squares - ages**2 / ones
        if spread <= 0.0:
            return 0.0
        together = products - ages * values / ones
        left = max(value_squares - values**2 / ones - together**2 / spread, 0.0)
        return float(-together / math.sqrt(spread * (left + SPREAD**2) / ones))


@dataclass
class Known:
    """A vibration that is followed."""

    frequency_hz: float
    slopes: list[Slope] = field(default_factory=lambda: [Slope(memory) for memory in MEMORIES_S for _ in DAMPINGS])
    heard: int = 0
    missed: int = 0

    def trends(self) -> list[float]:
        """Of either damping for each memory, bounded."""
        if self.heard < ENOUGH:
            return [0.0] * len(self.slopes)
        return [min(max(slope.significance, -LARGEST), LARGEST) for slope in self.slopes]


class Trends:
    """The vibrations of a cut, each known by its frequency."""

    def __init__(self) -> None:
        self._known: list[Known] = []

    def follow(self, lines: list[np.void]) -> list[list[float]]:
        """Take in the lines of another interval; returns the trends of each."""
        for known in self._known:
            known.missed += 1
            for slope in known.slopes:
                slope.age()
        self._known = [known for known in self._known if known.missed < FORGOTTEN]
        free = list(self._known)
        found = []
        for line in lines:
            hertz = float(line["frequency_hz"])
            nearest = min(free, key=lambda known: abs(math.log(hertz / known.frequency_hz)), default=None)
            if nearest is not None and _is_same(hertz, nearest.frequency_hz):
                free.remove(nearest)
            else:
                nearest = Known(hertz)
                self._known.append(nearest)
            nearest.frequency_hz, nearest.missed = hertz, 0
            nearest.heard += 1
            for slope, damping in zip(nearest.slopes, _log_dampings(line) * len(MEMORIES_S), strict=True):
                slope.add(damping)
            found.append(nearest.trends())
        return found


def _is_same(hertz: float, before_hz: float) -> bool:
    return abs(math.log(hertz / before_hz)) < max(SAME_VIBRATION, LINE_WIDTH_HZ / before_hz)


def _log_dampings(line: np.void) -> list[float]:
    """Decimal logarithms of the damping of a line, and of the mode at it, as the monitor's measures have them."""
    named = dict(zip(MEASURES, measures(line), strict=True))
    return [-named["tightness"], named["log_damping"]]


def rows(cut: Cut, *, speed_known: bool) -> Iterator[tuple[float, ...]]:
    """Measures and trends of each line of a cut that has a class; that class; and seconds since the cut is unstable."""
    following = Trends()
    heard = classified(cut, list(evidence_of(cut, speed_known=speed_known)))
    for lines, age in zip(heard, cut.truth.unstable_for_s, strict=False):  # a last interval may be missing
        for (line, kind), trends in zip(lines, following.follow([line for line, _ in lines]), strict=True):
            if kind is not None:
                yield (*measures(line), *trends, kind, age)


def told(learned: tuple[Floats, NDArray[np.int64]], x: Floats, kind: NDArray[np.int64], age_s: Floats) -> list[Floats]:
    """Percent of growing lines told at each age, for each of `FALSE`, by weights of other cuts."""
    weights = fit(*learned)[0]
    score = x @ weights[:-1]
    found = []
    for _, false, share in FALSE:
        grows = score > np.quantile(score[kind == false], 1.0 - share)
        aged = ((kind == GROWTH) & (age_s >= young) & (age_s < old) for young, old in pairwise(AGES_S))
        found.append(np.array([100.0 * np.mean(grows[lines]) for lines in aged]))
    return found


def main() -> None:
    """Hear the cuts, learn, print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.verdict.trend", description=__doc__)
    parser.add_argument("--cuts", type=int, default=1050)
    parser.add_argument("--cache", type=Path, help="directory that keeps the cuts")
    chosen = parser.parse_args()
    table: list[tuple[float, ...]] = []
    cuts = track(cached_cuts("development", chosen.cuts, chosen.cache), total=chosen.cuts, console=Console(stderr=True))
    for number, cut in enumerate(cuts):
        table += [(*row, number) for row in rows(cut, speed_known=number // 15 % 2 == 0)]
    *columns, kinds, age_s, numbers = np.array(table).T
    x, kind, learns = np.array(columns).T, kinds.astype(np.int64), numbers % 2 == 0
    own = x.shape[1] - len(MEMORIES_S) * len(DAMPINGS)
    trends = {
        f"{damping}, {memory:g} s": [own + len(DAMPINGS) * i + j]
        for j, damping in enumerate(DAMPINGS)
        for i, memory in enumerate(MEMORIES_S)
    }
    print(f"{int(np.sum(~learns & (kind == GROWTH)))} growing lines; told of them, %, by seconds since it is unstable:")
    for name, further in ({"none": []} | trends).items():
        taken = [*range(own), *further]
        found = told((x[learns][:, taken], kind[learns]), x[~learns][:, taken], kind[~learns], age_s[~learns])
        print(f"trend: {name}")
        for (what, _, share), row in zip(FALSE, found, strict=True):
            ages = (f"{young:g}-{old:g}: {part:.0f}" for (young, old), part in zip(pairwise(AGES_S), row, strict=True))
            print(f"    with {100.0 * share:g} % of lines of {what}: {', '.join(ages)}")


if __name__ == "__main__":
    main()
