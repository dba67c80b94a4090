"""The suite: what each part costs next to yardsticks, and how the cost grows. Minutes on a machine that is free.

Writes everything into one JSON file, of which `python -m docs.performance` makes tables and a picture.

Run: python -m benchmarks [--rounds N] [--out FILE]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from benchmarks import growth, parts
from benchmarks.results import FILE, load_now, results, save


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--out", type=Path, default=FILE)
    arguments = parser.parse_args()
    load_before = load_now()
    costs = parts.costs(arguments.rounds)
    parts.report(costs)
    growths = growth.growths(arguments.rounds)
    growth.report(growths)
    save(results(costs, growths, load_before, arguments.rounds), arguments.out)


if __name__ == "__main__":
    main()
