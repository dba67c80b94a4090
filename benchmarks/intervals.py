"""Whether the intervals of full fits hold, apart from whether the right name was found.

    chatter-monitor prove --cases 100 --seed SEED --out DIR     # may be broken off once the key is sealed
    python -m benchmarks.intervals DIR ... [--kinds coulomb stribeck hysteresis]
    python -m benchmarks.intervals --draw SEED --each 10 [--kinds KIND ...]   # cases of its own, so many of each kind

Fits the true term to each recording, beginning with its true parameters and the mode that is left beside it, and
counts how often each 95 % interval holds the truth. A bias of the method shows here; that a fit from the shapes of a
grid stops on its way does not.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import soundfile

from benchmarks.stretches import written
from chatter_monitor.discrepancy.augment import Start, fullest
from chatter_monitor.discrepancy.case import Case
from chatter_monitor.discrepancy.columns import gather_machine
from chatter_monitor.discrepancy.diagnosis import in_band, recorded_from
from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.faults import restlessness
from chatter_monitor.discrepancy.innovations import Diverged, Innovations
from chatter_monitor.discrepancy.linear import Base, calibrate
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.discrepancy.prove.blind.case import make_case
from chatter_monitor.discrepancy.prove.blind.effects import CATALOGUE as EFFECTS
from chatter_monitor.discrepancy.prove.blind.effects import PART
from chatter_monitor.discrepancy.spectrum import RESOLUTION, periodogram
from chatter_monitor.physics.model_file import read_model
from chatter_monitor.physics.parts import AppliedTerm
from chatter_monitor.physics.terms import ABOVE, CATALOGUE


def prepared(directory: Path) -> Case:
    """A case of a proof with all that a full fit needs, and no candidates."""
    samples, rate_hz = soundfile.read(next(directory.glob("recording.*")))
    system = read_model(directory / "model.toml")
    whole, recorded = in_band(recorded_from(samples, float(rate_hz)), system)
    sensor, mode = system.sensor, system.modes[0]
    fitted = calibrate(recorded, Linear.of(system))
    spectrum = periodogram(recorded, RESOLUTION * mode.frequency_hz * mode.damping_ratio)
    inn = Innovations(recorded, fitted.linear)
    case = Case(system, whole, recorded, Base(fitted, fitted, [], sensor.quantity, [], spectrum), inn)
    case.unrest = restlessness(inn.white, inn.used, recorded.rate_hz)
    gather_machine(case)
    return case


def beginning(case: Case, applied: AppliedTerm) -> Start:
    """A true term, and the mode that the regression leaves beside it."""
    inn = case.innovations
    columns = np.concatenate([case.matrix, inn.of_terms([(applied.term, unit) for unit in applied.units.values()])])
    k = len(case.matrix)
    evidence = Evidence(inn.white, columns, case.weight, range(k), case.evidence.block)
    spring, damper = evidence.regress(range(k, len(columns))).all_coefficients[:2]
    return Start((applied,), inn.linear.beside(float(spring), float(damper)), ())


def _true(truth: dict[str, Any]) -> AppliedTerm:
    """The true term, above its amplitude if it has one."""
    term = CATALOGUE[truth["names"][0]]
    unsaid = {p.name: p.default if p.default is not None else float(not p.linear) for p in term.parameters}
    if truth["amplitude_above"] is None:
        return AppliedTerm(term, unsaid | truth["parameters"])
    return AppliedTerm(term.above_amplitude, unsaid | truth["parameters"] | {ABOVE.name: truth["amplitude_above"]})


def fitted(directory: Path, truth: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Estimate and standard deviation of each true parameter, over the truth."""
    case, applied = prepared(directory), _true(truth)
    if truth["time_s"]:  # the machine is that of the whole recording
        start = Start((applied,), case.innovations.linear, (), between_s=tuple(truth["time_s"][0]))
    else:
        start = beginning(case, applied)
    found = fullest(case, [start])[1].parameters[0]
    return {name: (found[name][0] / true, found[name][1] / abs(true)) for name, true in truth["parameters"].items()}


def of_proofs(proofs: Sequence[Path], kinds: Sequence[str]) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Cases of proofs: where they are, and the truth."""
    for proof in proofs:
        for name, truth in json.loads((proof / "key.json").read_text())["cases"].items():
            in_catalogue = truth["family"] in ("catalogue", "part") and not CATALOGUE[truth["names"][0]].delayed
            if in_catalogue and truth["kind"] in (kinds or [truth["kind"]]):
                yield proof / "cases" / name, truth


def drawn(seed: int, each: int, kinds: Sequence[str]) -> Iterator[tuple[Path, dict[str, Any]]]:
    """Cases that nobody has sealed."""
    for number in range(each):
        for effect_number, effect in enumerate((*EFFECTS, *PART), 1):
            if CATALOGUE[effect.names[0]].delayed or effect.kind not in (kinds or [effect.kind]):
                continue
            made = make_case(effect, seed, 1000 * number + effect_number)
            with tempfile.TemporaryDirectory() as folder:
                written(made, Path(folder))
                yield Path(folder), made.truth


def main() -> None:
    """Print every fit, how often the intervals hold, and the standard score of all estimates of a kind."""
    parser = argparse.ArgumentParser(description="Intervals of full fits")
    parser.add_argument("proofs", nargs="*", type=Path, metavar="DIR")
    parser.add_argument("--draw", type=int, metavar="SEED")
    parser.add_argument("--each", type=int, default=1)
    parser.add_argument("--kinds", nargs="*", default=[])
    arguments = parser.parse_args()
    cases = of_proofs(arguments.proofs, arguments.kinds)
    if arguments.draw is not None:
        cases = drawn(arguments.draw, arguments.each, arguments.kinds)
    scores: dict[str, list[float]] = defaultdict(list)
    for directory, truth in cases:
        kind, quantity = truth["kind"], truth["quantity"]
        try:
            found = fitted(directory, truth)
        except Diverged:
            print(f"{kind}, {quantity}: runs away", flush=True)
            continue
        scores[kind] += [(ratio - 1.0) / sd for ratio, sd in found.values()]
        said = ", ".join(f"{key} {ratio:.3f} +- {sd:.3f}" for key, (ratio, sd) in found.items())
        print(f"{kind}, {quantity}: {said}", flush=True)
    for kind, of_kind in scores.items():
        z = np.array(of_kind)
        held = np.count_nonzero(abs(z) < 1.96)
        print(f"{kind:24s}{held:5d} of {z.size}, score {z.mean():+.2f} on average, {np.sqrt(np.mean(z**2)):.2f} rms")


if __name__ == "__main__":
    main()
