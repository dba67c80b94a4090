"""The report as one HTML file, and the figures that only a free-running simulation gives."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp
from scipy import stats

from chatter_monitor.discrepancy.basis import REACH, scales, surface_at
from chatter_monitor.discrepancy.case import Case, Local
from chatter_monitor.discrepancy.conclude import Diagnosis, base_of, conclude
from chatter_monitor.discrepancy.locate import frequency_map, lag_map
from chatter_monitor.discrepancy.report import FreeRun, Report
from chatter_monitor.discrepancy.show_energy import draw_damping, draw_frequency, draw_stiffness, identified
from chatter_monitor.energy.identification import Identification
from chatter_monitor.errors import InputError
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.simulate import simulate

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Vector = NDArray[np.float64]

RUN_S = 10.0  # longest free-running simulation
SEED = 1
PIXELS = 400  # of the width of an axis, about
TICKS = 5  # of an axis, at most, and one
AMPLITUDE_CLASSES = 12
RECORDED, BASE, AUGMENTED = "#4a6fa5", "#9a9a9a", "#b0303a"
COLOURS = {"recording": RECORDED, "base": BASE, "augmented": AUGMENTED}
_STYLE = """body{font:16px/1.5 sans-serif;max-width:62rem;margin:2rem auto;padding:0 1rem;color:#222}
.verdict{padding:.8rem 1rem;border-left:.4rem solid #b0303a;background:#f6f1ee;font-size:1.15rem}
table{border-collapse:collapse;margin:1rem 0;display:block;overflow-x:auto}
td,th{padding:.25rem .8rem;border-bottom:1px solid #ddd;text-align:left}
img{max-width:100%}small{color:#666}"""


@dataclass(frozen=True, slots=True, eq=False)
class Begun:
    """What of a page does not wait for the conclusion.

    Attributes
    ----------
    maps : str
        Picture of the maps.
    runs : dict of str to ndarray
        The recording and the base simulation that runs on its own, at the recording's rate.
    found : dict of str to Identification
        Stiffness and damping of both by energy.
    """

    maps: str
    runs: dict[str, Vector]
    found: dict[str, Identification]


def concluded(case: Case, name: str) -> tuple[Diagnosis, str, Report]:
    """Conclude, and write the page, which is begun meanwhile.

    Returns
    -------
    Diagnosis, str, Report
        As from `conclude` and `page`.
    """
    with ThreadPoolExecutor(1) as beside:
        begun = beside.submit(begin, case)
        diagnosis = conclude(case)
        return diagnosis, *page(diagnosis, name, begun.result())


def begin(case: Case) -> Begun | None:
    """What of a page does not wait for the conclusion; None where there are no maps."""
    if not case.maps[1:]:
        return None
    runs = {"recording": case.whole.samples} | _run(case, "base", base_of(case))
    return Begun(_maps(case), runs, identified(runs, case.whole.rate_hz, case.base.quantity))


def page(diagnosis: Diagnosis, name: str, begun: Begun | None = None) -> tuple[str, Report]:
    """HTML page of a diagnosis, with what of it was begun.

    Returns
    -------
    str
        A page with everything inside.
    Report
        The report with what the free-running simulations add.
    """
    case, report = diagnosis.case, diagnosis.report
    begun = begun or begin(case)
    if begun is None:
        return document(report, name, []), report
    runs = begun.runs | (_run(case, "augmented", diagnosis.model) if diagnosis.augmented else {})
    report = _with_runs(diagnosis, report, runs)
    pictures = [("Where they differ", begun.maps), ("Recording and simulations", _comparison(diagnosis, runs))]
    found = identified(runs, case.whole.rate_hz, case.base.quantity, begun.found)
    pictures += [("Stiffness and damping by energy", _by_energy(found))] if found else []
    return document(report, name, pictures), report


def document(report: Report, name: str, pictures: Sequence[tuple[str, str]], compared: str = "") -> str:
    """A page with everything inside: summary, findings, pictures (title, PNG in base64), tables.

    `compared` is HTML that stands behind the findings.
    """
    parts = [
        f"<h1>{html.escape(name)}</h1>",
        f'<p class="verdict"><b>{report.verdict.replace("_", " ")}</b>. {html.escape(report.summary)}</p>',
        *(f"<p><small>{html.escape(warning)}</small></p>" for warning in report.warnings),
        _terms(report),
        compared,
        *(f'<h2>{title}</h2><img alt="{title}" src="data:image/png;base64,{data}">' for title, data in pictures),
        _tables(report),
    ]
    body = "\n".join(parts)
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{html.escape(name)}</title>'
        f"<style>{_STYLE}</style></head><body>{body}</body></html>\n"
    )


def _run(case: Case, name: str, system: MachiningSystem) -> dict[str, Vector]:
    """A simulation that runs on its own, at the recording's rate, by its name; nothing if there is none."""
    run = _free(system, min(case.whole.seconds, RUN_S), case.whole.rate_hz)
    return {} if run is None else {name: run}


def _free(system: MachiningSystem, seconds: float, rate_hz: float) -> Vector | None:
    if system.excitation.kind == "measured":
        return None
    slowest = min(mode.damping_ratio * mode.omega for mode in system.modes)
    try:
        run = simulate(system, seconds, SEED, rate_hz, settle_s=min(10.0 / slowest, 2.0))
    except InputError:
        return None  # it grows without bound, which the report shows as missing
    return (run.signal - float(np.mean(run.signal))) / system.sensor.gain


def psd_distance_db(a: Vector, b: Vector, rate_hz: float, top_hz: float) -> float:
    """Rms difference of two spectra in dB up to a frequency, from Welch's method with 2048 samples."""
    f, one = dsp.welch(a, rate_hz, nperseg=2048)
    _, other = dsp.welch(b, rate_hz, nperseg=2048)
    inside = (f > 0.01 * top_hz) & (f < top_hz)
    return float(np.sqrt(np.mean((10.0 * np.log10(one[inside] / other[inside])) ** 2)))


def _with_runs(diagnosis: Diagnosis, report: Report, runs: dict[str, Vector]) -> Report:
    if "base" not in runs:
        return report
    rate, recorded = diagnosis.case.whole.rate_hz, runs["recording"]
    top = 0.42 * diagnosis.case.recorded.rate_hz
    after = runs.get("augmented", runs["base"])
    distance = [psd_distance_db(recorded, run, rate, top) for run in (runs["base"], after)]
    amplitude = [_amplitude_distance(recorded, run) for run in (runs["base"], after)]
    three = (recorded, runs["base"], after)
    rms = [float(np.std(each)) for each in three]
    kurtosis = [float(stats.kurtosis(each)) + 3.0 for each in three]
    free = FreeRun((rms[0], rms[1], rms[2]), (kurtosis[0], kurtosis[1], kurtosis[2]), amplitude[0], amplitude[1])
    fit = msgspec.structs.replace(
        report.fit, psd_distance_db_before=distance[0], psd_distance_db_after=distance[1], free_run=free
    )
    return msgspec.structs.replace(report, fit=fit)


def _amplitude_distance(a: Vector, b: Vector) -> float:
    """Largest difference of the distribution functions of the amplitudes, each relative to its rms."""
    one, other = (np.abs(dsp.hilbert(each[: 1 << int(np.log2(each.size))])) / np.std(each) for each in (a, b))
    return float(stats.ks_2samp(one[::8], other[::8]).statistic)


def _terms(report: Report) -> str:
    if not report.terms:
        return ""
    rows = [
        f"<tr><td>{term.name.replace('_', ' ')}{f' ({html.escape(term.sense)})' if term.sense else ''}</td>"
        f"<td>{name}</td>"
        f"<td>{e.value:.4g}</td><td>{e.ci95[0]:.4g} to {e.ci95[1]:.4g}</td><td>{html.escape(e.unit)}</td>"
        f"<td>{term.evidence_nats:.1f}</td></tr>"
        for term in report.terms
        for name, e in term.parameters.items()
    ]
    reasons = "".join(f"<p>{html.escape(term.why)}</p>" for term in report.terms)
    head = "<tr><th>missing</th><th>parameter</th><th>value</th><th>95 %</th><th>unit</th><th>evidence, nats</th></tr>"
    return f"<h2>What is missing</h2>{reasons}<table>{head}{''.join(rows)}</table>"


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = ["".join(f"<th>{cell}</th>" for cell in head)]
    lines += ["".join(f"<td>{html.escape(cell)}</td>" for cell in row) for row in rows]
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"


def _tables(report: Report) -> str:
    fit, free = report.fit, report.fit.free_run
    maps = [(each.name.replace("_", " "), f"{each.value:.4g}", f"{each.p_value:.2g}") for each in report.located.maps]
    others = [(each.name.replace("_", " "), f"{each.evidence_nats:.1f}") for each in report.alternatives]
    could = [
        (each.name.replace("_", " "), f"{100 * each.detectable:.2g} %", f"{each.seconds_for_two_percent:.3g} s")
        for each in report.information
    ]
    parts = []
    if fit.residual_white_p_before is not None and fit.residual_white_p_after is not None:
        parts.append(
            f"<h2>Held-out stretches</h2><p>Gain {fit.gain_nats:.1f} nats ({fit.gain_bits:.1f} bits) over the "
            f"re-calibrated base model. Whiteness of what is left: p = {fit.residual_white_p_before:.2g} before, "
            f"{fit.residual_white_p_after:.2g} after.</p>"
        )
    if free is not None:
        runs: list[tuple[str, ...]] = [
            ("rms", *(f"{value:.4g}" for value in free.rms)),
            ("kurtosis", *(f"{value:.3f}" for value in free.kurtosis)),
            (
                "distance of the spectra, dB",
                "",
                f"{fit.psd_distance_db_before:.3f}",
                f"{fit.psd_distance_db_after:.3f}",
            ),
        ]
        shown = 4 if (free.rms[1], free.kurtosis[1]) != (free.rms[2], free.kurtosis[2]) else 3  # nothing was added
        head = ("", "recording", "base", "augmented")
        parts += ["<h2>Free-running</h2>", _table(head[:shown], [row[:shown] for row in runs])]
    if maps:
        parts += ["<h2>Maps</h2>", _table(("map", "statistic", "p"), maps)]
    if others:
        parts += ["<h2>Other explanations</h2>", _table(("name", "nats"), others)]
    if could:
        parts += [
            "<h2>What this recording could have shown</h2><p>Smallest effect, as a share of the restoring force that "
            "nothing linear makes, and how long to record for 2 %.</p>",
            _table(("name", "smallest", "for 2 %"), could),
        ]
    return "".join(parts)


def _maps(case: Case) -> str:
    """The maps in one picture."""
    inn = case.innovations
    figure, axes = figure_of(2)
    p = {each.name: each.p_value for each in case.maps}
    white, used = inn.white * case.weight, inn.used
    rate = case.recorded.rate_hz
    block = max(1, round(0.25 * rate))
    count = white.size // block
    local = np.mean(white[: count * block].reshape(count, block) ** 2, axis=1)
    axes[0].plot((np.arange(count) + 0.5) * block / rate, local, color=RECORDED, lw=1)
    axes[0].set(
        xlabel="time, s", ylabel="mean square of the errors", title=f"time, p = {p['time']:.2g}", ylim=(0, None)
    )
    if case.local is not None and case.local.between_s is not None:
        axes[0].axvspan(*case.local.between_s, color=AUGMENTED, alpha=0.12, lw=0)
        _draw_explained(axes[0], case, case.local, block)
    _, f, ratio = frequency_map(case.base.spectrum, case.base.fitted)
    axes[1].plot(f, 10.0 * np.log10(ratio), color=RECORDED)
    axes[1].set(xlabel="Hz", ylabel="recording over base, dB", title=f"frequency, p = {p['frequency']:.2g}")
    _draw_plane(axes[2], case, p["phase_plane"])
    _draw_amplitude(axes[3], case, p["amplitude"])
    _, lags, correlation = lag_map(inn.white, used, rate)
    axes[4].plot(1e3 * lags, correlation, color=RECORDED, lw=0.6)
    if inn.linear.spindle is not None:
        axes[4].axvline(1e3 * inn.linear.spindle.delay_s, color=AUGMENTED, ls="--", lw=0.8)
    axes[4].set(xlabel="lag, ms", ylabel="correlation, standard deviations", title=f"lag, p = {p['lag']:.2g}")
    _draw_angle(axes[5], case, p["angle"])
    return encoded(figure)


def _draw_explained(axes: Axes, case: Case, local: Local, block: int) -> None:
    """What a force that acts in a stretch explains up to each time if it is taken to act all along.

    It rises where the force acts and falls where it does not.
    """
    retuning = case.columns["retuning"][:2]
    everywhere = retuning
    if local.candidate is not None:
        of_it = next(columns for candidate, columns in case.contest.entries if candidate == local.candidate)
        everywhere = [of_it[local.candidate.linear.index(i)] for i in local.units]
    columns = [*retuning, *case.columns["local"][: len(everywhere)]]
    errors, weighted = case.innovations.white * case.weight, case.matrix[columns] * case.weight
    coefficients = np.linalg.lstsq(weighted.T, errors, rcond=None)[0]
    errors = errors - coefficients[: len(retuning)] @ weighted[: len(retuning)]
    force = coefficients[len(retuning) :] @ (case.matrix[everywhere] * case.weight)
    gain = np.cumsum(force * (errors - 0.5 * force))[::block]
    beside = axes.twinx()
    at = np.arange(gain.size) * block / case.recorded.rate_hz
    beside.plot(at, gain, color=AUGMENTED, lw=1, label="nats that the force explains up to then")
    beside.tick_params(axis="y", direction="in", pad=-6, labelcolor=AUGMENTED)
    for label in beside.get_yticklabels():
        label.set_horizontalalignment("right")
    beside.legend(fontsize="small", loc="lower left")


def _draw_plane(axes: Axes, case: Case, p: float) -> None:
    axis = np.linspace(-REACH, REACH, 61)
    x, v = np.meshgrid(axis, axis, indexing="ij")
    force = surface_at(case.ceiling.coefficients, x, v)
    weight = np.exp(-0.5 * (x**2 + v**2))
    design = np.stack([np.ones_like(x), x, v]).reshape(3, -1)
    beta = np.linalg.solve((design * weight.ravel()) @ design.T, (design * weight.ravel()) @ force.ravel())
    force = np.where(np.hypot(x, v) < REACH, force - (beta @ design).reshape(x.shape), np.nan)
    sd_x, _ = scales(case.innovations.motion)
    relative = 100.0 * force / (case.innovations.linear.modes[0].omega ** 2 * sd_x)
    top = float(np.nanmax(np.abs(relative)))
    drawn = axes.pcolormesh(axis, axis, relative.T, cmap="RdBu_r", vmin=-top, vmax=top, shading="auto")
    axes.figure.colorbar(drawn, ax=axes, label="force, % of rms restoring force")
    axes.set(xlabel="x / rms", ylabel="x' / rms", title=f"phase plane: force nothing linear makes, p = {p:.2g}")


def _draw_amplitude(axes: Axes, case: Case, p: float) -> None:
    motion = case.innovations.motion
    sd_x, sd_v = scales(motion)
    # As predicted from the samples before: an amplitude that has seen the error would choose it.
    amplitude = np.roll(np.hypot(motion.x[1] / sd_x, motion.v[1] / sd_v), 1)
    edges = np.quantile(amplitude, np.linspace(0.0, 1.0, 13))
    inside = np.digitize(amplitude, edges[1:-1])
    weighted = case.innovations.white * case.weight
    for column, label, color in ((0, "stiffness", RECORDED), (1, "damping", AUGMENTED)):
        s = case.matrix[column] * case.weight
        information = np.bincount(inside, s * s, 12)
        value = np.bincount(inside, s * weighted, 12) / information
        centre = np.bincount(inside, amplitude, 12) / np.bincount(inside, minlength=12)
        w = case.innovations.linear.modes[0].omega
        unit = w * w if column == 0 else 2.0 * case.innovations.linear.modes[0].damping_ratio * w
        axes.errorbar(centre, 100 * value / unit, 196 / np.sqrt(information) / unit, fmt=".-", color=color, label=label)
    axes.axhline(0.0, color="0.6", lw=0.8)
    if case.local is not None and case.local.threshold is not None:
        axes.axvspan(case.local.threshold.above / sd_x, edges[-1], color=AUGMENTED, alpha=0.15, lw=0)
    axes.set(xlabel="amplitude / rms", ylabel="change, %", title=f"amplitude, p = {p:.2g}")
    axes.legend(fontsize="small")


def _draw_angle(axes: Axes, case: Case, p: float) -> None:
    s = case.matrix[0] * case.weight
    product = (case.innovations.white * case.weight) * s
    f, density = dsp.periodogram(product - product.mean(), case.recorded.rate_hz)
    top = f < 2.5 * case.innovations.linear.modes[0].frequency_hz
    # a line of so many pixels shows the largest of each few
    groups = np.array_split(np.arange(np.sum(top)), PIXELS)
    highest = [g[np.argmax(density[g])] for g in groups if g.size]
    axes.plot(f[highest], density[highest] / np.median(density[top]), color=RECORDED, lw=0.7)
    if case.innovations.linear.spindle is not None:
        turn = case.innovations.linear.spindle.speed_rpm / 60.0
        for order in range(1, min(9, int(f[top][-1] / turn) + 1)):
            axes.axvline(order * turn, color=AUGMENTED, ls=":", lw=0.6)
    axes.set(xlabel="Hz", ylabel="swing of the stiffness / median", title=f"angle, p = {p:.2g}", yscale="log")
    axes.set_ylim(bottom=1.0)


def _comparison(diagnosis: Diagnosis, runs: dict[str, Vector]) -> str:
    """Spectrum, amplitudes, and how the frequency of the first mode goes with its amplitude: its stiffness."""
    figure, (left, middle, right) = figure_of(1)
    rate = diagnosis.case.whole.rate_hz
    top = 0.5 * diagnosis.case.recorded.rate_hz
    for name, run in runs.items():
        color = COLOURS[name]
        f, density = dsp.welch(run, rate, nperseg=4096)
        left.plot(f[f < top], 10.0 * np.log10(density[f < top]), color=color, lw=0.9, label=name)
        amplitude = np.abs(dsp.hilbert(run[: 1 << int(np.log2(run.size))])) / np.std(run)
        middle.hist(amplitude, 80, range=(0, 4.5), density=True, histtype="step", color=color, label=name)
        right.plot(*backbone(run, rate, diagnosis.case.innovations.linear.modes[0].frequency_hz), color=color, lw=0.9)
    left.set(xlabel="Hz", ylabel="dB", title="spectrum")
    middle.set(xlabel="amplitude / rms", title="amplitudes", yscale="log", ylim=(1e-4, None))
    right.set(xlabel="amplitude / rms", ylabel="Hz", title="frequency of the first mode")
    left.legend(fontsize="small")
    return encoded(figure)


def _by_energy(found: Mapping[str, Identification]) -> str:
    """Stiffness, frequency and damping of the strongest mode, each identified from one of the runs alone."""
    figure, (left, middle, right) = figure_of(1)
    for name, result in found.items():
        color = COLOURS[name]
        draw_stiffness(left, result, color, name)
        draw_frequency(middle, result, color)
        draw_damping(right, result, color)
    left.set(xlabel="x / rms", ylabel="%", title="stiffness, of that at rest")
    middle.set(xlabel="energy / mean", ylabel="Hz", title="frequency")
    right.set(xlabel="energy / mean", ylabel="%", title="equivalent damping ratio", ylim=(0.0, None))
    left.legend(fontsize="small")
    return encoded(figure)


def backbone(run: Vector, rate_hz: float, mode_hz: float) -> tuple[Vector, Vector]:
    """Amplitude over its rms, and the median frequency, of what vibrates near a mode, in equally long classes.

    A spring that hardens raises the frequency with the amplitude, one that softens lowers it; without one it is level.

    Parameters
    ----------
    run : ndarray, shape (n,)
        Samples.
    rate_hz, mode_hz : float
        Their rate, and the frequency of the mode.

    Returns
    -------
    amplitude, hertz : ndarray, shape (AMPLITUDE_CLASSES,)
    """
    near = dsp.butter(2, (0.8 * mode_hz, min(1.2 * mode_hz, 0.49 * rate_hz)), "bandpass", fs=rate_hz, output="sos")
    vibration = dsp.hilbert(dsp.sosfilt(near, run)[: 1 << int(np.log2(run.size))])
    amplitude = np.abs(vibration[1:])
    hertz = rate_hz / (2.0 * np.pi) * np.angle(vibration[1:] * vibration[:-1].conj())
    classes = np.array_split(np.argsort(amplitude), AMPLITUDE_CLASSES)
    rms = np.sqrt(0.5 * np.mean(amplitude**2))
    return (
        np.array([np.median(amplitude[c]) for c in classes]) / rms,
        np.array([np.median(hertz[c]) for c in classes]),
    )


def figure_of(rows: int) -> tuple[Figure, NDArray[np.object_]]:
    """Rows of three axes with fixed margins: a layout engine would take longer than all of the drawing."""
    from matplotlib.figure import Figure

    height = 4.1 * rows
    figure = Figure(figsize=(14.0, height))
    margins = {"left": 0.05, "right": 0.985, "bottom": 0.55 / height, "top": 1.0 - 0.4 / height}
    axes = figure.subplots(rows, 3, gridspec_kw=margins | {"wspace": 0.22, "hspace": 0.3})
    return figure, np.asarray(axes).ravel()


def encoded(figure: Figure) -> str:
    """The picture as PNG in base64.

    Titles and labels stand where they are put, and there are few ticks, none of them small: to look for their places
    and to draw more would take longer than all the rest.
    """
    from matplotlib.ticker import MaxNLocator

    for axes in figure.axes:
        axes.set_title(axes.get_title(), y=1.0)
        axes.minorticks_off()
        axes.xaxis.set_label_coords(0.5, -0.1)
        for axis in (axes.xaxis, axes.yaxis):
            if isinstance(locator := axis.get_major_locator(), MaxNLocator):
                locator.set_params(nbins=TICKS)
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=80, format="png")
    return base64.b64encode(buffer.getvalue()).decode()
