"""Several recordings of one machine: process damping told from structural damping, and named only where it is.

    python -m benchmarks.several [--machines 40]

Each machine is cut at four spindle speeds, 20 s each; what is shared follows as in `chatter-monitor diagnose A B C D`.
Development seeds are below 50; the machines here have seeds from 100.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from chatter_monitor.discrepancy.diagnosis import in_band, recorded_from
from chatter_monitor.discrepancy.linear import fit_base
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.discrepancy.together.shared import Shared, seen, share
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Cut, Mode, Sensor, Spindle
from chatter_monitor.physics.simulate import simulate
from chatter_monitor.physics.terms import CATALOGUE

FIRST_SEED = 100
SPEEDS_RPM = (600.0, 1000.0, 1800.0, 3000.0)
DIAMETER_M, WIDTH_M = 0.05, 0.002
SECONDS, RATE_HZ, SNR = 20.0, 12800.0, 50.0


def machine(seed: int, doubled: float, regenerates: bool) -> tuple[Mode, float, float, Shared]:
    """A machine whose damping in the slowest cut is `doubled` times that of its structure, and what its cuts show.

    Returns
    -------
    Mode, float, float
        The structure, the true C, and the coefficient of its delay.
    Shared
        What was found.
    """
    rng = np.random.default_rng(seed)
    mode = Mode(float(rng.uniform(250.0, 700.0)), float(rng.uniform(0.01, 0.03)))
    cuts = [Cut(f"{rpm:g}", rpm, math.pi * DIAMETER_M * rpm / 60.0, WIDTH_M) for rpm in SPEEDS_RPM]
    slowest = cuts[0].cutting_speed_m_s or 1.0
    coefficient = (doubled - 1.0) * 2.0 * mode.damping_ratio * mode.omega * slowest / WIDTH_M
    regeneration = 0.4 * mode.damping_ratio if regenerates else 0.0
    given = Mode(
        mode.frequency_hz * float(rng.uniform(0.995, 1.005)), mode.damping_ratio * float(rng.uniform(0.8, 1.2))
    )
    bases = []
    for i, cut in enumerate(cuts):
        parameters = {"coefficient": coefficient, "width_m": WIDTH_M, "cutting_speed_m_s": cut.cutting_speed_m_s or 1.0}
        terms = [AppliedTerm(CATALOGUE["process_damping"], parameters)]
        if regenerates:
            terms.append(AppliedTerm(CATALOGUE["regenerative_delay"], {"coefficient": regeneration}))
        spindle, sensor = Spindle(cut.speed_rpm), Sensor("velocity")
        system = MachiningSystem((mode,), tuple(terms), spindle=spindle, sensor=sensor)
        samples = simulate(system, SECONDS, 10 * seed + i, RATE_HZ, settle_s=1.0).signal
        samples = samples + float(np.std(samples)) / SNR * rng.standard_normal(samples.size)
        _, recorded = in_band(
            recorded_from(samples, RATE_HZ), MachiningSystem((given,), spindle=spindle, sensor=sensor)
        )
        bases.append(fit_base(recorded, Linear((given,), "velocity", 1e-3, spindle=spindle)))
    return mode, coefficient, regeneration, share(seen(bases, cuts))


def main() -> None:
    """Print a row for each strength, with and without regeneration."""
    parser = argparse.ArgumentParser(description="Process damping from recordings at several speeds")
    parser.add_argument("--machines", type=int, default=40, help="of each kind")
    parser.add_argument("--seed", type=int, default=FIRST_SEED, help="of the first machine")
    arguments = parser.parse_args()
    print(
        "damping of the slowest cut                  named   C in its 95 %, error   "
        "structure in its 95 %, error   disagree"
    )
    for regenerates in (False, True):
        for doubled in (1.0, 1.5, 2.0, 3.0):
            named = disagree = inside = inside_structure = 0
            errors, structure_errors = [], []
            for seed in range(arguments.seed, arguments.seed + arguments.machines):
                mode, coefficient, _, found = machine(seed, doubled, regenerates)
                named += found.process_damped
                disagree += min(found.disagreement.values()) < 1e-5
                value, sd = found.process_damping or (math.nan, math.nan)
                inside += abs(value - coefficient) < 1.96 * sd
                errors.append(abs(value / coefficient - 1.0) if coefficient else math.nan)
                if found.process_damped or not coefficient:
                    away = found.modes[0].damping_ratio - mode.damping_ratio
                    inside_structure += abs(away) < 1.96 * float(found.damping_sd[0])
                    structure_errors.append(abs(away) / mode.damping_ratio)
            count, told = arguments.machines, max(len(structure_errors), 1)
            error = f"{100 * np.median(errors):.0f} %" if doubled > 1.0 else ""
            kind = f"{doubled:.1f} x structure{', regenerates' if regenerates else ''}"
            print(
                f"{kind:42s} {named:3d}/{count}   {inside:3d}/{count} {error:>6s}          "
                f"{inside_structure:3d}/{told} {100 * np.median(structure_errors or [math.nan]):5.1f} %"
                f"            {disagree:d}/{count}",
                flush=True,
            )


if __name__ == "__main__":
    main()
