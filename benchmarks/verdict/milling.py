"""Milling from the first contact on, by a simulator of teeth and chips: what is said as the tool enters, and after.

Two directions with two modes each, teeth that enter and leave, run-out, loss of contact, the surface that the tooth
before has left. It shares nothing with the cuts of `benchmarks.verdict`, in which the tool is in the cut from the first
sample on. A second of an idle machine in a room, a stable depth, then a deeper one that chatters or the same, then the
stable one, then the room; or, at once, what chatters does so from the first contact on. Speeds are told within 0.4 %,
or not at all.

The limit is where the linear cut begins to grow, by bisection. Depths are 0.3 to 0.75 of it, and 1.15 to 2.2 times.
But teeth that leave the chip may stop what would grow. Whether a cut chatters, and from when on, is told by its twin,
the same cut with next to no noise: that repeats from rotation to rotation unless it chatters. What is beyond the limit
and does not chatter yet, or hardly, is neither stable nor missed; alarms in it are counted apart.

Run: python -m benchmarks.verdict.milling [--cuts 40] [--first 200] [--at-once]
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray
from rich.progress import track
from scipy.interpolate import CubicSpline
from scipy.signal import fftconvolve, firwin

from benchmarks.verdict.cut import INTERVAL_S, RATE_HZ
from benchmarks.verdict.monitor import Passage, watch

Signal = NDArray[np.float64]
Bools = NDArray[np.bool_]

# When the tool enters, when the cut becomes deeper, when shallow again, when it leaves, and the end, in seconds.
ENTERS, DEEPER, SHALLOW, LEAVES, ENDS = 1.0, 6.0, 10.5, 12.5, 14.0
RAMP_S = 2.5  # of a depth that grows, where it does not jump
LEAST_RATE_HZ, STEPS_A_PERIOD = 50_000.0, 40.0
PASS_HZ = 5800.0
# Modes over the first of them: least and most.
OMEGA_RANGE = ([1.0, 1.4], [0.85, 1.4]), ([1.0, 2.6], [1.2, 2.6])
STIFFNESS_RANGE = ([1.0, 3.0], [0.8, 3.0]), ([1.0, 8.0], [2.0, 8.0])
# Forces on an idle machine, of a mean chip's force.
IDLE = 5e-5
# Noise of the twin, of that of the cut, and how much of the motion is another after a rotation where it chatters.
TWIN_NOISE, CHATTERING = 0.02, 0.1
# How long a cut is tried at another speed, and how often it chatters in the last half of that if it does.
AT_ANOTHER_S, OFTEN = 2.0, 0.05
# Intervals from the onset of chatter on until it has to be recognised, as in `benchmarks.verdict.labels`; what is over
# in so many was the step from one depth to the next.
FROM_ONSET, LASTING = 3, 10


@dataclass(frozen=True)
class Mill:
    """A machine, a tool, a workpiece and a sensor; SI units.

    Attributes
    ----------
    omega, zeta, stiffness : ndarray, shape (2, 2)
        Modes, in rows those of a direction.
    teeth, rotation_hz, told_hz
        Edges, speed, and the speed that is told.
    begins, ends : float
        Angle at which a tooth enters and leaves.
    feed, run_out : float, ndarray of shape (teeth,)
        Chip thickness, and how far each tooth stands out.
    pressure, radial : float
        Cutting force per area of chip, and that across over it.
    unsteady : float
        Relative unsteadiness of the force.
    chatters, ramp, over, under : bool, bool, float, float
        Whether the deeper cut is beyond the limit, and reached slowly; depths in limits.
    direction, derivative, noise_db, wander : int, int, float, float
        What is measured; the room below the cut; relative wander of the speed.
    """

    seed: int
    omega: Signal
    zeta: Signal
    stiffness: Signal
    teeth: int
    rotation_hz: float
    told_hz: float
    begins: float
    ends: float
    feed: float
    run_out: Signal
    pressure: float
    radial: float
    unsteady: float
    chatters: bool
    ramp: bool
    over: float
    under: float
    direction: int
    derivative: int
    noise_db: float
    wander: float

    @property
    def steps(self) -> int:
        """Steps of the simulation from tooth to tooth."""
        fastest = max(LEAST_RATE_HZ, STEPS_A_PERIOD * float(self.omega.max()) / (2.0 * math.pi))
        return math.ceil(fastest / (self.rotation_hz * self.teeth))

    @property
    def beyond_s(self) -> float:
        """When the depth passes the limit; never where it does not."""
        if not self.chatters:
            return math.inf
        return DEEPER + (RAMP_S * (1.0 - self.under) / (self.over - self.under) if self.ramp else 0.0)

    @property
    def step_s(self) -> float:
        """Length of one."""
        return 1.0 / (self.rotation_hz * self.teeth * self.steps)


def draw(seed: int) -> Mill:
    """Draw a cut."""
    rng = np.random.default_rng([seed, 1])
    first = np.exp(rng.uniform(np.log(250.0), np.log(1500.0)))
    rotation_hz = float(np.exp(rng.uniform(np.log(20.0), np.log(150.0))))
    teeth = int(rng.integers(1, 6))
    swept = math.acos(1.0 - 2.0 * rng.choice([0.1, 0.25, 0.5, 1.0], p=[0.15, 0.3, 0.35, 0.2]))
    down = rng.random() < 0.5
    feed = rng.uniform(0.03e-3, 0.12e-3)
    return Mill(
        seed=seed,
        omega=2.0 * np.pi * first * rng.uniform(*OMEGA_RANGE),
        zeta=rng.uniform(0.012, 0.045, (2, 2)),
        stiffness=10 ** rng.uniform(6.8, 7.6) * rng.uniform(*STIFFNESS_RANGE),
        teeth=teeth,
        rotation_hz=rotation_hz,
        told_hz=rotation_hz * (1.0 + rng.uniform(-0.004, 0.004)),
        begins=math.pi - swept if down else 0.0,
        ends=math.pi if down else swept,
        feed=feed,
        run_out=rng.uniform(-1.0, 1.0, teeth) * rng.choice([0.02, 0.1, 0.3]) * feed,
        pressure=rng.uniform(6e8, 2e9),
        radial=rng.uniform(0.2, 0.5),
        unsteady=rng.uniform(0.03, 0.15),
        chatters=bool(rng.random() < 0.6),
        ramp=bool(rng.random() < 0.4),
        over=rng.uniform(1.15, 2.2),
        under=rng.uniform(0.3, 0.75),
        direction=int(rng.integers(2)),
        derivative=int(rng.integers(3)),
        noise_db=rng.uniform(15.0, 35.0),
        wander=float(rng.choice([0.0003, 0.001, 0.002])),
    )  # fmt: skip


@njit(cache=True)
def _cut(steps, step_s, begins, ends, omega, zeta, stiffness, pressure, radial, feed, run_out, depth, noise, idle):
    """Displacement, velocity and acceleration of both directions for a depth at each step, shape (steps, 2, 3).

    ``noise`` has the relative unsteadiness of the force and two random forces at each step. Without a feed the cut is
    linear: no tooth loses contact, and it starts from a small deflection.
    """
    teeth, linear = run_out.size, feed == 0.0
    turn = steps * teeth
    x, v, left = np.zeros((2, 2)), np.zeros((2, 2)), np.zeros((teeth, turn))
    if linear:
        x[0, 0] = x[1, 0] = 1e-9
    out = np.zeros((depth.size, 2, 3))
    for i in range(depth.size):
        force_x, force_y = idle * noise[i, 1], idle * noise[i, 2]
        for tooth in range(teeth):
            at, before = (i + tooth * steps) % turn, (tooth + 1) % teeth
            angle = 2.0 * np.pi * at / turn
            if depth[i] == 0.0 or not begins <= angle <= ends:
                left[tooth, at] = 0.0
                continue
            sine, cosine = np.sin(angle), np.cos(angle)
            towards = x[0].sum() * sine + x[1].sum() * cosine
            nominal = feed * sine + run_out[tooth] - run_out[before]
            chip = nominal + towards - left[before, at]
            if not (linear or chip > 0.0):  # it leaves the surface as it is
                left[tooth, at] = left[before, at] - nominal
                continue
            left[tooth, at] = towards
            tangential = pressure * depth[i] * chip * (1.0 + noise[i, 0])
            force_x -= tangential * (cosine + radial * sine)
            force_y += tangential * (sine - radial * cosine)
        for d, force in ((0, force_x), (1, force_y)):
            for m in range(2):
                w = omega[d, m]
                acceleration = w * w * (force / stiffness[d, m] - x[d, m]) - 2.0 * zeta[d, m] * w * v[d, m]
                v[d, m] += step_s * acceleration
                x[d, m] += step_s * v[d, m]
                out[i, d, 0] += x[d, m]
                out[i, d, 1] += v[d, m]
                out[i, d, 2] += acceleration
    return out


def _run(mill: Mill, depth: Signal, noise: Signal, *, linear: bool) -> Signal:
    feed, run_out = (0.0, 0.0 * mill.run_out) if linear else (mill.feed, mill.run_out)
    return np.asarray(
        _cut(
            *(mill.steps, mill.step_s, mill.begins, mill.ends, mill.omega, mill.zeta, mill.stiffness, mill.pressure),
            *(mill.radial, feed, run_out, depth, noise, IDLE * mill.unsteady * mill.feed * mill.pressure),
        )
    )


def limit(mill: Mill) -> float:
    """Depth at which the linear cut begins to grow, m."""
    turn = mill.steps * mill.teeth
    count = turn * max(12, int(0.35 / (turn * mill.step_s)))
    silence = np.zeros((count, 3))

    def grows(depth: float) -> bool:
        size = np.abs(_run(mill, np.full(count, depth), silence, linear=True)[:, :, 0]).max(axis=1)
        with np.errstate(invalid="ignore", over="ignore"):
            return not size[-count // 4 :].max() < size[count // 2 : 3 * count // 4].max()

    deep = 2e-5
    while not grows(deep) and deep < 0.05:
        deep *= 1.6
    shallow = deep / 1.6
    for _ in range(9):
        middle = math.sqrt(shallow * deep)
        shallow, deep = (shallow, middle) if grows(middle) else (middle, deep)
    return deep


def simulate(mill: Mill) -> tuple[Signal, Bools]:
    """The recording, at the tracker's rate, and whether it chatters in each interval."""
    rng = np.random.default_rng([mill.seed, 2])
    count = int(ENDS / mill.step_s)
    time_s = np.arange(count) * mill.step_s
    depth = np.where((time_s > ENTERS) & (time_s < LEAVES), mill.under, 0.0)
    if mill.chatters:
        deeper = (time_s > DEEPER) & (time_s < SHALLOW)
        way = np.clip((time_s[deeper] - DEEPER) / RAMP_S, 0.0, 1.0) if mill.ramp else 1.0
        depth[deeper] = mill.under + (mill.over - mill.under) * way
    depth *= limit(mill)
    noise = _noise(mill, rng, count)
    cut = _run(mill, depth, noise, linear=False)[:, mill.direction]
    moved = cut[:, mill.derivative]
    heard = fftconvolve(moved, firwin(401, PASS_HZ, fs=1.0 / mill.step_s), "same")
    if mill.derivative == 0:  # a sensor of displacement that hears no static deflection
        heard -= np.convolve(heard, np.full(round(0.05 / mill.step_s), mill.step_s / 0.05), "same")
    wander = CubicSpline(np.linspace(0.0, ENDS, 60), np.cumsum(rng.standard_normal(60)))(time_s)
    wander = mill.wander * (wander - wander.mean()) / np.abs(wander - wander.mean()).max()
    at_s = np.interp(np.arange(int((ENDS - 0.1) * RATE_HZ)) / RATE_HZ, np.cumsum(1.0 + wander) * mill.step_s, time_s)
    samples = CubicSpline(time_s, heard)(at_s)
    cutting = samples[int(2.0 * RATE_HZ) : int(5.0 * RATE_HZ)].std()
    samples = samples / cutting + 10 ** (-mill.noise_db / 20.0) * rng.standard_normal(len(samples))
    return np.asarray(samples), _chatters(mill, depth, noise, cut[:, 1])


def chatters_at(mill: Mill, depth_m: float, rotation_hz: float) -> bool:
    """Whether it chatters as deep as that at another speed, for long enough in the last half of some seconds."""
    mill = replace(mill, rotation_hz=rotation_hz)
    count = int(AT_ANOTHER_S / mill.step_s)
    depth, noise = np.full(count, depth_m), _noise(mill, np.random.default_rng([mill.seed, 3]), count)
    chatters = _chatters(mill, depth, noise, _run(mill, depth, noise, linear=False)[:, mill.direction, 1])
    return bool(chatters[len(chatters) // 2 :].mean() > OFTEN)


def _noise(mill: Mill, rng: np.random.Generator, count: int) -> Signal:
    """Unsteadiness of the force, of one colour, and two random forces, shape (count, 3)."""
    noise = rng.standard_normal((count, 3))
    colour = np.exp(-np.arange(400) / 50.0)
    noise[:, 0] = mill.unsteady * fftconvolve(noise[:, 0], colour / np.sqrt((colour**2).sum()))[:count]
    return noise


def _chatters(mill: Mill, depth: Signal, noise: Signal, speed: Signal) -> Bools:
    """Whether the cut with next to no noise is another after a rotation, in each interval in which it cuts.

    By a tenth of what moves, in it and in the cut itself: of a cut whose teeth make no force that changes only noise
    moves, and of its twin the same, fainter.
    """
    twin = _run(mill, depth, TWIN_NOISE * noise, linear=False)[:, mill.direction, 1]
    turn, interval = mill.steps * mill.teeth, round(INTERVAL_S / mill.step_s)
    changed = np.zeros_like(twin)
    changed[turn:] = twin[turn:] - twin[:-turn]
    count = len(twin) // interval
    power, of_twin, of_change = (
        (x[: count * interval].reshape(count, interval) ** 2).mean(axis=1) for x in (speed, twin, changed)
    )
    cutting = depth[: count * interval : interval] > 0.0
    return np.asarray(cutting & (of_change > CHATTERING**2 * np.maximum(power, of_twin)))


@dataclass
class Score:
    """What was said of all recordings.

    Attributes
    ----------
    chatter, told : int
        Intervals that chatter, from `FROM_ONSET` on, and those of them with an alarm.
    lags_s : list of float
        From the onset of chatter to the end of the first alarm, infinite without one.
    stable, false : int
        Stretches of cutting within the limit, and those of them with an alarm.
    beyond, early : int
        Stretches beyond it in which nothing chatters yet, and those of them with an alarm.
    """

    chatter: int = 0
    told: int = 0
    lags_s: list[float] = field(default_factory=list)
    stable: int = 0
    false: int = 0
    beyond: int = 0
    early: int = 0

    def add(self, alarm: Bools, chatters: Bools, mill: Mill) -> None:
        """Add a recording."""
        at_once = mill.under > 1.0
        first, last = (ENTERS, LEAVES) if at_once else (DEEPER, SHALLOW)
        begin, end = round(first / INTERVAL_S), round(last / INTERVAL_S)
        onsets = np.flatnonzero(np.convolve(chatters[begin:end], np.ones(LASTING), "valid") > LASTING - 0.5)
        onset = begin + int(onsets[0]) if onsets.size else end
        if onset < end:
            scored = chatters[onset + FROM_ONSET : end]
            self.chatter += int(scored.sum())
            self.told += int((scored & alarm[onset + FROM_ONSET : end]).sum())
            alarms = np.flatnonzero(alarm[onset:end])
            self.lags_s.append(INTERVAL_S * (int(alarms[0]) + 1) if alarms.size else math.inf)
        if at_once:
            return
        limit = min(end, onset, round(min(mill.beyond_s, ENDS) / INTERVAL_S))
        for begins, ends in ((round(ENTERS / INTERVAL_S), begin), (begin, limit)):
            if ends > begins:
                self.stable += 1
                self.false += bool(alarm[begins:ends].any())
        if onset > limit:
            self.beyond += 1
            self.early += bool(alarm[limit:onset].any())


def passages(mill: Mill, samples: Signal) -> Iterator[Passage]:
    """The recording in whole intervals: the room, and all that comes after, with the speed that is told."""
    interval = round(INTERVAL_S * RATE_HZ)
    borders = [0, round(ENTERS / INTERVAL_S) * interval, len(samples) // interval * interval]
    for doing, begin, end in zip(("idle", "cuts"), borders[:-1], borders[1:], strict=True):
        yield Passage(samples[begin:end], doing, (60.0 * mill.told_hz, mill.teeth))


def main() -> None:
    """Print what was said."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cuts", type=int, default=40, help="how many cuts (default %(default)s)")
    parser.add_argument("--first", type=int, default=200, help="seed of the first (default %(default)s)")
    parser.add_argument("--at-once", action="store_true", help="what chatters does so from the first contact on")
    options = parser.parse_args()
    scores = {True: Score(), False: Score()}
    for seed in track(range(options.first, options.first + options.cuts), description="cuts"):
        mill = draw(seed)
        if options.at_once and mill.chatters:
            mill = replace(mill, under=mill.over)
        samples, chatters = simulate(mill)
        for known, score in scores.items():
            states = [state for remarks in watch(passages(mill, samples), announce=known) for state in remarks.states]
            score.add(np.array(states) == "self_excited", chatters, mill)
    print("speed    chattering  told   never of   median lag  within the limit  alarms  beyond, not yet  alarms")
    for known, score in scores.items():
        never, lag = sum(map(math.isinf, score.lags_s)), np.median(score.lags_s or [math.nan])
        told = score.told / score.chatter if score.chatter else math.nan
        print(
            f"{'told' if known else 'unknown':8}{INTERVAL_S * score.chatter:9.1f} s {told:6.1%}"
            f" {never:5d} {len(score.lags_s):3d} {lag:9.2f} s {score.stable:14d} {score.false:10d}"
            f" {score.beyond:12d} {score.early:10d}"
        )


if __name__ == "__main__":
    main()
