"""Score the monitor on simulated cuts.

Run: python -m benchmarks.verdict [--split development|report] [--cuts N] [--first N]
    [--speed known|unknown|both|stale] [--out DIR]
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import track

from benchmarks.verdict.cache import cached_cuts
from benchmarks.verdict.curves import detectors
from benchmarks.verdict.monitor import listen, stale
from benchmarks.verdict.pictures import draw_curves, draw_reliability, draw_worst
from benchmarks.verdict.report import as_results, show
from benchmarks.verdict.scoring import Heard


def main() -> None:
    """Generate, listen, score, print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.verdict", description=__doc__)
    parser.add_argument("--split", choices=("development", "report"), default="development")
    parser.add_argument("--cuts", type=int, default=420, help="how many, families in turn (default 420)")
    parser.add_argument("--first", type=int, default=0, help="number of the first (default 0)")
    told = "stale: that of another cut is told (default both, known and unknown)"
    parser.add_argument("--speed", choices=("known", "unknown", "both", "stale"), default="both", help=told)
    parser.add_argument("--out", type=Path, help="directory for results.json and pictures")
    parser.add_argument("--cache", type=Path, help="directory to keep generated cuts in")
    chosen = parser.parse_args()
    console = Console(width=150)
    console.print(f"Split: {chosen.split}, {chosen.cuts} cuts from {chosen.first} on")
    speeds = ("known", "unknown") if chosen.speed == "both" else (chosen.speed,)
    heard: dict[str, list[Heard]] = {f"speed {speed}": [] for speed in speeds}
    made = cached_cuts(chosen.split, chosen.cuts, chosen.cache, chosen.first)
    for cut in track(made, total=chosen.cuts, description="cuts", console=Console(stderr=True)):
        told_of = {"known": (cut.nominal_rpm, cut.teeth), "unknown": None, "stale": stale(cut)}
        for speed, opinions in zip(speeds, heard.values(), strict=True):
            opinions.append(Heard(cut, listen(cut, told_of[speed])))
    found = {name: detectors(list_of, speed_known=name == "speed known") for name, list_of in heard.items()}
    results = {name: as_results(list_of, found[name]) for name, list_of in heard.items()}
    for name, result in results.items():
        show(console, name, result)
    if chosen.out is not None:
        chosen.out.mkdir(parents=True, exist_ok=True)
        document = {"split": chosen.split, "first": chosen.first, "cuts": chosen.cuts, "results": results}
        (chosen.out / "results.json").write_text(json.dumps(_finite(document), indent=1, allow_nan=False))
        for name, list_of in heard.items():
            stem = name.replace(" ", "_")
            draw_curves(name, found[name], list_of, chosen.out / f"curves_{stem}.png")
            draw_reliability(name, results[name]["reliability"], chosen.out / f"reliability_{stem}.png")
            draw_worst(name, list_of, chosen.out / f"worst_{stem}.png")
        console.print(f"Results and pictures: {chosen.out}")


def _finite(value: Any) -> Any:
    """Replace infinite lags by null: JSON has no infinity, and `never` counts them."""
    if isinstance(value, dict):
        return {key: _finite(part) for key, part in value.items()}
    if isinstance(value, list):
        return [_finite(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


if __name__ == "__main__":
    main()
