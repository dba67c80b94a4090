"""How well the margin is heard in the steady stable cuts of the verdict's benchmark, through the whole channel.

`benchmarks.margin` has one mode and a steady speed. Here teeth enter and leave, the speed wanders by 0.3 % and is told
1 to 3 % off, there are further modes, and the sensor hears what the force excites elsewhere. What was told over the
last 5 s of a cut is compared with the truth of these.

Run: python -m benchmarks.verdict.margin [--split development|report] [--cuts N] [--first N]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from benchmarks.verdict.cut import INTERVAL_S, INTERVAL_SAMPLES, Cut
from benchmarks.verdict.generator import cut, family_of
from benchmarks.verdict.shift import enter_and_leave
from chatter_monitor.tracking.channel import Channel
from chatter_monitor.tracking.orders import OrderSettings
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.tracking.tracker import TrackerSettings

LAST = round(5.0 / INTERVAL_S)  # intervals that are compared
# A pass, the air after it, the part of a pass that is compared, and what comes after that.
PASS_S, AIR_S, LATE_S, LEAVING_S = 6.0, 2.0, 1.0, 0.1
ROOM = 0.02  # noise of it, over the root mean square of the cut
LEAST = 0.3  # of the intervals that are compared with a margin
FAMILY = "stable"
WORST = 5  # cuts that are shown

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Told:
    """What was told of a cut at its end and what is true then; medians.

    Attributes
    ----------
    name : str
        Of the cut.
    ratio, low, high : float
        Kappa over its critical value, and the ends of its 95 % interval.
    damping : float
        Rightmost damping ratio.
    true_ratio, true_damping : float
        The same, true.
    """

    name: str
    ratio: float
    low: float
    high: float
    damping: float
    true_ratio: float
    true_damping: float

    @property
    def error(self) -> float:
        """Of the ratio, relative: negative where there is less room than was told."""
        return self.ratio / self.true_ratio - 1.0


def in_passes(made: Cut) -> tuple[Floats, NDArray[np.bool_]]:
    """A cut in passes with air between, and which of its intervals are late in a pass."""
    rng = np.random.default_rng(made.samples.size)
    whole, between, late, leaving = (round(span_s / INTERVAL_S) for span_s in (PASS_S, AIR_S, LATE_S, LEAVING_S))
    air = np.zeros(between * INTERVAL_SAMPLES)
    length = whole * INTERVAL_SAMPLES
    passes = made.samples[: made.samples.size // length * length].reshape(-1, length)
    samples = np.concatenate([part for each in passes for part in (enter_and_leave(rng, each), air)])
    compared = np.zeros(whole + between, np.bool_)
    compared[whole - leaving - late : whole - leaving] = True
    room = ROOM * float(np.std(made.samples)) * rng.standard_normal(samples.size)
    return samples + room, np.tile(compared, len(passes))


def told_of(made: Cut, *, passes: bool = False) -> Told | None:
    """What the channel tells of a cut of a nominal speed, whole or in passes; None where that is no margin."""
    samples, compared = (
        in_passes(made) if passes else (made.samples, np.arange(len(made.truth)) >= len(made.truth) - LAST)
    )
    channel = Channel(TrackerSettings(), OrderSettings(), SpindleSettings(made.nominal_rpm, made.teeth))
    rows = [
        (margin.ratio, *(margin.ratio_ci95 or ()), margin.damping_rightmost)
        for margin in (
            observation.margin for observation, here in zip(channel.process(0, samples), compared, strict=True) if here
        )
        if margin.margin_percent is not None
    ]
    if len(rows) < LEAST * np.count_nonzero(compared):
        return None
    ratio, low, high, damping = np.median(np.array(rows, float), axis=0).tolist()
    truth = made.truth
    true_ratio = np.median((truth.kappa / truth.kappa_critical)[-LAST:])
    return Told(made.name, ratio, low, high, damping, float(true_ratio), float(np.median(truth.damping_ratio[-LAST:])))


def summary(told: Sequence[Told]) -> str:
    """Errors, and how often the interval holds."""
    errors = np.array([each.error for each in told])
    within, good, bad, holds, damped = (
        f"{100.0 * np.mean(where):.0f} %"
        for where in (
            abs(errors) <= 0.15,
            errors < -0.15,
            errors > 0.15,
            [each.low <= each.true_ratio <= each.high for each in told],
            [abs(each.damping - each.true_damping) <= 0.005 for each in told],
        )
    )
    worst = sorted(told, key=lambda each: -abs(each.error))[:WORST]
    return "\n".join(
        (
            f"error of kappa over its critical value: median {100.0 * np.median(abs(errors)):.1f} %",
            f"within 15 % in {within}, too good by more in {good}, too bad in {bad}",
            f"the 95 % interval holds in {holds}, the rightmost damping is within 0.005 in {damped}",
            "the worst:",
            *(f"  {w.name}: {w.ratio:.2f} ({w.low:.2f} to {w.high:.2f}), true {w.true_ratio:.2f}" for w in worst),
        )
    )


def main() -> None:
    """Simulate, listen, print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.verdict.margin", description=__doc__)
    parser.add_argument("--split", choices=("development", "report"), default="development")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--cuts", type=int, default=600, help="of these one in 15 counts (default 600)")
    parser.add_argument("--passes", action="store_true", help=f"with air between passes of {PASS_S:g} s")
    chosen = parser.parse_args()
    of_all = range(chosen.first, chosen.first + chosen.cuts)
    numbers = [number for number in of_all if family_of(number) == FAMILY]
    heard = [
        told_of(cut(chosen.split, number), passes=chosen.passes)
        for number in track(numbers, "cuts", console=Console(stderr=True))
    ]
    told = [each for each in heard if each is not None]
    print(f"{chosen.split} {chosen.first} to {of_all[-1]}: a margin in {len(told)} of {len(heard)} steady stable cuts")
    if told:
        print(summary(told))


if __name__ == "__main__":
    main()
