"""One case: drawn, moved and measured, with the truth about it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy.prove.blind import laws
from chatter_monitor.discrepancy.prove.blind.chain import QUANTITIES, RATE_HZ, measure
from chatter_monitor.discrepancy.prove.blind.concealment import concealment
from chatter_monitor.discrepancy.prove.blind.effects import COUNTS, DECK, Effect
from chatter_monitor.discrepancy.prove.blind.machine import Escaped, Machine, Motion, move, with_strength
from chatter_monitor.discrepancy.prove.blind.motion import Hidden
from chatter_monitor.discrepancy.prove.blind.nearest import beyond_nearest

Array = NDArray[np.float64]

LONG_S, SHORT_S = 20.0, 8.0
SHORT_SHARE = 1 / 3
FREQUENCY_HZ, DAMPING, SNR_DB, STRENGTH = (150.0, 1400.0), (0.008, 0.04), (26.0, 40.0), (0.01, 0.10)
LEVEL = (0.02, 0.08)  # rms of the recording, about
_GENTLER = 0.7  # strength over the last one, where the machine did not bear it
_ATTEMPTS = 8


@dataclass(frozen=True)
class Case:
    """What is handed to the program under test, and the truth, which is not.

    Attributes
    ----------
    samples : ndarray of float64, shape (n,)
        The recording, at `RATE_HZ`.
    integers : bool
        It is to be written with 24 bit; in floating point otherwise.
    model : str
        Text of the base model's file.
    truth : dict
        What is hidden, and how well.
    """

    samples: Array
    integers: bool
    model: str
    truth: dict[str, Any]


@dataclass(frozen=True)
class Chain:
    """The sensor of a case: what it measures, its gain and noise, and what is wrong with it."""

    quantity: str
    gain: float
    snr_db: float
    clipped_share: float = 0.0
    hum: float = 0.0  # amplitude, in rms of the recording
    wander: float = 0.0  # of the offset over the recording, in rms

    def record(self, motion: Motion, rng: np.random.Generator) -> tuple[Array, float]:
        """Samples of the recording, and the rms of the noise in them."""
        clean = self.gain * measure(motion.x, motion.v, self.quantity, motion.oversampling)
        rms = float(clean.std())
        noise_rms = rms * 10.0 ** (-self.snr_db / 20.0)
        time_s = np.arange(clean.size) / RATE_HZ
        samples = clean + noise_rms * rng.standard_normal(clean.size)
        samples += self.hum * rms * np.sin(2.0 * math.pi * 50.0 * time_s + rng.uniform(0.0, 6.28))
        samples += self.wander * rms * (time_s / time_s[-1] - 0.5)
        if self.clipped_share:
            level = float(np.quantile(np.abs(samples), 1.0 - self.clipped_share))
            samples = np.clip(samples, -level, level)
        return samples, noise_rms


def deal(cases: int, seed: int) -> list[Effect]:
    """Effects of so many cases in random order; every 100 of them hold the whole deck."""
    rng = np.random.default_rng([seed, 0])
    deck = [effect for effect, count in zip(DECK, COUNTS, strict=True) for _ in range(count)]
    dealt: list[Effect] = []
    while len(dealt) < cases:
        dealt += [deck[i] for i in rng.permutation(len(deck))]
    return dealt[:cases]


def make_case(
    effect: Effect,
    seed: int,
    number: int,
    quantities: Sequence[str] = QUANTITIES,
    strength: tuple[float, float] = STRENGTH,
) -> Case:
    """Make a case.

    Parameters
    ----------
    effect : Effect
        What to hide.
    seed, number : int
        Of the draw, and of the case in it, from 1; the same give the same case.
    quantities : sequence of str
        What the sensor may measure.
    strength : (float, float)
        Share of the rms restoring force, between which it is drawn.
    """
    rng = np.random.default_rng([seed, number])
    machine, chain, seconds, wanted, (hidden, motion) = _bearable(effect, rng, [seed, number, 1], quantities, strength)
    samples, noise_rms = chain.record(motion, rng)
    spindle = _spindle(effect, hidden, rng)
    base = _base_mode(effect, machine, seconds, rng)
    integers = rng.random() < 0.5 and float(np.abs(samples).max()) < 1.0
    seen = concealment(
        samples,
        chain.quantity,
        machine.frequency_hz,
        machine.damping_ratio,
        chain.snr_db,
        np.random.default_rng([seed, number, 2]),
    )
    truth = {
        "kind": effect.kind,
        "family": effect.family,
        "verdict": effect.verdict,
        "names": list(effect.names),
        "sense": effect.sense,
        "parameters": effect.parameters(hidden.p) if effect.parameters else {},
        "strength": motion.strength or None,
        "strength_drawn": wanted if effect.law else None,
        "beyond_nearest": _beyond_nearest(effect, hidden, motion),
        "time_s": [[hidden.from_s, hidden.until_s]] if math.isfinite(hidden.from_s) else [],
        "amplitude_above": hidden.above or None,
        "amplitude": hidden.p.tolist(),
        "rms_displacement": motion.rms_x,
        "seconds": seconds,
        "quantity": chain.quantity,
        "snr_db": chain.snr_db,
        "frequency_hz": machine.frequency_hz,
        "damping_ratio": machine.damping_ratio,
        "base": {"frequency_hz": float(base[0]), "damping_ratio": float(base[1]), "spindle": spindle},
        "concealed": seen.concealed,
        "concealment": {
            "distance": seen.distance,
            "band95": seen.band95,
            "spectrum_p": seen.spectrum_p,
            "normality_p": seen.normality_p,
            "independent": seen.independent,
        },
    }
    return Case(samples, integers, _model_text(chain, noise_rms, base, spindle), truth)


def _beyond_nearest(effect: Effect, hidden: Hidden, motion: Motion) -> float | None:
    """Share of the force that no other law of the catalogue could stand for; None where there is none all along."""
    if effect.family not in ("catalogue", "outside"):
        return None
    every = slice(None, None, motion.oversampling)
    return beyond_nearest(hidden, motion.x[every], motion.v[every], motion.force)


def _bearable(
    effect: Effect,
    rng: np.random.Generator,
    seed: list[int],
    quantities: Sequence[str],
    strength: tuple[float, float],
) -> tuple[Machine, Chain, float, float, tuple[Hidden, Motion]]:
    """Machine, sensor, length, strength and motion; another machine where the first does not bear the effect at all."""
    while True:
        machine = _machine(effect, rng)
        chain = _chain(effect, machine, quantities, rng)
        seconds = SHORT_S if effect.family != "part" and rng.random() < SHORT_SHARE else LONG_S
        wanted = min(effect.most, math.exp(rng.uniform(*np.log(strength))))
        try:
            return machine, chain, seconds, wanted, _hide(effect, machine, wanted, seconds, rng, seed)
        except Escaped:
            continue


def _machine(effect: Effect, rng: np.random.Generator) -> Machine:
    frequency_hz, damping = (math.exp(rng.uniform(*np.log(span))) for span in (FREQUENCY_HZ, DAMPING))
    if effect.sign < 0.0 and effect.law == laws.ENERGY:
        damping = rng.uniform(0.03, DAMPING[1])  # damping that falls with the amplitude needs some to fall from
    machine = Machine(frequency_hz, damping)
    match effect.kind:
        case "second_mode":
            ratio = rng.choice([rng.uniform(0.5, 0.75), rng.uniform(1.35, 2.2)])
            weight = math.exp(rng.uniform(math.log(0.02), math.log(0.2)))
            return replace(machine, second=(ratio * frequency_hz, damping * rng.uniform(0.7, 1.4), weight))
        case "coloured_excitation":
            return replace(machine, corner_hz=frequency_hz * rng.uniform(0.4, 1.5))
        case "impacts":
            return replace(machine, impacts_per_s=rng.uniform(5.0, 40.0), impact_share=rng.uniform(0.3, 0.7))
        case "nonstationary_excitation":
            return replace(machine, swell_hz=rng.uniform(0.2, 2.0), swell_depth=rng.uniform(0.4, 0.9))
    return machine


def _chain(effect: Effect, machine: Machine, quantities: Sequence[str], rng: np.random.Generator) -> Chain:
    quantity = str(rng.choice(quantities))
    unit = machine.w ** {"displacement": 0, "velocity": 1}.get(quantity, 2)
    chain = Chain(quantity, float(f"{rng.uniform(*LEVEL) / unit:.4g}"), rng.uniform(*SNR_DB))
    match effect.kind:
        case "clipping":
            return replace(chain, clipped_share=math.exp(rng.uniform(math.log(0.002), math.log(0.03))))
        case "mains_hum":
            return replace(chain, hum=math.exp(rng.uniform(math.log(0.03), math.log(0.3))))
        case "offset_drift":
            return replace(chain, wander=rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 1.5))
    return chain


def _hide(
    effect: Effect, machine: Machine, wanted: float, seconds: float, rng: np.random.Generator, seed: list[int]
) -> tuple[Hidden, Motion]:
    """The hidden force at the strength wanted, or as close below it as the machine bears, and the motion."""
    hidden = Hidden(effect.law, np.array([0.0, *effect.shapes(rng)]), machine.w)
    above = rng.uniform(*effect.above) if effect.above else 0.0
    if effect.open_s is not None:
        begin = rng.uniform(2.0, seconds - effect.open_s - 2.0)
        hidden = hidden._replace(from_s=begin, until_s=begin + effect.open_s)
    if effect.law == laws.TONE:
        hidden = hidden._replace(p=np.array([0.0, machine.w * rng.uniform(0.3, 1.7), rng.uniform(0.0, 6.28)]))
    if effect.law == laws.DRIFT:  # 2 p x is what drifts, its rms 1 / sqrt(3) of the ends
        hidden = hidden._replace(p=np.array([0.5 * math.sqrt(3.0) * wanted * rng.choice([-1.0, 1.0]), seconds]))
    for _ in range(_ATTEMPTS):
        try:
            found = hidden
            if effect.law not in (laws.NONE, laws.DRIFT):
                found = with_strength(machine, hidden, effect.units, wanted, effect.sign, above, seed)
            return found, move(machine, found, seconds, [*seed, 1], machine.oversampling)
        except Escaped:
            wanted *= _GENTLER
    raise Escaped(f"{effect.kind} at {machine.frequency_hz:.0f} Hz, {machine.damping_ratio:.4f}")


def _spindle(effect: Effect, hidden: Hidden, rng: np.random.Generator) -> tuple[float, int] | None:
    """Speed in rpm and teeth that the base model states: the true ones where they matter, any or none elsewhere."""
    teeth = int(rng.integers(1, 7))
    if effect.law in (laws.DELAY, laws.CONTACT):
        return 60.0 / (float(hidden.p[1]) * teeth), teeth
    if effect.law == laws.TONE:
        order = int(rng.integers(1, 9)) * teeth
        return 60.0 * float(hidden.p[1]) / (2.0 * math.pi * order), teeth
    return (rng.uniform(600.0, 9000.0), teeth) if rng.random() < 0.7 else None


def _base_mode(effect: Effect, machine: Machine, seconds: float, rng: np.random.Generator) -> tuple[float, float]:
    """Frequency and damping ratio of the simulation: exact for `none`, wrong for `parameters`, else nearly right."""
    f, z = machine.frequency_hz, machine.damping_ratio
    if effect.verdict == "none":
        return f, z
    near = f * (1.0 + rng.uniform(-0.005, 0.005)), z * math.exp(rng.uniform(-0.2, 0.2))
    if effect.verdict != "parameters":
        return near
    shift = f * (1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.01, 0.04))
    # The relative standard deviation of a damping ratio is 1 / sqrt(zeta w T): wrong by more than the record hides.
    least = max(math.log(1.6), 6.0 / math.sqrt(z * machine.w * seconds))
    factor = math.exp(rng.choice([-1.0, 1.0]) * rng.uniform(least, least + 0.4))
    match effect.kind:
        case "wrong frequency":
            return shift, z
        case "wrong damping":
            return f, z * factor
        case "process damping":
            return f, z / max(factor, 1.0 / factor)
    return shift, z * factor


def _model_text(chain: Chain, noise_rms: float, mode: tuple[float, float], spindle: tuple[float, int] | None) -> str:
    text = f"""[sensor]
quantity = "{chain.quantity}"
gain = {chain.gain:.10g}
noise_rms = {noise_rms:.4g}

[[mode]]
frequency_hz = {mode[0]:.10g}
damping_ratio = {mode[1]:.10g}

[excitation]
kind = "white_noise"
"""
    if spindle:
        text += f"\n[spindle]\nspeed_rpm = {spindle[0]:.10g}\nteeth = {spindle[1]}\n"
    return text
