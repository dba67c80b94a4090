"""A diagnosis: what is said, the seven maps and the comparison out of its report, and the numbers before and after."""

from __future__ import annotations

import base64
from html.parser import HTMLParser
from pathlib import Path

import msgspec
import rerun as rr
import rerun.blueprint as rrb

from chatter_monitor.discrepancy.report import Report
from chatter_monitor.errors import InputError
from chatter_monitor.outlets.dashboard.stream import Stream

PICTURE = "data:image/png;base64,"


class _Pictures(HTMLParser):
    """Collects the pictures inside a page, by their titles."""

    def __init__(self) -> None:
        super().__init__()
        self.found: dict[str, bytes] = {}

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take the picture of an img tag."""
        known = dict(attrs)
        source = known.get("src") or ""
        if tag == "img" and source.startswith(PICTURE):
            self.found[known.get("alt") or "picture"] = base64.b64decode(source.removeprefix(PICTURE))


def draw_diagnosis(stream: Stream, directory: Path) -> None:
    """Draw what `diagnose` wrote.

    Parameters
    ----------
    stream : Stream
        Where to.
    directory : Path
        With report.json and report.html.

    Raises
    ------
    InputError
        If there is no diagnosis in it.
    """
    try:
        report = msgspec.json.decode((directory / "report.json").read_bytes(), type=Report)
        pictures = _Pictures()
        pictures.feed((directory / "report.html").read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(
            f"there is no diagnosis: {error.strerror}",
            got=str(directory),
            allowed="a directory that `chatter-monitor diagnose --out` wrote",
        ) from error
    except msgspec.DecodeError as error:
        raise InputError(f"report.json is not that of a diagnosis: {error}", got=str(directory)) from error
    stream.static("diagnosis/answer", _markdown(answer(report)))
    stream.static("diagnosis/numbers", _markdown(numbers(report)))
    views: list[rrb.View | rrb.Container] = []
    for index, (title, png) in enumerate(pictures.found.items()):
        stream.static(f"diagnosis/picture_{index}", rr.EncodedImage(contents=png, media_type="image/png"))
        views.append(rrb.Spatial2DView(origin=f"diagnosis/picture_{index}", name=title))
    words = rrb.Vertical(
        rrb.TextDocumentView(origin="diagnosis/answer", name="Answer"),
        rrb.TextDocumentView(origin="diagnosis/numbers", name="Numbers"),
        row_shares=[2, 3],
    )
    stream.show(
        rrb.Blueprint(
            rrb.Horizontal(words, rrb.Vertical(*views, row_shares=[2, 1, 1][: len(views)]), column_shares=[2, 3])
            if views
            else words,
            rrb.TimePanel(state="hidden"),
            rrb.BlueprintPanel(state="hidden"),
            rrb.SelectionPanel(state="hidden"),
            auto_views=False,
            auto_layout=False,
        )
    )


def answer(report: Report) -> str:
    """Markdown: the verdict, the missing terms and what else was considered."""
    lines = [f"# {report.verdict.replace('_', ' ')}", "", report.summary, ""]
    for term in report.terms:
        sense = f", {term.sense}" if term.sense else ""
        lines.append(f"- **{term.name.replace('_', ' ')}**{sense}: evidence {term.evidence_nats:.1f} nats. {term.why}")
        lines += [
            f"  - {name} = {e.value:.4g} (95 %: {e.ci95[0]:.4g} to {e.ci95[1]:.4g}) {e.unit}"
            for name, e in term.parameters.items()
        ]
    lines += [f"- next best: {other.name}, {other.evidence_nats:.1f} nats" for other in report.alternatives[:2]]
    return "\n".join([*lines, *(f"- {warning}" for warning in report.warnings)])


def numbers(report: Report) -> str:
    """Markdown: tests of the seven maps, and how well the models predict what no fit has seen."""
    fit = report.fit
    rows = [
        ("neg. log likelihood / sample", fit.nll_per_sample_before, fit.nll_per_sample_after),
        ("residuals white, p", fit.residual_white_p_before, fit.residual_white_p_after),
        ("spectra differ by / dB", fit.psd_distance_db_before, fit.psd_distance_db_after),
    ]
    lines = ["| held out | before | after |", "|---|---|---|"]
    lines += [f"| {name} | {_number(before)} | {_number(after)} |" for name, before, after in rows]
    lines += ["", "| map of the base model | statistic | p |", "|---|---|---|"]
    lines += [f"| {test.name} | {test.value:.3g} | {test.p_value:.2g} |" for test in report.located.maps]
    return "\n".join(lines)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def _markdown(text: str) -> rr.TextDocument:
    return rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)
