"""The dashboard."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from chatter_monitor.commands.events import event_store
from chatter_monitor.commands.options import CONFIG, DEBUG


@click.command()
@click.option("--connect", "endpoint", metavar="ENDPOINT", help="Where a monitor publishes; its default by default.")
@click.option("--recording", type=click.Path(path_type=Path), help="Replay a recording onto the dashboard.")
@click.option("--event", "event_id", metavar="ID", help="Show a recorded event of --directory.")
@click.option("--diagnosis", type=click.Path(path_type=Path), metavar="DIR", help="Show what `diagnose` wrote.")
@click.option("--save", type=click.Path(path_type=Path), metavar="X.rrd", help="Write a file, without any viewer.")
@click.option("--browser", "viewer", flag_value="browser", help="Show it in a browser instead of a window.")
@click.option("--no-viewer", "viewer", flag_value="none", help="Open none, only say where one can connect.")
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, help="Where viewers connect; any free one by default."
)
@click.option(
    "--memory-limit",
    default="500MB",
    show_default=True,
    help="Of the data kept to scroll back, and of the viewer that is opened; the oldest go first.",
)
@click.option("--server-public-key", type=click.Path(path_type=Path), help="Certificate of a monitor that encrypts.")
@click.option("--client-secret-key", type=click.Path(path_type=Path), help="Own secret certificate for it.")
@click.option("--directory", type=click.Path(path_type=Path), help="Recorded events; [recorder] directory by default.")
@CONFIG
@DEBUG
def dashboard(
    endpoint: str | None,
    recording: Path | None,
    event_id: str | None,
    diagnosis: Path | None,
    save: Path | None,
    viewer: Literal["browser", "none"] | None,
    port: int,
    memory_limit: str,
    server_public_key: Path | None,
    client_secret_key: Path | None,
    directory: Path | None,
    configs: tuple[Path, ...],
) -> None:
    """Show what a running monitor publishes, a recording, a recorded event or a diagnosis.

    Needs rerun: pip install 'chatter-monitor[dashboard]'.
    """
    from chatter_monitor.client import Subscriber
    from chatter_monitor.config import load
    from chatter_monitor.outlets.dashboard.place import Place
    from chatter_monitor.outlets.event_files import read
    from chatter_monitor.service.showing import TOPICS, show_diagnosis, show_live, show_recording

    chosen = [what for what in (endpoint, recording, event_id, diagnosis) if what is not None]
    if len(chosen) > 1:
        raise click.UsageError("Choose one of --connect, --recording, --event and --diagnosis.")

    def say(line: str) -> None:
        click.echo(line, err=True)

    place = Place(save, viewer or "window", port, memory_limit)
    if event_id is not None:
        entry = event_store(directory, configs).find(event_id)
        recording = entry.path / str(read(entry.json).recording)
        configs = (entry.json, *configs)
    if recording is not None:
        show_recording(recording, load(configs), place, say)
    elif diagnosis is not None:
        show_diagnosis(diagnosis, place, say)
    else:
        endpoint = endpoint or load(configs).publish.bind
        with Subscriber(
            endpoint, TOPICS, server_public_key=server_public_key, client_secret_key=client_secret_key
        ) as monitor:
            show_live(monitor.receive, place, endpoint, say)
