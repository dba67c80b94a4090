"""From the equations of a cut and its vibration to what is true of every interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.verdict.cut import INTERVAL_S, INTERVAL_SAMPLES, Label, Truth
from benchmarks.verdict.recipe import Recipe
from benchmarks.verdict.roots import critical_kappa, damping_ratio, rightmost_root

Floats = NDArray[np.float64]

UNSTABLE_DAMPING = -0.0015  # where the issue calls it self-excited
FROM_CROSSING_S = 0.15  # and from when on it has to be recognised
SETTLING_S = 0.3  # of every recording, not scored
DIED_DOWN = 0.2  # of the largest rms of an unstable stretch: below this the vibration of the past is over
FORCED_SHARE = 0.5
OUT_OF_CUT = 0.02  # of the time, beyond what the teeth do by themselves: the vibration has saturated
SPEEDS_OF_LIMIT = 5  # the limit is computed at so many speeds of the cut and interpolated


@dataclass(frozen=True, eq=False)
class Heard:
    """A simulated vibration at the monitor's rate, and the part of each interval with the tool out of the cut."""

    vibration: Floats
    out_of_cut: Floats

    @property
    def rms(self) -> Floats:
        """Of each interval."""
        return np.asarray(np.sqrt(np.mean(self.vibration.reshape(-1, INTERVAL_SAMPLES) ** 2, axis=1)))


def judge_truth(
    recipe: Recipe, harmonics: NDArray[np.complex128], limit: float, rpm: Floats, heard: Heard, forced: Heard
) -> Truth:
    """Truth of every interval.

    Parameters
    ----------
    recipe : Recipe
        The cut.
    harmonics : ndarray of complex
        Of the modulation of the process stiffness.
    limit : float
        Process stiffness that the recipe's depth is counted in.
    rpm : ndarray, shape (intervals,)
        True speed in the middle of each.
    heard, forced : Heard
        The cut, and the same cut with nothing random in it.
    """
    middle = INTERVAL_S * (np.arange(rpm.size) + 0.5)
    tau = 60.0 / (recipe.teeth * rpm)
    kappa = recipe.depth(middle) * limit
    root = rightmost_root(recipe.modes, kappa, tau, harmonics)
    damping = damping_ratio(root)
    speeds = np.linspace(rpm.min(), rpm.max(), SPEEDS_OF_LIMIT)
    limits = [critical_kappa(recipe.modes, 60.0 / (recipe.teeth * speed), harmonics) for speed in speeds]
    rms = heard.rms
    share = np.minimum((forced.rms / np.maximum(rms, 1e-30)) ** 2, 1.0)
    saturated = heard.out_of_cut > forced.out_of_cut + OUT_OF_CUT
    label, crossings = _labels(damping, rms, share, saturated)
    return Truth(
        label=label,
        damping_ratio=damping,
        frequency_hz=np.abs(root) / (2.0 * np.pi),
        kappa=kappa,
        kappa_critical=np.interp(rpm, speeds, limits),
        synchronous_share=share,
        out_of_cut=heard.out_of_cut,
        vibration_rms=rms,
        crossings_s=crossings,
        doubled_s=tuple(_doubled(heard.vibration, at) for at in crossings),
    )


def _labels(
    damping: Floats, rms: Floats, share: Floats, saturated: NDArray[np.bool_]
) -> tuple[NDArray[np.int8], tuple[float, ...]]:
    """Label every interval by the rules of `Truth`, and find when unstable stretches begin."""
    label = np.where(share > FORCED_SHARE, Label.FORCED, Label.OTHER).astype(np.int8)
    crossings = []
    unstable_for = 0.0
    largest = 0.0  # rms since the crossing; positive while an unstable stretch or its end lasts
    for i in range(damping.size):
        if damping[i] < UNSTABLE_DAMPING or (damping[i] < 0.0 and saturated[i]):
            if largest == 0.0 and i > 0 and damping[i] < UNSTABLE_DAMPING:
                part = (damping[i - 1] - UNSTABLE_DAMPING) / (damping[i - 1] - damping[i])
                crossings.append(INTERVAL_S * (i - 0.5 + float(part)))
            largest = max(largest, rms[i])
            label[i] = Label.SELF_EXCITED if unstable_for >= FROM_CROSSING_S else Label.UNSCORED
            unstable_for += INTERVAL_S
        elif largest > 0.0 and rms[i] > DIED_DOWN * largest:
            label[i] = Label.UNSCORED  # dying down; grown again, it needs no new recognition
        else:
            largest = unstable_for = 0.0
            if damping[i] < 0.0:
                label[i] = Label.UNSCORED
    label[: round(SETTLING_S / INTERVAL_S)] = Label.UNSCORED
    return label, tuple(crossings)


def _doubled(heard: Floats, crossing_s: float) -> float | None:
    """When the rms of the vibration has grown to twice that before the crossing, in the way that it stays there."""
    rate = INTERVAL_SAMPLES / INTERVAL_S
    at = round(crossing_s * rate)
    before = heard[max(0, at - round(0.5 * rate)) : at]
    if before.size == 0:
        return None
    hop = INTERVAL_SAMPLES // 5
    later = heard[at : at + (heard.size - at) // hop * hop]
    power = np.convolve(np.mean(later.reshape(-1, hop) ** 2, axis=1), np.full(5, 0.2), mode="valid")
    beyond = power > 4.0 * np.mean(before**2)
    runs = np.flatnonzero(np.convolve(beyond, np.ones(10), mode="valid") > 9.5)
    return crossing_s + (float(runs[0]) + 2.5) * hop / rate if runs.size else None
