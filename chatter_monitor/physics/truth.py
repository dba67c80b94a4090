"""What is true about a simulated recording: the machine's roots along time and where it chatters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.model_file import as_tables
from chatter_monitor.physics.stability import Root, rightmost_root, rightmost_roots_along

INTERVAL_S = 0.05
_PAUSE_S = 0.25  # chatter that pauses for less than this is one stretch

Stretches = list[tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Truth:
    """The truth about a simulated recording.

    Attributes
    ----------
    system, seed, sample_rate_hz, duration_s :
        What was simulated and how.
    roots : tuple of Root
        Rightmost characteristic root in the middle of each interval of `INTERVAL_S`, parameters frozen there.
    unstable_s : list of (float, float)
        Stretches in which that root has negative damping.
    chatter_s : list of (float, float)
        Stretches of developed chatter: self-excited so far that the tool leaves the cut. It begins after the loss of
        stability, when the vibration has grown, and may outlast it. Without loss of contact in the model, the same
        as `unstable_s`.
    """

    system: MachiningSystem
    seed: int
    sample_rate_hz: float
    duration_s: float
    roots: tuple[Root, ...]
    unstable_s: Stretches
    chatter_s: Stretches

    def to_json(self) -> dict[str, Any]:
        """Objects that any JSON encoder takes, as in the sidecar of a recording."""
        spindle = self.system.spindle
        return {
            "schema": "chatter-monitor/truth/1",
            "seed": self.seed,
            "sample_rate_hz": self.sample_rate_hz,
            "duration_s": self.duration_s,
            "spindle_rpm": spindle.speed_rpm if spindle else None,
            "teeth": spindle.teeth if spindle else None,
            "unstable_s": self.unstable_s,
            "chatter_s": self.chatter_s,
            "interval_s": INTERVAL_S,
            "intervals": [
                {
                    "t0": round(i * INTERVAL_S, 6),
                    "frequency_hz": round(root.frequency_hz, 4),
                    "damping_ratio": round(root.damping_ratio, 7),
                    "stable": root.stable,
                }
                for i, root in enumerate(self.roots)
            ],
            "model": as_tables(self.system),
        }


def truth_of(system: MachiningSystem, out_of_cut: NDArray[np.bool_], sample_rate_hz: float, seed: int) -> Truth:
    """Work out the truth about a simulated recording from the system and from when the tool was out of the cut."""
    duration_s = out_of_cut.size / sample_rate_hz
    count = max(1, int(duration_s / INTERVAL_S + 1e-9))
    if system.drifts:
        roots = rightmost_roots_along(system, [INTERVAL_S * (i + 0.5) for i in range(count)])
    else:
        roots = (rightmost_root(system),) * count
    unstable = np.array([not root.stable for root in roots])
    chatter = unstable
    if any(applied.term.chip_thickness for applied in system.terms):
        leaving = np.logical_or.reduceat(out_of_cut, np.arange(count) * round(INTERVAL_S * sample_rate_hz))
        chatter = np.zeros_like(unstable)
        for first, last in _runs(leaving, round(_PAUSE_S / INTERVAL_S)):
            chatter[first:last] = unstable[first:last].any()
    return Truth(system, seed, sample_rate_hz, duration_s, roots, _stretches(unstable), _stretches(chatter))


def _runs(flags: NDArray[np.bool_], pause: int = 0) -> list[tuple[int, int]]:
    """First and one-past-last index of each run of true flags; runs at most `pause` apart are one."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    runs: list[tuple[int, int]] = []
    for first, last in edges.reshape(-1, 2).tolist():
        if runs and first - runs[-1][1] <= pause:
            runs[-1] = (runs[-1][0], last)
        else:
            runs.append((first, last))
    return runs


def _stretches(flags: NDArray[np.bool_]) -> Stretches:
    return [(round(first * INTERVAL_S, 6), round(last * INTERVAL_S, 6)) for first, last in _runs(flags)]
