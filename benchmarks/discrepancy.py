"""Speed of `diagnose` and of its filter, effects that act in part only, and the Silverbox with its input hidden.

    python -m benchmarks.discrepancy [speed filter part silverbox]

Development seeds of the engine are below 100; the recordings here are seed 3000.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from chatter_monitor.discrepancy.conclude import conclude
from chatter_monitor.discrepancy.diagnosis import examine, recorded_from
from chatter_monitor.discrepancy.innovations import known_forces
from chatter_monitor.discrepancy.observer import Linear, observer, sized
from chatter_monitor.kernels.observer import AFTER, BEFORE, SMOOTH, SUBSTEPS, Motion, observe
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Mode, Sensor, Spindle
from chatter_monitor.physics.terms import CATALOGUE
from chatter_monitor.reports.diagnosis.alone import concluded
from tests.discrepancy.machine import Machine, record

SEED = 3000
PARTS = 10  # recordings of each effect that acts in part only
DATA = Path(__file__).parents[1] / ".." / "shared" / "data"
PUBLISHED_K3, PUBLISHED_K1, SILVERBOX_HZ = 3.915, 0.990, 68.32


def speed() -> None:
    """Seconds for records of 20 and 60 s, report and pictures included; second call, kernels compiled."""
    print("\nSpeed                     seconds   mode    samples in band     wall, s   processor, s")
    for seconds in (20.0, 60.0):
        for frequency in (400.0, 900.0):
            machine = Machine("hardening", 0.05, frequency_hz=frequency, quantity="velocity", seconds=seconds)
            samples = record(machine, SEED)
            modes = (Mode(frequency, machine.damping_ratio),)
            system = MachiningSystem(modes, sensor=Sensor(quantity="velocity"), spindle=Spindle(3000.0))
            for _ in range(2):
                start, processor = time.perf_counter(), time.process_time()
                found, _, _ = concluded(examine(recorded_from(samples, machine.rate_hz), system), "recording")
                took = time.perf_counter() - start, time.process_time() - processor
            names = [term.name for term in found.report.terms]
            n = found.case.recorded.samples.size
            figures = f"{seconds:5.0f} s  {frequency:5.0f} Hz {n:12d} {took[0]:15.2f} {took[1]:12.2f}"
            print(f"{'':26s}{figures}  {names}")


def filter_cost() -> None:
    """Nanoseconds per sample of the filter next to the same filter in plain C."""
    print("\nFilter, ns per sample           here      in C     ratio   (best of 5, in turns)")
    for name, (here, there) in filter_nanoseconds().items():
        print(f"{name:26s}{here:10.1f}{there:10.1f}{here / there:10.1f}")


def filter_nanoseconds() -> dict[str, tuple[float, float]]:
    """Nanoseconds per sample here and in C, without and with a cubic spring; nothing where there is no C compiler."""
    compiler = shutil.which("cc")
    if compiler is None:
        print("skipped: there is no C compiler")
        return {}
    rate_hz = 5600.0
    linear = Linear((Mode(400.0, 0.02),), "displacement", 1e-3)
    samples = record(Machine("hardening", 0.02, rate_hz=rate_hz), SEED)
    samples = samples / np.std(samples)
    spring = AppliedTerm(CATALOGUE["cubic_stiffness"], {"coefficient": 0.02})
    steady = sized(observer(linear, rate_hz), 0.05)
    n = samples.size
    errors, motion = np.empty(n), Motion(*(np.zeros((2, n)) for _ in range(3)))
    nothing, always = np.zeros(n, dtype=bool), np.ones(n, dtype=bool)
    with tempfile.TemporaryDirectory() as directory:
        program, data = Path(directory) / "observer_limit", Path(directory) / "data"
        source = Path(__file__).with_name("observer_limit.c")
        subprocess.run([compiler, "-O3", "-march=native", "-o", program, source], check=True)
        numbers = (
            steady.transition, steady.begin, steady.end, steady.gain, steady.output, steady.tool,
            *(steady.spread[when + SUBSTEPS : when + SUBSTEPS + SMOOTH] for when in (BEFORE, AFTER)),
            steady.back, [steady.step_s, steady.omega, 0.02], samples,
        )  # fmt: skip
        np.concatenate([np.ravel(each) for each in numbers]).tofile(data)
        said = subprocess.run([program, data], check=True, capture_output=True, text=True).stdout.split()
    found = {}
    for i, (name, terms) in enumerate((("linear", []), ("with a cubic spring", [spring]))):
        best = np.inf
        for _ in range(6):
            start = time.process_time()
            observe(steady, known_forces(terms), samples, nothing, always, errors, motion)
            best = min(best, time.process_time() - start)
        here, there, total = 1e9 * best / n, float(said[2 * i]), float(said[2 * i + 1])
        if not np.isclose(errors @ errors, total, rtol=1e-6):
            raise ArithmeticError(f"not the same filter: {errors @ errors} here, {total} in C")
        found[name] = here, there
    return found


def part() -> None:
    """Effects in a stretch or above an amplitude only: how many are named, and how well they are located.

    Overlap is intersection over union: of the stretches, or of the times at which the tool swings beyond the two
    amplitudes.
    """
    print("\nEffects in part only, 20 s          named   overlap: least  median   at least 0.8")
    rng = np.random.default_rng(SEED)
    for name, effect, strength in (("clearance for 4 s", "clearance", 0.06), ("friction above", "coulomb", 0.06)):
        named, overlaps = 0, []
        for number in range(PARTS):
            begin, above = rng.uniform(1.0, 15.0), rng.uniform(0.9, 1.3)
            machine = Machine(
                effect,
                strength,
                frequency_hz=rng.uniform(150.0, 500.0),
                quantity=("displacement", "velocity")[number % 2],
                between_s=(begin, begin + 4.0) if effect == "clearance" else None,
                above=0.0 if effect == "clearance" else above,
            )
            system = MachiningSystem((Mode(machine.frequency_hz, 0.02),), sensor=Sensor(quantity=machine.quantity))
            found = conclude(examine(recorded_from(record(machine, SEED + number), machine.rate_hz), system))
            wanted = {"clearance": "clearance", "coulomb": "coulomb_friction"}[effect]
            named += [term.name for term in found.report.terms] == [wanted]
            located = found.report.located
            if effect == "clearance":
                [(a, b)] = located.time_s or [(0.0, 0.0)]
                shared, union = min(b, begin + 4.0) - max(a, begin), max(b, begin + 4.0) - min(a, begin)
            else:
                inn = found.case.innovations
                swing = np.hypot(inn.motion.x[0], inn.motion.v[0] / inn.observer.omega)
                low = located.amplitude[0] if located.amplitude else 0.0
                shared, union = np.mean(swing > max(low, above)), np.mean(swing > min(low, above))
            overlaps.append(max(float(shared / union), 0.0))
        least, median, enough = min(overlaps), np.median(overlaps), sum(each >= 0.8 for each in overlaps)
        print(f"{name:32s}{named:3d} of {PARTS:2d}{least:15.2f}{median:8.2f}{enough:8d} of {PARTS}", flush=True)


def silverbox() -> None:
    """Cubic coefficient of the Silverbox, from its output alone, in the published units."""
    print("\nSilverbox, input hidden (published k3 = 3.915)")
    if not DATA.is_dir():
        print("skipped: the recordings are not here")
        return
    output = loadmat(DATA / "silverbox_SNLS80mV.mat")["V2"].ravel()
    unit = (2.0 * np.pi * SILVERBOX_HZ) ** 2 / PUBLISHED_K1
    for name, part in (("arrow", output[:40000]), ("multisine", output[40000:]), ("all", output)):
        found = conclude(examine(recorded_from(part, 610.35), MachiningSystem((Mode(SILVERBOX_HZ, 0.049),))))
        scale = found.model.modes[0].omega ** 2 / unit
        print(f"{name:10s} {found.report.verdict}: {found.report.summary}")
        for term in found.report.terms:
            for key, e in term.parameters.items():
                k3, low, high = scale * e.value, scale * e.ci95[0], scale * e.ci95[1]
                print(f"{'':10s} {term.name} {term.sense} {key}: {k3:.3f} [{low:.3f}, {high:.3f}]")
        ranking = [f"{s.candidate.name} {s.evidence_nats:.1f}" for s in found.case.ranking[:3]]
        print(f"{'':10s} evidence: {', '.join(ranking)}")


def main() -> None:
    """Print the tables asked for, all by default."""
    sections = {"speed": speed, "filter": filter_cost, "part": part, "silverbox": silverbox}
    parser = argparse.ArgumentParser(description="Speed and answers of the discrepancy engine")
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=", ".join(sections))
    for section in parser.parse_args().sections or sections:
        sections[section]()


if __name__ == "__main__":
    main()
