"""What a simulated cut is made of, before it is simulated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.verdict.cutting import Mode, Sensor

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Path:
    """A quantity that changes with time, linear between its points and constant beyond them."""

    times_s: tuple[float, ...]
    values: tuple[float, ...]

    def __call__(self, t_s: Floats) -> Floats:
        """Return its values at times in seconds."""
        return np.interp(t_s, self.times_s, self.values)

    @classmethod
    def constant(cls, value: float) -> Path:
        """Return a path without change."""
        return cls((0.0,), (value,))


@dataclass(frozen=True)
class Engagement:
    """How the teeth modulate the process stiffness: alpha(t), one on the average.

    Attributes
    ----------
    depth : float
        0 for a constant coefficient, 0.7 for one that falls to 30 % between teeth.
    duty, edge : float
        Parts of the tooth period that a tooth is engaged for and enters or leaves in.
    spindle_depth : float
        Once-per-revolution modulation on top.
    slot : float
        Part of the revolution in which nothing is cut: a keyway, a cross hole. 0 for none.
    """

    depth: float = 0.0
    duty: float = 0.6
    edge: float = 0.1
    spindle_depth: float = 0.0
    slot: float = 0.0

    def teeth(self, turns: Floats) -> Floats:
        """Return the modulation by the teeth at a phase counted in tooth periods."""
        u = np.mod(turns, 1.0)
        rise = np.clip(u / self.edge, 0.0, 1.0)
        fall = np.clip((self.duty + self.edge - u) / self.edge, 0.0, 1.0)
        window = np.sin(0.5 * np.pi * rise) ** 2 * np.sin(0.5 * np.pi * fall) ** 2
        return np.asarray(1.0 - self.depth + self.depth * window / self.duty)

    def harmonics(self, count: int = 24) -> NDArray[np.complex128]:
        """Fourier coefficients of `teeth`, from the mean to harmonic `count`."""
        steps = 4096
        found: NDArray[np.complex128] = np.fft.rfft(self.teeth(np.arange(steps) / steps))[: count + 1] / steps
        return found

    def spindle(self, revolutions: Floats) -> Floats:
        """Return the modulation over a revolution."""
        u = np.mod(revolutions, 1.0)
        cutting = (
            1.0 if self.slot == 0.0 else np.clip((u - self.slot) / 0.01, 0.0, 1.0) * np.clip((1.0 - u) / 0.01, 0, 1)
        )
        return np.asarray((1.0 + self.spindle_depth * np.sin(2.0 * np.pi * u)) * cutting)


@dataclass(frozen=True)
class Recipe:
    """Everything about a cut that a family decides; the generator adds the random signals.

    Attributes
    ----------
    modes : tuple of Mode
        The first is the one that cuts.
    rpm : Path
        Spindle speed without its wander.
    teeth : int
        Cutting edges.
    depth : Path
        Process stiffness over its critical value at the speed (the smallest along the way).
    feed : Path
        Nominal chip thickness; 0 where nothing is cut.
    engagement : Engagement
        Teeth entering and leaving.
    run_out : float
        Standard deviation of the teeth's radii, over the feed.
    unsteadiness : float
        Standard deviation of the cutting force over its mean.
    slow_share : float
        Part of that variance below some tens of hertz; the rest is broad.
    impacts : tuple of (time in s, displacement it causes)
        Blows on the structure.
    tones : tuple of (frequency in Hz, level over the vibration's rms)
        From elsewhere, there all the time.
    loudness : Path
        Gain of what the sensor gets of it.
    clip : float or None
        Level of clipping over the largest sample.
    depth_wander, feed_wander : float
        Standard deviations of slow changes of process stiffness and feed over their means: the blank is not round, the
        stock not even. The former is part of the truth.
    clearance : float
        Amplitude of the first mode, over the nominal feed and beyond what the teeth cause, at which the flank rubs.
    clearance_wander : float
        Standard deviation of slow changes of that over its mean: the surface and the wear that the flank meets.
    direct : float
        What the force excites elsewhere (dense modes of machine and room) in the sensor: rms over that of `modes`.
    direct_decay_s : float
        Time constant in which that dies out.
    sensor : Sensor
        What is measured.
    snr_db : float
        Power of the vibration, averaged over what is cut, over that of the room noise.
    duration_s : float
        Length.
    """

    modes: tuple[Mode, ...]
    rpm: Path
    teeth: int
    depth: Path
    feed: Path
    engagement: Engagement
    run_out: float
    unsteadiness: float
    slow_share: float
    depth_wander: float
    feed_wander: float
    clearance: float
    clearance_wander: float
    direct: float
    direct_decay_s: float
    sensor: Sensor
    snr_db: float
    duration_s: float
    impacts: tuple[tuple[float, float], ...] = ()
    tones: tuple[tuple[float, float], ...] = ()
    loudness: Path = Path((0.0,), (1.0,))
    clip: float | None = None
