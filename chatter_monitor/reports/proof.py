"""The proof as lines for the terminal and as a page with its pictures in it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from chatter_monitor.discrepancy.prove.scoring import Judged, Rate, Score
from chatter_monitor.reports.page import Link, bitmap, page, table, text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = {"right": "#3f7d4e", "abstained": "#d9b44a", "missed": "#9aa7b8", "wrong": "#b0303a", "failed": "#333333"}
_HEADINGS = ("case", "hidden", "strength", "concealed", "spectrum", "normality p", "answer", "outcome", "gain, nats")


def lines(score: Score) -> Iterator[str]:
    """The table for the terminal."""
    for name, rate in score.rates.items():
        if rate.of:
            yield f"{name:<52} {_spoken(rate)}"
    for over, q in (("its bound", score.gain_share), ("that of the true model", score.true_gain_share)):
        if q:
            label = f"held-out gain over {over}, quartiles"
            yield f"{label:<52} {q['q25']:.2f} {q['median']:.2f} {q['q75']:.2f}"
    for name, p in score.p_uniform.items():
        yield f"{f'p-values of the {name} map uniform: p':<52} {p:.3g}"
    if score.elapsed_s:
        t = score.elapsed_s
        yield f"{'seconds a diagnosis, median and largest':<52} {t['median']:.1f} {t['largest']:.1f}"
    yield ""
    yield "hidden                              answered"
    for truth, answers in score.confusion.items():
        yield f"{truth:<35} " + ", ".join(f"{answer} {n}" for answer, n in answers.items())


def proof_page(judged: Sequence[Judged], score: Score, key_sha256: str, seed: int, drawn: int) -> str:
    """Self-contained HTML of the proof; the reports of the cases are linked, not embedded.

    `drawn` cases are in the draw; those judged are its first ones.
    """
    of_drawn = f"The first {len(judged)} of {drawn}" if len(judged) < drawn else f"{drawn}"
    rates = [(name, f"{rate.hits} of {rate.of}", _percent(rate), _interval(rate)) for name, rate in score.rates.items()]
    kinds = [
        (kind, strength, _counts(dict(sorted(row.items()))))
        for kind, bins in score.by_kind.items()
        for strength, row in sorted(bins.items())
    ]
    parts = [
        "<h1>Concealed-physics proof</h1>",
        f"<p>{of_drawn} cases of draw {seed}, made by a generator that shares no code with the engine. The key was"
        f" sealed before the first diagnosis: SHA-256 <code>{text(key_sha256)}</code>.</p>",
        "<h2>Counts</h2>",
        table(("share", "cases", "%", "95 % interval"), rates),
        *(_picture(draw, judged) for draw in (_draw_outcomes, _draw_uniform, _draw_intervals)),
        "<h2>Answers</h2>",
        table(("hidden", "answered"), [(truth, _counts(answers)) for truth, answers in score.confusion.items()]),
        "<h2>By effect and strength</h2>",
        "<p>Strength: share of the rms restoring force that no linear spring and damper can imitate.</p>",
        table(("effect", "strength", "outcome"), kinds),
        "<h2>Cases</h2>",
        "<p>A case is concealed if neither its spectrum (log-spectral distance from the best linear simulation, in"
        " brackets what 95 % of linear recordings stay below) nor its distribution (Shapiro-Wilk, 5 %) can be told from"
        " linear; so even a linear case looks visible in about one of ten. Gain: on the held-out half, in brackets what"
        " the true model gains there and the most that it could if the motion were known.</p>",
        table(_HEADINGS, map(_case_row, judged)),
    ]
    return page("Concealed-physics proof", parts)


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{what} {n}" for what, n in counts.items())


def _case_row(j: Judged) -> tuple[str | Link, ...]:
    gain = "" if j.gain_nats is None else f"{j.gain_nats:.1f}"
    most = [f"{each:.0f}" for each in (j.true_gain_nats, j.bound_nats) if each is not None]
    return (
        Link(j.case, f"diagnoses/{j.case}/report.html"),
        j.kind,
        "" if j.strength is None else f"{100 * j.strength:.1f} %",
        "yes" if j.concealed else "no",
        f"{j.distance:.3f} ({j.band95:.3f})",
        f"{j.normality_p:.3f}",
        j.answer,
        j.outcome,
        f"{gain} ({', '.join(most)})" if most else gain,
    )


def _draw_outcomes(axes: Axes, judged: Sequence[Judged]) -> bool:
    """Outcome of every hidden force over its strength."""
    forces = [j for j in judged if j.strength is not None]
    kinds = sorted({j.kind for j in forces})
    for outcome, colour in COLOURS.items():
        here = [j for j in forces if j.outcome == outcome]
        axes.plot(
            [100 * (j.strength or 0.0) for j in here],
            [kinds.index(j.kind) for j in here],
            "o",
            color=colour,
            alpha=0.8,
            label=outcome,
        )
    axes.set(xscale="log", xlabel="strength, % of the rms restoring force", title="Outcomes")
    axes.set_xticks([1, 2, 5, 10], ["1", "2", "5", "10"])
    axes.minorticks_off()
    axes.set_yticks(range(len(kinds)), kinds, fontsize="small")
    axes.legend(fontsize="small", ncols=5, loc="upper center", bbox_to_anchor=(0.5, -0.08))
    return bool(forces)


def _draw_uniform(axes: Axes, judged: Sequence[Judged]) -> bool:
    """Quantiles of the p-values of linear cases against uniform ones."""
    linear = [j for j in judged if j.family == "linear" and j.p_values]
    if not linear:
        return False
    for name in sorted({name for j in linear for name in j.p_values}):
        p = np.sort([j.p_values[name] for j in linear if name in j.p_values])
        axes.plot((np.arange(p.size) + 0.5) / p.size, p, ".-", lw=0.8, label=name)
    axes.plot([0, 1], [0, 1], "k--", lw=0.8)
    axes.set(xlabel="uniform", ylabel="p-value", title="p-values of the maps where nothing is hidden")
    axes.legend(fontsize="small")
    return True


def _draw_intervals(axes: Axes, judged: Sequence[Judged]) -> bool:
    """Estimate over truth of every parameter of a rightly named term."""
    names = sorted({(j.kind, name) for j in judged for name in j.ratios})
    for row, (kind, name) in enumerate(names):
        for j in judged:
            if j.kind == kind and name in j.ratios:
                axes.plot(j.ratios[name], row, "o", color=COLOURS["right" if j.inside[name] else "wrong"], alpha=0.7)
    axes.axvline(1.0, color="k", lw=0.8)
    axes.set(xlabel="estimate over truth (red: truth outside the 95 % interval)", title="Parameters", xlim=(0.0, 2.5))
    axes.set_yticks(range(len(names)), [f"{kind}: {name}" for kind, name in names], fontsize="small")
    return bool(names)


def _picture(draw: Callable[[Axes, Sequence[Judged]], bool], judged: Sequence[Judged]) -> str:
    """A figure inside the page; nothing where there is nothing to draw."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 6.5), layout="constrained")
    if not draw(figure.subplots(), judged):
        return ""
    return bitmap(figure, str(draw.__doc__), dpi=110)


def _spoken(rate: Rate) -> str:
    return f"{rate.hits:4d} of {rate.of:<4d} {_percent(rate):>8} {_interval(rate)}"


def _percent(rate: Rate) -> str:
    return "-" if rate.share is None else f"{100 * rate.share:.1f} %"


def _interval(rate: Rate) -> str:
    return "" if rate.ci95 is None else f"({100 * rate.ci95[0]:.0f} to {100 * rate.ci95[1]:.0f} %)"
