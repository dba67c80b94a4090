"""The limit of a cut that chatters: where the vibration stays the tool leaves the cut, and its size tells the chip's.

The amplitude of the limit is fitted, so what a simulation can be held to is its frequency, and the chip where it is
known. With many waves in the delay there is more than one limit, a wave more or less; the noise decides which one a cut
comes to. So several runs are looked at, each with other noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp

from chatter_monitor.discrepancy.chatter.growth import Regeneration, Vibration
from chatter_monitor.errors import InputError
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import AppliedTerm
from chatter_monitor.physics.simulate import Simulation, simulate
from chatter_monitor.physics.terms import CATALOGUE

_RUN_S, _TRIALS = 6.0, 3
_CLOSE = 0.02  # to which runs reach the recording's amplitude
_NOISES = 6


@dataclass(frozen=True, slots=True, eq=False)
class Limit:
    """Where a simulated cut stays in the last third of a run: amplitude, u, and frequency, Hz."""

    amplitude: float
    frequency_hz: float
    run: Simulation

    def is_at(self, frequency_hz: float) -> bool:
        """Whether it is the one at a frequency: it has as many waves in the delay."""
        spindle = self.run.system.spindle
        return spindle is None or abs(self.frequency_hz - frequency_hz) * spindle.delay_s < 0.5


def augmented(found: Vibration, made: Regeneration, system: MachiningSystem) -> MachiningSystem:
    """The machine with regeneration that makes the vibration; it leaves the cut where the vibration stays.

    Where the chip has not been seen, runs tell it: the motion is as large as the chip is thick, other things equal.
    """
    spindle = system.spindle
    if spindle is None:
        raise ValueError("regeneration has a spindle")
    modes = list(system.modes)
    modes[found.mode] = made.mode
    terms = [applied for applied in system.terms if not applied.term.delayed]
    # What the mode alone makes of its noise, as loud as it was before: var(x) = pi S_0 / (2 zeta w^3), and the median
    # of its amplitude is sqrt(2 log 2) times the root of that.
    variance = found.quiet**2 / (2.0 * math.log(2.0))
    intensity = 2.0 * made.mode.damping_ratio * made.mode.omega**3 * variance / math.pi
    excitation = replace(system.excitation, intensity=intensity)
    system = replace(
        system,
        modes=tuple(modes),
        spindle=replace(spindle, speed_rpm=60.0 / (spindle.teeth * made.delay_s)),
        excitation=excitation if excitation.kind != "measured" else system.excitation,
    )
    if math.isfinite(made.chip):
        return replace(system, terms=(*terms, _leaving(made, made.chip)))
    if not math.isfinite(found.plateau):
        delay = AppliedTerm(CATALOGUE["regenerative_delay"], {"coefficient": made.coefficient})
        return replace(system, terms=(*terms, delay))
    chip = found.plateau
    model = system
    for _ in range(_TRIALS):
        model = replace(system, terms=(*terms, _leaving(made, chip)))
        reached = limit_at(found.frequency_hz, limits_of(model))
        if reached is None or abs(reached.amplitude / found.plateau - 1.0) < _CLOSE:
            break
        chip *= found.plateau / reached.amplitude
    return model


def _leaving(made: Regeneration, chip: float) -> AppliedTerm:
    return AppliedTerm(CATALOGUE["loss_of_contact"], {"coefficient": made.coefficient, "chip_thickness": chip})


def limits_of(system: MachiningSystem) -> Iterator[Limit]:
    """Where simulated cuts stay, each with other noise; nothing of those that do not stay."""
    rate = 16.0 * max(mode.frequency_hz for mode in system.modes)
    for seed in range(1, _NOISES + 1):
        try:
            run = simulate(system, _RUN_S, seed, rate, settle_s=0.1)
        except InputError:
            continue
        late = run.displacement[int(0.7 * run.displacement.size) :]
        frequency, density = dsp.periodogram(late * np.hanning(late.size), rate, nfft=8 * late.size)
        yield Limit(float(np.sqrt(2.0) * np.std(late)), float(frequency[np.argmax(density)]), run)


def limit_at(frequency_hz: float, limits: Iterable[Limit]) -> Limit | None:
    """The limit at a frequency, if there is one there; any other if not, and none if nothing stays."""
    other = None
    for limit in limits:
        if limit.is_at(frequency_hz):
            return limit
        other = other or limit
    return other


def chip_sd(found: Vibration, made: Regeneration, model: MachiningSystem, reached: Limit | None) -> float:
    """Standard deviation of the chip thickness.

    Where the chip has not been seen: what else it would be with the mode and the coefficient elsewhere.

    Parameters
    ----------
    found : Vibration
    made : Regeneration
    model : MachiningSystem
        As from `augmented`, with a chip.
    reached : Limit, optional
        Where it stays.

    Returns
    -------
    float
        A vibration that would not stay with a parameter one standard deviation away counts as a factor of e.
    """
    if math.isfinite(made.chip):
        return float(made.sd[3])
    chip = model.terms[-1].parameters["chip_thickness"]
    if reached is None:
        return chip
    variance = _CLOSE**2
    for column in np.linalg.cholesky(made.covariance).T:
        shifted = [_shifted(made, model, found.mode, sign * column) for sign in (1.0, -1.0)]
        there = [limit_at(found.frequency_hz, limits_of(system)) for system in shifted]
        variance += float(np.mean([math.log(at.amplitude / reached.amplitude) ** 2 if at else 1.0 for at in there]))
    return chip * math.sqrt(variance)


def _shifted(made: Regeneration, model: MachiningSystem, number: int, change: NDArray[np.float64]) -> MachiningSystem:
    """The model with another frequency, damping ratio and coefficient."""
    mode = replace(
        made.mode,
        frequency_hz=made.mode.frequency_hz + float(change[0]),
        damping_ratio=max(made.mode.damping_ratio + float(change[1]), 1e-4),
    )
    *terms, cut = model.terms
    coefficient = max(made.coefficient + float(change[2]), 0.0)
    cut = AppliedTerm(cut.term, {**cut.parameters, "coefficient": coefficient})
    return replace(model, modes=(*model.modes[:number], mode, *model.modes[number + 1 :]), terms=(*terms, cut))
