"""Passes as plain as they can be: chatter that is there as soon as the tool enters should be an alarm, a new job none.

Made of a resonance that noise drives, a comb of teeth, and a self-excited oscillation; it shares nothing with the cuts
of `benchmarks.verdict`. The tool enters and leaves within 50 ms; between passes there is the noise of a room.

- ``chatter``: two calm passes, then one that chatters from its first moment. Speeds are told within 1 %, or not at all.
- ``again``: a pass that turns to chatter, and three that chatter from their first moment on, in rooms as loud as a
  hundredth to a tenth of the chatter.
- ``jobs``: four calm passes, each of another job. Speeds are told in time, or the first one goes on being believed, or
  none is told; in half of the runs a pump is switched on in a pause.

Run: python -m benchmarks.verdict.entries [--seeds 10] [--first 0]
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.verdict.cut import RATE_HZ
from benchmarks.verdict.monitor import Passage, watch
from benchmarks.verdict.oscillators import STEPS, move
from chatter_monitor.tracking.tracker import INTERVAL_S

ENTERING_S = 0.05
NEGATIVE_DAMPING = 0.02  # of what excites itself, where it is small

Signal = NDArray[np.float64]
Announced = tuple[float, int]  # revolutions per minute, teeth


class Job(NamedTuple):
    """A pass: when it begins and ends (s), and the spindle's speed (Hz) and teeth."""

    begins_s: float
    ends_s: float
    rotation_hz: float
    teeth: int


def resonance(frequency_hz: float, damping: float, force: Signal) -> Signal:
    """Response of a mode to a force, of unit size."""
    pole = np.exp(2 * np.pi * frequency_hz / RATE_HZ * (-damping + 1j * np.sqrt(1 - damping**2)))
    response = np.asarray(lfilter([1.0], [1.0, -2 * pole.real, abs(pole) ** 2], force))
    return response / np.std(response)


def chatter(frequency_hz: float, samples: int, rng: np.random.Generator) -> Signal:
    """A self-excited oscillation at the size at which it stays, of unit size."""
    settling = round(2.0 * RATE_HZ)
    force = 0.02 * rng.standard_normal(samples + settling)
    damping, silence = np.full(force.size, -NEGATIVE_DAMPING), np.zeros(STEPS * force.size)
    grown = move(2 * np.pi * frequency_hz, damping, 4 * NEGATIVE_DAMPING, force, silence, STEPS, 0)[settling:]
    return np.asarray(grown / np.std(grown))


def teeth(job: Job, t: Signal, rng: np.random.Generator) -> Signal:
    """Eight multiples of the passing of teeth, of unit size together."""
    passing_hz = job.rotation_hz * job.teeth
    comb = sum(
        rng.uniform(0.05, 1.0) * np.cos(2 * np.pi * passing_hz * order * t + rng.uniform(0, 2 * np.pi))
        for order in range(1, 9)
        if passing_hz * order < 0.45 * RATE_HZ
    )
    return np.asarray(comb / np.std(comb))


def engaged(job: Job, t: Signal) -> Signal:
    """How far the tool is in the cut, 0 to 1."""
    return np.asarray(np.clip((t - job.begins_s) / ENTERING_S, 0, 1) * np.clip((job.ends_s - t) / ENTERING_S, 0, 1))


def cutting(
    job: Job, t: Signal, noise: Signal, frequency_hz: float, damping: float, grown: Signal, rng: np.random.Generator
) -> Signal:
    """A cut with chatter of the size ``grown``; of noise, shape (n, samples), the first three."""
    return (
        0.1 * resonance(frequency_hz, damping, noise[0])
        + 0.15 * resonance(1.6 * frequency_hz, 0.03, noise[1])
        + 0.05 * noise[2]
        + 0.3 * teeth(job, t, rng)
        + grown * chatter(frequency_hz, t.size, rng)
    )


def chattering_pass(seed: int) -> tuple[Signal, list[Job], float]:
    """Two calm passes and one that chatters; the signal, its passes, and when the last begins (s)."""
    rng = np.random.default_rng([5, seed])
    t = np.arange(round(11.0 * RATE_HZ)) / RATE_HZ
    frequency_hz, damping = float(np.exp(rng.uniform(np.log(200), np.log(2000)))), float(rng.uniform(0.01, 0.04))
    rotation_hz, number = float(rng.uniform(15, 100)), int(rng.integers(1, 6))
    jobs = [Job(begins, ends, rotation_hz, number) for begins, ends in ((1, 3), (4, 6), (7, 12))]
    noise = rng.standard_normal((4, t.size))
    cut = cutting(jobs[0], t, noise, frequency_hz, damping, t >= jobs[-1].begins_s, rng)
    return sum(engaged(job, t) for job in jobs) * cut + 0.01 * noise[3], jobs, jobs[-1].begins_s


def chattering_again(seed: int) -> tuple[Signal, list[Job]]:
    """A pass that turns to chatter, and three that chatter at once."""
    rng = np.random.default_rng([7, seed])
    t = np.arange(round(16.0 * RATE_HZ)) / RATE_HZ
    frequency_hz, damping = float(np.exp(rng.uniform(np.log(200), np.log(2000)))), float(rng.uniform(0.01, 0.04))
    rotation_hz, number = float(rng.uniform(15, 100)), int(rng.integers(1, 6))
    jobs = [Job(begins, ends, rotation_hz, number) for begins, ends in ((1, 6), (7, 9), (10, 12), (13, 15))]
    noise = rng.standard_normal((4, t.size))
    turns_s, growing_s = 3.0, float(rng.uniform(0.05, 0.3))
    grown = np.where(t < turns_s, 0.0, np.minimum(0.02 * np.exp((t - turns_s) / growing_s), 1.0))
    cut = cutting(jobs[0], t, noise, frequency_hz, damping, grown, rng)
    room = 10.0 ** rng.uniform(-2.0, -1.0)
    return sum(engaged(job, t) for job in jobs) * cut + room * noise[3], jobs


def calm_jobs(seed: int) -> tuple[Signal, list[Job]]:
    """Four calm passes of four jobs."""
    rng = np.random.default_rng([3, seed])
    t = np.arange(round(22.0 * RATE_HZ)) / RATE_HZ
    frequency_hz, damping = float(np.exp(rng.uniform(np.log(150), np.log(2000)))), float(rng.uniform(0.01, 0.05))
    signal = float(rng.choice([0.01, 0.03])) * rng.standard_normal(t.size)
    if rng.random() < 0.5:
        signal += 0.1 * np.cos(2 * np.pi * float(rng.uniform(80, 900)) * t) * (t > 10.5)
    jobs = []
    for number in range(4):
        job = Job(1 + 5 * number, 5 + 5 * number, float(rng.uniform(12, 110)), int(rng.integers(1, 6)))
        noise = rng.standard_normal((3, t.size))
        cut = (
            0.5 * resonance(frequency_hz, damping, noise[0])
            + 0.15 * resonance(1.7 * frequency_hz, 0.03, noise[1])
            + 0.05 * noise[2]
            + float(rng.choice([0.2, 0.7, 2.0])) * teeth(job, t, rng)
        )
        signal += float(rng.uniform(0.5, 2.0)) * engaged(job, t) * cut
        jobs.append(job)
    return signal, jobs


def announced(job: Job, off: float = 1.005) -> Announced:
    """What is told of a pass, with a speed that is off by a factor."""
    return 60.0 * job.rotation_hz * off, job.teeth


def states(signal: Signal, told: Sequence[tuple[float, Announced]]) -> list[str]:
    """What the monitor says of each interval when speeds and teeth are told at these times (s), ascending."""
    pieces = np.split(signal, [round(begins_s * RATE_HZ) for begins_s, _ in told])
    known = [None, *(spindle for _, spindle in told)]
    passages = (Passage(piece, "", spindle) for piece, spindle in zip(pieces, known, strict=True) if piece.size)
    return list(chain.from_iterable(each.states for each in watch(passages, announce=True)))


def main() -> None:
    """Count and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=0)
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.seeds)
    for known in (True, False):
        after_s = []
        for seed in seeds:
            signal, jobs, begins_s = chattering_pass(seed)
            said = states(signal, [(0.0, announced(jobs[0]))] if known else [])
            alarms = INTERVAL_S * (1 + np.flatnonzero(np.array(said) == "self_excited"))
            after_s += [min(t for t in alarms if t > begins_s) - begins_s] if alarms.size else []
        median = f", after {np.median(after_s):.2f} s (median)" if after_s else ""
        print(f"chatter from the entry, speed {'told' if known else 'unknown'}: {len(after_s)} of {len(seeds)}{median}")
    for known in (True, False):
        first: Counter[bool] = Counter()
        later: Counter[bool] = Counter()
        for seed in seeds:
            signal, jobs = chattering_again(seed)
            said = np.array(states(signal, [(0.0, announced(jobs[0]))] if known else [])) == "self_excited"
            ends = INTERVAL_S * (1 + np.arange(said.size))
            first[bool(said[ends < jobs[0].ends_s].any())] += 1
            for job in jobs[1:]:
                later.update(said[(ends > job.begins_s + ENTERING_S) & (ends < job.ends_s)].tolist())
        print(
            f"chatter again, speed {'told' if known else 'unknown'}: alarm in {first[True]} of {len(seeds)} first "
            f"passes; in the later ones {100 * later[True] / later.total():.0f} % of the intervals"
        )
    for how in ("told", "the first one believed", "unknown"):
        heard: Counter[str] = Counter()
        runs = 0
        for seed in seeds:
            signal, jobs = calm_jobs(seed)
            told = [(job.begins_s - 0.5, announced(job)) for job in jobs]
            said = states(signal, {"told": told, "unknown": []}.get(how, told[:1]))
            heard.update(said)
            runs += "self_excited" in said
        shares = ", ".join(
            f"{state} {100 * heard[state] / heard.total():.1f} %" for state in ("self_excited", "approaching")
        )
        print(f"new jobs, speed {how}: a false alarm in {runs} of {len(seeds)} runs; of the intervals {shares}")


if __name__ == "__main__":
    main()
