"""Commands that take many recordings instead of one."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from chatter_monitor.commands.options import print_json

if TYPE_CHECKING:
    from chatter_monitor.service.archive.dataset import R
    from chatter_monitor.service.archive.kind import Kind


def do_archive(
    files: tuple[str, ...], kind: Kind[R], out: Path, jobs: int | None, scheduler: str | None, as_json: bool
) -> None:
    """Do an archive, print what came of it, and end with the error that there was, if any.

    Raises
    ------
    UsageError
        With both jobs and a scheduler.
    """
    import msgspec
    from rich.console import Console

    from chatter_monitor.service.archive.archive import PAGE, Archive

    if jobs is not None and scheduler is not None:
        raise click.UsageError("Choose one of --jobs and --scheduler.")
    done = Archive(files, kind, out, jobs, scheduler).run()
    if as_json:
        print_json({"out": str(out), "done": msgspec.to_builtins(done.done), "broken": done.problems})
    else:
        done.show(Console())
        click.echo(f"wrote {out} and {out / PAGE}")
    if (error := done.error()) is not None:
        raise error


def is_archive(file: str) -> bool:
    """Whether it may be many recordings: a URL, a folder, a glob that the shell has left alone."""
    path = Path(file)
    return "://" in file or path.is_dir() or (not path.exists() and bool(set("*?[") & set(file)))


def refuse_given(context: click.Context, what: str, *parameters: str) -> None:
    """Refuse options that make no sense together with what else was said."""
    for parameter in context.command.params:
        given = context.get_parameter_source(str(parameter.name)) is click.core.ParameterSource.COMMANDLINE
        if given and parameter.name in parameters:
            raise click.UsageError(f"{parameter.opts[0]} does not go with {what}.")
