"""Model files: TOML to `MachiningSystem` and back, with errors that name file, key and remedy."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, Field, fields
from pathlib import Path
from typing import Any, TypeVar

from chatter_monitor.errors import InputError
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm, Cut, Drift, Excitation, Mode, Sensor, Spindle
from chatter_monitor.physics.terms import ABOVE, CATALOGUE, Term

Part = TypeVar("Part")
Table = Mapping[str, Any]

_SECTIONS = ("sensor", "mode", "excitation", "spindle", "term", "drift", "cut")
_TEXTS = ("quantity", "kind", "name", "parameter", "recording")
_LISTS = ("time_s", "value")


def read_model(path: Path, catalogue: Mapping[str, Term] = CATALOGUE) -> MachiningSystem:
    """Read a model file.

    Parameters
    ----------
    path : Path
        A TOML file with ``[[mode]]`` and, as needed, ``[sensor]``, ``[excitation]``, ``[spindle]``, ``[[term]]``,
        ``[[drift]]`` and ``[[cut]]``.
    catalogue : mapping of str to Term
        Terms that the file may name.

    Raises
    ------
    InputError
        With the file, the table and the key, what is allowed and what to do.
    """
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"model file {path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"model file {path} is no text: {error}") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"model file {path} is not valid TOML: {error}") from error
    return _system(tables, str(path), catalogue)


def model_text(system: MachiningSystem) -> str:
    """Text of the model file that `read_model` reads back to an equal system."""
    lines: list[str] = []
    for name, content in as_tables(system).items():
        several = isinstance(content, list)
        for table in content if several else [content]:
            lines.append(f"[[{name}]]" if several else f"[{name}]")
            lines += [f"{key} = {_value_text(value)}" for key, value in table.items()]
            lines.append("")
    return "\n".join(lines)


def as_tables(system: MachiningSystem) -> dict[str, Any]:
    """Tables of the model file; optional keys at their defaults are left out, parameters of terms never are."""
    tables: dict[str, Any] = {
        "sensor": {"quantity": system.sensor.quantity} | _changed(system.sensor),
        "mode": [_changed(mode) for mode in system.modes],
        "excitation": {"kind": system.excitation.kind} | _changed(system.excitation),
    }
    if system.spindle:
        tables["spindle"] = {"speed_rpm": system.spindle.speed_rpm, "teeth": system.spindle.teeth}
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
    if system.cuts:
        tables["cut"] = [_changed(cut) for cut in system.cuts]
    return tables


def _changed(part: Any) -> dict[str, Any]:
    """Fields of a part that differ from their defaults."""
    return {f.name: getattr(part, f.name) for f in fields(part) if getattr(part, f.name) != f.default}


def _value_text(value: Any) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list):
        return f"[{', '.join(_value_text(item) for item in value)}]"
    return repr(value)


def _system(tables: Table, file: str, catalogue: Mapping[str, Term]) -> MachiningSystem:
    _refuse_unknown(tables, _SECTIONS, file)

    def single(name: str, make: Callable[..., Part]) -> Part | None:
        if name not in tables:
            return None
        return _part(make, tables[name], f"{file}: [{name}]")

    def several(name: str, make: Callable[[Table, str], Part]) -> tuple[Part, ...]:
        content = tables.get(name, [])
        if not isinstance(content, list):
            raise InputError(f"{file}: {name} has to be a list of tables", remedy=f"Write [[{name}]].")
        return tuple(make(table, f"{file}: [[{name}]] number {i}") for i, table in enumerate(content, 1))

    modes = several("mode", lambda table, where: _part(Mode, table, where))
    terms = several("term", lambda table, where: _applied_term(table, where, catalogue))
    drifts = several("drift", lambda table, where: _part(Drift, table, where))
    cuts = several("cut", lambda table, where: _part(Cut, table, where))
    excitation = single("excitation", Excitation) or Excitation()
    sensor = single("sensor", Sensor) or Sensor()
    spindle = single("spindle", Spindle)
    with _Located(file):
        return MachiningSystem(modes, terms, excitation, spindle, sensor, drifts, cuts)


def _part(make: Callable[..., Part], table: Table, where: str) -> Part:
    """Build a part from a table whose keys are its fields."""
    known: dict[str, Field[Any]] = {f.name: f for f in fields(make)}  # type: ignore[arg-type]
    values = _checked(table, known, where)
    for name, declared in known.items():
        if declared.default is MISSING and name not in values:
            raise InputError(f"{where}: {name} is missing", remedy=f"Add {name} = ...")
    with _Located(where):
        return make(**values)


def _applied_term(table: Table, where: str, catalogue: Mapping[str, Term]) -> AppliedTerm:
    name = table.get("name") if isinstance(table, dict) else None
    if not isinstance(name, str) or name not in catalogue:
        raise InputError(
            f"{where}: name is not in the catalogue of terms",
            got=name,
            allowed=", ".join(catalogue),
            remedy=_nearest(str(name), catalogue),
        )
    term = catalogue[name]
    if ABOVE.name in table and not term.needs_spindle:
        term = term.above_amplitude
    values = _checked(table, ["name", *(parameter.name for parameter in term.parameters)], f"{where} ({name})")
    del values["name"]
    with _Located(where):
        return AppliedTerm(term, values)


def _checked(table: Any, known: Iterable[str], where: str) -> dict[str, Any]:
    """Refuse unknown keys and wrong types; whole numbers become floats, lists become tuples."""
    if not isinstance(table, dict):
        raise InputError(f"{where} has to be a table", got=table)
    _refuse_unknown(table, known, where)
    values: dict[str, Any] = {}
    for key, value in table.items():
        if key in _TEXTS:
            expected, fits = "a text in quotes", isinstance(value, str)
        elif key in _LISTS:
            expected, fits = "a list of numbers", isinstance(value, list) and all(map(_is_number, value))
        elif key == "teeth":
            expected, fits = "a whole number", isinstance(value, int) and _is_number(value)
        else:
            expected, fits = "a number", _is_number(value)
        if not fits:
            raise InputError(f"{where}: {key} has the wrong type", got=value, allowed=expected)
        values[key] = tuple(map(float, value)) if key in _LISTS else value
        if expected == "a number":
            values[key] = float(value)
    return values


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _refuse_unknown(table: Table, known: Iterable[str], where: str) -> None:
    known = list(known)
    for key in table:
        if key not in known:
            with_unit = [name for name in known if name.startswith(f"{key}_")]
            what = f"the unit of {key} is missing" if with_unit else f"unknown key {key}"
            remedy = f"Write {with_unit[0]}." if with_unit else _nearest(key, known)
            raise InputError(f"{where}: {what}", allowed=", ".join(known), remedy=remedy)


def _nearest(name: str, known: Iterable[str]) -> str | None:
    found = difflib.get_close_matches(name, list(known), n=1, cutoff=0.4)
    return f"Did you mean {found[0]}?" if found else None


class _Located:
    """Put the place in the file in front of the errors of the parts."""

    def __init__(self, where: str) -> None:
        self.where = where

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, InputError):
            raise InputError(
                f"{self.where}: {error.what}", got=error.got, allowed=error.allowed, remedy=error.remedy
            ) from error
