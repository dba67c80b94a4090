"""`diagnose --input` on machines with published answers: Silverbox, EMPS, a band brake with backlash.

    python -m benchmarks.driven [silverbox emps rig]

Every second half-second is held out. "force" is the rms of what is left of the measured force on held-out stretches
over its rms there; "free run" the rms difference between the recording and a simulation that the measured force
drives, over the rms of the recording, held out too, first 60 s. Coefficients are in units of the input.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.diagnosis import recorded_from
from chatter_monitor.discrepancy.driven.case import examine_driven
from chatter_monitor.discrepancy.driven.conclude import conclude_driven
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import Mode

DATA = Path(__file__).parents[1] / ".." / "shared" / "data"
Experiment = tuple[Recorded, Recorded, MachiningSystem]


def silverbox(part: slice = slice(None)) -> Experiment:
    """Electronic Duffing oscillator: k1 = 0.990, k3 = 3.915; linear fit 13.17 %, with the cubic 1.11 % (published)."""
    file = loadmat(DATA / "silverbox_SNLS80mV.mat")
    output, force = (recorded_from(file[name].ravel()[part], 610.35) for name in ("V2", "V1"))
    return output, force, MachiningSystem((Mode(68.32, 0.049),))


def emps() -> Experiment:
    """Drive with friction: mass 95.11 kg, Coulomb 20.39 N; 17.0 % of the force left, 3.96 % with it (published)."""
    file = loadmat(DATA / "DATA_EMPS.mat")
    force = file["vir"].ravel() * float(file["gtau"].item())
    return recorded_from(file["qm"].ravel(), 1000.0), recorded_from(force, 1000.0), MachiningSystem((Mode(0.5, 0.05),))


def rig(path: Path) -> Experiment:
    """Band brake: friction with backlash, in inches and kip."""
    file = np.load(path)
    moved, force = (recorded_from(file[name].astype(float), 1024.0) for name in ("disp_in", "force_kip"))
    return moved, force, MachiningSystem((Mode(5.0, 0.05),))


def show(name: str, experiment: Experiment) -> None:
    """One experiment, diagnosed."""
    report = conclude_driven(examine_driven(*experiment)).report
    closed = report.force_balance
    if closed is None:
        raise RuntimeError("a driven diagnosis without its force balance")
    force = f"force {100 * closed.residual_before:5.2f} -> {100 * closed.residual_after:5.2f} %"
    free = ""
    if closed.free_run_error_before is not None and closed.free_run_error_after is not None:
        free = f"  free run {100 * closed.free_run_error_before:5.2f} -> {100 * closed.free_run_error_after:5.3f} %"
    print(f"{name:38s} {report.verdict:16s} {force}{free}")
    for term in report.terms:
        for key, e in term.parameters.items():
            if key.endswith("_as_force"):
                print(f"    {term.name} {key}: {e.value:.4g} [{e.ci95[0]:.4g}, {e.ci95[1]:.4g}]")
    linear = [f"{key.split('.')[1]} {e.value:.4g}" for key, e in report.calibration.after.items() if "input" in key]
    others = [f"{a.name} {a.evidence_nats:.0f}" for a in report.alternatives[:3]]
    print(f"    {', '.join(linear)}; next: {', '.join(others)}")


def main() -> None:
    """Print the experiments asked for, all by default."""
    parser = argparse.ArgumentParser(description="Diagnosis with a measured force")
    parser.add_argument("sections", nargs="*", metavar="SECTION", help="silverbox, emps, rig")
    sections = parser.parse_args().sections or ["silverbox", "emps", "rig"]
    if not DATA.is_dir():
        print("skipped: the recordings are not here")
        return
    if "silverbox" in sections:
        for name, part in (("arrow", slice(40000)), ("multisine", slice(40000, None))):
            show(f"Silverbox, {name}", silverbox(part))
    if "emps" in sections:
        show("EMPS", emps())
    if "rig" in sections:
        for path in sorted((DATA / "friction_backlash").glob("*.npz")):
            show(path.stem, rig(path))


if __name__ == "__main__":
    main()
