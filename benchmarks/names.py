"""Which names effects of some kinds get: cases of a proof, or as many of each kind as wanted.

    python -m benchmarks.names --seed 182818 --cases 300 --kinds stribeck coulomb   # those of a proof of 300
    python -m benchmarks.names --seed 314159 --each 12 --kinds stribeck coulomb     # cases of its own
    python -m benchmarks.names --seed 9002 --each 6 --kinds "v|v|" --quantity displacement --strength 0.05 0.10

Draws, diagnoses and judges as `chatter-monitor prove` does, without a seal: for development, and for what a proof holds
too few of. From 10 nats on that the true model gains on the held-out blocks a case of the catalogue counts as tellable.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.stretches import written
from chatter_monitor.discrepancy.prove.blind.case import STRENGTH, Case, deal, make_case
from chatter_monitor.discrepancy.prove.blind.chain import QUANTITIES
from chatter_monitor.discrepancy.prove.blind.effects import DECK, Effect
from chatter_monitor.discrepancy.prove.scoring import TELLING_NATS, Judged, judge
from chatter_monitor.service.diagnosing import diagnose_file, true_gain

WITH_A_GAIN = ("catalogue", "part")


def dealt(seed: int, cases: int, each: int, kinds: Sequence[str]) -> Iterator[tuple[Effect, int]]:
    """Effects of those kinds, and the numbers of their cases."""
    if cases:
        yield from ((effect, n) for n, effect in enumerate(deal(cases, seed), 1) if effect.kind in kinds)
    for number in range(each):
        yield from ((effect, 1000 * number + k) for k, effect in enumerate(DECK, 1) if effect.kind in kinds)


def judged(made: Case, number: int) -> Judged:
    """One case, diagnosed and judged."""
    with tempfile.TemporaryDirectory() as folder:
        recording, model = written(made, Path(folder))
        report, _ = diagnose_file(recording, model, Path(folder) / "diagnosis")
        gain = true_gain(recording, model, made.truth) if made.truth["family"] in WITH_A_GAIN else None
    return judge(str(number), made.truth, report, gain)


def counted(kind: str, cases: Sequence[Judged]) -> str:
    """How many of a kind are right, and how many intervals hold."""
    tellable = [j for j in cases if j.true_gain_nats is None or j.true_gain_nats >= TELLING_NATS]
    right = sum(j.outcome == "right" for j in tellable)
    held = [hit for j in cases for hit in j.inside.values()]
    of_all = sum(j.outcome == "right" for j in cases)
    said = f"{kind:28s}right {right} of {len(tellable)} that are tellable, {of_all} of all {len(cases)}"
    return f"{said}; intervals hold {sum(held)} of {len(held)}" if held else said


def main() -> None:
    """Print every case, and how many of each kind are right."""
    parser = argparse.ArgumentParser(description="Names of effects by kind")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--cases", type=int, default=0, help="of a proof")
    parser.add_argument("--each", type=int, default=0, help="cases of each kind")
    parser.add_argument("--kinds", nargs="+", required=True, choices=[effect.kind for effect in DECK], metavar="KIND")
    parser.add_argument("--quantity", nargs="+", default=QUANTITIES, choices=QUANTITIES, help="of the sensor")
    parser.add_argument("--strength", nargs=2, type=float, default=STRENGTH, metavar=("LEAST", "MOST"))
    arguments = parser.parse_args()
    answers: dict[str, list[Judged]] = {kind: [] for kind in arguments.kinds}
    for effect, number in dealt(arguments.seed, arguments.cases, arguments.each, arguments.kinds):
        made = make_case(effect, arguments.seed, number, arguments.quantity, arguments.strength)
        one = judged(made, number)
        answers[effect.kind].append(one)
        gain = f"{one.true_gain_nats:8.1f} nats" if one.true_gain_nats is not None else ""
        about = f"{one.case:>6s} {one.kind:28s}{one.quantity:13s}{one.seconds:3.0f} s{gain:>14s}"
        print(f"{about}  {one.outcome:10s}{one.answer}", flush=True)
    for kind, cases in answers.items():
        print(counted(kind, cases))


if __name__ == "__main__":
    main()
