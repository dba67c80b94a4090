"""Cuts that the model calls stable and that chatter: what `diagnose` names, and what the augmented simulation does.

    python -m benchmarks.self_excited [--cuts 12] [--seed 100]

The cuts are made by the generator of `prove`, which shares no code with the program: a tool enters the cut after 2 of
8 s, at 1.15 to 2.5 times its stability limit. Four models have no regeneration, the next four half of the stability
limit, and so on; modes are off by up to 0.5 % and 20 %. The chip is 1 u thick in truth; that of the augmented model is
the one at which it stays at the amplitude of the recording. Development seeds are below 50; these are from 100.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from chatter_monitor.discrepancy.chatter.conclude import ChatterDiagnosis, conclude_chatter
from chatter_monitor.discrepancy.diagnosis import recorded_from
from chatter_monitor.discrepancy.prove.blind.laws import CONTACT
from chatter_monitor.discrepancy.prove.blind.motion import Hidden, march, noise_factor
from chatter_monitor.physics.lobes import stability_limit
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Mode, Quantity, Sensor, Spindle
from chatter_monitor.physics.stability import rightmost_root
from chatter_monitor.physics.terms import CATALOGUE

FIRST_SEED = 100
RATE_HZ, OVERSAMPLING = 12800.0, 16
SECONDS, ENTRY_S = 8.0, 2.0
SENSORS: tuple[Quantity, ...] = ("displacement", "velocity", "acceleration", "pressure")


@dataclass(frozen=True)
class Chattering:
    """A cut in truth: the mode, the spindle, regeneration, its limit of stability, chip 1 u."""

    mode: Mode
    spindle: Spindle
    coefficient: float
    limit: float
    quantity: Quantity
    noise_rms: float

    def machine(self, coefficient: float) -> MachiningSystem:
        """The linear machine with some regeneration."""
        terms = (AppliedTerm(CATALOGUE["regenerative_delay"], {"coefficient": coefficient}),) if coefficient else ()
        return MachiningSystem((self.mode,), terms, spindle=self.spindle, sensor=Sensor(self.quantity))


def draw(seed: int) -> tuple[Chattering, MachiningSystem]:
    """A cut and the model that calls it stable."""
    rng = np.random.default_rng([seed, 9])
    mode = Mode(float(rng.uniform(250.0, 900.0)), float(rng.uniform(0.015, 0.04)))
    spindle = Spindle(float(rng.uniform(900.0, 3500.0)))
    quantity = SENSORS[seed % 4]
    probe = MachiningSystem(
        (mode,), (AppliedTerm(CATALOGUE["regenerative_delay"], {"coefficient": 1e-3}),), spindle=spindle
    )
    limit = float(stability_limit(probe, np.array([spindle.speed_rpm]))[0])
    cut = Chattering(
        mode, spindle, float(rng.uniform(1.15, 2.5)) * limit, limit, quantity, float(rng.uniform(0.01, 0.06))
    )
    given = Mode(
        mode.frequency_hz * float(rng.uniform(0.995, 1.005)), mode.damping_ratio * float(rng.uniform(0.8, 1.2))
    )
    known = 0.5 * limit if seed // 4 % 2 else 0.0
    model = cut.machine(known)
    return cut, MachiningSystem((given,), model.terms, spindle=spindle, sensor=model.sensor)


def record(cut: Chattering, seed: int, seconds: float = SECONDS) -> NDArray[np.float64]:
    """What the sensor records, 40 dB over its noise, shape (n,)."""
    rng = np.random.default_rng(seed)
    w, zeta = cut.mode.omega, cut.mode.damping_ratio
    step_s = 1.0 / RATE_HZ / OVERSAMPLING
    n = int(seconds * RATE_HZ) * OVERSAMPLING
    factor = noise_factor([(w, zeta)], step_s) * math.sqrt(4.0 * zeta * w**3) * cut.noise_rms
    x, v, force = np.zeros(n), np.zeros(n), np.zeros(n)
    hidden = Hidden(CONTACT, np.array([cut.coefficient, cut.spindle.delay_s, 1.0]), w, from_s=ENTRY_S)
    march(hidden, zeta, step_s, rng.standard_normal((n, 2)) @ factor.T, np.zeros(0), 0.0, x, v, force)
    fine = {"displacement": x, "velocity": v}.get(cut.quantity, np.gradient(v, step_s))
    taps = signal.firwin(48 * OVERSAMPLING + 1, 0.96 / OVERSAMPLING)
    samples = signal.upfirdn(taps, fine, down=OVERSAMPLING)[24 : 24 + int(seconds * RATE_HZ)]
    return np.asarray(samples + 0.01 * np.std(samples) * rng.standard_normal(samples.size))


def growth_per_s(system: MachiningSystem) -> float:
    """Of the rightmost characteristic root."""
    root = rightmost_root(system)
    return -root.damping_ratio * 2.0 * math.pi * root.frequency_hz


def main() -> None:
    """Print a row for each cut, and how many are within 1 %, 20 % and 20 %."""
    parser = argparse.ArgumentParser(description="Regeneration in cuts that the model calls stable")
    parser.add_argument("--cuts", type=int, default=12)
    parser.add_argument("--seed", type=int, default=FIRST_SEED)
    arguments = parser.parse_args()
    print(
        "seed   mode  sensor        rpm  over limit  model   answer            frequency   growth  amplitude  chip (1)"
    )
    rows, held = [], []
    for seed in range(arguments.seed, arguments.seed + arguments.cuts):
        cut, model = draw(seed)
        found = conclude_chatter(recorded_from(record(cut, seed), RATE_HZ), model)
        how = f"{cut.mode.frequency_hz:5.0f}  {cut.quantity:12s} {cut.spindle.speed_rpm:5.0f}"
        how += f"  {cut.coefficient / cut.limit:8.2f}     {'half' if model.terms else 'none'}"
        if found is None or not found.report.terms:
            print(f"{seed:4d}  {how}   {found.report.summary if found else 'no self-excitation seen'}", flush=True)
            rows.append([math.nan] * 3)
            continue
        rows.append(errors(cut, found))
        held.append(intervals_hold(cut, found))
        frequency, growth, amplitude = rows[-1]
        term = found.report.terms[0]
        chip = term.parameters["chip_thickness"].value if "chip_thickness" in term.parameters else math.nan
        said = f"{100 * frequency:+8.2f} % {100 * growth:+7.1f} % {100 * amplitude:+8.1f} %  {chip:6.2f}"
        print(f"{seed:4d}  {how}   {term.name:16s} {said}", flush=True)
    away = np.abs(np.array(rows))
    named = int(np.isfinite(away[:, 1]).sum())
    within = [int(np.sum(away[:, i] < most)) for i, most in enumerate((0.01, 0.2, 0.2))]
    print(f"named {named} of {len(rows)}; frequency within 1 %: {within[0]}, growth within 20 %: {within[1]}, ", end="")
    print(f"amplitude within 20 %: {within[2]}")
    for name in ("frequency", "damping ratio", "coefficient", "chip thickness"):
        said = [each[name] for each in held if name in each]
        print(f"95 % interval of the {name} holds: {sum(said)} of {len(said)}")


def errors(cut: Chattering, found: ChatterDiagnosis) -> list[float]:
    """Relative errors of the augmented simulation: frequency and amplitude in the limit, growth of its root."""
    excited = found.report.self_excitation
    if excited is None or excited.simulated_frequency_hz is None or excited.simulated_amplitude is None:
        return [math.nan, growth_per_s(found.model) / growth_per_s(cut.machine(cut.coefficient)) - 1.0, math.nan]
    return [
        excited.simulated_frequency_hz / excited.frequency_hz - 1.0,
        growth_per_s(found.model) / growth_per_s(cut.machine(cut.coefficient)) - 1.0,
        excited.simulated_amplitude / (excited.amplitude or math.nan) - 1.0,
    ]


def intervals_hold(cut: Chattering, found: ChatterDiagnosis) -> dict[str, bool]:
    """Which 95 % intervals of the report hold the truth; the true chip is 1 u thick."""
    term, after = found.report.terms[0], found.report.calibration.after
    estimates = {
        "frequency": (after["mode.1.frequency_hz"], cut.mode.frequency_hz),
        "damping ratio": (after["mode.1.damping_ratio"], cut.mode.damping_ratio),
        "coefficient": (term.parameters["coefficient"], cut.coefficient),
    }
    if "chip_thickness" in term.parameters:
        estimates["chip thickness"] = (term.parameters["chip_thickness"], 1.0)
    return {name: said.ci95[0] < true < said.ci95[1] for name, (said, true) in estimates.items()}


if __name__ == "__main__":
    main()
