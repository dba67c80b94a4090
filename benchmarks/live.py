"""The simulation beside a running signal: how soon it tells, how often it is wrong, what it costs.

``python -m benchmarks.live delay|quiet|cost``; seeds below 50 were for development, those reported are from 50 on.

- ``delay``: something happens in the middle of a simulated run. When is it told, what is it called, was anything told
  before; and how long a stretch of what changed does `diagnose` need to give it a name (the shortest of lengths a
  quarter apart)?
- ``quiet``: a stationary machine for hours; false mismatches.
- ``cost``: processor time beside that of the tracker, in one run.

The machine is that of the engine's tests, which shares no code with it; second modes and other speeds come from
`simulate`.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import lfilter, ss2tf

from chatter_monitor.discrepancy.conclude import conclude
from chatter_monitor.discrepancy.diagnosis import examine, recorded_from
from chatter_monitor.discrepancy.live.found import Found
from chatter_monitor.discrepancy.live.watch import Watch
from chatter_monitor.errors import InputError
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Mode, Quantity, Sensor, Spindle
from chatter_monitor.physics.simulate import simulate
from chatter_monitor.physics.terms import CATALOGUE
from chatter_monitor.tracking.tracker import Tracker, TrackerSettings
from tests.discrepancy.machine import Machine, record

RATE_HZ = 12800.0
FRAME = 640
FIRST_REPORTED_SEED = 50
BEFORE_S, AFTER_S = 20.0, 40.0
JOIN_S = 4.0
EARLY_S = 70.0  # in which bases are fitted
GROWTH = 1.25  # from one length of a prefix to the next

Signal = NDArray[np.float64]
NAMES = {
    "hardening": "cubic_stiffness",
    "softening": "cubic_stiffness",
    "clearance": "clearance",
    "coulomb": "coulomb_friction",
    "second mode": "second_mode",
    "regeneration": "regenerative_delay",
    "another speed": "regenerative_delay",
}


@dataclass(frozen=True)
class Case:
    """A run, the model that it is compared with, and the stretch that differs from it."""

    name: str
    seed: int
    signal: Signal
    model: MachiningSystem

    @property
    def changed(self) -> Signal:
        """What comes after the change."""
        return self.signal[round(BEFORE_S * RATE_HZ) :]


def linear(speed_rpm: float, regeneration: float, *modes: Mode) -> MachiningSystem:
    """A machine of `simulate`."""
    delay = AppliedTerm(CATALOGUE["regenerative_delay"], {"coefficient": regeneration})
    terms = (delay,) if regeneration else ()
    return MachiningSystem(modes, terms, spindle=Spindle(speed_rpm), sensor=Sensor("displacement", noise_rms=0.02))


def case_of(name: str, seed: int) -> Case:
    """A run with a change after BEFORE_S; the machine differs from seed to seed."""
    rng = np.random.default_rng([seed, sum(map(ord, name))])
    frequency_hz, damping = float(rng.uniform(150.0, 600.0)), float(rng.uniform(0.01, 0.04))
    mode = Mode(frequency_hz, damping)
    if NAMES[name] in CATALOGUE and name not in ("regeneration", "another speed"):
        strength = float(rng.uniform(0.03, 0.1))
        total = BEFORE_S + AFTER_S
        machine = Machine(name, strength, frequency_hz, damping, seconds=total, between_s=(BEFORE_S, total))
        signal = record(machine, seed)
        while not np.isfinite(signal).all():  # a spring that softens so much lets the tool go
            machine = replace(machine, strength=0.7 * machine.strength)
            signal = record(machine, seed)
        return Case(name, seed, signal, MachiningSystem((mode,), sensor=Sensor("displacement")))
    speed_rpm, coefficient = float(rng.uniform(1500.0, 4000.0)), float(rng.uniform(0.4, 0.9)) * 2.0 * damping
    match name:
        case "second mode":
            other = Mode(frequency_hz * float(rng.uniform(1.3, 1.8)), damping, float(rng.uniform(0.2, 0.5)))
            before, after = linear(speed_rpm, 0.0, mode), linear(speed_rpm, 0.0, mode, other)
        case "regeneration":
            before = linear(speed_rpm, 0.0, mode)
            after = linear(speed_rpm * float(rng.uniform(0.98, 1.02)), coefficient, mode)
        case _:
            before = linear(speed_rpm, coefficient, mode)
            after = linear(speed_rpm * float(rng.choice([0.96, 0.97, 1.03, 1.04])), coefficient, mode)
    first = simulate(before, BEFORE_S, 2 * seed, settle_s=1.0).signal
    second = simulate(after, AFTER_S + JOIN_S, 2 * seed + 1, settle_s=1.0).signal
    return Case(name, seed, joined(first, second, frequency_hz), before)


def joined(first: Signal, second: Signal, frequency_hz: float) -> Signal:
    """Two runs, the second from where within JOIN_S it is most nearly as the first one ended: nobody hits a machine."""
    w = 2.0 * np.pi * frequency_hz / RATE_HZ
    state = np.stack([second, np.gradient(second) / w])[:, : round(JOIN_S * RATE_HZ)]
    ended = np.array([first[-1], (first[-1] - first[-2]) / w])
    at = int(np.argmin(np.sum((state - ended[:, None]) ** 2, axis=0)))
    return np.concatenate([first, second[at + 1 :][: round(AFTER_S * RATE_HZ)]])


def told(signal: Signal, model: MachiningSystem) -> Iterator[tuple[float, Found]]:
    """What is found about a signal, and when."""
    watch = Watch(model, RATE_HZ)
    for at in range(0, signal.size, FRAME):
        found = watch.take(signal[at : at + FRAME])
        if found is not None:
            yield (at + FRAME) / RATE_HZ, found


def batch_needs_s(case: Case) -> tuple[float | None, str | None]:
    """Shortest prefix of the changed stretch that `diagnose` gives a name to, and the name."""
    seconds = 1.0
    while seconds <= AFTER_S:
        part = case.changed[: round(seconds * RATE_HZ)]
        try:
            report = conclude(examine(recorded_from(part, RATE_HZ), case.model)).report
        except InputError:  # too short
            report = None
        if report is not None and report.verdict == "missing_physics":
            return seconds, report.terms[0].name
        seconds *= GROWTH
    return None, None


def delay_of(what: tuple[str, int]) -> dict[str, object]:
    """One case of ``delay``."""
    case = case_of(*what)
    before, first_any, first_named, last = 0, None, None, None
    for t, found in told(case.signal, case.model):
        if t <= BEFORE_S:
            before += found.outcome != "none"
            continue
        if found.outcome != "none" and first_any is None:
            first_any = t - BEFORE_S
        if found.effect == NAMES[case.name] and first_named is None:
            first_named = t - BEFORE_S
        last = found.effect or found.outcome
    needs_s, batch_name = batch_needs_s(case)
    return {
        "change": case.name, "seed": case.seed, "told_before": before, "first_s": first_any, "named_s": first_named,
        "last": last, "batch_s": needs_s, "batch_name": batch_name,
    }  # fmt: skip


def delay(seeds: range, workers: int) -> None:
    """All changes at all seeds."""
    what = [(name, seed) for name in NAMES for seed in seeds]
    rows = []
    with ProcessPoolExecutor(workers) as pool:
        for row in pool.map(delay_of, what):
            rows.append(row)
            print(json.dumps(row), flush=True)
    both = [r for r in rows if r["batch_name"] == NAMES[str(r["change"])]]
    same = [r for r in both if r["named_s"] is not None]
    soon = [r for r in same if float(str(r["named_s"])) <= 2.0 * float(str(r["batch_s"]))]
    print(f"{len(rows)} runs; told before the change: {sum(bool(r['told_before']) for r in rows)}")
    print(f"named right by diagnose: {len(both)}; of these live: {len(same)}, within twice the time: {len(soon)}")


def quiet_of(what: tuple[int, float]) -> list[str]:
    """One stationary machine for some hours: whatever is told but that nothing is missing."""
    seed, hours = what
    rng = np.random.default_rng(seed)
    frequency_hz, damping = float(rng.uniform(150.0, 600.0)), float(rng.uniform(0.01, 0.04))
    quantity: Quantity = "displacement" if seed % 2 == 0 else "velocity"
    watch = Watch(MachiningSystem((Mode(frequency_hz, damping),), sensor=Sensor(quantity)), RATE_HZ)
    # The sampled response to white noise, exactly: the transition of the state, and the root of what the noise adds.
    w = 2.0 * np.pi * frequency_hz
    A = np.array([[0.0, w], [-w, -2.0 * damping * w]])
    phi = expm(A / RATE_HZ)
    stationary = np.eye(2)  # of displacement and velocity over w, both of unit size
    root = np.linalg.cholesky(stationary - phi @ stationary @ phi.T)
    H = np.array([[1.0, 0.0]]) if quantity == "displacement" else np.array([[0.0, 1.0]])
    filters = [ss2tf(phi, root[:, [i]], H, np.zeros((1, 1))) for i in range(2)]
    memory = [np.zeros(2), np.zeros(2)]
    said, last = [], "none"
    for minute in range(round(60.0 * hours)):
        signal = 0.02 * rng.standard_normal(round(60.0 * RATE_HZ))
        for i, (b, a) in enumerate(filters):
            part, memory[i] = lfilter(b[0], a, rng.standard_normal(signal.size), zi=memory[i])
            signal += part
        for at in range(0, signal.size, FRAME):
            found = watch.take(signal[at : at + FRAME])
            if found is None:
                continue
            now = found.effect or found.outcome
            if now not in ("none", last):
                at_s = 60.0 * minute + at / RATE_HZ
                said.append(f"{at_s:.0f} s: {now}, {found.evidence_nats:.0f} nats, {found.parameters}")
            last = now
        if minute % 60 == 59:
            print(f"seed {seed}, {quantity}: {(minute + 1) / 60:g} h, {len(said)} false mismatches", flush=True)
    return said


def quiet(seeds: range, hours: float, workers: int) -> None:
    """Stationary machines."""
    with ProcessPoolExecutor(workers) as pool:
        for seed, said in zip(seeds, pool.map(quiet_of, [(seed, hours) for seed in seeds]), strict=True):
            print(f"seed {seed}, {hours:g} h: {len(said)} false mismatches", *said, sep="\n  ", flush=True)


def cost() -> None:
    """Processor time for a second of signal, beside the tracker's, for several modes; the first minute and after."""
    cost_of(400.0, 20.0)  # loads what is compiled
    for frequency_hz in (100.0, 400.0, 640.0, 1000.0):
        early, later, ms = cost_of(frequency_hz, 130.0)
        print(
            f"mode at {frequency_hz:.0f} Hz: {later:.2f} of the tracker's time ({ms[0]:.2f} of {ms[1]:.2f} ms/s); "
            f"{early:.2f} in the first 70 s",
            flush=True,
        )


def cost_of(frequency_hz: float, seconds: float) -> tuple[float, float, Signal]:
    """Time over the tracker's, in the first 70 s and after; and both after, in ms for a second of signal."""
    signal = record(Machine("none", 0.0, frequency_hz, 0.02, seconds=seconds), FIRST_REPORTED_SEED)
    watch = Watch(MachiningSystem((Mode(frequency_hz, 0.02),), sensor=Sensor("displacement")), RATE_HZ)
    tracker = Tracker(TrackerSettings())
    spent = np.zeros((2, 2))
    for at in range(0, signal.size, FRAME):
        frame = signal[at : at + FRAME]
        t0 = time.process_time()
        watch.take(frame)
        t1 = time.process_time()
        list(tracker.process(at, frame))
        late = int(at >= EARLY_S * RATE_HZ)
        spent[late] += t1 - t0, time.process_time() - t1
    early, later = spent[:, 0] / np.maximum(spent[:, 1], 1e-9)
    return float(early), float(later), 1000.0 * spent[1] / max(seconds - EARLY_S, 1.0)


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="*", default=["delay", "quiet", "cost"], choices=["delay", "quiet", "cost"])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--hours", type=float, default=8.0, help="of each machine of `quiet`")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--first", type=int, default=FIRST_REPORTED_SEED, help="seed")
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.seeds)
    if "delay" in given.what:
        delay(seeds, given.workers)
    if "quiet" in given.what:
        quiet(seeds, given.hours, given.workers)
    if "cost" in given.what:
        cost()


if __name__ == "__main__":
    main()
