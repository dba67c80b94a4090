"""An archive replayed: find the recordings, do what is left to do, report on all."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from chatter_monitor.errors import ChatterMonitorError, EnvironmentFault, InputError
from chatter_monitor.reports.archive import HEADINGS, Summary, archive_page, row, sentence, worst_first
from chatter_monitor.service.archive.dataset import DataSet
from chatter_monitor.service.archive.job import Job, Outcome, claim
from chatter_monitor.service.archive.recordings import find
from chatter_monitor.service.archive.spread import in_processes, on_cluster, processors
from chatter_monitor.service.compiling import what_takes_long

PAGE = "report.html"
SHOWN = 20


@dataclass(frozen=True)
class Archive:
    """Recordings to replay and where their results go.

    Attributes
    ----------
    files : sequence of str
        Files, folders and globs, as paths or URLs.
    out : Path
        The data set.
    tables : dict
        What the machine configuration says, without its defaults.
    processes : int or None
        How many at a time; as many as there are processors by default.
    scheduler : str or None
        Address of a Dask scheduler whose workers are to do it instead.
    """

    files: Sequence[str]
    out: Path
    tables: dict[str, dict[str, Any]]
    processes: int | None = None
    scheduler: str | None = None

    def run(self) -> Replayed:
        """Do what is not done yet and write the page.

        Raises
        ------
        InputError
            If there are no recordings, the configuration is wrong, or the directory holds results of another one.
        EnvironmentFault
            If a place cannot be reached, the directory cannot be written, or the cluster goes away.
        """
        recordings = find(self.files)
        results = DataSet(self.out.absolute())
        with results.claimed(claim(self.tables)):
            jobs = [Job(recording, self.tables, results.path, version("chatter-monitor")) for recording in recordings]
            broken = [outcome for outcome in self._outcomes(jobs) if outcome.problem is not None]
            replayed = Replayed(results.summaries(), broken)
            self._check_seen(jobs, replayed)
            page = archive_page(f"Archive: {self.out}", replayed.done, replayed.problems)
            (results.path / PAGE).write_text(page, encoding="utf-8")
        return replayed

    def _outcomes(self, jobs: Sequence[Job]) -> list[Outcome]:
        """Have the jobs done."""
        if self.scheduler is not None:
            outcomes = on_cluster(jobs, self.scheduler)
        else:
            outcomes = in_processes(jobs, self.processes or processors())
        with _progress(len(jobs)) as advance:
            return [advance(outcome) for outcome in outcomes]

    def _check_seen(self, jobs: Sequence[Job], replayed: Replayed) -> None:
        for job in jobs:
            if job.recording.name not in replayed.done.keys() | replayed.problems.keys():
                raise EnvironmentFault(
                    "the workers write their results where they cannot be seen from here",
                    got=str(self.out),
                    remedy="Share the directory with all of them.",
                )


@dataclass(frozen=True)
class Replayed:
    """What an archive comes to.

    Attributes
    ----------
    done : mapping
        Summary of every recording that has been replayed, now or before.
    broken : sequence of Outcome
        Those that could not be replayed now.
    """

    done: Mapping[str, Summary]
    broken: Sequence[Outcome]

    @property
    def problems(self) -> dict[str, str]:
        """What is wrong with each recording that could not be replayed."""
        return {outcome.recording: str(outcome.problem) for outcome in self.broken}

    def show(self, console: Console) -> None:
        """Print table and totals."""
        table = Table(box=None, pad_edge=False, collapse_padding=True, header_style="grey50")
        table.add_column(HEADINGS[0], overflow="fold", vertical="bottom")
        for heading in HEADINGS[1:]:
            table.add_column(heading.replace(" ", "\n"), justify="right", no_wrap=True)
        worst = worst_first(self.done)
        for name, summary in worst[:SHOWN]:
            table.add_row(*row(name, summary), style="bold red" if summary.events else None)
        console.print(table)
        if len(worst) > SHOWN:
            console.print(f"  and {len(worst) - SHOWN} more", style="grey50")
        for name, problem in sorted(self.problems.items()):
            console.print(f"  {name}: {problem}", style="magenta", markup=False, highlight=False, soft_wrap=True)
        console.print(sentence(self.done, self.problems), highlight=False)

    def error(self) -> ChatterMonitorError | None:
        """What the command ends with if recordings could not be replayed: a bug's exit code before all others."""
        count = "a recording" if len(self.broken) == 1 else f"{len(self.broken)} recordings"
        remedy = "The others are done. Run the same command again when this is mended; it does what is left."
        for kind in (ChatterMonitorError, EnvironmentFault, InputError):
            names = sorted(outcome.recording for outcome in self.broken if outcome.exit_code == kind.exit_code)
            if names:
                return kind(f"{count} could not be replayed", got=names[0], remedy=remedy)
        return None


@contextmanager
def _progress(total: int) -> Iterator[Callable[[Outcome], Outcome]]:
    """Progress on standard error, only where a person looks at it."""
    console = Console(stderr=True)
    if (first := what_takes_long()) is not None:
        console.print(f"{first.capitalize()}.")
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("replaying", total=total)

        def advance(outcome: Outcome) -> Outcome:
            progress.advance(task)
            return outcome

        yield advance
