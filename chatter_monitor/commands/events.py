"""Recorded events."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from chatter_monitor.commands.options import CONFIG, DEBUG, JSON, print_json

if TYPE_CHECKING:
    from chatter_monitor.outlets.event_store import EventStore


EVENTS_DIRECTORY = click.option(
    "--directory", type=click.Path(path_type=Path), help="Where they are; [recorder] directory by default."
)


class ListingGroup(click.Group):
    """Commands of which ``list`` is meant where none is named."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Put ``list`` before arguments that do not begin with a command."""
        if not args or (args[0] not in self.commands and args[0] not in ctx.help_option_names):
            args = ["list", *args]
        return super().parse_args(ctx, args)


@click.group(cls=ListingGroup)
def events() -> None:
    """Recorded events: `events [DIR]` lists them."""


@events.command("list")
@click.argument("directory", metavar="[DIR]", type=click.Path(path_type=Path), required=False)
@CONFIG
@JSON
@DEBUG
def list_events(directory: Path | None, configs: tuple[Path, ...], as_json: bool) -> None:
    """List the recorded events, oldest first."""
    from chatter_monitor.service.events import described, lines

    store = event_store(directory, configs)
    if as_json:
        print_json({"directory": str(store.directory), "events": [described(entry) for entry in store.entries()]})
        return
    for line in lines(store):
        click.echo(line)


@events.command("export")
@click.argument("name", metavar="ID")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Directory to copy it into.")
@EVENTS_DIRECTORY
@CONFIG
@JSON
@DEBUG
def export_event(name: str, out: Path, directory: Path | None, configs: tuple[Path, ...], as_json: bool) -> None:
    """Copy the files of an event: samples, ODPs, JSON."""
    store = event_store(directory, configs)
    copied = store.export(store.find(name), out)
    if as_json:
        print_json({"exported": str(copied)})
        return
    click.echo(f"{copied}: exported.")


@events.command("report")
@click.argument("name", metavar="ID")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="HTML file to write.")
@EVENTS_DIRECTORY
@CONFIG
@JSON
@DEBUG
def report_on_event(name: str, out: Path, directory: Path | None, configs: tuple[Path, ...], as_json: bool) -> None:
    """Write a page on an event: what happened, when, how sure, what to change."""
    from chatter_monitor.service.reporting import report_event

    report_event(event_store(directory, configs).find(name), out)
    if as_json:
        print_json({"report": str(out)})
    else:
        click.echo(f"wrote {out}")


@events.command("shift")
@click.argument("source", metavar="[JSONL|DIR]", type=click.Path(path_type=Path), required=False)
@click.option("--out", type=click.Path(path_type=Path), required=True, help="HTML file to write.")
@CONFIG
@JSON
@DEBUG
def report_on_shift(source: Path | None, out: Path, configs: tuple[Path, ...], as_json: bool) -> None:
    """Write a page on a shift: cutting time, forced, chatter, events, damping over the day.

    From the JSON lines of `replay --jsonl`, or with less to tell from a directory of recorded events, by default
    [recorder] directory.
    """
    from chatter_monitor.service.reporting import report_shift

    shift = report_shift(source or event_store(None, configs).directory, out)
    if as_json:
        print_json({"report": str(out), "events": len(shift.events), "seconds_in": shift.seconds})
    else:
        click.echo(f"wrote {out}")


@events.command("purge")
@click.option("--older-than", "days", type=click.FloatRange(min=0), metavar="DAYS", help="Those recorded before that.")
@click.option("--all", "everything", is_flag=True, help="All of them.")
@click.option("--yes", is_flag=True, help="Really; without it, only say what would go.")
@EVENTS_DIRECTORY
@CONFIG
@JSON
@DEBUG
def purge_events(
    days: float | None, everything: bool, yes: bool, directory: Path | None, configs: tuple[Path, ...], as_json: bool
) -> None:
    """Remove recorded events, but for the protected ones."""
    import time

    from chatter_monitor.service.events import purgeable

    if everything == (days is not None):
        raise click.UsageError("Say which events: either --older-than DAYS or --all.")
    store = event_store(directory, configs)
    chosen = purgeable(store.entries(), now=time.time(), older_than_days=days)
    if yes:
        for entry in chosen:
            store.remove(entry)
    if as_json:
        print_json({"chosen": [entry.id for entry in chosen], "removed": yes})
        return
    for entry in chosen:
        click.echo(f"{entry.id}: {'removed' if yes else 'would be removed'}.")
    if not chosen:
        click.echo("Nothing to remove.")
    elif not yes:
        click.echo("Nothing has been removed; say --yes to do it.")


@events.command("protect")
@click.argument("name", metavar="ID")
@click.option("--off", is_flag=True, help="Not any more.")
@EVENTS_DIRECTORY
@CONFIG
@JSON
@DEBUG
def protect_event(name: str, off: bool, directory: Path | None, configs: tuple[Path, ...], as_json: bool) -> None:
    """Let neither the quota nor purging remove an event."""
    store = event_store(directory, configs)
    store.protect(store.find(name), protected=not off)
    if as_json:
        print_json({"id": name, "protected": not off})
        return
    click.echo(f"{name}: {'not protected any more' if off else 'protected'}.")


def event_store(directory: Path | None, configs: tuple[Path, ...]) -> EventStore:
    """The events of a directory; without one, of the directory that the configuration names."""
    from chatter_monitor.config import load
    from chatter_monitor.outlets.event_store import EventStore

    if directory is None:
        directory = Path(load(configs).recorder.directory)
    return EventStore(directory)
