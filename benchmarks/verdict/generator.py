"""Simulated cuts with their truth, the same for the same split and number."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq
from scipy.signal import fftconvolve, lfilter

from benchmarks.verdict.cut import INTERVAL_S, INTERVAL_SAMPLES, RATE_HZ, Cut
from benchmarks.verdict.cutting import Drive, vibration
from benchmarks.verdict.families import FAMILIES
from benchmarks.verdict.labels import Sound, interval_rms, judge_truth
from benchmarks.verdict.recipe import Engagement, Recipe
from benchmarks.verdict.roots import critical_kappa

Floats = NDArray[np.float64]
Split = Literal["development", "report"]

# Disjoint streams of random numbers. Nobody looks at the report split while a monitor or a generator is being made.
SEEDS: dict[Split, int] = {"development": 20_131, "report": 77_003}

OVERSAMPLING = 4
STEP_HZ = OVERSAMPLING * RATE_HZ
# Cut off on both ends after the decimation, which takes the signal for a period.
MARGIN_S = 0.1

CALM_DEPTH = 0.8  # of the limit, for what the teeth do by themselves
WANDER = 0.003  # standard deviation of the speed over its mean
WANDER_CORNER_HZ = 1.0
AC_CORNER_HZ = 15.0  # sensors and sound cards pass no static deflection


def cuts(split: Split, count: int, first: int = 0) -> Iterator[Cut]:
    """Yield `count` cuts of a split, families in turn, beginning with number `first`.

    A cut depends on its split and number alone, not on how many are asked for.
    """
    for number in range(first, first + count):
        yield cut(split, number)


def cut(split: Split, number: int) -> Cut:
    """Cut `number` of a split."""
    rng = _random(split, number)
    family = family_of(number)
    return simulate(FAMILIES[family](rng), f"{split}-{number:04d}-{family}", family, rng)


def recipe_of(split: Split, number: int) -> Recipe:
    """What cut `number` of a split is made of."""
    return FAMILIES[family_of(number)](_random(split, number))


def _random(split: Split, number: int) -> np.random.Generator:
    return np.random.default_rng([SEEDS[split], number])


def family_of(number: int) -> str:
    """Family of cut `number` of either split: they come in turn."""
    return list(FAMILIES)[number % len(FAMILIES)]


def simulate(recipe: Recipe, name: str, family: str, rng: np.random.Generator) -> Cut:
    """Simulate what a recipe says and find out what is true of it."""
    intervals = int(recipe.duration_s / INTERVAL_S)
    keep = slice(round(MARGIN_S * RATE_HZ), round(MARGIN_S * RATE_HZ) + intervals * INTERVAL_SAMPLES)
    n = round((intervals * INTERVAL_S + 2.0 * MARGIN_S) * STEP_HZ)
    t = np.arange(n) / STEP_HZ - MARGIN_S

    rpm, revolutions, delay_s = _turning(rng, recipe, t)
    tooth_phase = recipe.teeth * revolutions
    harmonics = recipe.engagement.harmonics()
    limit = min(
        critical_kappa(recipe.modes, 60.0 / (recipe.teeth * speed), harmonics) for speed in set(recipe.rpm.values)
    )
    kappa = recipe.depth(t) * limit * (1.0 + recipe.depth_wander * _wander(rng, n, rng.uniform(0.3, 2.0)))
    engaged = _engaged(recipe.engagement, tooth_phase, revolutions)
    process = kappa * recipe.modes[0].omega ** 2
    mean = process * engaged
    feed = recipe.feed(t) * np.maximum(0.0, 1.0 + recipe.feed_wander * _wander(rng, n, rng.uniform(1.0, 20.0)))
    radii = recipe.run_out * rng.standard_normal(recipe.teeth)
    run_out = feed * _tooth_radius(radii - radii.mean(), tooth_phase, recipe.engagement.edge)
    unsteady = mean * (1.0 + recipe.unsteadiness * _unsteadiness(rng, n, recipe.slow_share))
    path = _direct_path(rng, recipe.direct_decay_s)
    # what the teeth alone do: nothing random, and never so deep that it chatters
    shallower = np.minimum(1.0, CALM_DEPTH * limit / np.maximum(kappa, 1e-12))
    calm = Drive(mean * shallower, feed, run_out, delay_s * STEP_HZ, np.zeros(n), np.full(n, np.inf))
    forced, steepest = _run(recipe, calm, path, t, keep)
    # a feed and a depth that wander move the tool as well, teeth or not
    toothless = replace(calm, stiffness=process * engaged.mean() * shallower, run_out=np.zeros(n))
    uneven_stock, _ = _run(recipe, toothless, path, t, keep)
    uneven = np.maximum(0.1, 1.0 + recipe.clearance_wander * _wander(rng, n, rng.uniform(0.5, 15.0)))
    beyond = recipe.clearance * recipe.modes[0].omega * uneven
    drive = Drive(unsteady, feed, run_out, delay_s * STEP_HZ, _blows(recipe, t), steepest + beyond)
    heard, _ = _run(recipe, drive, path, t, keep)
    level = recipe.direct * _rms(heard[0].vibration) / _rms(heard[1].vibration)
    cut_sound, forced_sound, stock_sound = (
        Sound(m.vibration + level * d.vibration, m.limited) for m, d in (heard, forced, uneven_stock)
    )
    turning = forced_sound.vibration - stock_sound.vibration

    middle = INTERVAL_S * (np.arange(intervals) + 0.5)
    depth = np.interp(middle, t, kappa)
    usual = float(np.sqrt(np.mean(cut_sound.rms[depth > 0] ** 2)))
    samples = cut_sound.vibration + _tones(rng, recipe, cut_sound.vibration.size, usual)
    samples += usual * 10 ** (-recipe.snr_db / 20.0) * _room_noise(rng, samples.size)
    share = np.minimum((interval_rms(turning) / interval_rms(samples)) ** 2, 1.0)
    truth = judge_truth(recipe, harmonics, depth, np.interp(middle, t, rpm), cut_sound, forced_sound.limited, share)
    samples = _delivered(rng, recipe, samples)
    off = rng.choice((-1.0, 1.0)) * rng.uniform(0.01, 0.03)
    coarse = slice(None, None, round(0.01 * STEP_HZ))
    return Cut(
        name=name,
        family=family,
        samples=samples,
        rate_hz=RATE_HZ,
        nominal_rpm=float(recipe.rpm.values[0] * (1.0 + off)),
        teeth=recipe.teeth,
        speed_times_s=t[coarse],
        speed_rpm=rpm[coarse],
        snr_db=recipe.snr_db,
        sensor=recipe.sensor,
        truth=truth,
    )


def _turning(rng: np.random.Generator, recipe: Recipe, t: Floats) -> tuple[Floats, Floats, Floats]:
    """Speed with its wander, revolutions so far, and the time since the tooth before passed the same place."""
    rpm = recipe.rpm(t) * (1.0 + WANDER * _wander(rng, t.size, WANDER_CORNER_HZ))
    revolutions = np.cumsum(rpm) / (60.0 * STEP_HZ) + rng.uniform(0.0, 1.0)
    earlier = np.interp(revolutions - 1.0 / recipe.teeth, revolutions, t, left=np.nan)
    return rpm, revolutions, np.where(np.isnan(earlier), 60.0 / (recipe.teeth * rpm), t - earlier)


def _delivered(rng: np.random.Generator, recipe: Recipe, samples: Floats) -> Floats:
    """Scale to some gain within full scale; an overdriven input clips what is beyond it."""
    peak = float(np.max(np.abs(samples)))
    gain = 10 ** rng.uniform(-2.5, -0.05) / peak
    if recipe.clip is not None:
        samples = np.clip(samples / peak, -recipe.clip, recipe.clip)
        gain = 1.0 / recipe.clip
    return np.asarray((gain * samples).astype(np.float32).astype(np.float64))  # as a recording has them


def _run(recipe: Recipe, drive: Drive, path: Floats, t: Floats, keep: slice) -> tuple[tuple[Sound, Sound], float]:
    """Simulate: what the sensor gets through the modes and through everything else, and the steepest."""
    motion = vibration(recipe.modes, drive, STEP_HZ, recipe.sensor)
    fine = slice(OVERSAMPLING * keep.start, OVERSAMPLING * keep.stop)
    limited = motion.limited[fine].reshape(-1, OVERSAMPLING * INTERVAL_SAMPLES).mean(axis=1)
    loudness = recipe.loudness(t)
    direct = fftconvolve(_recorded(loudness * motion.force), path)
    modal = Sound(_recorded(loudness * motion.seen)[keep], limited)
    return (modal, Sound(direct[keep], limited)), float(motion.into[fine].max())


def _direct_path(rng: np.random.Generator, decay_s: float) -> Floats:
    """Impulse response of everything but the modes: dense, dying out, weak at low frequencies (a room, a headstock)."""
    t = np.arange(round(6.0 * decay_s * RATE_HZ)) / RATE_HZ
    dense = rng.standard_normal(t.size) * np.exp(-t / decay_s)
    corner = math.exp(-2.0 * math.pi * rng.uniform(100.0, 800.0) / RATE_HZ)
    return np.asarray(lfilter([1.0, -1.0], [1.0, -corner], dense))


def _wander(rng: np.random.Generator, n: int, corner_hz: float) -> Floats:
    """Ornstein-Uhlenbeck process of unit variance: slow changes about a mean."""
    stride = 64
    rho = math.exp(-2.0 * math.pi * corner_hz * stride / STEP_HZ)
    coarse = rng.standard_normal(n // stride + 2) * math.sqrt(1.0 - rho**2)
    coarse[0] /= math.sqrt(1.0 - rho**2)
    return np.interp(np.arange(n) / stride, np.arange(coarse.size), lfilter([1.0], [1.0, -rho], coarse))


def _rms(signal: Floats) -> float:
    return float(np.sqrt(np.mean(signal**2)))


def _unsteadiness(rng: np.random.Generator, n: int, slow_share: float) -> Floats:
    """Cutting force over its mean, less one, of unit variance: chip segments, hard grains; broad and slow parts."""
    parts = []
    for corner_hz in (rng.uniform(500.0, 6000.0), rng.uniform(15.0, 80.0)):
        rho = math.exp(-2.0 * math.pi * corner_hz / STEP_HZ)
        parts.append(lfilter([math.sqrt(1.0 - rho**2)], [1.0, -rho], rng.standard_normal(n)))
    return np.asarray(math.sqrt(1.0 - slow_share) * parts[0] + math.sqrt(slow_share) * parts[1])


def _engaged(engagement: Engagement, tooth_phase: Floats, revolutions: Floats) -> Floats:
    return engagement.teeth(tooth_phase) * engagement.spindle(revolutions)


def _tooth_radius(radii: Floats, tooth_phase: Floats, edge: float) -> Floats:
    """Radius of the tooth in the cut, from one to the next over the `edge`."""
    tooth = np.floor(tooth_phase).astype(np.int64)
    blend = np.clip((tooth_phase - tooth) / edge, 0.0, 1.0)
    blend = np.sin(0.5 * np.pi * blend) ** 2
    previous, present = radii[(tooth - 1) % radii.size], radii[tooth % radii.size]
    return np.asarray(previous + (present - previous) * blend)


def _blows(recipe: Recipe, t: Floats) -> Floats:
    """Half sines of 1 ms, each strong enough for the displacement that the recipe says."""
    force = np.zeros(t.size)
    width_s = 0.001
    for at, displacement in recipe.impacts:
        first = int(np.searchsorted(t, at))
        pulse = np.sin(np.pi * np.arange(round(width_s * STEP_HZ)) / (width_s * STEP_HZ))
        force[first : first + pulse.size] += pulse * displacement * recipe.modes[0].omega * 0.5 * np.pi / width_s
    return force


def _recorded(fine: Floats) -> Floats:
    """Decimate to the monitor's rate without a hole at the edge of the band, and without what is static.

    The edge is a power-complementary half-cosine of 6.1-6.7 kHz: white noise stays exactly white under the folding. A
    brick wall below the edge would leave an empty top of the band, which spoils every ARMA fit.
    """
    size = OVERSAMPLING * next_fast_len(-(-fine.size // OVERSAMPLING), real=True)
    spectrum = rfft(fine, size)
    f = rfftfreq(size, 1.0 / STEP_HZ)
    edge = 0.5 * RATE_HZ
    u = np.clip((f - 0.953 * edge) / (2.0 * 0.047 * edge), 0.0, 1.0)
    spectrum *= np.cos(0.5 * np.pi * u)
    spectrum *= 1.0 / (1.0 - 1j * AC_CORNER_HZ / np.maximum(f, 1e-9))
    return np.asarray(irfft(spectrum, size)[: fine.size : OVERSAMPLING])


def _tones(rng: np.random.Generator, recipe: Recipe, n: int, usual: float) -> Floats:
    """Tones from elsewhere, a little unsteady in frequency and level."""
    t = np.arange(n) / RATE_HZ
    total = np.zeros(n)
    for frequency_hz, level in recipe.tones:
        drift = np.interp(t, np.arange(0.0, t[-1] + 1.0, 0.5), rng.standard_normal(int(2 * (t[-1] + 1.0)) + 1))
        phase = 2.0 * np.pi * frequency_hz * (t + 3e-5 * np.cumsum(drift) / RATE_HZ)
        total += math.sqrt(2.0) * usual * level * (1.0 + 0.03 * drift) * np.sin(phase + rng.uniform(0.0, 2.0 * np.pi))
    return total


def _room_noise(rng: np.random.Generator, n: int) -> Floats:
    """Gaussian noise of unit variance whose spectrum falls with frequency, on a white floor."""
    f = np.maximum(rfftfreq(n, 1.0 / RATE_HZ), 20.0)
    slope, corner_hz = rng.uniform(0.0, 1.0), rng.uniform(100.0, 1000.0)
    shape = (1.0 + (f / corner_hz) ** 2) ** (-0.5 * slope) + rng.uniform(0.02, 0.2)
    noise = irfft(shape * rfft(rng.standard_normal(n)), n)
    return np.asarray(noise / np.std(noise))
