"""What turns: how exactly it is followed, how much of it is taken out, and what must stay in.

Simulated combs: tooth passing harmonics of falling strength through a resonance, run-out at the spindle's orders,
white noise. The speed given to the monitor is 1 to 3 % off, or none is given. The true speed is constant, or wanders
by 0.3 % (Ornstein-Uhlenbeck with a corner of 0.1 or 1 Hz). What is left of the comb is known exactly: it is the
residual less the noise that was put in. Seeds below 1000 were for development; these are others.

Run: python -m benchmarks.orders [--cuts N]
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import hilbert, lfilter

from chatter_monitor.tracking.orders import Orders, OrderSettings, OrderTracker
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.tracking.tracker import Tracker, TrackerSettings

RATE_HZ = 12_800.0
REPORT = 1000  # the first seed of the report
SECONDS = 8.0
SETTLED_S = 4.0
WANDER = 0.003
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Cut:
    """A comb and the noise around it."""

    comb: Floats
    noise: Floats
    rotation_hz: Floats  # at every sample
    nominal: SpindleSettings


def wander(rng: np.random.Generator, n: int, corner_hz: float) -> Floats:
    """Ornstein-Uhlenbeck process of unit variance."""
    rho = math.exp(-2 * math.pi * corner_hz / RATE_HZ)
    noise = rng.standard_normal(n) * math.sqrt(1 - rho**2)
    noise[0] = rng.standard_normal()
    return np.asarray(lfilter([1], [1, -rho], noise))


def turned(rotation_hz: Floats) -> Floats:
    """Angle in radians at every sample."""
    return np.asarray(2 * np.pi * np.cumsum(rotation_hz) / RATE_HZ)


def cut(seed: int, snr_db: float, corner_hz: float | None, rotation_hz: float | None = None, teeth: int = 0) -> Cut:
    """One simulated cut; `corner_hz` None for a constant speed, `teeth` 0 for any number."""
    rng = np.random.default_rng(seed)
    n = round(SECONDS * RATE_HZ)
    mean_hz = rotation_hz or math.exp(rng.uniform(math.log(10), math.log(150)))
    teeth = teeth or int(rng.integers(1, 7))
    mode_hz = rng.uniform(180, 2200)
    rotation = mean_hz * (1 + (WANDER * wander(rng, n, corner_hz) if corner_hz else np.zeros(n)))
    angle = turned(rotation)
    comb = np.zeros(n)
    for order in range(1, int(4000 / mean_hz)):
        if order % teeth == 0:
            amplitude = teeth / order
        elif order <= 3 * teeth:
            amplitude = 0.15 * rng.uniform(0.3, 1)
        else:
            continue
        ratio = order * mean_hz / mode_hz
        amplitude /= abs(1 - ratio**2 + 0.06j * ratio)
        comb += amplitude * np.cos(order * angle + rng.uniform(0, 2 * np.pi))
    noise = rng.standard_normal(n) * 10 ** (-snr_db / 20)
    off = rng.uniform(0.01, 0.03) * rng.choice([-1, 1])
    return Cut(comb / comb.std(), noise, rotation, SpindleSettings(60 * mean_hz * (1 + off), teeth))


def take_out(samples: Floats, spindle: SpindleSettings) -> tuple[Floats, list[Orders]]:
    """Residual and frames."""
    residual, frames = OrderTracker(OrderSettings(), RATE_HZ, spindle).process(0, samples)
    return residual, frames


def decibels(power: float) -> float:
    """Ratio of powers in dB."""
    return 10 * math.log10(max(power, 1e-12))


def _relative_error(frame: Orders, truth_hz: float) -> float:
    """Of the rotation, or of whatever multiple of it was found."""
    multiple = (frame.rotation_hz or 0.0) / truth_hz
    return multiple / max(1, round(multiple)) - 1


def following(cuts: int) -> None:
    """Print how well combs are followed and taken out."""
    print(f"\nCombs of 10 to 150 Hz, 1 to 6 teeth, {cuts} cuts a row; from {SETTLED_S:.0f} s on unless a time is given")
    print("a tooth passing frequency that is found instead of the spindle's counts as found: nothing tells them apart")
    print("speed    wander          SNR dB   found  time to find s    speed error %     left of the comb, dB")
    print("                                         median   90 %     rms, median       median    90 %")
    for given in (True, False):
        for corner_hz in (None, 0.1, 1.0):
            for snr_db in (20, 5, -5):
                times, errors, left = [], [], []
                for seed in range(REPORT, REPORT + cuts):
                    made = cut(seed, snr_db, corner_hz)
                    residual, frames = take_out(made.comb + made.noise, made.nominal if given else SpindleSettings())
                    size = len(residual) // len(frames)
                    settled = round(SETTLED_S * RATE_HZ)
                    remains = (residual - made.noise)[settled:]
                    left.append(decibels(float(np.mean(remains**2) / np.mean(made.comb[settled:] ** 2))))
                    known = [i for i, frame in enumerate(frames) if frame.source in ("refined", "found")]
                    if not known:
                        continue
                    times.append(known[0] * size / RATE_HZ)
                    truth = made.rotation_hz.reshape(len(frames), size).mean(axis=1)
                    off = [_relative_error(frames[i], truth[i]) for i in known if i * size >= settled]
                    errors.append(100 * float(np.sqrt(np.mean(np.square(off)))) if off else math.nan)
                name = "none" if corner_hz is None else f"0.3 %, {corner_hz} Hz"
                nothing = [math.nan]
                print(
                    f"{'given' if given else 'unknown':8} {name:14} {snr_db:6d} {len(times) / cuts:8.2f} "
                    f"{np.median(times or nothing):9.2f} {np.quantile(times or nothing, 0.9):7.2f} "
                    f"{np.nanmedian(errors or nothing):12.3f} {np.median(left):16.1f} {np.quantile(left, 0.9):8.1f}"
                )


def neighbours(cuts: int) -> None:
    """Print how much of a vibration beside an order is left."""
    print(f"\nA vibration as strong as the whole comb starts at 5 s, some orders beside an order; {cuts} cuts a row,")
    print("SNR 15 dB, 4 teeth. Its amplitude in the residual over what it was; least of the cuts, and median")
    print("off by   rotation  wander           first 50 ms     to 200 ms      to 1 s         to 3 s")
    for off in (0.3, 0.1, 0.05, 0.0):
        for rotation_hz in (27.0, 100.0):
            for corner_hz in (None, 1.0):
                rows = []
                for seed in range(REPORT, REPORT + cuts):
                    made = cut(seed, 15, corner_hz, rotation_hz, teeth=4)
                    t = np.arange(len(made.comb)) / RATE_HZ
                    order = round(np.random.default_rng(seed).uniform(300, 1500) / rotation_hz)
                    line = np.where(t >= 5.0, math.sqrt(2) * np.cos(2 * np.pi * (order + off) * rotation_hz * t), 0.0)
                    residual, _ = take_out(made.comb + made.noise + line, made.nominal)
                    analytic = hilbert(line[t >= 5.0])
                    remains = (residual - made.noise)[t >= 5.0]
                    edges = [round(s * RATE_HZ) for s in (0.0, 0.05, 0.2, 1.0, 3.0)]
                    rows.append(
                        [
                            abs(np.vdot(analytic[a:b], remains[a:b])) * 2 / np.vdot(analytic[a:b], analytic[a:b]).real
                            for a, b in pairwise(edges)
                        ]
                    )
                least, middle = np.min(rows, axis=0), np.median(rows, axis=0)
                cells = "   ".join(f"{a:5.2f} {b:5.2f}" for a, b in zip(least, middle, strict=True))
                print(f"{off:5.2f} {rotation_hz:9.0f} Hz  {'none' if corner_hz is None else '0.3 %':12} {cells}")


NO_COMB = ("noise", "lone tones", "overtones", "sidebands")


def no_comb(kind: str, seed: int) -> tuple[Floats, SpindleSettings]:
    """A signal without a comb: noise, tones, or a self-excited vibration with its overtones and sidebands."""
    rng = np.random.default_rng([seed, NO_COMB.index(kind)])
    n = round(12.0 * RATE_HZ)
    noise = rng.standard_normal(n)
    if rng.random() < 0.5:
        noise = np.asarray(lfilter([1], [1, -0.9], noise))
    rotation_hz = math.exp(rng.uniform(math.log(10), math.log(150)))
    teeth = int(rng.integers(1, 7))
    spindle = SpindleSettings(60 * rotation_hz * (1 + rng.uniform(-0.03, 0.03)), teeth)
    signal = np.zeros(n)
    if kind == "lone tones":
        for _ in range(rng.integers(1, 6)):
            signal += rng.uniform(0.2, 1) * np.cos(turned(np.full(n, rng.uniform(50, 3000))) + rng.uniform(0, 6))
    elif kind != "noise":
        frequency_hz = rng.uniform(300, 1500)
        while abs(frequency_hz / rotation_hz - round(frequency_hz / rotation_hz)) < 0.1:
            frequency_hz = rng.uniform(300, 1500)
        angle = turned(frequency_hz * (1 + 0.001 * wander(rng, n, 0.2)))
        passing = turned(np.full(n, teeth * rotation_hz))
        strengths = (0.6, 0.4, 0.2) if kind == "sidebands" else ()
        around = 1 + sum(a * np.cos(k * passing + rng.uniform(0, 6)) for k, a in enumerate(strengths, 1))
        signal = around * sum(a * np.cos(k * angle) for k, a in ((1, 1.0), (2, 0.3), (3, 0.1)))
    return signal * 10 ** (rng.uniform(5, 30) / 20) + noise / noise.std(), spindle


def false_combs(cuts: int) -> None:
    """Print how often a comb is believed where there is none."""
    print(
        f"\nSignals without a comb, {cuts} of 12 s a row: with a comb at any time, share of time, amplitude left at the"
    )
    print("end (least, 10 %). Frequencies of self-excited vibrations wander by 0.1 %")
    for kind in NO_COMB:
        for given in (True, False):
            ever, share, left = 0, 0.0, []
            for seed in range(REPORT, REPORT + cuts):
                samples, spindle = no_comb(kind, seed)
                residual, frames = take_out(samples, spindle if given else SpindleSettings())
                believed = [frame.source in ("refined", "found") or frame.other_hz is not None for frame in frames]
                ever += any(believed)
                share += sum(believed) / len(believed) / cuts
                end = -round(4 * RATE_HZ)
                left.append(float(residual[end:].std() / samples[end:].std()))
            print(
                f"{kind:12} {'given' if given else 'unknown':8} {ever:4d} of {cuts} {100 * share:8.1f} % "
                f"{min(left):10.2f} {np.quantile(left, 0.1):6.2f}"
            )


def cost() -> None:
    """Print what a second of signal costs, over what the tracker costs."""
    print("\nProcessor time per second of signal, blocks of 0.1 s, least and median of 100; tracker in turns with it")
    for rotation_hz in (12.0, 27.0, 100.0):
        made = cut(REPORT, 10, 0.1, rotation_hz, teeth=4)
        samples = np.tile(made.comb + made.noise, 3)
        orders = OrderTracker(OrderSettings(), RATE_HZ, made.nominal)
        tracker = Tracker(TrackerSettings())
        ours, theirs = [], []
        for first in range(0, len(samples) - 1280, 1280):
            block = samples[first : first + 1280]
            began = time.process_time()
            orders.process(first, block)
            between = time.process_time()
            list(tracker.process(first, block))
            ours.append(10 * (between - began))
            theirs.append(10 * (time.process_time() - between))
        ours, theirs = ours[-100:], theirs[-100:]
        print(
            f"{rotation_hz:5.0f} Hz, given   orders {1e3 * min(ours):5.2f} {1e3 * np.median(ours):6.2f} ms"
            f"   tracker {1e3 * min(theirs):5.2f} {1e3 * np.median(theirs):6.2f} ms"
            f"   ratio {min(ours) / min(theirs):.2f} {np.median(ours) / np.median(theirs):.2f}"
        )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cuts", type=int, default=20)
    arguments = parser.parse_args()
    cost()
    following(arguments.cuts)
    neighbours(max(4, arguments.cuts // 3))
    false_combs(2 * arguments.cuts)


if __name__ == "__main__":
    main()
