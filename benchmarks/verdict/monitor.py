"""The one place where the benchmark meets the monitor: a cut in, a verdict for every interval out."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.verdict.cut import RATE_HZ, Cut
from chatter_monitor.acquisition.synthetic import Synthetic
from chatter_monitor.config import Settings, load
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.records import Event, Health, Odp, OdpFrame, Verdict
from chatter_monitor.service.monitor import Monitor

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Opinions:
    """What the monitor said of a cut; arrays of shape (intervals,), NaN where it said nothing.

    Attributes
    ----------
    state : ndarray of str
        As in the verdict message.
    confidence, frequency_hz, damping_ratio, margin_percent : ndarray
        Fields of the same names.
    """

    state: NDArray[np.str_]
    confidence: Floats
    frequency_hz: Floats
    damping_ratio: Floats
    margin_percent: Floats

    @property
    def score(self) -> Floats:
        """How much speaks for self-excitation: alarms by confidence, then warnings, then the rest the other way."""
        rank = np.where(self.state == "self_excited", 2.0, np.where(self.state == "approaching", 1.0, 0.0))
        return np.asarray(np.where(rank > 0, rank + self.confidence, 1.0 - self.confidence))


class Verdicts(Outlet):
    """Keeps the verdicts."""

    def __init__(self) -> None:
        self.kept: list[Verdict] = []

    def frame(self, frame: OdpFrame, odp: Odp) -> None:
        """Leave it."""

    def message(self, message: Verdict | Event | Health) -> None:
        """Keep verdicts."""
        if isinstance(message, Verdict):
            self.kept.append(message)

    def close(self) -> None:
        """Nothing to let go of."""


class NothingCounted:
    """A source that loses and clips nothing on its way."""

    clipped_samples = 0
    non_finite_samples = 0


def settings_for(rpm: float | None, teeth: int) -> Settings:
    """Return the default settings with the spindle as the monitor is told it."""
    return load([], {} if rpm is None else {"spindle": {"speed_rpm": rpm, "teeth": teeth}})


def listen(cut: Cut, *, speed_known: bool) -> Opinions:
    """Run the monitor over a cut, told its nominal speed and teeth or neither."""
    verdicts = Verdicts()
    source = Synthetic.from_array(cut.samples, RATE_HZ, block_samples=32768)
    monitor = Monitor(
        settings_for(cut.nominal_rpm if speed_known else None, cut.teeth),
        source,
        [verdicts],
        counts=NothingCounted(),
        source_rate_hz=RATE_HZ,
        session=cut.name,
        clock=time.perf_counter,
    )
    for _ in monitor.run():
        pass
    kept = verdicts.kept[: len(cut.truth)]
    if len(kept) != len(cut.truth):
        raise RuntimeError(f"{len(kept)} verdicts for {len(cut.truth)} intervals of {cut.name}")

    def column(name: str) -> Floats:
        return np.array([np.nan if (value := getattr(v, name)) is None else value for v in kept], float)

    return Opinions(
        state=np.array([v.state for v in kept]),
        confidence=column("confidence"),
        frequency_hz=column("frequency_hz"),
        damping_ratio=column("damping_ratio"),
        margin_percent=column("margin_percent"),
    )
