"""Something done with every recording of an archive: find them, do what is left to do, report on all."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Generic

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from chatter_monitor.errors import ChatterMonitorError, EnvironmentFault, InputError
from chatter_monitor.service.archive.dataset import R
from chatter_monitor.service.archive.job import Job, Outcome, claim
from chatter_monitor.service.archive.kind import Kind
from chatter_monitor.service.archive.recordings import find
from chatter_monitor.service.archive.spread import in_processes, on_cluster
from chatter_monitor.service.compiling import what_takes_long
from chatter_monitor.service.processors import processors

PAGE = "report.html"
SHOWN = 20


@dataclass(frozen=True)
class Archive(Generic[R]):
    """Recordings, what is to be done with them, and where the results go.

    Attributes
    ----------
    files : sequence of str
        Files, folders and globs, as paths or URLs.
    kind : Kind
        What is to be done.
    out : Path
        The data set.
    processes : int or None
        How many at a time; as many as there are processors by default.
    scheduler : str or None
        Address of a Dask scheduler whose workers are to do it instead.
    """

    files: Sequence[str]
    kind: Kind[R]
    out: Path
    processes: int | None = None
    scheduler: str | None = None

    def run(self) -> Done[R]:
        """Do what is not done yet and write the page.

        Raises
        ------
        InputError
            If there are no recordings, what is to be done makes no sense, or the directory holds other results.
        EnvironmentFault
            If a place cannot be reached, the directory cannot be written, or the cluster goes away.
        """
        recordings = find(self.files)
        results = self.kind.results(self.out.absolute())
        with results.claimed(claim(self.kind)):
            jobs = [Job(recording, self.kind, results.path, version("chatter-monitor")) for recording in recordings]
            broken = [outcome for outcome in self._outcomes(jobs) if outcome.problem is not None]
            done = Done(self.kind, results.summaries(), broken)
            self._check_seen(jobs, done)
            page = self.kind.telling.archive_page(f"Archive: {self.out}", done.done, done.problems)
            (results.path / PAGE).write_text(page, encoding="utf-8")
        return done

    def _outcomes(self, jobs: Sequence[Job]) -> list[Outcome]:
        """Have the jobs done."""
        if self.scheduler is not None:
            outcomes = on_cluster(jobs, self.scheduler)
        else:
            outcomes = in_processes(jobs, self.processes or processors())
        with _progress(self.kind.doing, len(jobs)) as advance:
            return [advance(outcome) for outcome in outcomes]

    def _check_seen(self, jobs: Sequence[Job], done: Done[R]) -> None:
        for job in jobs:
            if job.recording.name not in done.done.keys() | done.problems.keys():
                raise EnvironmentFault(
                    "the workers write their results where they cannot be seen from here",
                    got=str(self.out),
                    remedy="Share the directory with all of them.",
                )


@dataclass(frozen=True)
class Done(Generic[R]):
    """What an archive comes to.

    Attributes
    ----------
    kind : Kind
        What was to be done.
    done : mapping
        What every recording comes to with which it has been done, now or before.
    broken : sequence of Outcome
        Those with which it could not be done now.
    """

    kind: Kind[R]
    done: Mapping[str, R]
    broken: Sequence[Outcome]

    @property
    def problems(self) -> dict[str, str]:
        """What is wrong with each recording with which it could not be done."""
        return {outcome.recording: str(outcome.problem) for outcome in self.broken}

    def show(self, console: Console) -> None:
        """Print table and totals."""
        telling = self.kind.telling
        table = Table(box=None, pad_edge=False, collapse_padding=True, header_style="grey50")
        table.add_column(telling.HEADINGS[0], overflow="fold", vertical="bottom")
        for heading in telling.HEADINGS[1:]:
            table.add_column(heading.replace(" ", "\n"), justify="right", no_wrap=True)
        worst = telling.worst_first(self.done)
        for name, summary in worst[:SHOWN]:
            table.add_row(*telling.row(name, summary), style="bold red" if telling.strikes(summary) else None)
        console.print(table)
        if len(worst) > SHOWN:
            console.print(f"  and {len(worst) - SHOWN} more", style="grey50")
        for name, problem in sorted(self.problems.items()):
            console.print(f"  {name}: {problem}", style="magenta", markup=False, highlight=False, soft_wrap=True)
        console.print(telling.sentence(self.done, self.problems), highlight=False)

    def error(self) -> ChatterMonitorError | None:
        """What the command ends with if recordings are broken: a bug's exit code before all others."""
        count = "a recording" if len(self.broken) == 1 else f"{len(self.broken)} recordings"
        remedy = "The others are done. Run the same command again when this is mended; it does what is left."
        for kind in (ChatterMonitorError, EnvironmentFault, InputError):
            names = sorted(outcome.recording for outcome in self.broken if outcome.exit_code == kind.exit_code)
            if names:
                return kind(f"{count} could not be {self.kind.done}", got=names[0], remedy=remedy)
        return None


@contextmanager
def _progress(doing: str, total: int) -> Iterator[Callable[[Outcome], Outcome]]:
    """Progress on standard error, only where a person looks at it."""
    console = Console(stderr=True)
    if (first := what_takes_long()) is not None:
        console.print(f"{first.capitalize()}.")
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(doing, total=total)

        def advance(outcome: Outcome) -> Outcome:
            progress.advance(task)
            return outcome

        yield advance
