"""Score the monitor on simulated cuts.

Run: python -m benchmarks.verdict [--split development|report] [--cuts N] [--speed known|unknown|both] [--out DIR]
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
from benchmarks.verdict.monitor import listen
from benchmarks.verdict.pictures import draw_curves, draw_reliability, draw_worst
from benchmarks.verdict.report import as_results, show
from benchmarks.verdict.scoring import Heard


def main() -> None:
    """Generate, listen, score, print."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.verdict", description=__doc__)
    parser.add_argument("--split", choices=("development", "report"), default="development")
    parser.add_argument("--cuts", type=int, default=420, help="how many, families in turn (default 420)")
    parser.add_argument("--speed", choices=("known", "unknown", "both"), default="both")
    parser.add_argument("--out", type=Path, help="directory for results.json and pictures")
    parser.add_argument("--cache", type=Path, help="directory to keep generated cuts in")
    chosen = parser.parse_args()
    console = Console(width=150)
    console.print(f"Split: {chosen.split}, {chosen.cuts} cuts")
    known = {"known": (True,), "unknown": (False,), "both": (True, False)}[chosen.speed]
    heard: dict[str, list[Heard]] = {f"speed {'known' if k else 'unknown'}": [] for k in known}
    made = cached_cuts(chosen.split, chosen.cuts, chosen.cache)
    for cut in track(made, total=chosen.cuts, description="cuts", console=Console(stderr=True)):
        for k, opinions in zip(known, heard.values(), strict=True):
            opinions.append(Heard(cut, listen(cut, speed_known=k)))
    found = {name: detectors(list_of, speed_known=k) for k, (name, list_of) in zip(known, heard.items(), strict=True)}
    results = {name: as_results(list_of, found[name]) for name, list_of in heard.items()}
    for name, result in results.items():
        show(console, name, result)
    if chosen.out is not None:
        chosen.out.mkdir(parents=True, exist_ok=True)
        document = {"split": chosen.split, "cuts": chosen.cuts, "results": results}
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
