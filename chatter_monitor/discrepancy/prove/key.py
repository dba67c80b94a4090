"""The sealed key: the truth about all cases, fixed by its hash before anything is diagnosed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from chatter_monitor.errors import InputError

SCHEMA = "chatter-monitor/proof-key/1"
Truths = dict[str, dict[str, Any]]


def sha256(path: Path) -> str:
    """Hash of a file, hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def seal(truths: Mapping[str, Mapping[str, Any]], cases: Path, key: Path, published: Path) -> str:
    """Write the key and publish its hash.

    The key holds the hashes of every recording and base model as well: whoever knows its hash knows that none of them
    was exchanged.

    Parameters
    ----------
    truths : mapping of str to mapping
        Truth about each case by the name of its directory in `cases`.
    cases, key, published : Path
        Directory of the cases, file of the key, file of its hash.

    Returns
    -------
    str
        The hash.
    """
    held = {
        name: {**truth, "sha256": {file.name: sha256(file) for file in sorted((cases / name).iterdir())}}
        for name, truth in truths.items()
    }
    key.write_text(json.dumps({"schema": SCHEMA, "cases": held}, indent=1) + "\n", encoding="utf-8")
    value = sha256(key)
    published.write_text(f"{value}  {key.name}\n", encoding="ascii")
    return value


def open_key(key: Path, published: Path, cases: Path) -> Truths:
    """Read the key after checking it, and all the cases, against the published hash.

    Raises
    ------
    InputError
        If the key or a case is not what was sealed.
    """
    promised = published.read_text(encoding="ascii").split()[0]
    if (got := sha256(key)) != promised:
        raise InputError(
            f"the key {key} is not the one that was sealed", got=got, allowed=promised, remedy="Start with a new --out."
        )
    truths: Truths = json.loads(key.read_text(encoding="utf-8"))["cases"]
    for name, truth in truths.items():
        for file, value in truth["sha256"].items():
            if not (cases / name / file).is_file() or sha256(cases / name / file) != value:
                raise InputError(
                    f"{cases / name / file} is not the one that was sealed", remedy="Start with a new --out."
                )
    return truths
