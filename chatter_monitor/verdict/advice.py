"""What to change when a cut chatters: a spindle speed between the lobes, or less depth."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.errors import InputError
from chatter_monitor.kernels.likely_modes import DAMPING_RATIOS, DEPTHS, chances, room, weigh_modes
from chatter_monitor.physics.lobes import Recommendation
from chatter_monitor.records import Advice
from chatter_monitor.tracking.spindle import SpindleSettings

Floats = NDArray[np.float64]

MOST_SPEEDS = 3
# A speed is worth a try where the cut is about as likely stable as not, as deep as it is.
WORTH_IT = 0.4
# Of two that are as likely that at which the cut may be deeper.
DEEPER = 0.001
# Speeds that are looked at: by how much one is above the other, and how far those that are given are from each other
# and from the present one at least (natural logarithms).
STEP, APART = 0.01, 0.05
# Range of the spindle, relative to its present speed, where the machine's is not configured.
USUAL_RANGE = (0.5, 2.0)
# Speeds that it may have now: so many in all of the range, where none is told; and so many this near to the one that is
# told, where that is not heard, for real ones are off by as much.
ANYWHERE, NEARBY, NEAR = 16, 5, 0.03
# Of more waves between two teeth than this the part of the last one tells as much, and all of them take long.
MANY_WAVES = 20.0

ASSUMED = (
    f"Assumes modes with {100 * min(DAMPING_RATIOS):.0f} to {100 * max(DAMPING_RATIOS):.0f} % damping, the same at any"
    f" speed, a depth of up to {max(DEPTHS):.1f} times its limit, and evenly spaced teeth"
)


class LikelySpeed(NamedTuple):
    """A spindle speed as it is told, and how likely the cut is stable there as deep as it is."""

    rpm: float
    stable: float

    @property
    def in_ten(self) -> int:
        """Of ten such cuts so many are."""
        return round(10.0 * self.stable)


def advise(chatter_hz: float, spindle: SpindleSettings, rotation_hz: float | None = None) -> Recommendation:
    """Speeds at which the cut is likely to be stable as deep as it is, the likeliest first, and the same in words.

    Parameters
    ----------
    chatter_hz : float
        Frequency of the chatter.
    spindle : SpindleSettings
        Present speed as it was told, teeth and range of the machine, where known.
    rotation_hz : float, optional
        Speed at which it turns in truth, if that is heard: speeds are advised as they have to be told.

    Returns
    -------
    Recommendation
        At most three speeds; none, with the reason, where less depth is the better way.

    Raises
    ------
    InputError
        For a frequency that is none.
    """
    if not 0.0 < chatter_hz < math.inf:
        raise InputError("no spindle speed can be advised", got=chatter_hz, allowed="a frequency > 0 in Hz")
    reach = _reach(spindle)
    if reach is None:
        return Recommendation((), "no speed can be advised: neither the spindle's speed nor its range is known")
    likely = likely_speeds(chatter_hz, spindle, rotation_hz)
    worth = [speed for speed in likely if speed.stable > WORTH_IT]
    around = f"between {reach[0]:.0f} and {reach[1]:.0f} rpm"
    if not likely:
        return Recommendation((), f"reduce the depth of cut: {around} there is no other speed")
    if not worth:
        text = f"reduce the depth of cut: {around} no speed is likely to be stable as deep as now"
        best = f"the likeliest, {likely[0].rpm:.0f} rpm, is in {likely[0].in_ten} of 10 such cuts"
        return Recommendation((), f"{text}; {best}. {ASSUMED}")
    listed = " or ".join(f"{speed.rpm:.0f} rpm (stable in {speed.in_ten} of 10 such cuts)" for speed in worth)
    waves = [round(60.0 * chatter_hz / (spindle.teeth * speed.rpm)) for speed in worth]
    given = (Advice(spindle_rpm=speed.rpm, lobe=lobe) for speed, lobe in zip(worth, waves, strict=True))
    return Recommendation(
        tuple(given), f"{listed}: between the lobes of what chatters at {chatter_hz:.0f} Hz. {ASSUMED}"
    )


def likely_speeds(chatter_hz: float, spindle: SpindleSettings, rotation_hz: float | None = None) -> list[LikelySpeed]:
    """At most three speeds that are likelier to be stable than those around them, the likeliest first.

    A mode chatters above its own frequency, so that a tooth frequency in step with the chatter may be as bad as any.
    Instead each mode is looked at that would chatter at this frequency and speed (`kernels.likely_modes`), and where
    its lobes are. None without another speed to choose. Parameters as of `advise`.
    """
    reach = _reach(spindle)
    if reach is None:
        return []
    told, teeth = spindle.speed_rpm, spindle.teeth
    turns = 1.0 if told is None or rotation_hz is None else 60.0 * rotation_hz / told
    if told is None:
        present = np.geomspace(*reach, ANYWHERE)
    elif rotation_hz is None:
        present = told * np.linspace(1.0 - NEAR, 1.0 + NEAR, NEARBY)
    else:
        present = np.array([60.0 * rotation_hz])
    waves = 60.0 * chatter_hz / (teeth * present)
    waves = np.where(waves > MANY_WAVES, MANY_WAVES + waves % 1.0, waves)
    modes = room(len(present))
    weigh_modes(chatter_hz, waves / chatter_hz, modes)
    speeds = np.geomspace(*reach, 2 + math.ceil(math.log(reach[1] / reach[0]) / STEP))
    stable, deeper = np.empty((2, len(speeds)))
    chances(modes, 60.0 / (teeth * turns * speeds), stable, deeper)
    tops = _tops(speeds, stable + DEEPER * deeper, [] if told is None else [told])
    return [LikelySpeed(float(speeds[i]), float(stable[i])) for i in tops[:MOST_SPEEDS]]


def _tops(speeds: Floats, score: Floats, others: list[float]) -> list[int]:
    """Where the score is above that of both neighbours, or of the one that it has; none near another, or near these."""
    padded = np.pad(score, 1, constant_values=-math.inf)
    tops = np.flatnonzero((score > padded[:-2]) & (score >= padded[2:]))
    chosen: list[int] = []
    for i in tops[np.argsort(-score[tops], kind="stable")].tolist():
        if all(abs(math.log(speeds[i] / other)) >= APART for other in (*speeds[chosen], *others)):
            chosen.append(i)
    return chosen


def _reach(spindle: SpindleSettings) -> tuple[float, float] | None:
    """Speeds to choose from."""
    here = spindle.speed_rpm
    low = spindle.min_rpm if spindle.min_rpm is not None else here and USUAL_RANGE[0] * here
    high = spindle.max_rpm if spindle.max_rpm is not None else here and USUAL_RANGE[1] * here
    return None if low is None or high is None or low > high else (low, high)
