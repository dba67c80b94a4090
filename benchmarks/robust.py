"""What goes wrong around a diagnosis: right, `unknown` or confidently wrong answers, counted over seeds.

    python -m benchmarks.robust [--seeds 10] [--first 100]

A machine with a hard joint (6 % of the restoring force), one with dry friction, one that is linear, and one with
regeneration, each recorded under seven troubles: the model's spindle speed is 3 % off; its sensor measures something
else; a second machine runs in the background (five lines and a broad hump); 10 % of the samples are clipped; a second
in the middle is silent; teeth shake what the sensor sits on, one to ten times as loud as the machine, at a steady speed
and at one that wanders by 0.1 %. Right is the name of what is there, or of the trouble; `none` or `parameters` where
nothing is missing; a finding that is neither is a confident wrong one. Nothing said where something was is a miss.
Development seeds are below 50; those here from 100.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from chatter_monitor.discrepancy.chatter.conclude import conclude_chatter
from chatter_monitor.discrepancy.conclude import conclude
from chatter_monitor.discrepancy.diagnosis import examine, recorded_from
from chatter_monitor.discrepancy.report import Report
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import Mode, Quantity, Sensor, Spindle
from tests.discrepancy.machine import Machine, record

FIRST_SEED = 100
TROUBLES = (
    "nothing",
    "wrong speed",
    "wrong quantity",
    "second machine",
    "clipped",
    "silence",
    "teeth",
    "wandering teeth",
)
NAMES = {"none": None, "hardening": "cubic_stiffness", "coulomb": "coulomb_friction", "delay": "regenerative_delay"}
# Findings that are true of the trouble itself.
TRUE_OF = {
    "second machine": {"second_mode", "periodic_forcing"},
    "clipped": {"clipping"},
    "teeth": {"periodic_forcing"},
    "wandering teeth": {"periodic_forcing"},
}
TOOTH_S = 0.0187  # of the troubles with teeth: none of their orders is near one of the mains
OTHER: dict[Quantity, Quantity] = {"displacement": "velocity", "velocity": "displacement"}


def case(effect: str, trouble: str, seed: int, seconds: float = 10.0) -> tuple[NDArray[np.float64], MachiningSystem]:
    """A recording and its model."""
    rng = np.random.default_rng([seed, TROUBLES.index(trouble)])
    quantity: Quantity = "velocity" if seed % 2 else "displacement"
    machine = Machine(
        effect, 0.02 if effect == "delay" else 0.06, float(rng.uniform(200.0, 500.0)), float(rng.uniform(0.012, 0.03)),
        quantity, seconds,
    )  # fmt: skip
    if "teeth" in trouble:
        machine = replace(machine, delay_s=TOOTH_S)
    samples = record(machine, seed)
    t = np.arange(samples.size) / machine.rate_hz
    size = float(np.std(samples))
    speed = 60.0 / machine.delay_s
    match trouble:
        case "wrong speed":
            speed *= 1.03
        case "wrong quantity":
            quantity = OTHER[quantity]
        case "second machine":
            samples = samples + second_machine(t, rng) * 0.3 * size
        case "clipped":
            level = float(np.quantile(np.abs(samples), 0.9))
            samples = np.clip(samples, -level, level)
        case "silence":
            begin = samples.size // 2
            samples = samples.copy()
            samples[begin : begin + round(machine.rate_hz)] = 0.0
        case "teeth" | "wandering teeth":
            wander = 1e-3 if trouble == "wandering teeth" else 0.0
            samples = samples + teeth(t, rng, wander) * 10.0 ** rng.uniform(0.0, 1.0) * size
    given = Mode(
        machine.frequency_hz * float(rng.uniform(0.995, 1.005)), machine.damping_ratio * float(rng.uniform(0.8, 1.2))
    )
    return samples, MachiningSystem((given,), spindle=Spindle(speed), sensor=Sensor(quantity))


def second_machine(t: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """A motor with its harmonics and a broad hump of noise, 1 rms."""
    turn = float(rng.uniform(20.0, 45.0))
    lines = sum(np.sin(2.0 * np.pi * k * turn * t + rng.uniform(0.0, 6.28)) / k for k in range(1, 6))
    noise = np.fft.rfft(rng.standard_normal(t.size))
    f = np.fft.rfftfreq(t.size, t[1] - t[0])
    hump = np.fft.irfft(noise * np.exp(-0.5 * ((f - rng.uniform(100.0, 1500.0)) / 60.0) ** 2), t.size)
    both = lines / np.std(lines) + hump / np.std(hump)
    return np.asarray(both / np.std(both))


def teeth(t: NDArray[np.float64], rng: np.random.Generator, wander: float) -> NDArray[np.float64]:
    """Some orders of a spindle, whose speed wanders within tenths of a second to seconds, 1 rms."""
    slow = ndimage.gaussian_filter1d(rng.standard_normal(t.size), rng.uniform(0.2, 2.0) / t[1])
    turn = 2.0 * np.pi / TOOTH_S * np.cumsum(1.0 + wander * slow / np.std(slow)) * t[1]
    orders = rng.choice(np.arange(1, 13), int(rng.integers(1, 7)), replace=False)
    lines = sum(rng.uniform(0.1, 1.0) * np.sin(order * turn + rng.uniform(0.0, 6.28)) for order in orders)
    return np.asarray(lines / np.std(lines))


def answer(samples: NDArray[np.float64], model: MachiningSystem) -> Report:
    """As `chatter-monitor diagnose` answers."""
    recorded = recorded_from(samples, 12800.0)
    chattering = conclude_chatter(recorded, model)
    return chattering.report if chattering is not None else conclude(examine(recorded, model)).report


def judged(effect: str, trouble: str, report: Report) -> str:
    """One of right, unknown, missed, wrong."""
    if report.verdict == "unknown":
        return "unknown"
    named = {term.name for term in report.terms}
    true = NAMES[effect]
    if named - TRUE_OF.get(trouble, set()) - {true}:
        return "wrong"
    if true is None or named:
        return "right"
    return "missed"


def main() -> None:
    """Print counts for each effect and trouble, and every confident wrong answer."""
    parser = argparse.ArgumentParser(description="Diagnosis under troubles")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=FIRST_SEED)
    parser.add_argument("--troubles", nargs="*", default=TROUBLES)
    arguments = parser.parse_args()
    total: Counter[str] = Counter()
    print(f"{'':18s}{'right':>18s}{'unknown':>10s}{'missed':>10s}{'wrong':>10s}")
    for trouble in arguments.troubles:
        counts: Counter[str] = Counter()
        for effect in NAMES:
            for seed in range(arguments.first, arguments.first + arguments.seeds):
                report = answer(*case(effect, trouble, seed))
                how = judged(effect, trouble, report)
                counts[how] += 1
                if how == "wrong":
                    print(f"    {effect}, {trouble}, seed {seed}: {report.summary}", flush=True)
        total += counts
        print(
            f"{trouble:18s}" + "".join(f"{counts[how]:10d}" for how in ("right", "unknown", "missed", "wrong")),
            flush=True,
        )
    print(f"{'together':18s}" + "".join(f"{total[how]:10d}" for how in ("right", "unknown", "missed", "wrong")))


if __name__ == "__main__":
    main()
