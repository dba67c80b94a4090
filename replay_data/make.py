"""Make the simulated recordings of this directory: ``python -m replay_data.make``."""

from __future__ import annotations

import json
from pathlib import Path

import soundfile

from chatter_monitor.physics import cuts
from chatter_monitor.physics.simulate import simulate

CUTS = {
    "stable_turning": (cuts.stable_turning(), 10.0, 1),
    "bar_turning": (cuts.bar_turning(20.0), 20.0, 2),
    "forced_milling": (cuts.forced_milling(), 10.0, 3),
}
SAMPLE_RATE_HZ = 12800


def main(directory: Path = Path(__file__).parent) -> None:
    """Write NAME.flac (16 bit) and NAME.json (the truth) for every cut."""
    for name, (system, duration_s, seed) in CUTS.items():
        simulation = simulate(system, duration_s, seed, SAMPLE_RATE_HZ, settle_s=0.5)
        soundfile.write(directory / f"{name}.flac", simulation.signal, SAMPLE_RATE_HZ, subtype="PCM_16")
        text = json.dumps(simulation.truth.to_json(), indent=1)
        (directory / f"{name}.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
