"""The concealed-physics proof on disk: draw the cases, seal the key, diagnose blindly, open the key, report."""

from __future__ import annotations

import json
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import takewhile
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import msgspec
import soundfile
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from chatter_monitor.discrepancy.prove.blind.case import deal, make_case
from chatter_monitor.discrepancy.prove.blind.chain import RATE_HZ
from chatter_monitor.discrepancy.prove.key import Truths, open_key, seal
from chatter_monitor.discrepancy.prove.scoring import Judged, Score, count, judge
from chatter_monitor.discrepancy.report import Report
from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.reports.proof import proof_page

Diagnose = Callable[[Path, Path, Path], object]
"""Recording, base model and output directory; writes ``report.json`` there."""

Gauge = Callable[[Path, Path, Mapping[str, Any]], float]
"""Recording, base model and truth of a case; the gain of the true model."""


class Proof(msgspec.Struct, frozen=True):
    """What `proof.json` says."""

    cases: int
    seed: int
    key_sha256: str
    score: Score
    judged: list[Judged]


@dataclass(frozen=True)
class Proving:
    """A proof in a directory; whatever part of it is there already is not done again.

    Attributes
    ----------
    out : Path
        The directory: ``cases``, ``key.json``, its hash ``key.sha256``, ``diagnoses``, ``proof.json``, ``proof.html``.
    cases, seed : int
        How many, and of what draw.
    diagnose : callable
        What is put to the test; gets the recording, the base model and where to write, nothing else. It runs in other
        processes, so it has to be a function of a module.
    jobs : int
        Processes.
    gauge : callable, optional
        What the true models gain; called once the key is open, for effects of the catalogue.
    """

    out: Path
    cases: int
    seed: int
    diagnose: Diagnose
    jobs: int = 1
    gauge: Gauge | None = None

    def run(self, say: Callable[[str], None]) -> Proof:
        """Do what is left to do; `say` gets each line that the user should see.

        Raises
        ------
        InputError
            If the directory holds another draw, or not what was sealed.
        EnvironmentFault
            If the directory cannot be written.
        """
        with self._writing():
            self._claim()
            self._draw()
            published = self._published.read_text(encoding="ascii").split()[0]
            say(f"{self.cases} cases in {self._cases}; the key is sealed, SHA-256 {published}")
            self._diagnose()
            return self._report(open_key(self._key, self._published, self._cases), published)

    def so_far(self) -> Proof:
        """Report the cases before the first that is not diagnosed; nothing is drawn or diagnosed.

        Which cases those are, the order of the draw says, not how they were answered. Of the others nothing is said, so
        that the proof can go on.

        Raises
        ------
        InputError
            If the first case is not diagnosed, or the directory holds another draw or not what was sealed.
        EnvironmentFault
            If the directory cannot be written.
        """
        done = list(takewhile(self._diagnosed, self._names()))
        if not done or not self._published.exists():
            raise InputError(
                f"no case is diagnosed in {self.out}", remedy="Run the same command without --so-far for a while."
            )
        with self._writing():
            self._claim()
            published = self._published.read_text(encoding="ascii").split()[0]
            truths = open_key(self._key, self._published, self._cases)
            return self._report({name: truths[name] for name in done}, published)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise EnvironmentFault(f"the proof cannot be written: {error}", got=str(self.out)) from error

    def _report(self, truths: Truths, published: str) -> Proof:
        """Weigh, score and write the cases of an opened key."""
        self._gauge(truths)
        proof = self._score(truths, published)
        (self.out / "proof.json").write_bytes(msgspec.json.format(msgspec.json.encode(proof), indent=1) + b"\n")
        written = proof_page(proof.judged, proof.score, published, self.seed, self.cases)
        (self.out / "proof.html").write_text(written, encoding="utf-8")
        return proof

    @property
    def _cases(self) -> Path:
        return self.out / "cases"

    @property
    def _key(self) -> Path:
        return self.out / "key.json"

    @property
    def _published(self) -> Path:
        return self.out / "key.sha256"

    def _names(self) -> list[str]:
        return [f"{number:04d}" for number in range(1, self.cases + 1)]

    def _claim(self) -> None:
        """Say in the directory which draw it is for."""
        mark, draw = self.out / "draw.json", {"cases": self.cases, "seed": self.seed}
        self.out.mkdir(parents=True, exist_ok=True)
        if mark.exists():
            if (there := json.loads(mark.read_text(encoding="utf-8"))) != draw:
                raise InputError(
                    f"{self.out} holds another proof", got=draw, allowed=str(there), remedy="Use another --out."
                )
        else:
            mark.write_text(json.dumps(draw) + "\n", encoding="utf-8")

    def _draw(self) -> None:
        """Draw the cases and seal the key."""
        if self._published.exists():
            return
        drafts = self.out / "drafts"
        drafts.mkdir(exist_ok=True)
        left = [n for n, name in enumerate(self._names(), 1) if not (drafts / f"{name}.json").exists()]
        tasks = [partial(_draw_case, self.cases, self.seed, n, self._cases / f"{n:04d}", drafts) for n in left]
        self._spread("hiding effects", tasks)
        truths = {name: json.loads((drafts / f"{name}.json").read_text(encoding="utf-8")) for name in self._names()}
        seal(truths, self._cases, self._key, self._published)
        for draft in drafts.iterdir():
            draft.unlink()
        drafts.rmdir()

    def _diagnosed(self, name: str) -> bool:
        """Whether a case has been answered, if only by an error."""
        return any((self.out / "diagnoses" / name / file).exists() for file in ("report.json", "error.txt"))

    def _diagnose(self) -> None:
        """Diagnose what has no report yet."""
        tasks = []
        for name in self._names():
            recordings = sorted((self._cases / name).glob("recording.*"))
            out = self.out / "diagnoses" / name
            if not (out / "report.json").exists():
                tasks.append(partial(_diagnose_case, self.diagnose, recordings[0], out))
        self._spread("diagnosing", tasks)

    def _gauge(self, truths: Truths) -> None:
        """What the true models gain, where that is not known yet."""
        if self.gauge is None:
            return
        self._gains.mkdir(exist_ok=True)
        left = {
            name: truth
            for name, truth in truths.items()
            if truth["family"] in ("catalogue", "part") and not (self._gains / f"{name}.json").exists()
        }
        with _progress("true models", len(left)) as advance:  # each takes less than another process takes to begin
            for name, truth in left.items():
                recording = next((self._cases / name).glob("recording.*"))
                gain = self.gauge(recording, recording.with_name("model.toml"), truth)
                (self._gains / f"{name}.json").write_text(json.dumps(gain), encoding="ascii")
                advance()

    @property
    def _gains(self) -> Path:
        return self.out / "gains"

    def _score(self, truths: Truths, published: str) -> Proof:
        judged = []
        for name, truth in truths.items():
            gain = self._gains / f"{name}.json"
            true_gain = json.loads(gain.read_text(encoding="ascii")) if gain.exists() else None
            judged.append(judge(name, truth, _read(self.out / "diagnoses" / name / "report.json"), true_gain))
        return Proof(self.cases, self.seed, published, count(judged), judged)

    def _spread(self, what: str, tasks: Sequence[Callable[[], None]]) -> None:
        """Run tasks in processes of their own, with a progress bar."""
        if not tasks:
            return
        with _progress(what, len(tasks)) as advance, ProcessPoolExecutor(self.jobs, get_context("spawn")) as pool:
            futures = [pool.submit(task) for task in tasks]
            try:
                for future in as_completed(futures):
                    future.result()
                    advance()
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise


def _draw_case(cases: int, seed: int, number: int, directory: Path, drafts: Path) -> None:
    """Write recording and base model of a case, and the truth elsewhere."""
    case = make_case(deal(cases, seed)[number - 1], seed, number)
    directory.mkdir(parents=True, exist_ok=True)
    name, subtype = ("recording.flac", "PCM_24") if case.integers else ("recording.wav", "FLOAT")
    soundfile.write(directory / name, case.samples, RATE_HZ, subtype=subtype)
    (directory / "model.toml").write_text(case.model, encoding="utf-8")
    (drafts / f"{number:04d}.json").write_text(json.dumps(case.truth), encoding="utf-8")


def _diagnose_case(diagnose: Diagnose, recording: Path, out: Path) -> None:
    """Diagnose; what goes wrong is kept beside the reports and counts as a failure, it does not end the proof."""
    out.mkdir(parents=True, exist_ok=True)
    try:
        diagnose(recording, recording.with_name("model.toml"), out)
    except Exception:
        (out / "error.txt").write_text(traceback.format_exc(), encoding="utf-8")


def _read(report: Path) -> Report | None:
    """The report; None where there is none, or none that keeps to its contract."""
    try:
        return msgspec.json.decode(report.read_bytes(), type=Report)
    except (FileNotFoundError, msgspec.DecodeError):
        return None


@contextmanager
def _progress(what: str, total: int) -> Iterator[Callable[[], None]]:
    """Progress on standard error, only where a person looks at it."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(what, total=total)
        yield lambda: progress.advance(task)
