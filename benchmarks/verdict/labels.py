"""From the equations of a cut and its vibration to what is true of every interval."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.verdict.cut import INTERVAL_S, INTERVAL_SAMPLES, Label, Stretch, Truth
from benchmarks.verdict.recipe import Recipe
from benchmarks.verdict.roots import critical_kappa, damping_ratio, rightmost_root

Floats = NDArray[np.float64]

UNSTABLE_DAMPING = -0.0015  # where the issue calls it self-excited
FROM_CROSSING_S = 0.15  # and from when on it has to be recognised
SETTLING_S = 0.3  # of every recording, not scored
DIED_DOWN = 0.2  # of the largest rms of an unstable stretch: below this the vibration of the past is over
FORCED_SHARE = 0.5
LIMITED = 0.02  # of the time, beyond what the teeth do by themselves: the vibration has saturated
SPEEDS_OF_LIMIT = 4  # the limit is computed at so many speeds of the cut and interpolated


@dataclass(frozen=True, eq=False)
class Sound:
    """A simulated vibration at the monitor's rate, and the part of each interval that limits it."""

    vibration: Floats
    limited: Floats

    @property
    def rms(self) -> Floats:
        """Of each interval."""
        return interval_rms(self.vibration)


def interval_rms(signal: Floats) -> Floats:
    """Root mean square of each interval."""
    return np.asarray(np.sqrt(np.mean(signal.reshape(-1, INTERVAL_SAMPLES) ** 2, axis=1)))


def judge_truth(
    recipe: Recipe,
    harmonics: NDArray[np.complex128],
    kappa: Floats,
    rpm: Floats,
    heard: Sound,
    forced_limited: Floats,
    synchronous_share: Floats,
) -> Truth:
    """Truth of every interval.

    Parameters
    ----------
    recipe : Recipe
        The cut.
    harmonics : ndarray of complex
        Of the modulation of the process stiffness.
    kappa, rpm : ndarray, shape (intervals,)
        Process stiffness and true speed in the middle of each.
    heard : Sound
        The cut.
    forced_limited : ndarray, shape (intervals,)
        What `Sound.limited` is with nothing random in it.
    synchronous_share : ndarray, shape (intervals,)
        As in `Truth`.
    """
    tau = 60.0 / (recipe.teeth * rpm)
    root = rightmost_root(recipe.modes, kappa, tau, harmonics)
    damping = damping_ratio(root)
    speeds = np.linspace(rpm.min(), rpm.max(), SPEEDS_OF_LIMIT)
    limits = [critical_kappa(recipe.modes, 60.0 / (recipe.teeth * speed), harmonics) for speed in speeds]
    rms = heard.rms
    saturated = heard.limited > forced_limited + LIMITED
    label, stretches = _labels(damping, rms, synchronous_share, saturated)
    return Truth(
        label=label,
        damping_ratio=damping,
        frequency_hz=np.abs(root) / (2.0 * np.pi),
        kappa=kappa,
        kappa_critical=np.interp(rpm, speeds, limits),
        synchronous_share=synchronous_share,
        limited=heard.limited,
        vibration_rms=rms,
        unstable=tuple(replace(s, doubled_s=_doubled(heard.vibration, s.zero_s)) for s in stretches),
    )


def _labels(
    damping: Floats, rms: Floats, share: Floats, saturated: NDArray[np.bool_]
) -> tuple[NDArray[np.int8], list[Stretch]]:
    """Label every interval by the rules of `Truth`, and find the unstable stretches."""
    label = np.where(share > FORCED_SHARE, Label.FORCED, Label.OTHER).astype(np.int8)
    stretches = []
    zero_s: float | None = None  # when the damping fell below zero, while it is there or the vibration lasts
    crossing_s: float | None = None
    unstable_for = 0.0
    largest = 0.0  # rms of the unstable stretch; positive while it or its end lasts
    for i in range(damping.size):
        if damping[i] < 0.0 and zero_s is None:
            zero_s = _passed(damping, i, 0.0)
        if damping[i] < UNSTABLE_DAMPING or (damping[i] < 0.0 and saturated[i]):
            if damping[i] < UNSTABLE_DAMPING and crossing_s is None:
                crossing_s = _passed(damping, i, UNSTABLE_DAMPING)
            largest = max(largest, rms[i])
            label[i] = Label.SELF_EXCITED if unstable_for >= FROM_CROSSING_S else Label.UNSCORED
            unstable_for += INTERVAL_S
        elif largest > 0.0 and rms[i] > DIED_DOWN * largest:
            label[i] = Label.UNSCORED  # dying down; grown again, it needs no new recognition
        elif damping[i] < 0.0:
            label[i] = Label.UNSCORED
        else:
            if largest > 0.0 and zero_s is not None:
                stretches.append(Stretch(zero_s, crossing_s))
            zero_s = crossing_s = None
            largest = unstable_for = 0.0
    if largest > 0.0 and zero_s is not None:
        stretches.append(Stretch(zero_s, crossing_s))
    label[: round(SETTLING_S / INTERVAL_S)] = Label.UNSCORED
    return label, stretches


def _passed(damping: Floats, i: int, threshold: float) -> float:
    """Instant between the middles of interval `i` and the one before at which the damping falls below a threshold."""
    if i == 0 or damping[i - 1] <= threshold:
        return INTERVAL_S * (i + 0.5)
    part = (damping[i - 1] - threshold) / (damping[i - 1] - damping[i])
    return INTERVAL_S * (i - 0.5 + float(part))


def _doubled(heard: Floats, since_s: float) -> float | None:
    """When the rms over 50 ms has grown to twice that of the 0.5 s before, and stays there for 0.1 s."""
    rate = INTERVAL_SAMPLES / INTERVAL_S
    at = round(since_s * rate)
    before = heard[max(0, at - round(0.5 * rate)) : at]
    if before.size == 0:
        return None
    hop = INTERVAL_SAMPLES // 5
    later = heard[at : at + (heard.size - at) // hop * hop]
    power = np.convolve(np.mean(later.reshape(-1, hop) ** 2, axis=1), np.full(5, 0.2), mode="valid")
    beyond = power > 4.0 * np.mean(before**2)
    runs = np.flatnonzero(np.convolve(beyond, np.ones(10), mode="valid") > 9.5)
    return since_s + (float(runs[0]) + 2.5) * hop / rate if runs.size else None
