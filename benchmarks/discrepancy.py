"""Speed of `diagnose` and of its filter, and its answer on the Silverbox with the input hidden.

    python -m benchmarks.discrepancy [speed silverbox]

Development seeds of the engine are below 100; the recordings here are seed 3000.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from chatter_monitor.discrepancy.conclude import conclude
from chatter_monitor.discrepancy.diagnosis import examine, recorded_from
from chatter_monitor.discrepancy.innovations import known_forces
from chatter_monitor.kernels.signatures import Motion, observe
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import Mode, Sensor, Spindle
from tests.discrepancy.machine import Machine, record

SEED = 3000
DATA = Path(__file__).parents[1] / ".." / "shared" / "data"
PUBLISHED_K3, PUBLISHED_K1, SILVERBOX_HZ = 3.915, 0.990, 68.32


def speed() -> None:
    """Seconds for records of 20 and 60 s, and nanoseconds per sample of the filter; second call, kernels compiled."""
    print("\nSpeed (one core)          seconds   mode    samples in band   diagnose   filter per sample")
    for seconds in (20.0, 60.0):
        for frequency in (400.0, 900.0):
            machine = Machine("hardening", 0.05, frequency_hz=frequency, quantity="velocity", seconds=seconds)
            samples = record(machine, SEED)
            modes = (Mode(frequency, machine.damping_ratio),)
            system = MachiningSystem(modes, sensor=Sensor(quantity="velocity"), spindle=Spindle(3000.0))
            for _ in range(2):
                start = time.process_time()
                found = conclude(examine(recorded_from(samples, machine.rate_hz), system))
                took = time.process_time() - start
            inn = found.case.innovations
            n = inn.errors.size
            motion = Motion(*(np.zeros((2, n)) for _ in range(3)))
            start = time.process_time()
            recorded = inn.recorded
            observe(
                inn.observer, known_forces(()), recorded.samples, recorded.missing, inn.settled, np.empty(n), motion
            )
            per_sample = (time.process_time() - start) / n
            names = [term.name for term in found.report.terms]
            figures = f"{seconds:5.0f} s  {frequency:5.0f} Hz {n:12d} {took:14.2f} s {1e9 * per_sample:12.0f} ns"
            print(f"{'':26s}{figures}  {names}")


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
    sections = {"speed": speed, "silverbox": silverbox}
    parser = argparse.ArgumentParser(description="Speed and answers of the discrepancy engine")
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=", ".join(sections))
    for section in parser.parse_args().sections or sections:
        sections[section]()


if __name__ == "__main__":
    main()
