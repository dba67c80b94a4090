"""Numbers of one verdict interval that a verdict is made from; no decision yet."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.records import Flag, ModeStatus, OdpFrame
from chatter_monitor.tracking.spindle import SpindleSettings

# A mode is looked at when it carries at least this share of the signal's power: the poles of a fit to little more than
# noise wander anywhere, zero damping included.
SIGNIFICANT_SHARE = 0.05

# Plain numbers, because looking members up costs more than comparing a frame with them.
OSCILLATORY, HELD, STARTING = int(ModeStatus.OSCILLATORY), int(ModeStatus.HELD), int(ModeStatus.STARTING)


@dataclass(frozen=True, slots=True)
class ModeEvidence:
    """One mode over one interval: medians over its samples, with the median of their standard deviations."""

    frequency_hz: float
    damping_ratio: float
    damping_sd: float
    share: float


@dataclass(frozen=True, slots=True)
class Evidence:
    """What one interval says.

    Attributes
    ----------
    critical : ModeEvidence or None
        The least damped of the modes that carry a significant share of the power.
    held : bool
        No sample of the interval could be adapted to: nothing moves.
    starting : bool
        The tracker knows too little yet, at the start or after a gap.
    rms : float
        Of the signal without its offset.
    flags : Flag
        What is wrong with the samples.
    """

    critical: ModeEvidence | None
    held: bool
    starting: bool
    rms: float
    flags: Flag


def modes_evidence(frame: OdpFrame) -> list[ModeEvidence | None]:
    """Summary of each mode slot; None where it had no frequency for half of the interval or longer."""
    columns = np.array([frame.frequency_hz, frame.damping_ratio, frame.damping_sd])
    good = frame.status == OSCILLATORY
    if good.all():
        medians = _middle(columns).T.tolist()
    else:
        medians = [
            _middle(columns[:, good[:, mode], mode]).tolist() if 2 * good[:, mode].sum() > len(frame) else None
            for mode in range(good.shape[1])
        ]
    return [
        None if values is None else ModeEvidence(values[0], values[1], values[2], share)
        for values, share in zip(medians, frame.share.tolist(), strict=True)
    ]


def _middle(columns: NDArray[np.float32]) -> NDArray[np.float32]:
    """Median along the second axis, the upper one of two."""
    middle = columns.shape[1] // 2
    return np.partition(columns, middle, axis=1)[:, middle]


def weigh(frame: OdpFrame) -> Evidence:
    """Reduce the samples of a frame to evidence."""
    significant = [mode for mode in modes_evidence(frame) if mode is not None and mode.share >= SIGNIFICANT_SHARE]
    return Evidence(
        critical=min(significant, key=lambda mode: mode.damping_ratio, default=None),
        held=bool((frame.status == HELD).all()),
        starting=bool((frame.status == STARTING).any()),
        rms=frame.rms,
        flags=frame.flags,
    )


def probability_below(mode: ModeEvidence, damping_ratio: float) -> float:
    """Probability that the mode's damping is below a value, its estimate being normally distributed."""
    if not mode.damping_sd < math.inf:
        return 0.5
    return 0.5 * math.erfc((mode.damping_ratio - damping_ratio) / (math.sqrt(2.0) * max(mode.damping_sd, 1e-9)))


def spindle_order(frequency_hz: float, spindle: SpindleSettings) -> float | None:
    """Frequency in multiples of the spindle's, None where its speed is unknown."""
    return None if spindle.speed_rpm is None else frequency_hz * 60.0 / spindle.speed_rpm
