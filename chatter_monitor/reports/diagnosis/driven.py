"""The report of a diagnosis with a measured force."""

from __future__ import annotations

import numpy as np

from chatter_monitor.discrepancy.driven.conclude import DrivenDiagnosis
from chatter_monitor.reports.diagnosis.document import document
from chatter_monitor.reports.diagnosis.drawing import AUGMENTED, BASE, RECORDED, figure_of, titled

_SHOWN = 30  # periods of the fastest that is looked at
_BINS = 40


def page_driven(diagnosis: DrivenDiagnosis, name: str) -> str:
    """HTML page with everything inside."""
    return document(diagnosis.report, name, [_picture(diagnosis)])


def _picture(diagnosis: DrivenDiagnosis) -> str:
    """The force along a stretch, and what is left of it over displacement and velocity."""
    case = diagnosis.case
    found = case.balance
    t = np.arange(found.force.size) / found.rate_hz
    models = {"linear": (case.explained(named=False), BASE), "augmented": (case.explained(named=True), AUGMENTED)}
    if not case.named:
        del models["augmented"]
    figure, (left, middle, right) = figure_of(1)
    shown_s = _SHOWN / found.edge_hz
    begin = max(0.0, 0.5 * float(t[-1] - shown_s))
    shown = (t >= begin) & (t <= begin + shown_s)
    left.plot(t[shown], found.force[shown], color=RECORDED, lw=1.2, label="measured")
    for label, (force, color) in models.items():
        left.plot(t[shown], force[shown], color=color, lw=0.9, label=label)
    left.set(xlabel="time, s", ylabel="force, input", title=f"force below {found.edge_hz:.3g} Hz")
    left.legend(fontsize="small")
    held = case.held_out
    motion = found.motion
    for axes, fine, label in ((middle, motion.x[0], "displacement"), (right, motion.v[0], "velocity")):
        place = fine[:: found.factor][: held.size][held]
        edges = np.quantile(place, np.linspace(0.0, 1.0, _BINS + 1))
        inside = np.digitize(place, edges[1:-1])
        count = np.maximum(np.bincount(inside, minlength=_BINS), 1)
        centre = np.bincount(inside, place, _BINS) / count
        for name, (force, color) in models.items():
            rest = (found.force - force)[held]
            mean = np.bincount(inside, rest, _BINS) / count
            spread = np.sqrt(np.maximum(np.bincount(inside, rest**2, _BINS) / count - mean**2, 0.0))
            axes.plot(centre, mean, color=color, lw=1.2, label=name)
            axes.fill_between(centre, mean - spread, mean + spread, color=color, alpha=0.2, lw=0)
        axes.set(xlabel=label, title=f"left of the force over the {label}: mean and spread")
    return titled(figure, "Force balance")
