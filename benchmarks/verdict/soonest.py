"""How soon a sudden onset can be told by anyone: a bound for observers who hear nothing else and know everything else.

Such an observer has the complex amplitude a of the vibration itself, without any noise of room or sensor, other modes,
teeth or tones. He knows what drives it, its growth rate before and after, and the very instant in between; all that he
does not know is whether the machine has become unstable then, or has not. With the rates r (1/s, of growth) the
alternatives are

    da = r a dt + dw,    r = after, or instead of that: as before, half as much, or 0 (just not unstable),

and no test of them is better than the likelihood ratio (Neyman and Pearson 1933). How it is distributed is found by
simulating both. He decides once, and may be wrong in one case of a thousand where nothing has become unstable; an onset
is told when he is right in every other one. Who decides again and again, or knows less, takes longer.

It is a bound for a vibration that is the response of one root to white noise. A change of its frequency, and how the
load sounds otherwise, would tell more about the depth, not about stability.

Run: python -m benchmarks.verdict.soonest [--split S] [--first N] [--cuts N] [--cache DIR]
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from benchmarks.verdict.cache import cached_cuts
from benchmarks.verdict.cut import INTERVAL_S, Cut
from benchmarks.verdict.scoring import LAG_PERIODS, LAG_S, sudden_onset

Floats = NDArray[np.float64]

FALSE = 1e-3
PATHS = 20_000
# A step is so much of the shortest time in which the amplitude changes e-fold, and no longer than so many seconds.
STEP, LONGEST_STEP_S = 0.05, 0.002
LONGEST_S = 5.0
# What an unstable root is to be told from: its growth rate over that before, for names.
INSTEAD = {"as damped as before": 1.0, "half as damped": 0.5, "just not unstable": 0.0}
BEFORE, AFTER = 20, 4  # intervals of which the rates are the medians


def soonest(before: float, after: float, instead: float, seed: int = 0) -> float:
    """Seconds until the likelihood ratio tells half of the onsets, wrong in `FALSE` of the others.

    Parameters
    ----------
    before, after, instead : float
        Growth rates in 1/s: before the instant (negative), after it if the machine has become unstable, and if not.
    seed : int
        Of the simulated paths.

    Returns
    -------
    float
        Infinite if it takes more than `LONGEST_S`.
    """
    rng = np.random.default_rng(seed)
    step_s = min(LONGEST_STEP_S, STEP / max(abs(before), abs(after), abs(instead)))
    unstable, stable = (_log_ratios(rng, before, rate, (after, instead), step_s) for rate in (after, instead))
    for steps in range(1, math.ceil(LONGEST_S / step_s) + 1):
        if np.median(next(unstable)) > np.quantile(next(stable), 1.0 - FALSE):
            return steps * step_s
    return math.inf


def _log_ratios(
    rng: np.random.Generator, before: float, rate: float, pair: tuple[float, float], step_s: float
) -> Iterator[Floats]:
    """Log likelihood of one of a pair of rates over that of the other, step by step, where `rate` is true."""
    amplitude = _noise(rng, 0.5 / -before)
    ratio = np.zeros(PATHS)
    while True:
        later = amplitude * math.exp(rate * step_s) + _noise(rng, _driven(rate, step_s))
        for assumed, sign in zip(pair, (1.0, -1.0), strict=True):
            power = _driven(assumed, step_s)
            miss = np.abs(later - amplitude * math.exp(assumed * step_s)) ** 2
            ratio = ratio - sign * (miss / power + math.log(power))
        amplitude = later
        yield ratio


def _driven(rate: float, step_s: float) -> float:
    """Power that noise of unit intensity adds in a step."""
    return math.expm1(2.0 * rate * step_s) / (2.0 * rate) if rate else step_s


def _noise(rng: np.random.Generator, power: float) -> NDArray[np.complex128]:
    parts = rng.standard_normal((PATHS, 2)) * math.sqrt(0.5 * power)
    return np.asarray(parts[:, 0] + 1j * parts[:, 1])


def rates(cut: Cut, crossing_s: float) -> tuple[float, float]:
    """Growth rates of a cut before and after it becomes unstable (1/s)."""
    truth, at = cut.truth, int(crossing_s / INTERVAL_S)
    growth = -truth.damping_ratio * 2.0 * np.pi * truth.frequency_hz
    before, after = growth[max(0, at - BEFORE) : at - 1], growth[at + 1 : at + 1 + AFTER]
    return float(np.median(before)), float(np.median(after))


def as_scored(crossing_s: float, seconds: float) -> float:
    """Lag of a verdict after so many seconds: it is given at the end of an interval."""
    return INTERVAL_S * math.ceil((crossing_s + seconds) / INTERVAL_S) - crossing_s


def main() -> None:
    """Print how soon the onsets of a set can be told."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--split", choices=("development", "report"), default="development")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--cuts", type=int, default=300)
    parser.add_argument("--cache", type=Path, help="directory to keep generated cuts in")
    chosen = parser.parse_args()
    made = cached_cuts(chosen.split, chosen.cuts, chosen.cache, chosen.first)
    found: dict[str, list[tuple[float, float, float]]] = {name: [] for name in INSTEAD}
    for cut in track(made, total=chosen.cuts, console=Console(stderr=True)):
        onset = sudden_onset(cut)
        if onset is None:
            continue
        crossing_s, limit_s = onset
        before, after = rates(cut, crossing_s)
        for name, part in INSTEAD.items():
            seconds = soonest(before, after, part * before)
            found[name].append((seconds, as_scored(crossing_s, seconds), limit_s))
    for name, rows in found.items():
        seconds, scored, limit = np.array(rows).T
        print(
            f"told from a machine that is {name}: {len(rows)} onsets, median {1e3 * np.median(seconds):.0f} ms, to the "
            f"end of the interval {1e3 * np.median(scored):.0f} ms, {np.median(scored / limit):.2f} of the limit "
            f"({LAG_S:g} s or {LAG_PERIODS:g} periods), 95 % within {np.quantile(scored / limit, 0.95):.1f} of it"
        )


if __name__ == "__main__":
    main()
