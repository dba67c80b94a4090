"""Options that several commands have, and how a command prints for machines."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import click

CONFIG = click.option(
    "--config", "configs", type=click.Path(path_type=Path), multiple=True, help="Machine configuration; later ones win."
)
CHANNEL = click.option("--channel", type=click.IntRange(min=0), default=0, show_default=True, help="Counted from 0.")
BETWEEN = click.option(
    "--between", "between_s", type=(float, float), metavar="BEGIN END", help="Stretch to look at, in seconds."
)
JOBS = click.option(
    "--jobs", type=click.IntRange(min=1), help="Processes for an archive; one per processor by default."
)
SCHEDULER = click.option("--scheduler", metavar="ADDRESS", help="A Dask cluster that is to do an archive instead.")
JSON = click.option("--json", "as_json", is_flag=True, help="Print for machines instead of people.")
DEBUG = click.option("--debug", is_flag=True, expose_value=False, help="Show where an error comes from.")


def print_json(value: object) -> None:
    """Print a value as JSON."""
    import msgspec

    click.echo(msgspec.json.encode(value))


def print_report(as_json: bool, to_json: Callable[[], bytes], lines: Iterable[str], written: Iterable[Path]) -> None:
    """Print a report as JSON, or its lines and which files have been written."""
    if as_json:
        click.echo(to_json())
        return
    for line in lines:
        click.echo(line)
    for path in written:
        click.echo(f"wrote {path}")
