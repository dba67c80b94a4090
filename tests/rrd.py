"""Reading a dashboard's file back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rerun.chunk import RrdReader

TIME = "time"


class Rrd:
    """What an .rrd file holds, by entity and component, in the order of time."""

    def __init__(self, path: Path) -> None:
        self._rows: dict[tuple[str, str], list[tuple[float | None, Any]]] = {}
        for chunk in RrdReader(path).stream():
            batch = chunk.to_record_batch()
            times = _seconds(batch.column(TIME)) if TIME in batch.schema.names else [None] * batch.num_rows
            for name in batch.schema.names:
                if ":" not in name:
                    continue
                rows = self._rows.setdefault((chunk.entity_path, name), [])
                values = batch.column(name).to_pylist()
                rows += [(t, value) for t, value in zip(times, values, strict=True) if value is not None]
        for rows in self._rows.values():
            rows.sort(key=lambda row: -np.inf if row[0] is None else row[0])

    @property
    def entities(self) -> set[str]:
        """Every entity path."""
        return {entity for entity, _ in self._rows}

    def rows(self, entity: str, component: str) -> list[tuple[float | None, Any]]:
        """Time in seconds, None for what is static, and value of every row."""
        return self._rows[(entity, component)]

    def series(self, entity: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Times, shape (n,), and numbers, shape (n, series), of a curve."""
        rows = self.rows(entity, "Scalars:scalars")
        return np.array([t for t, _ in rows], np.float64), np.array([values for _, values in rows], np.float64)


def _seconds(column: Any) -> list[float]:
    return [float(t) / 1e9 for t in column.cast("int64").to_pylist()]
