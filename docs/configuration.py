"""Write docs/configuration.md from the settings classes: ``python -m docs.configuration``.

What a key is for stands in its class's docstring, its range and default in its annotation, its unit in its name.
"""

from __future__ import annotations

import inspect
import itertools
import json
import re
from pathlib import Path
from typing import Any

import msgspec
from msgspec.inspect import (
    DataclassType,
    Field,
    FloatType,
    IntType,
    LiteralType,
    NoneType,
    StrType,
    StructType,
    TupleType,
    UnionType,
    VarTupleType,
)

from chatter_monitor.config import Settings

PAGE = Path(__file__).with_suffix(".md")

BEGINNING = """<!-- Made by `make docs` from the settings classes; changes here are lost. -->

# The configuration

A machine is described by a TOML file, given with `--config FILE`; of several, later ones win key by key. Every table
and every key may be left out. An unknown one is refused, and so is a value that is not allowed, with exit code 2 and a
line that says what is allowed. [config/lathe.toml](../config/lathe.toml) is the machine of the demo,
[config/machine.toml](../config/machine.toml) the beginning of one for [the service](service.md).
"""

UNITS = {
    "_s": "s",
    "_ms": "ms",
    "_hz": "Hz",
    "_rpm": "rpm",
    "_gb": "GB",
    "_percent": "%",
}


def main() -> None:
    """Write the page where it stands."""
    PAGE.write_text(page(), encoding="utf-8")


def page() -> str:
    """Markdown of the reference."""
    tables = msgspec.inspect.type_info(Settings)
    assert isinstance(tables, StructType)  # noqa: S101
    return "\n".join([BEGINNING, *(_table(field) for field in tables.fields)])


def _table(table: Field) -> str:
    """Section on one table of the file."""
    settings = table.type
    assert isinstance(settings, StructType | DataclassType)  # noqa: S101
    summary, keys = _documented(settings.cls)
    rows = []
    for about, together in itertools.groupby(settings.fields, lambda field: keys[field.name]):
        fields = list(together)
        names = ", ".join(f"`{field.name}`" for field in fields)
        default = " and ".join(dict.fromkeys(_default(field.default) for field in fields))
        rows.append(f"| **{names}**<br>{_allowed(fields[0])}<br>default: {default} | {about} |")
    return "\n".join([f"## [{table.name}]", "", summary, "", "| key | what it is |", "|---|---|", *rows, ""])


def _documented(settings: type) -> tuple[str, dict[str, str]]:
    """What a class says of itself, and of each of its attributes.

    Raises
    ------
    KeyError
        By the caller, for an attribute that the docstring leaves out.
    """
    text = inspect.getdoc(settings) or ""
    summary, _, rest = text.partition("\n\nAttributes\n----------\n")
    attributes = re.split(r"\n\n\w+\n---+\n", rest)[0]
    keys = {}
    for names, about in re.findall(r"^(\S.*?) : .*\n((?:    .*(?:\n|$))+)", attributes, flags=re.MULTILINE):
        keys |= dict.fromkeys(names.split(", "), _markdown(about))
    return _markdown(re.sub(r": the table ``\[\w+\]`` of a machine configuration", "", summary)), keys


def _markdown(text: str) -> str:
    """Text of a docstring as Markdown on one line, with links to the pages that it names; None is a key left out."""
    line = " ".join(text.split()).replace("``", "`").replace("|", r"\|").replace("None", "left out")
    return re.sub(r"docs/(\S+\.md)", lambda named: f"[{_title(named[1])}]({named[1]})", line)


def _title(page: str) -> str:
    return (PAGE.parent / page).read_text(encoding="utf-8").splitlines()[0].removeprefix("# ")


def _allowed(field: Field) -> str:
    """Range of a key, with its unit."""
    unit = next((f" {unit}" for suffix, unit in UNITS.items() if field.name.endswith(suffix)), "")
    return _range(field.type) + unit


def _range(kind: Any) -> str:
    """What values a type lets pass."""
    match kind:
        case UnionType():
            return " or ".join(_range(one) for one in kind.types if not isinstance(one, NoneType))
        case FloatType() | IntType():
            name = "number" if isinstance(kind, FloatType) else "integer"
            bounds = {"&gt;": kind.gt, "≥": kind.ge, "&lt;": kind.lt, "≤": kind.le}
            given = ", ".join(f"{sign} {bound}" for sign, bound in bounds.items() if bound is not None)
            return f"{name} {given}".strip()
        case StrType():
            return "text" + (f" of at most {kind.max_length} characters" if kind.max_length else "")
        case LiteralType():
            return ", ".join(f'`"{value}"`' for value in kind.values)
        case VarTupleType():
            return f"list of {_range(kind.item_type)}".replace("integer", "integers")
        case TupleType():
            return "[" + ", ".join(_range(item) for item in kind.item_types) + "]"
    raise TypeError(kind)


def _default(value: Any) -> str:
    """Value as TOML has it, which for text, numbers and lists is as JSON has it."""
    if value is None:
        return "left out"
    return f"`{json.dumps(value)}`"


if __name__ == "__main__":
    main()
