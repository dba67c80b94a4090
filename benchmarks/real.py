"""`diagnose` on real milling and turning against a linear simulation: what is located and named, honestly.

    python -m benchmarks.real [name ...] [--out DIRECTORY]

Nothing is known of these machines but the spindle speed of the turning. The model is one mode where the recording has
its broad peak, with 3 % damping; for milling the tooth frequency is taken from the distance of the side lines (216 Hz)
and of the comb (91.6 Hz, 150 Hz), so that the lag is tested at that and no other.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.model_file import model_text
from chatter_monitor.physics.parts import Mode, Quantity, Sensor, Spindle
from chatter_monitor.service.diagnosing import diagnose_file

DATA = Path(__file__).parents[1] / ".." / "shared" / "data"


class Real(NamedTuple):
    """A recording, its stretch, and the linear model."""

    file: str
    between_s: tuple[float, float]
    frequency_hz: float
    spindle: Spindle
    quantity: Quantity


RECORDINGS = {
    "turning_chatter": Real("turning_c_770_005_10k.wav", (0.0, 1.0), 1180.0, Spindle(770.0), "acceleration"),
    "turning_stable_30": Real("turning_s_320_030_10k.wav", (0.0, 1.0), 950.0, Spindle(320.0), "acceleration"),
    "turning_stable_40": Real("turning_s_320_040_10k.wav", (0.0, 1.0), 1160.0, Spindle(320.0), "acceleration"),
    "milling_chatter": Real("ubc_milling_chatter.flac", (4.5, 17.0), 1050.0, Spindle(216.0 * 15.0, 4), "pressure"),
    "milling_forced": Real("ubc_milling_no_chatter.flac", (0.0, 9.2), 740.0, Spindle(91.6 * 15.0, 4), "pressure"),
    "milling_burst": Real(
        "ubc_milling_accelerometer_5k.wav", (2.0, 5.0), 690.0, Spindle(150.0 * 15.0, 4), "acceleration"
    ),
}


def diagnosed(name: str, out: Path, progress: Callable[[str], None] = lambda _step: None) -> None:
    """Diagnose one recording into a directory, and print what is said."""
    real = RECORDINGS[name]
    out.mkdir(parents=True, exist_ok=True)
    system = MachiningSystem((Mode(real.frequency_hz, 0.03),), spindle=real.spindle, sensor=Sensor(real.quantity))
    model = out / "linear.toml"
    model.write_text(model_text(system))
    start = time.process_time()
    report, _ = diagnose_file(DATA / real.file, model, out, between_s=real.between_s, progress=progress)
    print(f"{name} ({time.process_time() - start:.0f} s): {report.verdict}\n    {report.summary}")
    for warning in report.warnings:
        print(f"    note: {warning}")
    maps = ", ".join(f"{each.name} {each.p_value:.1g}" for each in report.located.maps)
    if maps:
        print(f"    maps: {maps}")
    for other in report.alternatives[:3]:
        print(f"    next: {other.name} {other.evidence_nats:.1f} nats")


def main() -> None:
    """Diagnose the recordings asked for, all by default."""
    parser = argparse.ArgumentParser(description="Real recordings against a linear simulation")
    parser.add_argument("names", nargs="*", metavar="name", help=", ".join(RECORDINGS))
    parser.add_argument("--out", type=Path, default=Path("out/real"))
    arguments = parser.parse_args()
    if not DATA.is_dir():
        print("skipped: the recordings are not here")
        return
    for name in arguments.names or RECORDINGS:
        diagnosed(name, arguments.out / name)


if __name__ == "__main__":
    main()
