"""What each part costs, next to yardsticks that are timed in turns with it in the same run.

- One recursion with poles and standard deviations, alone and one of two side by side: the C yardstick (no standard
  deviations), one channel and eight in vector lanes; the same recursion in NumPy; padasip's recursive least squares:
  four coefficients, no poles.
- The stages of the chain (`benchmarks.chain`) and the whole on simulated cuts: the recursion, and the C yardstick.
- The filter of `diagnose`: the same in C (`observer_limit.c`), without guards.
- The simulator's integrator: SciPy's `solve_ivp` on the same equations.

Run: python -m benchmarks.parts [--rounds N]
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.chain import Case, Stopwatch, by_stage, whole
from benchmarks.discrepancy import filter_nanoseconds
from benchmarks.results import Cost
from benchmarks.simulator import STEP_S, kernel_alone, scipy_alone, two_modes
from benchmarks.tracker_speed import (
    RATE_HZ,
    compile_yardstick,
    nanoseconds,
    numpy_loop,
    padasip_rls,
    signal,
    tracker,
    two_trackers,
    values_from_poles,
    yardstick_nanoseconds,
)
from benchmarks.verdict.generator import cut
from chatter_monitor.physics.excitation import random_force
from chatter_monitor.tracking.spindle import SpindleSettings

CUTS = 3
SIMULATED_S, SCIPY_S = 5.0, 0.02
NUMPY_SAMPLES, PADASIP_SAMPLES = 3000, 20_000
RECURSION = "one recursion"
PAIR = "one of two recursions side by side"
VALUES = "of it, frequency, damping and standard deviations"
C, C8 = "C yardstick", "C yardstick, 8 lanes"
Samples = NDArray[np.float64]
# Processor nanoseconds per sample by name; the least of all rounds.
Least = dict[str, float]


def simulating() -> tuple[float, float]:
    """Nanoseconds per sample of the simulator's integrator, which makes four steps of it, and of SciPy's."""
    system = two_modes()
    steps, short = round(SIMULATED_S / STEP_S), round(SCIPY_S / STEP_S)
    drive = random_force(system, STEP_S * np.arange(steps + 1), STEP_S, np.random.default_rng(1))
    _, ours_s = kernel_alone(system, drive)
    _, theirs_s = scipy_alone(system, drive[: short + 1])
    steps_a_sample = 1.0 / (STEP_S * RATE_HZ)
    return ours_s / steps * steps_a_sample * 1e9, theirs_s / short * steps_a_sample * 1e9


def stages(kinds: dict[str, list[Case]]) -> Least:
    """Nanoseconds per sample of the whole chain and of its stages, by kind of signal and stage."""
    found: Least = {}
    for kind, cases in kinds.items():
        watch = Stopwatch()
        for samples, spindle in cases:
            watch.time("whole chain", lambda samples=samples, spindle=spindle: whole(samples, spindle))
            by_stage(watch, samples, spindle)
        watch.end_round()
        total = sum(len(samples) for samples, _ in cases)
        found |= {f"{stage}, {kind}": seconds / total * 1e9 for stage, seconds in watch.least_s.items()}
    return found


def keep(least: Least, found: Least) -> None:
    """Keep what was faster than before."""
    for name, ns in found.items():
        least[name] = min(ns, least.get(name, ns))


def costs(rounds: int) -> list[Cost]:
    """All of them."""
    noise = signal(500_000)
    cuts = [cut("development", number) for number in range(CUTS)]
    kinds: dict[str, list[Case]] = {
        "speed known": [(c.samples, SpindleSettings(speed_rpm=c.nominal_rpm, teeth=c.teeth)) for c in cuts],
        "speed unknown": [(c.samples, SpindleSettings()) for c in cuts],
    }
    chain: Least = {}
    others: Least = {}
    with tempfile.TemporaryDirectory() as folder:
        programs = {name: compile_yardstick(Path(folder), lanes) for name, lanes in ((C, 1), (C8, 8))}
        for measured in range(rounds + 1):
            round_others = {
                name: yardstick_nanoseconds(program) for name, program in programs.items() if program is not None
            }
            round_others[RECURSION] = nanoseconds(tracker, noise)
            round_others[PAIR] = nanoseconds(two_trackers, noise)
            round_others[VALUES] = nanoseconds(values_from_poles, noise)
            round_chain = stages(kinds)
            if measured:  # the first round compiles
                keep(others, round_others)
                keep(chain, round_chain)
    others["NumPy"] = nanoseconds(numpy_loop, noise[:NUMPY_SAMPLES])
    others["padasip"] = nanoseconds(padasip_rls, noise[:PADASIP_SAMPLES])
    simulating()
    others["integrator"], others["solve_ivp"] = simulating()

    def cost(part: str, ns: float, yardsticks: Iterable[str]) -> Cost:
        return Cost(part, ns, {name: others[name] for name in yardsticks if name in others})

    return [
        cost(RECURSION, others[RECURSION], (C, C8, "NumPy", "padasip")),
        cost(PAIR, others[PAIR], (C, C8)),
        cost(VALUES, others[VALUES], (RECURSION,)),
        *(cost(name, ns, (RECURSION, C)) for name, ns in chain.items()),
        *(
            Cost(f"filter of diagnose, {name}", here, {"the same in C": there})
            for name, (here, there) in filter_nanoseconds().items()
        ),
        cost("integrator of simulate", others["integrator"], ("solve_ivp",)),
    ]


def report(found: Iterable[Cost]) -> None:
    """Print a line for each."""
    print(f"{'':52}{'ns a sample':>12}   times")
    for cost in found:
        ratios = ", ".join(f"{name} {cost.ns / ns:.3g}" for name, ns in cost.yardsticks_ns.items())
        print(f"{cost.part:52}{cost.ns:12.0f}   {ratios}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    report(costs(parser.parse_args().rounds))


if __name__ == "__main__":
    main()
