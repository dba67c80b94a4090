"""Oscillators that excite themselves: what the verdict is worth where its own benchmark is not at home.

One mode, driven by noise and by teeth, whose damping is set and becomes negative; what grows is limited by a damping
that grows with the square of the amplitude (van der Pol). There is no chip and no delay, so nothing regenerates, and
the truth is the damping that was set: below -0.0015 for 150 ms or longer it is self-excited, above zero it is not, and
for half a second after it has been negative nobody is asked. Just above zero it is not chatter either.

- ``step``, ``ramp``, ``bar``: the damping becomes negative at once, within seconds, or for a while.
- ``hum``, ``faint``: at once, beside the mains, or in noise of a third of all power.
- ``forced``, ``resonance``, ``jumps``: teeth, teeth of which a multiple is at the mode, and teeth whose force jumps.
- ``quiet``: noise alone.

Speeds are told within 2 %, or not at all.

Run: python -m benchmarks.verdict.oscillators [--cuts 270] [--first 1000]
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.verdict.cut import INTERVAL_S, INTERVAL_SAMPLES, RATE_HZ
from benchmarks.verdict.labels import FROM_CROSSING_S, UNSTABLE_DAMPING
from benchmarks.verdict.monitor import Passage, watch
from benchmarks.verdict.scoring import LAG_PERIODS, LAG_S

Signal = NDArray[np.float64]
Bools = NDArray[np.bool_]

FAMILIES = ("step", "ramp", "bar", "forced", "resonance", "jumps", "hum", "quiet", "faint")
LENGTH_S = 10.0
STEPS = 4  # of the integration in a sample
CALM_S = 2.0  # of which its size is known before it is made
DIES_DOWN_S = 0.5
LOUDNESS = 0.02  # of the first seconds, full scale 1


@dataclass(frozen=True)
class Oscillator:
    """What a recording is made of.

    Attributes
    ----------
    family : str
        One of `FAMILIES`.
    frequency_hz : float
        Of the mode.
    rpm, teeth : float, int
        What is told.
    damping : ndarray
        Damping ratio that is set, for each sample.
    samples : ndarray
        What a microphone or accelerometer delivers.
    """

    family: str
    frequency_hz: float
    rpm: float
    teeth: int
    damping: Signal
    samples: Signal

    @property
    def allowed_s(self) -> float:
        """How late an alarm may be."""
        return max(LAG_S, LAG_PERIODS / self.frequency_hz)

    def labels(self, intervals: int) -> tuple[Bools, Bools]:
        """Which of so many intervals are self-excited, and which are not."""
        damping = self.damping[: intervals * INTERVAL_SAMPLES].reshape(intervals, INTERVAL_SAMPLES).mean(axis=1)
        unstable = damping < UNSTABLE_DAMPING
        shown, over = round(FROM_CROSSING_S / INTERVAL_S), round(DIES_DOWN_S / INTERVAL_S)
        chatters = np.array([unstable[max(0, i - shown) : i + 1].all() and i >= shown for i in range(intervals)])
        calm = np.array([(damping[max(0, i - over) : i + 1] > 0.0).all() for i in range(intervals)])
        return chatters, calm

    def begins(self) -> float:
        """When it becomes self-excited, s; infinite if it never does."""
        unstable = np.flatnonzero(self.damping < UNSTABLE_DAMPING)
        return unstable[0] / RATE_HZ if unstable.size else math.inf


@njit(cache=True)
def move(omega, damping, limiting, force, noise, steps, derivative):  # type: ignore[no-untyped-def]
    """Displacement of van der Pol's oscillator from rest, or its velocity or acceleration in units of that.

    Parameters
    ----------
    omega : float
        Of the mode, rad/s.
    damping : ndarray, shape (n,)
        Damping ratio in each sample, at rest; with the square of the displacement it grows by ``limiting``.
    force : ndarray, shape (n,)
        Over the stiffness.
    noise : ndarray, shape (n * steps,)
        What is added to that in each step of the integration.
    steps : int
        In a sample.
    derivative : int
        0, 1 or 2: what the sensor measures.
    """
    step_s = 1.0 / (steps * RATE_HZ)
    x = v = a = 0.0
    out = np.empty(force.size)
    for i in range(force.size):
        for k in range(steps):
            resisting = 2.0 * omega * (damping[i] + limiting * x * x)
            a = omega**2 * (force[i] + noise[i * steps + k] - x) - resisting * v
            v += step_s * a
            x += step_s * v
        out[i] = x if derivative == 0 else (v / omega if derivative == 1 else a / omega**2)
    return out


def draw(seed: int) -> Oscillator:
    """Draw a recording; families in turn."""
    rng = np.random.default_rng([23, seed])
    family = FAMILIES[seed % len(FAMILIES)]
    t = np.arange(round(LENGTH_S * RATE_HZ)) / RATE_HZ
    frequency_hz = float(np.exp(rng.uniform(*np.log((180.0, 2200.0)))))
    rpm, teeth = float(np.exp(rng.uniform(*np.log((600.0, 9000.0))))), int(rng.integers(1, 7))
    if family == "resonance":
        passing_hz = rpm / 60.0 * teeth
        frequency_hz = max(1, round(frequency_hz / passing_hz)) * passing_hz * rng.uniform(0.997, 1.003)
    stable = float(rng.uniform(0.01, 0.04))
    negative = -float(np.exp(rng.uniform(*np.log((0.003, 0.02)))))
    damping = _damping(family, t, stable, negative, rng)
    force = _teeth(t, rpm / 60.0 * rng.uniform(0.98, 1.02), teeth, rng) if family != "quiet" else np.zeros(t.size)
    unsteady = 1.0 + 0.1 * np.interp(t, np.arange(0.0, LENGTH_S + 0.1, 0.05), rng.standard_normal(202))
    force *= unsteady * (_jumps(t, rng) if family == "jumps" else 1.0)
    driven = rng.uniform(0.01, 0.05) * force
    noise = rng.uniform(0.02, 0.3) * rng.standard_normal(STEPS * t.size)
    omega, derivative = 2.0 * math.pi * frequency_hz, int(rng.integers(3))
    first = slice(0, round(CALM_S * RATE_HZ))
    calm = move(omega, damping[first], 0.0, driven[first], noise, STEPS, 0)
    limited = float(np.std(calm)) * np.exp(rng.uniform(*np.log((4.0, 30.0))))
    moved = move(omega, damping, 2.0 * abs(negative) / limited**2, driven, noise, STEPS, derivative)
    heard = moved + 0.05 * rng.uniform() * force  # the sensor hears the teeth, too, without the mode
    heard /= np.std(heard[first])
    if family == "hum":
        heard += 0.7 * np.cos(2.0 * math.pi * 50.0 * t) + 0.3 * np.cos(2.0 * math.pi * 150.0 * t)
    below_db = 5.0 if family == "faint" else rng.uniform(10.0, 35.0)
    heard += 10.0 ** (-below_db / 20.0) * rng.standard_normal(t.size)
    return Oscillator(family, frequency_hz, rpm, teeth, damping, LOUDNESS * heard)


def _damping(family: str, t: Signal, stable: float, negative: float, rng: np.random.Generator) -> Signal:
    """Damping ratio as it is set."""
    begins_s, lasts_s, calm = rng.uniform(3.0, 6.0), rng.uniform(1.0, 3.0), stable * rng.uniform(0.4, 0.9)
    if family == "ramp":
        return np.asarray(np.interp(t, (2.0, 9.0), (stable, negative)))
    if family not in ("step", "bar", "hum", "faint"):
        return np.full(t.size, calm)
    ends_s = begins_s + lasts_s if family == "bar" else math.inf
    return np.where((t >= begins_s) & (t < ends_s), negative, calm)


def _teeth(t: Signal, rotation_hz: float, teeth: int, rng: np.random.Generator) -> Signal:
    """Their force, of unit size: multiples of their passing, a run-out, and in every other cut a speed that wanders."""
    wander = 0.001 * np.cumsum(rng.standard_normal(t.size)) / math.sqrt(RATE_HZ) * (rng.random() < 0.5)
    angle = 2.0 * math.pi * np.cumsum(rotation_hz * (1.0 + wander)) / RATE_HZ
    force = rng.uniform(0.0, 0.3) * np.cos(angle)
    for order in range(1, int(5000.0 / (rotation_hz * teeth)) + 1):
        force += rng.uniform(0.2, 1.0) / order * np.cos(order * teeth * angle + rng.uniform(0.0, 2.0 * math.pi))
    return np.asarray(force / np.std(force))


def _jumps(t: Signal, rng: np.random.Generator) -> Signal:
    """Four jumps by 10 dB, up or down."""
    level = np.ones(t.size)
    for at_s in rng.uniform(1.0, 9.0, 4):
        level[t >= at_s] *= rng.choice((1.0 / 3.0, 3.0))
    return np.clip(level, 0.1, 10.0)


@dataclass
class Score:
    """Counts of one family: intervals, those of them in alarm, and lags over what is allowed."""

    chatter: int = 0
    told: int = 0
    calm: int = 0
    false: int = 0
    lags: list[float] = field(default_factory=list)

    def add(self, made: Oscillator, alarm: Bools) -> None:
        """Count a recording."""
        chatters, calm = made.labels(alarm.size)
        self.chatter += int(chatters.sum())
        self.told += int((chatters & alarm).sum())
        self.calm += int(calm.sum())
        self.false += int((calm & alarm).sum())
        if chatters.any():
            ends_s = INTERVAL_S * (1 + np.flatnonzero(alarm & ~calm))
            later = ends_s[ends_s > made.begins()]
            self.lags.append((later[0] - made.begins()) / made.allowed_s if later.size else math.inf)

    @property
    def cells(self) -> tuple[str, ...]:
        """What is printed of it."""
        recalled = f"{100.0 * self.told / self.chatter:.1f} %" if self.chatter else ""
        lag = f"{np.median(self.lags):.2f}, {sum(map(math.isinf, self.lags))}" if self.lags else ""
        return f"{self.chatter}", recalled, f"{self.calm}", f"{self.false}", lag


def main() -> None:
    """Listen and count."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.verdict.oscillators", description=__doc__)
    parser.add_argument("--cuts", type=int, default=270, help="how many, families in turn (default %(default)s)")
    parser.add_argument("--first", type=int, default=1000, help="seed of the first (default %(default)s)")
    given = parser.parse_args()
    scores = {(told, name): Score() for told in (True, False) for name in (*FAMILIES, "all")}
    seeds = range(given.first, given.first + given.cuts)
    for seed in track(seeds, description="oscillators", console=Console(stderr=True)):
        made = draw(seed)
        for told in (True, False):
            heard = watch([Passage(made.samples, "", (made.rpm, made.teeth))], announce=told)
            alarm = np.array([state for remarks in heard for state in remarks.states]) == "self_excited"
            for name in (made.family, "all"):
                scores[told, name].add(made, alarm)
    table = Table("speed", "family", "self-excited", "recalled", "others", "false alarms", "lag over the limit, never")
    for (told, name), score in scores.items():
        table.add_row("told" if told else "unknown", name, *score.cells)
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
