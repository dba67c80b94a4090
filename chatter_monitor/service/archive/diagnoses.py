"""Diagnosing every recording of an archive against one model."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

from chatter_monitor.discrepancy.report import Report
from chatter_monitor.outlets.message_tables import MessageTable
from chatter_monitor.physics.model_file import model_text, read_model
from chatter_monitor.reports import diagnoses as telling
from chatter_monitor.reports.diagnoses import Diagnosed, Parameter
from chatter_monitor.service.archive.dataset import Place
from chatter_monitor.service.archive.kind import Kind, Tables
from chatter_monitor.service.diagnosing import diagnose_file


@dataclass(frozen=True)
class Diagnoses(Kind[Diagnosed]):
    """What all recordings are diagnosed against, each by itself.

    Attributes
    ----------
    model : str
        Text of the model file, which other computers need not see.
    channel : int
        Counted from 0.
    between_s : (float, float) or None
        Stretch to look at.
    """

    model: str
    channel: int = 0
    between_s: tuple[float, float] | None = None

    doing, done = "diagnosing", "diagnosed"
    tables = ("parameter",)
    summary = Diagnosed
    telling = telling

    @classmethod
    def of(cls, model: Path, channel: int, between_s: tuple[float, float] | None) -> Diagnoses:
        """By a model file.

        Raises
        ------
        InputError
            If it cannot be used.
        """
        return cls(model_text(read_model(model)), channel, between_s)

    def decisive(self, file: Path | None = None) -> Tables:  # noqa: ARG002  nothing lies beside a recording
        """The model and where to look."""
        return {"diagnose": {"model": self.model, "channel": self.channel, "between_s": self.between_s}}

    def do(self, file: Path, place: Place[Diagnosed]) -> Diagnosed:
        """Diagnose it, with pages of its own."""
        with tempfile.TemporaryDirectory(prefix="chatter-monitor-") as folder, place.pages() as pages:
            model = Path(folder, "model.toml")
            model.write_text(self.model, encoding="utf-8")
            report, _ = diagnose_file(file, model, pages, channel=self.channel, between_s=self.between_s)
        with MessageTable(place.file("parameter"), Parameter) as table:
            for parameter in _parameters(report):
                table.append(parameter)
        runner_up = report.alternatives[0] if report.terms and report.alternatives else None
        return Diagnosed(
            key=place.key,
            verdict=report.verdict,
            effects=[term.name for term in report.terms],
            senses=[term.sense for term in report.terms],
            evidence_nats=sum(term.evidence_nats for term in report.terms),
            gain_nats=report.fit.gain_nats,
            runner_up=None if runner_up is None else runner_up.name,
            runner_up_nats=None if runner_up is None else runner_up.evidence_nats,
            sentence=report.summary,
            warnings=report.warnings,
            page=str(place.folder.relative_to(place.results.path) / "report.html"),
        )


def _parameters(report: Report) -> list[Parameter]:
    return [
        Parameter(effect=term.name, name=name, value=e.value, low=e.ci95[0], high=e.ci95[1], unit=e.unit)
        for term in report.terms
        for name, e in term.parameters.items()
    ]
