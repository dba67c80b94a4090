"""A working day without chatter: eight hours of stable cuts, air, blows and speed changes; every alarm is a false one.

What is reused and what is not: the vibration of the cuts comes from a library of stable simulated cuts, of which every
pass takes a part of its own at another level, polarity and tilt of the spectrum. Room noise, gaps between passes,
blows, pumps and levels are drawn afresh all day long. With a library of 60 cuts each is heard some 50 times.
The standard library is that of the days from which rules were learned: ``--first`` takes others.

Jobs have a cutter, a speed and a few dozen passes. A new speed is announced to the monitor in seven jobs of ten; in the
others it goes on believing the old one. A tool that enters slowly takes up to 0.6 s, as one that is fed into the side
of the work does.

Run: python -m benchmarks.verdict.shift [--hours 8] [--seed 1] [--speed known|unknown] [--split report|development]
    [--first N] [--cache DIR] [--slowly]
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import Progress
from scipy.signal import lfilter

from benchmarks.verdict.cache import cached_cuts
from benchmarks.verdict.cut import INTERVAL_S, RATE_HZ, Cut, Label
from benchmarks.verdict.generator import Split
from benchmarks.verdict.labels import SETTLING_S
from benchmarks.verdict.monitor import Passage, watch

Floats = NDArray[np.float64]

LIBRARY = 60
# A pump or the mains is heard while nothing is cut, too: in a piece of such a cut its tone would come with the tool.
TONES = ("background_tone", "hum")
ANNOUNCED = 0.7
FADE_S, SLOWLY_S = (0.005, 0.1), (0.1, 0.6)
PASS_S, GAP_S, PAUSE_S = (2.0, 12.0), (0.3, 6.0), (5.0, 60.0)
SETTLED = 256  # samples after which the filter of the noise has forgotten its start


@dataclass(frozen=True)
class Room:
    """What is heard of a job besides its cuts: noise of one colour, sometimes a pump."""

    noise: float
    colour: float
    pump_hz: float | None
    pump: float


def library(size: int, cache: Path | None, split: Split = "development", first: int = 0) -> list[Cut]:
    """Return stable cuts of a split, from one on, of all families but those of the room: it has tones of its own."""
    # a third of the families turns to chatter
    stable = (cut for cut in cached_cuts(split, 4 * size, cache, first) if cut.family not in TONES and _is_stable(cut))
    return list(islice(stable, size))


def _is_stable(cut: Cut) -> bool:
    return bool((cut.truth.damping_ratio > 0).all()) and not (cut.truth.label == Label.SELF_EXCITED).any()


def shift(cuts: list[Cut], seconds: float, seed: int, fade_s: tuple[float, float] = FADE_S) -> Iterator[Passage]:
    """Yield the day piece by piece, each with what is being done and the speed if one is announced with it."""
    rng = np.random.default_rng(seed)
    left = round(seconds * RATE_HZ)
    for passage in _day(rng, cuts, fade_s):
        yield Passage(passage.samples[:left], passage.doing, passage.announced)
        left -= len(passage.samples)
        if left <= 0:
            return


def _day(rng: np.random.Generator, cuts: list[Cut], fade_s: tuple[float, float]) -> Iterator[Passage]:
    at = 0
    while True:
        cut = cuts[int(rng.integers(len(cuts)))]
        level, room = level_and_room(rng, cut.samples)
        told = (cut.nominal_rpm, cut.teeth) if rng.random() < ANNOUNCED else None
        samples = air(rng, PAUSE_S, blows=False)
        doing = "pause"
        for _ in range(int(rng.integers(10, 60))):
            samples += noise(rng, room, at, samples.size)
            yield Passage(samples, doing, told)
            at += samples.size
            told = None
            if doing.startswith("cut"):
                samples, doing = air(rng, GAP_S, blows=rng.random() < 0.3), "air"
            else:
                samples, doing = one_pass(rng, cut, level, fade_s), f"cut {cut.name}"


def level_and_room(rng: np.random.Generator, samples: Floats) -> tuple[float, Room]:
    """Draw by how much a cut is louder in a job than as it was made, and what is heard besides."""
    level = 10 ** rng.uniform(-2.0, -0.7) / float(np.std(samples))
    pump_hz = float(rng.uniform(80.0, 2500.0)) if rng.random() < 0.2 else None
    room = Room(float(10 ** rng.uniform(-3.5, -2.5)), float(rng.uniform(0.5, 0.98)), pump_hz, rng.uniform(0.5, 3.0))
    return level, room


def one_pass(rng: np.random.Generator, cut: Cut, level: float, fade_s: tuple[float, float] = FADE_S) -> Floats:
    """Return one pass of the tool, with entry and exit: part of a cut, never joined to another part of it."""
    source = cut.samples[round(SETTLING_S * RATE_HZ) :]
    n = min(round(rng.uniform(*PASS_S) * RATE_HZ), source.size)
    start = int(rng.integers(source.size - n + 1))
    vibration = lfilter([1.0, rng.uniform(-0.3, 0.3)], [1.0], source[start : start + n])
    vibration *= level * rng.uniform(0.7, 1.4) * rng.choice((-1.0, 1.0))
    return enter_and_leave(rng, vibration, fade_s)


def enter_and_leave(rng: np.random.Generator, vibration: Floats, fade_s: tuple[float, float] = FADE_S) -> Floats:
    """Return a vibration as of a tool that enters and leaves, within so many seconds each."""
    faded = vibration.copy()
    for end in (slice(None), slice(None, None, -1)):
        fade = round(rng.uniform(*fade_s) * RATE_HZ)
        faded[end][:fade] *= np.linspace(0.0, 1.0, fade)
    return faded


def air(rng: np.random.Generator, span_s: tuple[float, float], *, blows: bool) -> Floats:
    """Nothing cut, perhaps blows: doors, clamps, chips; each rings a few modes of the machine."""
    samples = np.zeros(round(rng.uniform(*span_s) * RATE_HZ))
    for _ in range(int(rng.integers(1, 5)) if blows else 0):
        first = int(rng.integers(samples.size))
        t = np.arange(min(samples.size - first, round(0.3 * RATE_HZ))) / RATE_HZ
        for _ in range(3):
            w, zeta = 2.0 * np.pi * rng.uniform(100.0, 4000.0), rng.uniform(0.005, 0.05)
            samples[first : first + t.size] += rng.uniform(0.0, 0.3) * np.exp(-zeta * w * t) * np.sin(w * t)
    return samples


def noise(rng: np.random.Generator, room: Room, at: int, n: int) -> Floats:
    """Return fresh noise of the room for the samples from `at` on; its pump keeps its phase."""
    gain = room.noise * np.sqrt(1.0 - room.colour**2)
    heard = lfilter([gain], [1.0, -room.colour], rng.standard_normal(n + SETTLED))[SETTLED:]
    if room.pump_hz is not None:
        heard += room.noise * room.pump * np.sin(2.0 * np.pi * room.pump_hz / RATE_HZ * np.arange(at, at + n))
    return np.asarray(heard)


def in_room(
    rng: np.random.Generator, room: Room, parts: Iterable[tuple[str, Floats]], told: tuple[float, int]
) -> list[Passage]:
    """Return what is done, part after part, as it is heard in a room; the speed is told with the first."""
    passages, at = [], 0
    for doing, samples in parts:
        heard = samples + noise(rng, room, at, samples.size)
        passages.append(Passage(heard, doing, None if at else told))
        at += samples.size
    return passages


def choose_entry(parser: argparse.ArgumentParser) -> None:
    """Add the option that says how fast a tool enters and leaves."""
    parser.add_argument(
        "--slowly", dest="fade_s", action="store_const", const=SLOWLY_S, default=FADE_S,
        help="tools take 0.1 to 0.6 s to enter and to leave, not 5 to 100 ms",
    )  # fmt: skip


def choose_library(parser: argparse.ArgumentParser) -> None:
    """Add the options that say which cuts a library is made of, and the seed of what is done with them."""
    parser.add_argument("--seed", type=int, default=1)
    choose_cuts(parser)


def choose_cuts(parser: argparse.ArgumentParser) -> None:
    """Add the options that say which cuts are meant."""
    parser.add_argument("--split", choices=("development", "report"), default="report", help="whose cuts")
    parser.add_argument("--first", type=int, default=0, help="number of the first of these (default %(default)s)")
    parser.add_argument("--cache", type=Path, help="directory to keep generated cuts in")


def main() -> None:
    """Make the day, listen to it, count."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.verdict.shift", description=__doc__)
    parser.add_argument("--hours", type=float, default=8.0)
    parser.add_argument("--speed", choices=("known", "unknown"), default="known", help="whether speeds are announced")
    choose_entry(parser)
    choose_library(parser)
    chosen = parser.parse_args()
    cuts = library(LIBRARY, chosen.cache, chosen.split, chosen.first)
    seconds = 3600.0 * chosen.hours
    alarms: Counter[str] = Counter()
    states: Counter[str] = Counter()
    events, generating, began = 0, 0.0, time.perf_counter()
    with Progress(console=Console(stderr=True)) as progress:
        task = progress.add_task("shift", total=seconds)
        for heard in watch(
            shift(cuts, seconds, chosen.seed, chosen.fade_s), announce=chosen.speed == "known", ahead=True
        ):
            states.update(heard.states)
            alarms[heard.doing] += heard.states.count("self_excited")
            events += heard.events
            generating = heard.generating_s
            progress.update(task, completed=heard.until_s)
    elapsed = time.perf_counter() - began
    total = sum(states.values())
    print(f"{chosen.hours:g} h, {round(seconds * RATE_HZ):,} samples, {total:,} intervals of {INTERVAL_S:g} s")
    print("states: " + ", ".join(f"{state} {100.0 * n / total:.2f} %" for state, n in states.most_common()))
    print(f"alarms: {events} events, {states['self_excited']} intervals")
    for doing, count in alarms.most_common(10):
        if count:
            print(f"    {count} intervals during {doing}")
    print(f"replay {elapsed - generating:.0f} s ({seconds / (elapsed - generating):.0f} times real time)")
    print(f"generation besides {generating:.0f} s ({seconds / generating:.0f} times real time)")


if __name__ == "__main__":
    main()
