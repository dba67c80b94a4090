"""Machine configuration: TOML files to frozen settings, unknown keys refused.

Each component owns its settings class with its defaults; here they are only put together.
"""

from __future__ import annotations

import difflib
import math
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import msgspec

from chatter_monitor.acquisition.settings import InputSettings
from chatter_monitor.discrepancy.live.settings import ModelSettings
from chatter_monitor.errors import InputError
from chatter_monitor.outlets.control import ControlSettings
from chatter_monitor.outlets.event_files import read
from chatter_monitor.outlets.flight_recorder import RecorderSettings
from chatter_monitor.outlets.metrics import MetricsSettings
from chatter_monitor.outlets.publisher import PublishSettings
from chatter_monitor.tracking.orders import OrderSettings
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.tracking.tracker import TrackerSettings
from chatter_monitor.verdict.settings import JudgeSettings


class MachineSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the machine is called: the table ``[machine]`` of a machine configuration.

    Attributes
    ----------
    name : str
        Name that messages and tables carry.
    """

    name: Annotated[str, msgspec.Meta(min_length=1, max_length=100)] = "machine"


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All tables of a machine configuration; every table and key may be left out."""

    machine: MachineSettings = MachineSettings()
    input: InputSettings = InputSettings()
    spindle: SpindleSettings = SpindleSettings()
    tracker: TrackerSettings = TrackerSettings()
    orders: OrderSettings = OrderSettings()
    verdict: JudgeSettings = JudgeSettings()
    model: ModelSettings = ModelSettings()
    publish: PublishSettings = PublishSettings()
    control: ControlSettings = ControlSettings()
    metrics: MetricsSettings = MetricsSettings()
    recorder: RecorderSettings = RecorderSettings()


# Tables that say where results go, and with what the signal is compared: verdicts, events and ODPs do not hang on them.
_ELSEWHERE = ("model", "publish", "control", "metrics", "recorder")


def decisive_tables(settings: Settings) -> dict[str, dict[str, Any]]:
    """Tables that the verdicts on given samples depend on, defaults and all."""
    tables: dict[str, dict[str, Any]] = msgspec.to_builtins(settings)
    return {name: table for name, table in tables.items() if name not in _ELSEWHERE}


def load(paths: Sequence[Path], overrides: dict[str, dict[str, Any]] | None = None) -> Settings:
    """Read configuration files, later ones winning key by key.

    Parameters
    ----------
    paths : sequence of Path
        TOML files, or the JSON of recorded events; none for the defaults.
    overrides : dict, optional
        Tables that win over all files, such as command-line options.

    Raises
    ------
    InputError
        If a file cannot be read, is not TOML, has an unknown table or key, or a value that is not allowed.
    """
    return settings_of(merged_tables(paths, overrides))


def merged_tables(
    paths: Sequence[Path], overrides: dict[str, dict[str, Any]] | None = None
) -> dict[str, dict[str, Any]]:
    """Read configuration files as `load` does, but only what they say, without the defaults.

    Raises
    ------
    InputError
        As `load`.
    """
    merged: dict[str, dict[str, Any]] = {}
    for path in paths:
        tables = _read(path)
        _refuse_unknown(path, tables)
        _convert(f"the configuration {str(path)!r}", tables)
        _merge(merged, tables)
    _merge(merged, overrides or {})
    return merged


def settings_of(tables: dict[str, dict[str, Any]]) -> Settings:
    """Settings out of tables; InputError if a value is not allowed."""
    return _convert("the settings", tables)


def _read(path: Path) -> dict[str, Any]:
    if path.suffix == ".json":
        return dict(read(path).settings)
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        what = f"the configuration cannot be read: {error.strerror}"
        raise InputError(what, got=str(path), remedy="Check the path.") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"the configuration is not TOML: {error}", got=str(path)) from error


def _merge(into: dict[str, dict[str, Any]], tables: dict[str, dict[str, Any]]) -> None:
    for name, table in tables.items():
        into.setdefault(name, {}).update(table)


def _refuse_unknown(path: Path, tables: dict[str, Any]) -> None:
    known_tables = {field.name: field.type for field in msgspec.structs.fields(Settings)}
    for name, table in tables.items():
        if name not in known_tables:
            raise _unknown(path, f"[{name}]", name, list(known_tables))
        if not isinstance(table, dict):
            raise InputError(f"{name!r} in the configuration {str(path)!r} is a table", got=table, allowed=f"[{name}]")
        keys = _keys(known_tables[name])
        for key in table:
            if key not in keys:
                raise _unknown(path, f"[{name}] {key}", key, keys)


def _keys(settings: type) -> list[str]:
    info = msgspec.inspect.type_info(settings)
    if not isinstance(info, msgspec.inspect.StructType | msgspec.inspect.DataclassType):
        raise TypeError(settings)
    return [field.name for field in info.fields]


def _unknown(path: Path, what: str, name: str, known: list[str]) -> InputError:
    nearest = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    return InputError(
        f"unknown key {what} in the configuration {str(path)!r}",
        allowed=", ".join(known),
        remedy=f"Did you mean {nearest[0]!r}?" if nearest else None,
    )


def _convert(what: str, tables: dict[str, dict[str, Any]]) -> Settings:
    for name, values in tables.items():
        for key, value in values.items():
            if isinstance(value, float) and not math.isfinite(value):
                raise InputError(f"[{name}] {key} in {what} is not allowed", got=value, allowed="a finite number")
    try:
        return msgspec.convert(tables, Settings)
    except InputError as error:  # of a settings class, which does not know where its values come from
        where = f"{error.what} (in {what})"
        raise InputError(where, got=error.got, allowed=error.allowed, remedy=error.remedy) from error
    except msgspec.ValidationError as error:
        message, _, where = str(error).partition(" - at `$.")
        table, _, key = where.rstrip("`").partition(".")
        got = tables.get(table, {}).get(key.split("[")[0]) if key else tables.get(table)
        place = f"[{table}] {key}".strip() if table else "a table"
        raise InputError(f"{place} in {what} is not allowed", got=got, allowed=message) from error
