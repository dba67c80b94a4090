"""The report of one recording whose force was not measured."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy.case import Case
from chatter_monitor.discrepancy.conclude import Diagnosis, base_of, conclude
from chatter_monitor.discrepancy.free_run import free_run, with_runs
from chatter_monitor.discrepancy.report import Report
from chatter_monitor.energy.identification import Identification
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.reports.diagnosis.by_energy import identified
from chatter_monitor.reports.diagnosis.document import document
from chatter_monitor.reports.diagnosis.maps import maps
from chatter_monitor.reports.diagnosis.runs import by_energy, comparison

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Begun:
    """What of a page does not wait for the conclusion.

    Attributes
    ----------
    maps : str
        Picture of them.
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
    return Begun(maps(case), runs, identified(runs, case.whole.rate_hz, case.base.quantity))


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
    report = with_runs(case, report, runs)
    pictures = [begun.maps, comparison(case, runs)]
    found = identified(runs, case.whole.rate_hz, case.base.quantity, begun.found)
    pictures += [by_energy(found)] if found else []
    return document(report, name, pictures), report


def _run(case: Case, name: str, system: MachiningSystem) -> dict[str, Vector]:
    """A simulation that runs on its own, by its name; nothing if there is none."""
    run = free_run(case, system)
    return {} if run is None else {name: run}
