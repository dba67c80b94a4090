"""Make the paper's figures and the page about them: ``python -m docs.paper [--out DIRECTORY]``."""

from __future__ import annotations

import time
from pathlib import Path

import click

from docs.paper import damping, milling, noise, operational, stiffness, turning
from docs.paper.drawing import DPI
from docs.paper.page import page
from docs.paper.plate import Plate

GROUPS = (noise, stiffness, damping, turning, operational, milling)


def build(directory: Path) -> list[Plate]:
    """Draw every figure into ``directory/figures`` and write ``directory/README.md``, with a line on each figure."""
    pictures = directory / "figures"
    pictures.mkdir(parents=True, exist_ok=True)
    start = time.perf_counter()
    plates = []
    for group in GROUPS:
        for plate in group.plates():
            plate.figure.savefig(pictures / plate.file, dpi=DPI)
            click.echo(f"{time.perf_counter() - start:5.1f} s  figure {plate.label}: {plate.title}")
            plates.append(plate)
    (directory / "README.md").write_text(page(plates), encoding="utf-8")
    return plates


@click.command()
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path(__file__).parent,
    help="Where README.md and figures/ are written.",
)
def main(out: Path) -> list[Plate]:
    """Make the figures of Nicolescu and Archenti (2013) again."""
    return build(out)


if __name__ == "__main__":
    main()
