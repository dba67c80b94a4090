"""What several recordings of one machine share: modes, process damping, regeneration.

Each recording gives estimates of the linear machine with their covariance (Whittle's likelihood of its own spectrum,
own noise and colour). What is shared follows from all of them by generalised least squares, and what the shares leave
is chi-squared if the recordings agree. Damping is where the cut comes in: per unit mass it is

    d_r = structural + C b_r / v_r                                                                  eq. (4)

so a line over b / v separates the two, which no single recording can.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from chatter_monitor.discrepancy.linear import Base
from chatter_monitor.discrepancy.report import Estimate
from chatter_monitor.discrepancy.spectrum import SpectralFit, fit
from chatter_monitor.physics.model import MachiningSystem
from chatter_monitor.physics.parts import Cut, Mode
from chatter_monitor.physics.terms import CATALOGUE

Vector = NDArray[np.float64]
PROCESS_DAMPING = "process_damping"
NAMED_P = 1e-4
DISAGREE_P = 1e-5
FAMILIES = ("frequency", "damping", "regeneration")
UNIT_WIDTH_M = 1.0  # of a cut that says nothing of its width


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """The linear machine as one recording shows it.

    Attributes
    ----------
    cut : Cut
    values : ndarray of float64, shape (p,)
        Logarithm of the frequency (of f in Hz) and damping 2 zeta w in 1/s of each mode; regeneration, if there is any.
    covariance : ndarray of float64, shape (p, p)
    modes : tuple of Mode
    """

    cut: Cut
    values: Vector
    covariance: Vector
    modes: tuple[Mode, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Shared:
    """What the recordings share.

    Attributes
    ----------
    modes : tuple of Mode
        Of the structure alone, process damping taken out.
    frequency_sd, damping_sd : ndarray of float64, shape (modes,)
        Standard deviations: relative; of the damping ratio.
    process_damping, regeneration : (float, float) or None
        Value and standard deviation: C over the modal mass in 1/s^2 per metre of width; coefficient of the delay in the
        first cut (it grows with the width).
    gain_nats, p_value : float
        What process damping explains beyond a damping that is the same at all speeds, and its test.
    disagreement : dict of str to float
        For each of `FAMILIES`: how often chance lets the recordings differ as much from what is shared.
    checked : bool
        Whether there are more speeds than parameters, so that the law of eq. (4) could have failed.
    """

    modes: tuple[Mode, ...]
    frequency_sd: Vector
    damping_sd: Vector
    process_damping: tuple[float, float] | None
    regeneration: tuple[float, float] | None
    gain_nats: float
    p_value: float
    disagreement: dict[str, float]
    checked: bool

    @property
    def process_damped(self) -> bool:
        """Whether process damping is there."""
        return self.process_damping is not None and self.process_damping[0] > 0.0 and self.p_value < NAMED_P

    def damping_ratio(self, mode: int, cut: Cut) -> float:
        """Damping ratio of a mode (from 0) in a cut."""
        found = self.modes[mode]
        process = self.process_damping[0] if self.process_damping is not None and self.process_damped else 0.0
        inverse = inverse_speed(cut)
        added = process * inverse * found.participation**2 if inverse is not None else 0.0
        return found.damping_ratio + added / (2.0 * found.omega)


def inverse_speed(cut: Cut) -> float | None:
    """Chip width over cutting speed, b / v_c of eq. (4), in s; None without a cutting speed."""
    if cut.cutting_speed_m_s is None:
        return None
    return _width_m(cut) / cut.cutting_speed_m_s


def with_process_damping(system: MachiningSystem) -> MachiningSystem:
    """The same machine with its process damping, which in one cut is a damper, in the damping ratios of its modes."""
    damper = sum(
        applied.term.force(0.0, 1.0, 0.0, 0.0, 1.0, 0.0, applied.values)
        for applied in system.terms
        if applied.term.name == PROCESS_DAMPING
    )
    modes = tuple(
        replace(mode, damping_ratio=mode.damping_ratio + damper * mode.participation**2 / (2.0 * mode.omega))
        for mode in system.modes
    )
    terms = tuple(applied for applied in system.terms if applied.term.name != PROCESS_DAMPING)
    return replace(system, modes=modes, terms=terms)


def seen(bases: Sequence[Base], cuts: Sequence[Cut]) -> list[Seen]:
    """The linear machine of each recording; with a delay in all of them if one regenerates."""
    delayed = [any(o.name == "regenerative_delay" for o in base.omissions) for base in bases]
    return [
        _seen(_with_delay(base) if any(delayed) and not own else _fitted(base), cut)
        for base, own, cut in zip(bases, delayed, cuts, strict=True)
    ]


def _fitted(base: Base) -> SpectralFit:
    for omission in base.omissions:
        if omission.name == "regenerative_delay":
            return omission.fit
    return base.fitted


def _with_delay(base: Base) -> SpectralFit:
    spindle = base.fitted.linear.spindle
    if spindle is None:
        return base.fitted
    return fit(base.spectrum, replace(base.fitted.linear, delay_s=spindle.delay_s, regeneration=0.0))


def _seen(found: SpectralFit, cut: Cut) -> Seen:
    """Values and covariance in the units of what is shared, by the delta method."""
    modes = found.linear.modes
    rows: list[Vector] = []
    values: list[float] = []
    at = 0
    for i, mode in enumerate(modes):
        frequency, damping = np.zeros(found.vector.size), np.zeros(found.vector.size)
        frequency[at] = 1.0
        damper = 2.0 * mode.damping_ratio * mode.omega
        damping[at : at + 2] = damper
        rows += [frequency, damping]
        values += [math.log(mode.frequency_hz), damper]
        at += 2 + (i > 0)
    if found.linear.delay_s is not None:
        row = np.zeros(found.vector.size)
        row[found.regeneration_at] = 1.0
        rows.append(row)
        values.append(found.linear.regeneration)
    jacobian = np.array(rows)
    return Seen(cut, np.array(values), jacobian @ found.covariance @ jacobian.T, modes)


@dataclass(frozen=True, slots=True, eq=False)
class _Solved:
    values: Vector
    covariance: Vector
    chi2: float
    freedom: int


def _solve(recordings: Sequence[Seen], process: bool, free: Collection[str] = ()) -> _Solved:
    """Generalised least squares; families in `free` are those of each recording alone."""
    modes = len(recordings[0].modes)
    delayed = recordings[0].values.size > 2 * modes
    shared = 2 * modes + delayed + process
    extra = sum({"frequency": modes, "damping": modes, "regeneration": int(delayed)}[name] for name in free)
    width = shared + extra * len(recordings)
    information, right = np.zeros((width, width)), np.zeros(width)
    chi2, count = 0.0, 0
    at = shared
    for each in recordings:
        design = np.zeros((each.values.size, width))
        for row in range(each.values.size):
            family = FAMILIES[2] if row >= 2 * modes else FAMILIES[row % 2]
            if family in free:
                design[row, at] = 1.0
                at += 1
                continue
            design[row, row] = _width_m(each.cut) / _width_m(recordings[0].cut) if family == "regeneration" else 1.0
            if process and family == "damping":
                design[row, 2 * modes + delayed] = (inverse_speed(each.cut) or 0.0) * each.modes[
                    row // 2
                ].participation ** 2
        inverse = np.linalg.inv(each.covariance)
        information += design.T @ inverse @ design
        right += design.T @ inverse @ each.values
        chi2 += float(each.values @ inverse @ each.values)
        count += each.values.size
    used = np.flatnonzero(np.diag(information) > 0.0)
    size = np.sqrt(np.diag(information)[used])  # parameters of very different units
    covariance = np.zeros((width, width))
    scaled = information[np.ix_(used, used)] / np.outer(size, size)
    covariance[np.ix_(used, used)] = np.linalg.pinv(scaled, rcond=1e-12, hermitian=True) / np.outer(size, size)
    values = covariance @ right
    return _Solved(values, covariance, chi2 - float(values @ right), count - used.size)


def _width_m(cut: Cut) -> float:
    return cut.width_m or UNIT_WIDTH_M


def share(recordings: Sequence[Seen]) -> Shared:
    """Find what recordings share.

    Parameters
    ----------
    recordings : sequence of Seen
        Two or more, with as many modes each.
    """
    inverse = [inverse_speed(each.cut) for each in recordings]
    known = [value for value in inverse if value is not None]
    speeds = len({round(value, 12) for value in known}) if len(known) == len(inverse) else 0
    plain = _solve(recordings, process=False)
    fullest = _solve(recordings, process=True) if speeds > 1 else plain
    gain = 0.5 * (plain.chi2 - fullest.chi2)
    p_value = float(stats.chi2.sf(2.0 * max(gain, 0.0), 1)) if speeds > 1 else 1.0
    best, process = plain, False
    if speeds > 1 and p_value < NAMED_P and fullest.values[-1] > 0.0:
        best, process = fullest, True
    modes = len(recordings[0].modes)
    delayed = recordings[0].values.size > 2 * modes
    disagreement = {}
    for family in FAMILIES[: 2 + delayed]:
        alone = _solve(recordings, process and family != "damping", {family})
        freedom = best.freedom - alone.freedom
        disagreement[family] = float(stats.chi2.sf(best.chi2 - alone.chi2, freedom)) if freedom > 0 else 1.0
    sd = np.sqrt(np.diag(best.covariance))
    found = []
    for i, mode in enumerate(recordings[0].modes):
        frequency = math.exp(best.values[2 * i])
        ratio = float(best.values[2 * i + 1]) / (4.0 * math.pi * frequency)
        found.append(Mode(frequency, min(max(ratio, 1e-5), 0.9), mode.participation))
    at = [2 * i + 1 for i in range(modes)]
    omegas = np.array([mode.omega for mode in found])
    widest = fullest if speeds > 1 else None
    return Shared(
        tuple(found),
        sd[[2 * i for i in range(modes)]],
        sd[at] / (2.0 * omegas),
        (float(widest.values[-1]), float(np.sqrt(widest.covariance[-1, -1]))) if widest is not None else None,
        (float(best.values[2 * modes]), float(sd[2 * modes])) if delayed else None,
        gain,
        p_value,
        disagreement,
        speeds > 2,
    )


def estimates(found: Shared) -> dict[str, Estimate]:
    """The shared parameters by name, with 95 % intervals."""
    named: dict[str, Estimate] = {}

    def add(name: str, value: float, sd: float, unit: str) -> None:
        named[name] = Estimate(value, (value - 1.96 * sd, value + 1.96 * sd), unit)

    for i, mode in enumerate(found.modes, 1):
        add(f"mode.{i}.frequency_hz", mode.frequency_hz, mode.frequency_hz * float(found.frequency_sd[i - 1]), "Hz")
        add(f"mode.{i}.damping_ratio", mode.damping_ratio, float(found.damping_sd[i - 1]), "1")
    if found.process_damping is not None:
        unit = next(p.unit for p in CATALOGUE[PROCESS_DAMPING].parameters if p.linear)
        add("process_damping.coefficient", *found.process_damping, unit)
    if found.regeneration is not None:
        add("regenerative_delay.coefficient", *found.regeneration, "1")
    return named
