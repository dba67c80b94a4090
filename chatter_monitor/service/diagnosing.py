"""Diagnosing a recording against a model: files in, files out."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from chatter_monitor.acquisition.recording import Recording
from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.chatter.conclude import conclude_chatter
from chatter_monitor.discrepancy.diagnosis import examine, recorded_from
from chatter_monitor.discrepancy.driven.case import examine_driven
from chatter_monitor.discrepancy.driven.conclude import conclude_driven
from chatter_monitor.discrepancy.oracle import gain_of
from chatter_monitor.discrepancy.report import Report
from chatter_monitor.discrepancy.together.diagnose import diagnose_together
from chatter_monitor.discrepancy.together.shared import with_process_damping
from chatter_monitor.errors import EnvironmentFault, InputError
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.model_file import model_text, read_model
from chatter_monitor.physics.parts import AppliedTerm, Mode
from chatter_monitor.physics.terms import CATALOGUE
from chatter_monitor.records import Flag
from chatter_monitor.reports.diagnosis.alone import concluded, page
from chatter_monitor.reports.diagnosis.chatter import page_chatter
from chatter_monitor.reports.diagnosis.driven import page_driven
from chatter_monitor.reports.diagnosis.together import page_together


def diagnose_file(
    file: Path,
    model: Path,
    out: Path,
    *,
    channel: int = 0,
    between_s: tuple[float, float] | None = None,
    driven_by: Path | None = None,
    input_channel: int = 0,
    progress: Callable[[str], None] = lambda _step: None,
) -> tuple[Report, list[Path]]:
    """Diagnose one channel of a recording; write report.json, report.html and model.toml.

    Parameters
    ----------
    file, model, out : Path
        Recording, model file, directory to write into.
    channel : int
        Counted from 0.
    between_s : (float, float), optional
        Stretch to look at.
    driven_by : Path, optional
        Recording of the force that drives the machine, sample by sample beside `file`; it may be another channel of it.
    input_channel : int
        Its channel, counted from 0.
    progress : callable, optional
        Told the name of every step.

    Returns
    -------
    Report, list of Path
        The answer, and the files written.

    Raises
    ------
    InputError
        If recording or model cannot be used.
    EnvironmentFault
        If the directory cannot be written.
    """
    started = time.perf_counter()
    system = read_model(model)
    system = system.in_cut(file.name)
    progress("reading the recording")
    recorded = _read(file, channel, between_s)
    chattering = conclude_chatter(recorded, system, progress) if driven_by is None else None
    if chattering is not None:
        progress("report")
        html, report, augmented = page_chatter(chattering, file.name), chattering.report, chattering.model
    elif driven_by is None:
        case = examine(recorded, with_process_damping(system), progress)
        progress("conclusion and report")
        diagnosis, html, report = concluded(case, file.name)
        augmented = diagnosis.model
    else:
        force = _read(driven_by, input_channel, between_s)
        driven = conclude_driven(examine_driven(recorded, force, system, progress), progress)
        progress("report")
        html, report, augmented = page_driven(driven, file.name), driven.report, driven.model
    report = msgspec.structs.replace(report, elapsed_s=round(time.perf_counter() - started, 3))
    return report, _write(out, report, html, augmented)


def diagnose_files(
    files: Sequence[Path],
    model: Path,
    out: Path,
    *,
    channel: int = 0,
    between_s: tuple[float, float] | None = None,
    progress: Callable[[str], None] = lambda _step: None,
) -> tuple[Report, list[Path]]:
    """Diagnose several recordings of one machine: what they share in `out`, each by itself in a directory below it.

    Parameters
    ----------
    files : sequence of Path
        Two or more, of different names; the cuts of the model file say at which speed each was recorded.
    model, out, channel, between_s, progress
        As for `diagnose_file`; channel and stretch are those of all recordings.

    Returns
    -------
    Report, list of Path
        The common answer, and the files written for it.

    Raises
    ------
    InputError, EnvironmentFault
        As for `diagnose_file`.
    """
    started = time.perf_counter()
    system = read_model(model)
    names = [file.name for file in files]
    if len(set(names)) < len(names):
        raise InputError("two recordings have the same name", got=", ".join(names), remedy="Rename one of them.")
    progress("reading the recordings")
    recordings = [(file.name, _read(file, channel, between_s)) for file in files]
    folders = [f"{i}-{file.stem}" for i, file in enumerate(files, 1)]
    together = diagnose_together(recordings, system, folders, progress)
    progress("reports")
    for folder, name, diagnosis in zip(folders, names, together.diagnoses, strict=True):
        html, report = page(diagnosis, name)
        _write(out / folder, report, html, diagnosis.model)
    report = msgspec.structs.replace(together.report, elapsed_s=round(time.perf_counter() - started, 3))
    return report, _write(out, report, page_together(together, ", ".join(names)), together.model)


def _write(out: Path, report: Report, html: str, model: MachiningSystem) -> list[Path]:
    written = [out / "report.json", out / "report.html", out / "model.toml"]
    try:
        out.mkdir(parents=True, exist_ok=True)
        written[0].write_bytes(report.to_json())
        written[1].write_text(html, encoding="utf-8")
        written[2].write_text(model_text(model), encoding="utf-8")
    except OSError as error:
        raise EnvironmentFault(f"the diagnosis cannot be written: {error.strerror}", got=str(out)) from error
    return written


def true_gain(file: Path, model: Path, truth: Mapping[str, Any]) -> float:
    """What the true model of a recording gains on its held-out blocks, nats (`discrepancy.oracle`).

    Parameters
    ----------
    file, model : Path
        Recording and base model.
    truth : mapping
        ``names`` with the one term, its ``parameters`` (coefficients that are not given are 0, a cutting speed is 1),
        ``frequency_hz`` and ``damping_ratio``; for a delay its ``amplitude``, of which the second number
        is the delay in seconds (the speed in the model file may be off); for what acts in part only ``time_s`` with the
        one stretch, or ``amplitude_above``.
    """
    system = read_model(model)
    mode = Mode(truth["frequency_hz"], truth["damping_ratio"])
    true = replace(with_hidden(system, truth), modes=(mode,))
    begin_end = truth.get("time_s") or [None]
    return gain_of(_read(file, 0, None), system, true, begin_end[0], truth.get("amplitude_above"))


def with_hidden(system: MachiningSystem, truth: Mapping[str, Any]) -> MachiningSystem:
    """A base model with the one term that is hidden from it, as for `true_gain`; its modes stay."""
    term = CATALOGUE[truth["names"][0]]
    unsaid = {p.name: 0.0 if p.linear else 1.0 for p in term.parameters if p.default is None}
    spindle = system.spindle
    if term.delayed and spindle is not None:
        spindle = replace(spindle, speed_rpm=60.0 / (spindle.teeth * truth["amplitude"][1]))
    return replace(system, terms=(*system.terms, AppliedTerm(term, unsaid | truth["parameters"])), spindle=spindle)


def lines(report: Report) -> list[str]:
    """The answer in a few lines for a terminal."""
    said = [f"{report.verdict}: {report.summary}"]
    for term in report.terms:
        sense = f" ({term.sense})" if term.sense else ""
        values = ", ".join(
            f"{name} = {e.value:.4g} [{e.ci95[0]:.4g}, {e.ci95[1]:.4g}] {e.unit}" for name, e in term.parameters.items()
        )
        said.append(f"  {term.name}{sense}: {values or 'no parameters'}; evidence {term.evidence_nats:.1f} nats")
    if report.terms and report.alternatives:
        runner = report.alternatives[0]
        said.append(f"  next: {runner.name} with {runner.evidence_nats:.1f} nats")
    if report.located.statistic is not None:
        statistic = report.located.statistic
        said.append(f"  clearest map: {statistic.name}, p = {statistic.p_value:.2g}")
    if report.force_balance is not None and report.force_balance.free_run_error_after is not None:
        errors = report.force_balance.free_run_error_before, report.force_balance.free_run_error_after
        before, after = ("runs away" if error is None else f"{100 * error:.3g} %" for error in errors)
        said.append(f"  driven by the measured force, the simulation is off by {before} before, {after} after")
    for each in report.recordings:
        at = f" at {each.cutting_speed_m_s:g} m/s" if each.cutting_speed_m_s is not None else ""
        speed = f" {each.speed_rpm:g} rpm" if each.speed_rpm is not None else ""
        low, high = (100 * end for end in each.damping_ratio.ci95)
        said.append(
            f"  {each.recording}{speed}{at}: {each.frequency_hz.value:.4g} Hz, damping "
            f"{100 * each.damping_ratio.value:.3g} [{low:.3g}, {high:.3g}] %; "
            f"shared {100 * each.shared_damping_ratio:.3g} %; alone: {each.verdict}"
        )
    said += [f"  note: {warning}" for warning in report.warnings]
    return said


def _read(file: Path, channel: int, between_s: tuple[float, float] | None) -> Recorded:
    pieces, missing = [], []
    with Recording(file, channels=[channel]) as recording:
        rate_hz = recording.sample_rate_hz
        for block in recording.blocks():
            pieces.append(block.samples[:, 0])
            lost = bool(block.flags) and bool(block.flags[0] & Flag.NON_FINITE)
            missing.append(np.full(len(block.samples), lost))
    samples, absent = np.concatenate(pieces), np.concatenate(missing)
    begin_s, end_s = between_s or (0.0, samples.size / rate_hz)
    part = slice(max(round(begin_s * rate_hz), 0), round(end_s * rate_hz))
    if not begin_s < end_s or samples[part].size == 0:
        raise InputError("impossible stretch", got=between_s, allowed="0 <= begin < end, within the recording")
    return recorded_from(samples[part], rate_hz, absent[part])
