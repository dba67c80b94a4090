"""Model files: TOML to `MachiningSystem` and back, with errors that name file, key and remedy."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from chatter_monitor.physics.model import MachiningSystem


def as_tables(system: MachiningSystem) -> dict[str, Any]:
    """Tables of the model file; what is at its default is written too, what is not set is left out."""
    tables: dict[str, Any] = {"sensor": _without_none(asdict(system.sensor))}
    tables["mode"] = [asdict(mode) for mode in system.modes]
    tables["excitation"] = _without_none(asdict(system.excitation))
    if system.spindle:
        tables["spindle"] = asdict(system.spindle)
    if system.terms:
        tables["term"] = [
            {"name": applied.term.name}
            | {p.name: value for p, value in zip(applied.term.parameters, applied.values, strict=True)}
            for applied in system.terms
        ]
    if system.drifts:
        tables["drift"] = [
            {"parameter": drift.parameter, "time_s": list(drift.time_s), "value": list(drift.value)}
            for drift in system.drifts
        ]
    return tables


def _without_none(table: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in table.items() if value is not None}
