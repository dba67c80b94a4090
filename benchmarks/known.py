"""Models that have the physics already: nothing may be found missing.

    python -m benchmarks.known [--seeds 1] [--share 1.0] [--jobs 1]

Recordings of the generator of `prove`, which shares no code with the engine, 20 s each, every effect of its catalogue
that acts all along. The model that they are held against has the hidden force, its coefficients true or times a share,
and modes as wrong as in a proof: the right answer is `parameters`, or `none` where they are nearly right. Development
seeds are below 100.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

from benchmarks.stretches import written
from chatter_monitor.discrepancy.prove.blind.case import make_case
from chatter_monitor.discrepancy.prove.blind.effects import CATALOGUE
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.model_file import model_text, read_model
from chatter_monitor.physics.parts import AppliedTerm
from chatter_monitor.service.diagnosing import diagnose_file, with_hidden


def weakened(system: MachiningSystem, share: float) -> MachiningSystem:
    """The same model with the coefficients of its last term times a share."""
    *others, applied = system.terms
    linear = [p.name for p in applied.term.parameters if p.linear]
    parameters = {k: v * (share if k in linear else 1.0) for k, v in applied.parameters.items()}
    return replace(system, terms=(*others, AppliedTerm(applied.term, parameters)))


def answered(case: tuple[int, int, float]) -> tuple[str, str, str, str]:
    """One case, by its seed, number and share: what is in it, the sensor, the verdict, and the summary."""
    seed, number, share = case
    made = make_case(CATALOGUE[number], seed, number + 1)
    with tempfile.TemporaryDirectory() as folder:
        recording, model = written(made, Path(folder))
        system = weakened(with_hidden(read_model(model), made.truth), share)
        model.write_text(model_text(system), encoding="utf-8")
        report, _ = diagnose_file(recording, model, Path(folder) / "diagnosis")
    return CATALOGUE[number].kind, made.truth["quantity"], report.verdict, report.summary


def main() -> None:
    """Print every case, and how often each answer came."""
    parser = argparse.ArgumentParser(description="Models that have the physics already")
    parser.add_argument("--seeds", nargs="+", type=int, default=[1])
    parser.add_argument("--share", type=float, default=1.0, help="of the true coefficients, in the model")
    parser.add_argument("--jobs", type=int, default=1)
    arguments = parser.parse_args()
    numbers = [number for number, effect in enumerate(CATALOGUE) if len(effect.names) == 1]
    cases = [(seed, number, arguments.share) for seed in arguments.seeds for number in numbers]
    counts: Counter[str] = Counter()
    with ProcessPoolExecutor(arguments.jobs, get_context("spawn")) as pool:
        for kind, quantity, verdict, summary in pool.map(answered, cases):
            counts[verdict] += 1
            print(f"{kind:22s}{quantity:13s}{verdict:17s}{summary}", flush=True)
    print(f"of {counts.total()}: " + ", ".join(f"{verdict} {count}" for verdict, count in counts.most_common()))


if __name__ == "__main__":
    main()
