"""Generated cuts kept in files: generating takes about a second each, reading a few milliseconds."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from dataclasses import asdict, fields
from pathlib import Path

import numpy as np

from benchmarks.verdict.cut import Cut, Stretch, Truth
from benchmarks.verdict.generator import Split, cut


def cached_cuts(split: Split, count: int, directory: Path | None, first: int = 0) -> Iterator[Cut]:
    """Yield the cuts of `generator.cuts`, from files in `directory` where they are there already.

    The files know nothing of the generator's version: empty the directory when it changes.
    """
    for number in range(first, first + count):
        if directory is None:
            yield cut(split, number)
            continue
        file = directory / f"{split}-{number:04d}.npz"
        if not file.exists():
            directory.mkdir(parents=True, exist_ok=True)
            _save(cut(split, number), file)
        yield _load(file)


def _save(made: Cut, file: Path) -> None:
    arrays, plain = {}, {}
    for prefix, part in (("cut.", made), ("truth.", made.truth)):
        for field in fields(part):
            value = getattr(part, field.name)
            if isinstance(value, np.ndarray):
                arrays[prefix + field.name] = value
            elif field.name == "unstable":
                plain[prefix + field.name] = [asdict(stretch) for stretch in value]
            elif not isinstance(value, Truth):
                plain[prefix + field.name] = value
    arrays["cut.samples"] = made.samples.astype(np.float32)  # they are float32 values
    partial = file.with_suffix(f".{os.getpid()}.npz")
    np.savez(partial, plain=json.dumps(plain), **arrays)
    partial.rename(file)  # whole or not at all


def _load(file: Path) -> Cut:
    with np.load(file) as stored:
        values = json.loads(str(stored["plain"])) | {name: stored[name] for name in stored.files if name != "plain"}
    parts = {
        prefix: {name.removeprefix(prefix): value for name, value in values.items() if name.startswith(prefix)}
        for prefix in ("cut.", "truth.")
    }
    truth = parts["truth."]
    truth["unstable"] = tuple(Stretch(**stretch) for stretch in truth["unstable"])
    parts["cut."]["samples"] = parts["cut."]["samples"].astype(np.float64)
    return Cut(truth=Truth(**truth), **parts["cut."])
