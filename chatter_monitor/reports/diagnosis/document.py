"""What every report of a diagnosis says in words and numbers, around its pictures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from chatter_monitor.discrepancy.report import Fit, FreeRun, Report, Verdict
from chatter_monitor.outlets.look import BLUISH_GREEN, ORANGE, REDDISH_PURPLE, VERMILLION, Colour
from chatter_monitor.reports.diagnoses import WORDS
from chatter_monitor.reports.page import answer, page, table, text

_COLOURS: dict[Verdict, Colour] = {
    "missing_physics": VERMILLION,
    "unknown": REDDISH_PURPLE,
    "parameters": ORANGE,
    "none": BLUISH_GREEN,
}


def document(report: Report, name: str, pictures: Sequence[str], compared: str = "") -> str:
    """HTML page with everything inside: summary, what is missing, pictures, tables.

    Parameters
    ----------
    report : Report
        The diagnosis.
    name : str
        Of the recording.
    pictures : sequence of str
        HTML.
    compared : str
        HTML that stands before the pictures.
    """
    parts = [
        f"<h1>{text(name)}</h1>",
        answer(f"{WORDS[report.verdict].capitalize()}.", report.summary, _COLOURS[report.verdict]),
        *(f'<p class="soft">{text(warning)}</p>' for warning in report.warnings),
        *_missing(report),
        compared,
        *pictures,
        *_held_out(report.fit),
        *_free_running(report.fit, report.fit.free_run),
        *_maps(report),
        *_others(report),
        *_could_have_shown(report),
    ]
    return page(name, parts)


def _plain(name: str) -> str:
    return name.replace("_", " ")


def _missing(report: Report) -> Iterator[str]:
    if not report.terms:
        return
    rows = [
        (
            _plain(term.name) + (f" ({term.sense})" if term.sense else ""),
            name,
            f"{e.value:.4g}",
            f"{e.ci95[0]:.4g} to {e.ci95[1]:.4g}",
            e.unit,
            f"{term.evidence_nats:.1f}",
        )
        for term in report.terms
        for name, e in term.parameters.items()
    ]
    yield "<h2>What is missing</h2>"
    yield from (f"<p>{text(term.why)}</p>" for term in report.terms)
    yield table(("missing", "parameter", "value", "95 %", "unit", "evidence, nats"), rows)


def _held_out(fit: Fit) -> Iterator[str]:
    if fit.residual_white_p_before is not None and fit.residual_white_p_after is not None:
        yield "<h2>Held-out stretches</h2>"
        yield (
            f"<p>Gain {fit.gain_nats:.1f} nats ({fit.gain_bits:.1f} bits) over the re-calibrated base model. Whiteness"
            f" of what is left: p = {fit.residual_white_p_before:.2g} before,"
            f" {fit.residual_white_p_after:.2g} after.</p>"
        )


def _free_running(fit: Fit, free: FreeRun | None) -> Iterator[str]:
    if free is None:
        return
    runs = [
        ("rms", *(f"{value:.4g}" for value in free.rms)),
        ("kurtosis", *(f"{value:.3f}" for value in free.kurtosis)),
        ("distance of the spectra, dB", "", f"{fit.psd_distance_db_before:.3f}", f"{fit.psd_distance_db_after:.3f}"),
    ]
    shown = 4 if (free.rms[1], free.kurtosis[1]) != (free.rms[2], free.kurtosis[2]) else 3  # nothing was added
    yield "<h2>Free-running</h2>"
    yield table(("", "recording", "base", "augmented")[:shown], [row[:shown] for row in runs])


def _maps(report: Report) -> Iterator[str]:
    if report.located.maps:
        yield "<h2>Maps</h2>"
        rows = [(_plain(each.name), f"{each.value:.4g}", f"{each.p_value:.2g}") for each in report.located.maps]
        yield table(("map", "statistic", "p"), rows)


def _others(report: Report) -> Iterator[str]:
    if report.alternatives:
        yield "<h2>Other explanations</h2>"
        rows = [(_plain(each.name), f"{each.evidence_nats:.1f}") for each in report.alternatives]
        yield table(("name", "nats"), rows)


def _could_have_shown(report: Report) -> Iterator[str]:
    if report.information:
        yield "<h2>What this recording could have shown</h2>"
        yield (
            "<p>Smallest effect, as a share of the restoring force that nothing linear makes, and how long to record"
            " for 2 %.</p>"
        )
        rows = [
            (_plain(each.name), f"{100 * each.detectable:.2g} %", f"{each.seconds_for_two_percent:.3g} s")
            for each in report.information
        ]
        yield table(("name", "smallest", "for 2 %"), rows)
