"""The kinds of cuts, each a draw from its distribution.

Ranges are those of the issue: 600-9000 rpm, 1-6 teeth, modes at 180-2200 Hz with 1-5 % damping, coefficients modulated
by 0-70 %, forces unsteady by 3-15 %, signal-to-noise ratios of 10-35 dB.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.verdict.cutting import SENSORS, Mode
from benchmarks.verdict.recipe import Engagement, Path, Recipe

Draw = Callable[[np.random.Generator], Recipe]

# At longer delays, in periods of the mode, vibration that grows does so too slowly to fall below a damping of -0.0015.
LONGEST_UNSTABLE_DELAY = 50.0
# A tooth frequency above this part of the mode's leaves the field of lobes where cuts are planned.
HIGHEST_TOOTH_FREQUENCY = 0.7


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _plain(rng: np.random.Generator, teeth: int | None = None, longest_delay: float = 100.0) -> Recipe:
    """Return a steady stable cut; what the families change is changed there. Delays in periods of the mode."""
    first = Mode(_log_uniform(rng, 180.0, 2200.0), float(rng.uniform(0.01, 0.05)))
    modes = [first]
    for _ in range(int(rng.integers(0, 3))):
        ratio = _log_uniform(rng, 1.3, 4.0) ** float(rng.choice((-1.0, 1.0)))
        frequency = float(np.clip(first.frequency_hz * ratio, 120.0, 4500.0))
        modes.append(
            Mode(frequency, float(rng.uniform(0.01, 0.05)), float(rng.uniform(0.05, 0.35)), float(rng.uniform(-1, 1)))
        )
    teeth = int(rng.integers(1, 7)) if teeth is None else teeth
    fastest = min(9000.0, HIGHEST_TOOTH_FREQUENCY * first.frequency_hz * 60.0 / teeth)
    slowest = max(600.0, first.frequency_hz * 60.0 / (teeth * longest_delay))
    rpm = _log_uniform(rng, slowest, fastest)
    depth = float(rng.uniform(0.0, 0.7 if teeth > 1 else 0.2))
    sensor = SENSORS[int(rng.integers(3))]
    duration_s = float(rng.uniform(8.0, 14.0))
    return Recipe(
        modes=tuple(modes),
        rpm=Path.constant(rpm),
        teeth=teeth,
        depth=Path.constant(float(rng.uniform(0.2, 0.7))),
        feed=_feed(rng, duration_s),
        engagement=Engagement(
            depth, float(rng.uniform(0.4, 0.8)), float(rng.uniform(0.03, 0.15)), float(rng.uniform(0.0, 0.3)) * depth
        ),
        run_out=float(rng.uniform(0.0, 0.1)) if teeth > 1 else 0.0,
        unsteadiness=float(rng.uniform(0.03, 0.15)),
        slow_share=float(rng.uniform(0.1, 0.5)),
        depth_wander=float(rng.uniform(0.0, 0.08)),
        feed_wander=_log_uniform(rng, 0.01, 0.4),
        clearance=_log_uniform(rng, 0.03, 0.6),
        clearance_wander=_log_uniform(rng, 0.05, 0.6),
        direct=10 ** float(rng.uniform(-1.5, -0.5) if sensor == "displacement" else rng.uniform(-1.0, 0.3)),
        direct_decay_s=_log_uniform(rng, 0.001, 0.015),
        sensor=sensor,
        snr_db=float(rng.uniform(10.0, 35.0)),
        duration_s=duration_s,
    )


def _feed(rng: np.random.Generator, duration_s: float) -> Path:
    """Return a feed that somebody turns up or down in half of the cuts: louder is not chatter."""
    if rng.random() < 0.5:
        return Path.constant(1.0)
    begin = float(rng.uniform(0.5, duration_s - 1.0))
    return Path((begin, begin + _log_uniform(rng, 0.02, 3.0)), (1.0, _log_uniform(rng, 0.4, 2.5)))


def ramp(rng: np.random.Generator) -> Recipe:
    """Depth of cut grows slowly through the limit."""
    plain = _plain(rng, longest_delay=LONGEST_UNSTABLE_DELAY)
    start = rng.uniform(0.5, 2.0)
    end = plain.duration_s - rng.uniform(0.5, 1.5)
    return replace(plain, depth=Path((start, end), (rng.uniform(0.3, 0.6), rng.uniform(1.4, 1.9))))


def _sudden(rng: np.random.Generator, plain: Recipe) -> Path:
    at = rng.uniform(0.35, 0.65) * plain.duration_s
    return Path((at, at + 0.01), (rng.uniform(0.2, 0.7), rng.uniform(1.4, 2.2)))


def step(rng: np.random.Generator) -> Recipe:
    """Unstable from one moment to the next: a step in the workpiece."""
    plain = _plain(rng, longest_delay=LONGEST_UNSTABLE_DELAY)
    return replace(plain, depth=_sudden(rng, plain))


def bar(rng: np.random.Generator) -> Recipe:
    """Turning a slender bar: in the middle it gives way and chatters, at both ends it does not."""
    plain = _plain(rng, teeth=1, longest_delay=LONGEST_UNSTABLE_DELAY)
    t = np.linspace(0.0, plain.duration_s, 41)
    ends, middle = rng.uniform(0.2, 0.4), rng.uniform(1.4, 2.0)
    shape = np.sin(np.pi * np.linspace(0.05, 0.95, t.size)) ** 2
    return replace(plain, depth=Path(tuple(t.tolist()), tuple((ends + (middle - ends) * shape).tolist())))


def _forced(rng: np.random.Generator) -> Recipe:
    """Return milling whose teeth are loud and whose depth is moderate."""
    plain = _plain(rng, teeth=int(rng.integers(2, 7)), longest_delay=LONGEST_UNSTABLE_DELAY)
    engagement = replace(plain.engagement, depth=float(rng.uniform(0.4, 0.7)))
    return replace(plain, engagement=engagement, run_out=float(rng.uniform(0.02, 0.2)))


def forced(rng: np.random.Generator) -> Recipe:
    """Stable milling that is loud with its teeth."""
    return _forced(rng)


def _at_resonance(rng: np.random.Generator, plain: Recipe) -> Recipe:
    frequency = plain.modes[0].frequency_hz * (1.0 + rng.uniform(-0.004, 0.004))
    lowest, highest = (frequency * 60.0 / plain.teeth / rpm for rpm in (9000.0, 600.0))
    harmonic = int(rng.integers(int(np.ceil(max(lowest, 1.0))), min(int(highest), 12) + 1))
    return replace(plain, rpm=Path.constant(frequency * 60.0 / plain.teeth / harmonic))


def forced_at_resonance(rng: np.random.Generator) -> Recipe:
    """Stable milling with a tooth harmonic right on the mode."""
    return _at_resonance(rng, _forced(rng))


def forced_then_chatter(rng: np.random.Generator) -> Recipe:
    """Loud with its teeth, then unstable as well."""
    plain = _forced(rng)
    return replace(plain, depth=_sudden(rng, plain))


def low_damped(rng: np.random.Generator) -> Recipe:
    """Stable with a structure that hardly damps: 0.4 %."""
    plain = _plain(rng)
    first = replace(plain.modes[0], damping_ratio=0.004)
    others = tuple(replace(m, compliance=0.3 * m.compliance) for m in plain.modes[1:])
    return replace(plain, modes=(first, *others), depth=Path.constant(float(rng.uniform(0.1, 0.5))))


def level_jumps(rng: np.random.Generator) -> Recipe:
    """Stable, but several times louder or quieter from one moment to the next."""
    plain = _plain(rng)
    times, levels, level = [0.0], [1.0], 1.0
    for at in np.sort(rng.uniform(1.0, plain.duration_s - 0.5, int(rng.integers(3, 8)))):
        times += [at, at + rng.uniform(0.002, 0.03)]
        levels += [level, level := _log_uniform(rng, 0.25, 4.0)]
    feed = Path(tuple(times), tuple(levels))
    return replace(plain, feed=feed) if rng.random() < 0.5 else replace(plain, loudness=feed)


def air_and_impacts(rng: np.random.Generator) -> Recipe:
    """In and out of the workpiece, with blows on the machine in between."""
    plain = _plain(rng)
    at, times, values, cutting = float(rng.uniform(0.5, 1.5)), [0.0], [0.0], False
    while at < plain.duration_s:
        times += [at, at + rng.uniform(0.005, 0.1)]
        values += [float(cutting), float(not cutting)]
        cutting = not cutting
        at += float(rng.uniform(0.7, 2.5))
    blows = np.sort(rng.uniform(0.4, plain.duration_s - 0.2, int(rng.integers(3, 10))))
    level = plain.depth.values[0]
    return replace(
        plain,
        feed=Path(tuple(times), tuple(values)),
        depth=Path(tuple(times), tuple(level * v for v in values)),
        impacts=tuple((float(t), _log_uniform(rng, 0.02, 0.5)) for t in blows),
    )


def background_tone(rng: np.random.Generator) -> Recipe:
    """A pump or a fan that runs before, during and after a stable cut."""
    plain = _plain(rng)
    begin, end = rng.uniform(1.5, 2.5), plain.duration_s - rng.uniform(0.0, 1.5)
    gate = Path((begin, begin + 0.05, end, end + 0.05), (0.0, 1.0, 1.0, 0.0))
    level = plain.depth.values[0]
    frequencies = np.exp(rng.uniform(np.log(100.0), np.log(4000.0), int(rng.integers(1, 4))))
    return replace(
        plain,
        feed=gate,
        depth=Path(gate.times_s, tuple(level * v for v in gate.values)),
        tones=tuple((float(f), float(10 ** rng.uniform(-0.5, 0.3))) for f in frequencies),
    )


def speed_ramp(rng: np.random.Generator) -> Recipe:
    """Stable while the spindle changes its speed by 10-40 %."""
    plain = _forced(rng) if rng.random() < 0.5 else _plain(rng)
    rpm = plain.rpm.values[0]
    start = rng.uniform(1.0, 3.0)
    end = start + rng.uniform(1.0, plain.duration_s - start - 0.5)
    factor = 1.0 + rng.uniform(0.1, 0.4)
    other = rpm * factor if rpm * factor < 9000.0 and rng.random() < 0.5 else max(rpm / factor, 600.0)
    return replace(plain, rpm=Path((start, end), (rpm, other)), depth=Path.constant(float(rng.uniform(0.2, 0.5))))


def interrupted(rng: np.random.Generator) -> Recipe:
    """A slot in the workpiece: the tool falls out of the cut and hits it again in every revolution."""
    plain = _plain(rng, teeth=int(rng.integers(1, 3)))
    rpm = _log_uniform(rng, 600.0, min(2400.0, 15.0 * plain.modes[0].frequency_hz / plain.teeth))
    engagement = replace(plain.engagement, slot=float(rng.uniform(0.15, 0.5)))
    depth = Path.constant(float(rng.uniform(0.2, 0.55)))
    return replace(plain, rpm=Path.constant(rpm), engagement=engagement, depth=depth)


def clipped(rng: np.random.Generator) -> Recipe:
    """Too loud for the microphone: a forced cut, or one that turns to chatter."""
    plain = _forced(rng) if rng.random() < 0.5 else step(rng)
    return replace(plain, clip=float(rng.uniform(0.3, 0.7)))


def hum(rng: np.random.Generator) -> Recipe:
    """Mains hum with harmonics over a stable cut or one that turns to chatter."""
    plain = _plain(rng) if rng.random() < 0.6 else step(rng)
    mains = float(rng.choice((50.0, 60.0))) * (1.0 + rng.uniform(-0.002, 0.002))
    level = 10 ** rng.uniform(-0.5, 0.3)
    tones = tuple((k * mains, float(level * rng.uniform(0.1, 1.0) / k)) for k in range(1, 9))
    return replace(plain, tones=tones)


def stable(rng: np.random.Generator) -> Recipe:
    """Steady at 20-90 % of the limit: what the margin is measured on."""
    return replace(_plain(rng), depth=Path.constant(float(rng.uniform(0.2, 0.9))), depth_wander=0.01, clearance=1.0)


FAMILIES: dict[str, Draw] = {
    draw.__name__: draw
    for draw in (
        ramp,
        step,
        bar,
        forced,
        forced_at_resonance,
        forced_then_chatter,
        low_damped,
        level_jumps,
        air_and_impacts,
        background_tone,
        speed_ramp,
        interrupted,
        clipped,
        hum,
        stable,
    )
}
