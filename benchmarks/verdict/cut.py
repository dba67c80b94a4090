"""A simulated cut and what is true of it, interval by interval."""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.verdict.cutting import Sensor

Floats = NDArray[np.float64]

RATE_HZ = 12800.0
INTERVAL_S = 0.05
INTERVAL_SAMPLES = round(INTERVAL_S * RATE_HZ)


class Label(enum.IntEnum):
    """What is true of an interval."""

    OTHER = 0  # stable and not mostly synchronous: cutting noise, idle, impacts, tones from elsewhere
    FORCED = 1  # stable, and more than half of the power is synchronous with the spindle
    SELF_EXCITED = 2  # unstable for long enough, saturated or not
    UNSCORED = 3  # physics or definition leave it open; `Truth` says when


@dataclass(frozen=True)
class Stretch:
    """An unstable part of a cut.

    Attributes
    ----------
    zero_s : float
        When the true damping fell below zero.
    crossing_s : float or None
        When it fell below -0.0015; None where it never did and the vibration became large all the same.
    doubled_s : float or None
        When the vibration had grown to twice the rms of the half second before `zero_s`; None for never.
    """

    zero_s: float
    crossing_s: float | None
    doubled_s: float | None = None


@dataclass(frozen=True, eq=False)
class Truth:
    """What is true of each interval; arrays of shape (intervals,).

    ``SELF_EXCITED`` begins 150 ms after the true damping has fallen below -0.0015 and lasts while it stays there. It is
    also where the damping is negative at all and the vibration has become so large that it throws the tool out of the
    cut or makes its flank rub: at long delays (low speed, high mode) the rightmost damping is small however deep the
    cut, because what grows grows by a factor a pass.
    ``UNSCORED`` are: the first 0.3 s of the recording, other intervals with a true damping between -0.0015 and 0, those
    150 ms, and what follows an unstable stretch until the vibration has died down.

    Attributes
    ----------
    label : ndarray of int8
        A `Label` each.
    damping_ratio, frequency_hz : ndarray
        Of the rightmost characteristic root at the interval's middle.
    kappa, kappa_critical : ndarray
        Process stiffness over that of the first mode, and its value at the limit of stability at the present speed.
    synchronous_share : ndarray
        Power of what turns over that of the recording with its noise and tones: of the same cut without an unsteady
        force and never deeper than 80 % of the limit, less that of a cutter with no teeth to tell apart, which the
        wandering feed and depth move alone.
    limited : ndarray
        Part of the time in which the tool is out of the cut or its flank rubs.
    vibration_rms : ndarray
        Of the vibration alone, in the units of the samples, without room noise, tones and clipping.
    unstable : tuple of Stretch
        Unstable stretches in which the vibration had time to become self-excited.
    """

    label: NDArray[np.int8]
    damping_ratio: Floats
    frequency_hz: Floats
    kappa: Floats
    kappa_critical: Floats
    synchronous_share: Floats
    limited: Floats
    vibration_rms: Floats
    unstable: tuple[Stretch, ...]

    def __len__(self) -> int:
        return int(self.label.size)

    @property
    def start_s(self) -> Floats:
        """Beginning of each interval."""
        return np.arange(len(self)) * np.float64(INTERVAL_S)

    @property
    def unstable_for_s(self) -> Floats:
        """How long ago the latest unstable stretch began, infinite where none has."""
        since = np.full(len(self), np.inf)
        for stretch in self.unstable:
            age = self.start_s - stretch.zero_s
            since = np.where(age >= 0.0, np.minimum(since, age), since)
        return since


@dataclass(frozen=True, eq=False)
class Cut:
    """A recording of a cut that never was, with its truth.

    Attributes
    ----------
    name, family : str
        Which cut of which split, and what kind.
    samples : ndarray, shape (n,)
        What the microphone or accelerometer delivers, full scale 1, at `rate_hz`.
    rate_hz : float
        12,800 Hz.
    nominal_rpm : float
        What the monitor is told where it is told the speed: 1-3 % off the truth.
    teeth : int
        Cutting edges.
    speed_times_s, speed_rpm : ndarray, shape (m,)
        The true speed.
    snr_db : float
        Power of the vibration, averaged over what is cut, over that of the room noise.
    sensor : Sensor
        What it measures.
    truth : Truth
        Per interval of 50 ms.
    """

    name: str
    family: str
    samples: Floats
    rate_hz: float
    nominal_rpm: float
    teeth: int
    speed_times_s: Floats
    speed_rpm: Floats
    snr_db: float
    sensor: Sensor
    truth: Truth

    def true_rpm(self, t_s: Floats | float) -> Floats:
        """Spindle speed at times in seconds."""
        return np.asarray(np.interp(t_s, self.speed_times_s, self.speed_rpm))

    def without_samples(self) -> Cut:
        """The same for those who have heard it: samples of a thousand cuts take gigabytes."""
        return replace(self, samples=np.zeros(0))

    @property
    def duration_s(self) -> float:
        """Length of the recording."""
        return self.samples.size / self.rate_hz
