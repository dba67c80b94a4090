"""The report of several recordings: side by side, and what they share."""

from __future__ import annotations

import numpy as np

from chatter_monitor.discrepancy.together.diagnose import Together
from chatter_monitor.discrepancy.together.shared import inverse_speed
from chatter_monitor.reports.diagnoses import WORDS
from chatter_monitor.reports.diagnosis.document import document
from chatter_monitor.reports.diagnosis.drawing import AUGMENTED, RECORDED, figure_of, titled
from chatter_monitor.reports.page import Link, table

_PER_ROW = 3


def page_together(together: Together, name: str) -> str:
    """HTML page with everything inside; the reports of the recordings are linked."""
    pictures = [_damping(together), _spectra(together)]
    return document(together.report, name, pictures, f"<h2>The recordings</h2>{_table(together)}")


def _table(together: Together) -> str:
    """The recordings, a row each."""
    head = ("recording", "spindle, rpm", "v_c, m/s", "alone", "Hz", "damping, %", "95 %", "shared, %")
    rows = []
    for each in together.report.recordings:
        low, high = (100 * end for end in each.damping_ratio.ci95)
        cells = (
            Link(each.recording, each.report),
            "" if each.speed_rpm is None else f"{each.speed_rpm:g}",
            "" if each.cutting_speed_m_s is None else f"{each.cutting_speed_m_s:g}",
            WORDS[each.verdict],
            f"{each.frequency_hz.value:.4g}",
            f"{100 * each.damping_ratio.value:.3g}",
            f"{low:.3g} to {high:.3g}",
            f"{100 * each.shared_damping_ratio:.3g}",
        )
        rows.append(cells)
    return table(head, rows)


def _damping(together: Together) -> str:
    """Frequency, damping over b / v_c, and what is left of it."""
    figure, (left, middle, right) = figure_of(1)
    compared, found = together.report.recordings, together.shared
    inverse = [inverse_speed(cut) for cut in together.cuts]
    known = all(value is not None for value in inverse)
    along = np.array([value if known and value is not None else i for i, value in enumerate(inverse)])
    where = "b / v_c, s" if known else "recording"
    for axes, unit, values, title in (
        (left, 1.0, [each.frequency_hz for each in compared], "frequency, Hz"),
        (middle, 100.0, [each.damping_ratio for each in compared], "damping ratio, %"),
    ):
        centre = np.array([unit * e.value for e in values])
        reach = np.abs(np.array([[unit * e.ci95[0], unit * e.ci95[1]] for e in values]).T - centre)
        axes.errorbar(along, centre, reach, fmt="o", color=RECORDED, label="each recording alone")
        axes.set(xlabel=where, title=title)
    shares = np.array([100.0 * each.shared_damping_ratio for each in compared])
    order = np.argsort(along)
    left.axhline(found.modes[0].frequency_hz, color=AUGMENTED, lw=1.0, label="shared")
    middle.plot(along[order], shares[order], color=AUGMENTED, lw=1.0, label="shared")
    if known:
        middle.plot(
            [0.0, along[order][0]],
            [100.0 * found.modes[0].damping_ratio, shares[order][0]],
            color=AUGMENTED,
            lw=1.0,
            ls="--",
        )
        middle.set(xlim=(0.0, None), ylim=(0.0, None))
    middle.legend(fontsize="small")
    sd = np.array([100.0 * (each.damping_ratio.ci95[1] - each.damping_ratio.ci95[0]) / 3.92 for each in compared])
    alone = np.array([100.0 * each.damping_ratio.value for each in compared])
    right.bar([each.recording for each in compared], (alone - shares) / sd, color=RECORDED)
    right.axhspan(-1.96, 1.96, color="0.9", zorder=0)
    right.set(title="damping alone less shared, standard deviations")
    right.tick_params(axis="x", labelrotation=20, labelsize=8)
    return titled(figure, "Damping over the speed")


def _spectra(together: Together) -> str:
    """The spectrum of every recording with that of its base model."""
    count = len(together.diagnoses)
    figure, axes = figure_of(-(-count // _PER_ROW))
    for each, cut, axis in zip(together.diagnoses, together.cuts, axes, strict=False):
        spectrum, ratio = each.case.base.spectrum, each.case.base.fitted.ratio
        axis.plot(spectrum.frequency_hz, 10.0 * np.log10(spectrum.density), color=RECORDED, lw=0.5, label="recording")
        axis.plot(
            spectrum.frequency_hz,
            10.0 * np.log10(spectrum.density / ratio),
            color=AUGMENTED,
            lw=1.0,
            label="linear base",
        )
        axis.set(xlabel="Hz", ylabel="dB", title=f"{cut.recording}, {cut.speed_rpm:g} rpm")
    for axis in axes[count:]:
        axis.set_visible(False)
    axes[0].legend(fontsize="small")
    return titled(figure, "Spectra")
