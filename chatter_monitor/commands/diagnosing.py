"""Simulation against recording, and the blind proof of it."""

from __future__ import annotations

from pathlib import Path

import click

from chatter_monitor.commands.archives import do_archive, is_archive, refuse_given
from chatter_monitor.commands.options import BETWEEN, CHANNEL, DEBUG, JOBS, JSON, SCHEDULER, print_json, print_report


@click.command()
@click.argument("files", nargs=-1, required=True, metavar="RECORDING...")
@click.option("--model", type=click.Path(path_type=Path), required=True, help="Model file that is to explain it.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Directory for report and model.")
@CHANNEL
@BETWEEN
@click.option(
    "--input",
    "driven_by",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Recording of the force, if there is one.",
)
@click.option(
    "--input-channel", type=click.IntRange(min=0), default=0, show_default=True, help="Its channel, counted from 0."
)
@JOBS
@SCHEDULER
@JSON
@DEBUG
@click.pass_context
def diagnose(
    context: click.Context,
    files: tuple[str, ...],
    model: Path,
    out: Path,
    channel: int,
    between_s: tuple[float, float] | None,
    driven_by: Path | None,
    input_channel: int,
    jobs: int | None,
    scheduler: str | None,
    as_json: bool,
) -> None:
    """Find out where a recording differs from a simulation, and which physics the simulation lacks.

    Writes report.json, report.html and model.toml, the augmented model, which `simulate` runs. Several recordings share
    one machine; a [[cut]] in the model file says at which speed each was recorded.

    Folders, globs and URLs are an archive: each of its recordings is diagnosed by itself, into a data set with a page
    of all. Run again, it does only what is left to do.
    """
    from chatter_monitor.errors import InputError
    from chatter_monitor.service.diagnosing import diagnose_file, diagnose_files, lines

    def progress(step: str) -> None:
        click.echo(f"{step} ...", err=True)

    if any(is_archive(file) for file in files):
        from chatter_monitor.service.archive.diagnoses import Diagnoses

        refuse_given(context, "folders, globs and URLs", "driven_by", "input_channel")
        do_archive(files, Diagnoses.of(model, channel, between_s), out, jobs, scheduler, as_json)
        return
    refuse_given(context, "single recordings (give their folder)", "jobs", "scheduler")
    recordings = [Path(file) for file in files]
    if len(recordings) > 1:
        if driven_by is not None:
            raise InputError("--input goes with one recording only", got=f"{len(files)} recordings")
        report, written = diagnose_files(
            recordings, model, out, channel=channel, between_s=between_s, progress=progress
        )
    else:
        report, written = diagnose_file(
            recordings[0],
            model,
            out,
            channel=channel,
            between_s=between_s,
            driven_by=driven_by,
            input_channel=input_channel,
            progress=progress,
        )
    print_report(as_json, report.to_json, lines(report), written)


@click.command()
@click.option("--cases", type=click.IntRange(min=1), default=300, show_default=True, help="How many to draw.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Same seed, same cases.")
@click.option("--out", type=click.Path(path_type=Path), required=True, help="Directory; what is done there stays done.")
@click.option("--jobs", type=click.IntRange(min=1), default=1, show_default=True, help="Processes.")
@click.option("--so-far", is_flag=True, help="Report the cases that are diagnosed already; diagnose none.")
@JSON
@DEBUG
def prove(cases: int, seed: int, out: Path, jobs: int, so_far: bool, as_json: bool) -> None:
    """Hide physics in recordings, seal the key, diagnose them blindly, open the key, report."""
    from chatter_monitor.reports.proof import lines
    from chatter_monitor.service.diagnosing import diagnose_file, true_gain
    from chatter_monitor.service.proving import Proving

    proving = Proving(out, cases, seed, diagnose_file, jobs, true_gain)
    proof = proving.so_far() if so_far else proving.run(lambda line: click.echo(line, err=as_json))
    if as_json:
        print_json(proof.score)
        return
    if len(proof.judged) < proof.cases:
        click.echo(f"the first {len(proof.judged)} of {proof.cases} cases; the key's SHA-256 is {proof.key_sha256}")
    for line in lines(proof.score):
        click.echo(line)
    click.echo(f"wrote {out / 'proof.json'} and {out / 'proof.html'}")
