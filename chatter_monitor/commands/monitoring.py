"""Listening: to a recording, to a sound device; and what there is to listen with."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from chatter_monitor.commands.archives import do_archive, refuse_given
from chatter_monitor.commands.options import CONFIG, DEBUG, JOBS, JSON, SCHEDULER, print_json


@click.command()
@click.argument("files", metavar="FILE...", nargs=-1, required=True)
@CONFIG
@click.option("--spindle-rpm", type=float, help="Spindle speed, if it is known.")
@click.option("--teeth", type=int, help="Cutting edges of the tool (1 for turning).")
@click.option("--model", type=click.Path(path_type=Path), help="Model file to compare the signal with while it runs.")
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
@click.option("--record", type=click.Path(path_type=Path), help="Record events in a directory, as the daemon would.")
@click.option("--out", type=click.Path(path_type=Path), help="An archive's results: a data set of Parquet tables.")
@JOBS
@SCHEDULER
@JSON
@DEBUG
@click.pass_context
def replay(
    context: click.Context,
    files: tuple[str, ...],
    configs: tuple[Path, ...],
    spindle_rpm: float | None,
    teeth: int | None,
    model: Path | None,
    pace: str,
    publish: bool,
    wait_subscriber: float,
    jsonl: Path | None,
    odp_table: Path | None,
    record: Path | None,
    out: Path | None,
    jobs: int | None,
    scheduler: str | None,
    as_json: bool,
) -> None:
    """Monitor a recording: WAV, FLAC, any rate, any number of channels.

    A recorded event (see `events`) is replayed with the settings that it was recorded with; --config changes them.

    With --out, monitor an archive: files, folders, globs, also as URLs. Run again, it does only what is left to do.
    """
    from chatter_monitor.config import load, merged_tables
    from chatter_monitor.outlets.event_files import recorded_event
    from chatter_monitor.service.replay import Replay

    spindle: dict[str, Any] = {"speed_rpm": spindle_rpm, "teeth": teeth}
    overrides = {"spindle": {key: value for key, value in spindle.items() if value is not None}}
    if model is not None:
        overrides["model"] = {"file": str(model)}
    if out is not None:
        refuse_given(context, "--out", "model", "pace", "publish", "wait_subscriber", "jsonl", "odp_table", "record")
        from chatter_monitor.service.archive.replays import Replays

        do_archive(files, Replays(merged_tables(configs, overrides)), out, jobs, scheduler, as_json)
        return
    refuse_given(context, "a single recording (say --out DIR)", "jobs", "scheduler")
    file = Path(files[0])
    if len(files) > 1 or file.is_dir() or "://" in files[0]:
        is_folder = " Is a directory:" if file.is_dir() else ""
        raise click.UsageError(f"{files[0]}:{is_folder} say with --out DIR where an archive's results go.")
    if recorded_event(file) is not None:
        configs = (file.with_suffix(".json"), *configs)
    settings = load(configs, overrides)
    Replay(
        file=file,
        settings=settings,
        real_time=pace == "real",
        publish=publish,
        wait_subscriber_s=wait_subscriber,
        jsonl=jsonl,
        odp_table=odp_table,
        record=record,
    ).run(as_json=as_json)


@click.command()
@CONFIG
@DEBUG
def run(configs: tuple[Path, ...]) -> None:
    """Listen to a sound device: the daemon. SIGTERM stops it, SIGHUP has it read its configuration again."""
    import os

    from chatter_monitor.service.daemon import run_daemon
    from chatter_monitor.service.journal import journal

    with journal(os.environ):
        run_daemon(configs, os.environ)


@click.command()
@CONFIG
@JSON
@DEBUG
def devices(configs: tuple[Path, ...], as_json: bool) -> None:
    """List the sound devices that can be listened to, at which rates, and which one the configuration chooses."""
    import msgspec

    from chatter_monitor.config import load
    from chatter_monitor.service.devices import lines, listing

    found = listing(load(configs))
    if as_json:
        print_json(msgspec.to_builtins(found))
    else:
        for line in lines(found):
            click.echo(line)
    if not found.devices:
        raise SystemExit(3)


@click.command()
@click.option("--running", is_flag=True, help="Only ask the running monitor whether it hears (a health check).")
@CONFIG
@JSON
@DEBUG
def doctor(configs: tuple[Path, ...], running: bool, as_json: bool) -> None:
    """Say what is wrong with this installation and what to do about it; exit code 3 if anything is."""
    import msgspec

    from chatter_monitor.config import load
    from chatter_monitor.service import doctor

    findings = []
    for finding in [doctor.running(load(configs))] if running else doctor.examine(configs):
        findings.append(finding)
        if not as_json:
            click.echo(doctor.line(finding))  # as they come: some take seconds
    wrong = any(finding.state == "wrong" for finding in findings)
    if as_json:
        print_json({"ok": not wrong, "findings": msgspec.to_builtins(findings)})
    if wrong:
        raise SystemExit(3)
