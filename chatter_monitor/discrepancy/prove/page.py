"""The proof as lines for the terminal and as a page with its pictures in it."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from chatter_monitor.discrepancy.prove.scoring import Judged, Rate, Score

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = {"right": "#3f7d4e", "abstained": "#d9b44a", "missed": "#9aa7b8", "wrong": "#b0303a", "failed": "#333333"}

_STYLE = """body{font:15px/1.45 system-ui,sans-serif;max-width:1100px;margin:2em auto;padding:0 1em;color:#222}
table{border-collapse:collapse;margin:1em 0;display:block;overflow-x:auto}
td,th{padding:.2em .7em;text-align:left;border-bottom:1px solid #ddd}
td.n{text-align:right;font-variant-numeric:tabular-nums}img{max-width:100%}code{background:#f3f3f3}
.right{color:#3f7d4e}.wrong,.failed{color:#b0303a;font-weight:600}.abstained{color:#8a6d10}.missed{color:#667}"""


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


def page(judged: Sequence[Judged], score: Score, key_sha256: str, seed: int, drawn: int) -> str:
    """Self-contained HTML of the proof; the reports of the cases are linked, not embedded.

    `drawn` cases are in the draw; those judged are its first ones.
    """
    of_drawn = f"The first {len(judged)} of {drawn}" if len(judged) < drawn else f"{drawn}"
    rates = "".join(
        f"<tr><td>{html.escape(name)}</td><td class=n>{rate.hits} of {rate.of}</td>"
        f"<td class=n>{_percent(rate)}</td><td class=n>{_interval(rate)}</td></tr>"
        for name, rate in score.rates.items()
    )
    confusion = "".join(
        f"<tr><td>{html.escape(truth)}</td><td>"
        + ", ".join(f"{html.escape(answer)}&nbsp;<b>{n}</b>" for answer, n in answers.items())
        + "</td></tr>"
        for truth, answers in score.confusion.items()
    )
    kinds = "".join(
        f"<tr><td>{html.escape(kind)}</td><td>{html.escape(strength)}</td><td>"
        + ", ".join(f"<span class={outcome}>{outcome} {n}</span>" for outcome, n in sorted(row.items()))
        + "</td></tr>"
        for kind, bins in score.by_kind.items()
        for strength, row in sorted(bins.items())
    )
    cases = "".join(_case_row(j) for j in judged)
    pictures = "".join(_picture(draw, judged) for draw in (_draw_outcomes, _draw_uniform, _draw_intervals))
    return f"""<!doctype html><html lang=en><meta charset=utf-8><title>Concealed-physics proof</title>
<style>{_STYLE}</style><h1>Concealed-physics proof</h1>
<p>{of_drawn} cases of draw {seed}, made by a generator that shares no code with the engine. The key
was sealed before the first diagnosis: SHA-256 <code>{key_sha256}</code>. A case is <em>concealed</em> if neither its
spectrum (log-spectral distance from the best linear simulation, against linear recordings, 5 %) nor its distribution
(Shapiro-Wilk, 5 %) can be told from linear; so even a linear case looks visible in about one of ten.</p>
<h2>Counts</h2><table><tr><th>share<th>cases<th>%<th>95 % interval</tr>{rates}</table>
{pictures}<h2>Answers</h2><table><tr><th>hidden<th>answered</tr>{confusion}</table>
<h2>By effect and strength</h2>
<p>Strength: share of the rms restoring force that no linear spring and damper can imitate.</p>
<table><tr><th>effect<th>strength<th>outcome</tr>{kinds}</table>
<h2>Cases</h2>
<p>Spectrum: log-spectral distance from the best linear simulation, and in brackets what 95 % of linear recordings stay
below. Gain: on the held-out half, and in brackets what the true model gains there and
the most that it could if the motion were known.</p>
<table>
<tr><th>case<th>hidden<th>strength<th>concealed<th>spectrum<th>normality p<th>answer<th>outcome<th>gain, nats</tr>
{cases}</table>
</html>
"""


def _case_row(j: Judged) -> str:
    strength = "" if j.strength is None else f"{100 * j.strength:.1f} %"
    gain = "" if j.gain_nats is None else f"{j.gain_nats:.1f}"
    most = [f"{each:.0f}" for each in (j.true_gain_nats, j.bound_nats) if each is not None]
    if most:
        gain += f" ({', '.join(most)})"
    return (
        f'<tr><td><a href="diagnoses/{j.case}/report.html">{j.case}</a></td><td>{html.escape(j.kind)}</td>'
        f"<td class=n>{strength}</td><td>{'yes' if j.concealed else 'no'}</td>"
        f"<td class=n>{j.distance:.3f} ({j.band95:.3f})</td><td class=n>{j.normality_p:.3f}</td>"
        f"<td>{html.escape(j.answer)}</td>"
        f"<td class={j.outcome}>{j.outcome}</td><td class=n>{gain}</td></tr>"
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
    """A figure as an image in the page; nothing where there is nothing to draw."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 6.5), layout="constrained")
    if not draw(figure.subplots(), judged):
        return ""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    encoded = base64.b64encode(buffer.getvalue()).decode("ascii")
    return f'<p><img alt="{html.escape(str(draw.__doc__))}" src="data:image/png;base64,{encoded}"></p>'


def _spoken(rate: Rate) -> str:
    return f"{rate.hits:4d} of {rate.of:<4d} {_percent(rate):>8} {_interval(rate)}"


def _percent(rate: Rate) -> str:
    return "-" if rate.share is None else f"{100 * rate.share:.1f} %"


def _interval(rate: Rate) -> str:
    return "" if rate.ci95 is None else f"({100 * rate.ci95[0]:.0f} to {100 * rate.ci95[1]:.0f} %)"
