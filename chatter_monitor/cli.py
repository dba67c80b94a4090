"""The command line. What a command needs is imported when it runs, so that ``--help`` is quick."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

CONFIG = click.option(
    "--config", "configs", type=click.Path(path_type=Path), multiple=True, help="Machine configuration; later ones win."
)
JSON = click.option("--json", "as_json", is_flag=True, help="Print for machines instead of people.")
DEBUG = click.option("--debug", is_flag=True, expose_value=False, help="Show where an error comes from.")


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="chatter-monitor")
def cli() -> None:
    """Listen to a machine tool: operational damping and frequency, and whether it chatters."""


@cli.command()
@click.argument("file", type=click.Path(path_type=Path))
@CONFIG
@click.option("--spindle-rpm", type=float, help="Spindle speed, if it is known.")
@click.option("--teeth", type=int, help="Cutting edges of the tool (1 for turning).")
@click.option("--pace", type=click.Choice(["fast", "real"]), default="fast", help="As fast as possible, or as it was.")
@click.option("--publish", is_flag=True, help="Publish over ZeroMQ as well.")
@click.option(
    "--wait-subscriber",
    type=click.FloatRange(min=0),
    default=0.0,
    metavar="SECONDS",
    help="With --publish: wait so long for a first subscriber, so that it misses nothing.",
)
@click.option("--jsonl", type=click.Path(path_type=Path), help="Write every message to a file of JSON lines.")
@click.option(
    "--odp", "odp_table", type=click.Path(path_type=Path), help="Write every sample's ODPs to a Parquet file."
)
@JSON
@DEBUG
def replay(
    file: Path,
    configs: tuple[Path, ...],
    spindle_rpm: float | None,
    teeth: int | None,
    pace: str,
    publish: bool,
    wait_subscriber: float,
    jsonl: Path | None,
    odp_table: Path | None,
    as_json: bool,
) -> None:
    """Monitor a recording: WAV, FLAC, any rate, any number of channels."""
    from chatter_monitor.config import load
    from chatter_monitor.service.replay import Replay

    spindle: dict[str, Any] = {"speed_rpm": spindle_rpm, "teeth": teeth}
    settings = load(configs, {"spindle": {key: value for key, value in spindle.items() if value is not None}})
    Replay(
        file=file,
        settings=settings,
        real_time=pace == "real",
        publish=publish,
        wait_subscriber_s=wait_subscriber,
        jsonl=jsonl,
        odp_table=odp_table,
    ).run(as_json=as_json)
