"""Effects that are there only part of the time: named, located, or told to be there.

    python -m benchmarks.stretches [--seeds 1 2] [--kinds clearance coulomb] [--jobs 1]

Made by the generator of `prove`, which shares no code with the engine: 20 s each, every effect of the catalogue that
may act for a part of the time does so for 3 to 8 s, and stiffness, clearance and friction act above an amplitude only.
Each case is held to what its true model, told where it acts, gains on the held-out blocks
(`chatter_monitor.discrepancy.oracle`): from 10 nats on it counts as tellable. Development seeds are below 100.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import soundfile

from chatter_monitor.discrepancy.findings import IN_WORDS
from chatter_monitor.discrepancy.prove.blind.case import Case, make_case
from chatter_monitor.discrepancy.prove.blind.chain import RATE_HZ
from chatter_monitor.discrepancy.prove.blind.effects import CATALOGUE, Effect
from chatter_monitor.discrepancy.prove.scoring import OVERLAP, TELLING_NATS, Judged, judge
from chatter_monitor.service.diagnosing import diagnose_file, true_gain

LASTS_S, ABOVE = (3.0, 8.0), (1.2, 1.9)
MAY_BE_ABOVE = ("cubic hardening", "clearance", "coulomb")
DELAYED = ("regenerative delay", "loss of contact")  # the comb of a delay is looked for in the whole spectrum


def effects(seed: int) -> Iterator[Effect]:
    """What is hidden with a seed."""
    rng = np.random.default_rng([seed, 3])
    for effect in CATALOGUE:
        lasts = float(rng.uniform(*LASTS_S))
        if effect.kind not in DELAYED:
            yield replace(effect, kind=f"{effect.kind}, {lasts:.1f} s", family="part", open_s=lasts)
    for effect in CATALOGUE:
        if effect.kind in MAY_BE_ABOVE:
            yield replace(effect, kind=f"{effect.kind}, above", family="part", above=ABOVE)


def written(made: Case, folder: Path) -> tuple[Path, Path]:
    """Recording and base model of a case, as files."""
    recording, model = folder / "recording.wav", folder / "model.toml"
    soundfile.write(recording, made.samples, RATE_HZ, subtype="FLOAT")
    model.write_text(made.model, encoding="utf-8")
    return recording, model


def answered(case: tuple[int, int]) -> tuple[Judged, str]:
    """One case, by its seed and number, made, diagnosed and judged; and what was said."""
    seed, number = case
    made = make_case(list(effects(seed))[number - 1], seed, number)
    with tempfile.TemporaryDirectory() as folder:
        recording, model = written(made, Path(folder))
        report, _ = diagnose_file(recording, model, Path(folder) / "diagnosis")
        gain = true_gain(recording, model, made.truth)
    return judge(f"{seed}.{number}", made.truth, report, gain), report.summary


def row(judged: Judged, summary: str) -> str:
    """A line of the table."""
    where = f"{judged.overlap or 0.0:5.2f}"
    strength = 100.0 * (judged.strength or 0.0)
    head = f"{judged.case:8s}{judged.kind:28s}{judged.quantity:13s}{strength:5.1f} %{judged.true_gain_nats:8.1f}"
    return f"{head}{judged.outcome:>11s}{where:>9s}  {summary}"


def counted(answers: Iterable[tuple[Judged, str]]) -> Iterator[str]:
    """How many are named, listed among names that are not told apart, located and wrong, of the tellable and others."""
    everything = list(answers)
    for above in (False, True):
        of_kind = [(j, said) for j, said in everything if j.kind.endswith("above") == above]
        for tellable in (True, False):
            some = [(j, said) for j, said in of_kind if ((j.true_gain_nats or 0.0) >= TELLING_NATS) == tellable]
            outcomes = [j.outcome for j, _ in some]
            listed = sum(j.outcome == "abstained" and IN_WORDS[j.truth] in said for j, said in some)
            located = sum((j.overlap or 0.0) >= OVERLAP for j, _ in some)
            telling = (
                f"{'above an amplitude' if above else 'in a stretch'}, {'tellable' if tellable else 'not tellable'}"
            )
            yield (
                f"{telling:36s}{len(some):4d}: named {outcomes.count('right')}, unknown {outcomes.count('abstained')} "
                f"(the truth among the names listed in {listed}), "
                f"missed {outcomes.count('missed')}, wrong {outcomes.count('wrong')}; "
                f"located to {100 * OVERLAP:.0f} % {located}"
            )


def main() -> None:
    """Print every case, and how many are named and located."""
    parser = argparse.ArgumentParser(description="Effects that act in part only")
    parser.add_argument("--seeds", nargs="+", type=int, default=[1])
    parser.add_argument("--kinds", nargs="*", default=[], help="how their names begin; all if not given")
    parser.add_argument("--jobs", type=int, default=1)
    arguments = parser.parse_args()
    cases = [
        (seed, number)
        for seed in arguments.seeds
        for number, effect in enumerate(effects(seed), 1)
        if not arguments.kinds or effect.kind.startswith(tuple(arguments.kinds))
    ]
    print("case    hidden                      sensor     strength  gain, nats  outcome  overlap", flush=True)
    judged = []
    with ProcessPoolExecutor(arguments.jobs, get_context("spawn")) as pool:
        for one, summary in pool.map(answered, cases):
            judged.append((one, summary))
            print(row(one, summary), flush=True)
    print("\n".join(counted(judged)))


if __name__ == "__main__":
    main()
