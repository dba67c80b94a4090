"""Put the figures of docs/performance.json into docs/performance.md, and draw them: ``python -m docs.performance``."""

from __future__ import annotations

import re
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from benchmarks.results import Cost, Growth, Results, read

PAGE = Path(__file__).with_suffix(".md")
PICTURE = PAGE.parent / "pictures" / "performance.png"
RATE_HZ = 12_800.0
MEMORY = "seconds of signal"  # along which it must be flat


def main() -> None:
    """Write page and picture where they stand."""
    found = read()
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8"), found), encoding="utf-8")
    draw(found, PICTURE)


def filled(page: str, found: Results) -> str:
    """The page with each part between ``<!-- name -->`` and ``<!-- end -->`` made anew."""
    parts = {"run": _run(found), "costs": _costs(found.costs), "growths": _growths(found.growths)}
    for name, text in parts.items():
        page, count = re.subn(
            rf"(<!-- {name} -->\n).*?(<!-- end -->)",
            lambda marks, text=text: marks[1] + text + marks[2],
            page,
            flags=re.S,
        )
        if count != 1:
            raise ValueError(f"the page has {count} places for {name}")
    return page


def _run(found: Results) -> str:
    before, after = found.load
    machine = f"{found.date}, {found.processor}, {found.cores} cores, least of {found.rounds} rounds."
    return f"{machine} Load, this run's own included: {before} in the minute before it, {after} in its last.\n"


def _costs(costs: list[Cost]) -> str:
    lines = ["| part | ns a sample | times real time | next to |", "|---|---|---|---|"]
    for cost in costs:
        ratios = [f"{_short(cost.ns / ns)} times {name}" for name, ns in cost.yardsticks_ns.items()]
        lines.append(f"| {cost.part} | {cost.ns:.0f} | {1e9 / (cost.ns * RATE_HZ):.0f} | {', '.join(ratios)} |")
    return "\n".join(lines) + "\n"


def _short(ratio: float) -> str:
    return f"{ratio:.2g}" if ratio < 10 else f"{ratio:.0f}"


def _growths(growths: list[Growth]) -> str:
    lines = ["| cost of | along | from, to | processor seconds | exponent | memory, MB |", "|---|---|---|---|---|---|"]
    for growth in growths:
        memory = growth.resident_mb
        span = "" if memory is None else f"{memory[0]:.0f} to {memory[-1]:.0f}"
        lines.append(
            f"| {growth.cost} | {growth.along} | {growth.at[0]:g}, {growth.at[-1]:g} "
            f"| {growth.seconds[0]:.2g} to {growth.seconds[-1]:.2g} | {growth.exponent:.2f} | {span} |"
        )
    lines += ["", f"![Cost and memory]({PICTURE.relative_to(PAGE.parent)})"]
    return "\n".join(lines) + "\n"


def draw(found: Results, path: Path) -> None:
    """Draw cost along each thing that grows, over the cost at its least value, and memory along the length."""
    figure, (cost, memory) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    for growth in found.growths:
        label = f"{growth.cost} by {growth.along.partition(',')[0]}: exponent {growth.exponent:.2f}"
        cost.loglog(*_over_first(growth), "o-", label=label, base=2)
    _linear(cost)
    cost.set(xlabel="over the least", ylabel="processor time over that at the least")
    figure.legend(fontsize=7, loc="outside upper left", ncols=4)
    (flat,) = (growth for growth in found.growths if growth.along == MEMORY)
    gained_mb = flat.resident_mb or [0.0]
    memory.semilogx(flat.at, gained_mb, "o-", base=2)
    room = (0.0, 2.0 * max(gained_mb))
    memory.set(xlabel="seconds of signal so far, one channel", ylabel="memory gained, MB", ylim=room)
    figure.savefig(path, dpi=120, metadata={"Software": None})
    plt.close(figure)


def _over_first(growth: Growth) -> tuple[list[float], list[float]]:
    return [at / growth.at[0] for at in growth.at], [seconds / growth.seconds[0] for seconds in growth.seconds]


def _linear(axes: Axes) -> None:
    axes.axline((1, 1), (2, 2), color="0.7", linestyle=":", label="linear")


if __name__ == "__main__":
    main()
