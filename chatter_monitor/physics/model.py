"""A machining system: modes, excitation, spindle, terms of the catalogue, sensor, and what drifts along the cut."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.errors import InputError
from chatter_monitor.kernels.oscillator import PER_MODE, PER_SPINDLE, Oscillator, oscillator
from chatter_monitor.physics.parts import AppliedTerm, Cut, Drift, Excitation, Mode, Sensor, Spindle


@dataclass(frozen=True)
class MachiningSystem:
    """Everything that is simulated, filtered with and printed; see the module `terms` for the equation of motion."""

    modes: tuple[Mode, ...]
    terms: tuple[AppliedTerm, ...] = ()
    excitation: Excitation = field(default_factory=Excitation)
    spindle: Spindle | None = None
    sensor: Sensor = field(default_factory=Sensor)
    drifts: tuple[Drift, ...] = ()
    cuts: tuple[Cut, ...] = ()

    def __post_init__(self) -> None:
        if not self.modes:
            raise InputError("a machining system needs at least one mode", remedy="Add a [[mode]].")
        limited = any(applied.term.limits_growth for applied in self.terms)
        for number, mode in enumerate(self.modes, 1):
            if mode.damping_ratio < 0.0 and not limited:
                raise InputError(
                    f"damping_ratio of mode {number} is negative and nothing limits the growth",
                    got=mode.damping_ratio,
                    allowed=">= 0 and < 1",
                    remedy="Negative damping needs energy_damping or quadratic_damping beside it.",
                )
        for applied in self.terms:
            if applied.term.needs_spindle and self.spindle is None:
                raise InputError(
                    f"{applied.term.name} needs the spindle speed, and there is no [spindle]",
                    remedy="Add [spindle] with speed_rpm and teeth.",
                )
        names = [cut.recording for cut in self.cuts]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError("two cuts have the same recording", got=", ".join(twice))
        for key in ("cutting_speed_m_s", "width_m"):
            if len({getattr(cut, key) is None for cut in self.cuts}) > 1:
                raise InputError(f"{key} is given for some cuts only", remedy="Give it for all of them, or for none.")
        slots = self._slots()
        for drift in self.drifts:
            if drift.parameter not in slots and drift.parameter != "excitation.intensity":
                raise InputError(
                    "unknown parameter of a drift",
                    got=drift.parameter,
                    allowed=", ".join([*slots, "excitation.intensity"]),
                )
        for time_s in sorted({time_s for drift in self.drifts for time_s in drift.time_s}):
            self.at(time_s)

    @property
    def intensity(self) -> float:
        """S_0 in u^2/s^3; by default S_0 = 2 zeta w^3 / pi, for which the first mode alone moves by 1 u rms."""
        if self.excitation.intensity is not None:
            return self.excitation.intensity
        return 2.0 * abs(self.modes[0].damping_ratio) * self.modes[0].omega ** 3 / math.pi

    def in_cut(self, recording: str) -> MachiningSystem:
        """Return the machine as it was in one recording: spindle speed, and geometry of the terms that have it.

        Raises
        ------
        InputError
            If there are cuts, and none of that recording.
        """
        if not self.cuts:
            return self
        known = {cut.recording: cut for cut in self.cuts}
        if recording not in known:
            raise InputError(
                "the model file says nothing about this recording",
                got=recording,
                allowed=", ".join(known),
                remedy="Add a [[cut]] with its name and speed_rpm.",
            )
        cut = known[recording]
        geometry = {
            key: value
            for key, value in (("cutting_speed_m_s", cut.cutting_speed_m_s), ("width_m", cut.width_m))
            if value is not None
        }
        terms = tuple(
            AppliedTerm(
                applied.term,
                {
                    **applied.parameters,
                    **{p.name: geometry[p.name] for p in applied.term.parameters if p.name in geometry},
                },
            )
            for applied in self.terms
        )
        teeth = self.spindle.teeth if self.spindle else 1
        return replace(self, terms=terms, spindle=Spindle(cut.speed_rpm, teeth), cuts=())

    @property
    def delayed(self) -> bool:
        """Whether any term looks back by one tooth passing."""
        return any(applied.term.delayed for applied in self.terms)

    def drifting(self, parameter: str, time_s: NDArray[np.float64], otherwise: float) -> NDArray[np.float64]:
        """Values of a parameter at the given times; `otherwise` everywhere when it does not drift."""
        for drift in self.drifts:
            if drift.parameter == parameter:
                return np.interp(time_s, drift.time_s, drift.value)
        return np.full(time_s.shape, otherwise)

    def chip_thickness(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Largest x - x(t - tau) with the tool in the cut; the largest number for models without loss of contact."""
        least = np.full(time_s.shape, np.finfo(np.float64).max)
        for k, applied in enumerate(self.terms, 1):
            name = applied.term.chip_thickness
            if name is not None:
                thickness = self.drifting(f"term.{k}.{name}", time_s, applied.parameters[name])
                least = np.minimum(least, thickness)
        return least

    def at(self, time_s: float) -> MachiningSystem:
        """Return the same system with its parameters frozen as they are at one time."""
        if not self.drifts:
            return self
        when = np.array([time_s])

        def now(parameter: str, otherwise: float) -> float:
            return float(self.drifting(parameter, when, otherwise)[0])

        modes = tuple(
            Mode(
                now(f"mode.{i}.frequency_hz", mode.frequency_hz),
                now(f"mode.{i}.damping_ratio", mode.damping_ratio),
                now(f"mode.{i}.participation", mode.participation),
            )
            for i, mode in enumerate(self.modes, 1)
        )
        terms = tuple(
            AppliedTerm(
                applied.term,
                {
                    p.name: now(f"term.{i}.{p.name}", value)
                    for p, value in zip(applied.term.parameters, applied.values, strict=True)
                },
            )
            for i, applied in enumerate(self.terms, 1)
        )
        spindle = self.spindle and Spindle(now("spindle.speed_rpm", self.spindle.speed_rpm), self.spindle.teeth)
        excitation = replace(self.excitation, intensity=now("excitation.intensity", self.intensity))
        return MachiningSystem(modes, terms, excitation, spindle, self.sensor)

    def oscillator(self, zero_s: float = 0.0) -> Oscillator:
        """Hand the equations to the kernels: addresses of the compiled terms and the table of their parameters.

        Parameters
        ----------
        zero_s : float
            How long after the first step the times of the drifts begin to count.
        """
        slots, columns = self._slots(), self._term_columns()
        knots = np.array(sorted({time_s for drift in self.drifts for time_s in drift.time_s} or {0.0})) + zero_s
        table = np.zeros((knots.size, columns[-1]))
        for parameter, (column, scale, value) in slots.items():
            table[:, column] = scale * self.drifting(parameter, knots - zero_s, value)
        table[:, columns[0] - 1] = self.chip_thickness(knots - zero_s)
        forces = np.array([applied.term.compiled_force.address for applied in self.terms], dtype=np.int64)
        rates = np.array(
            [rate.address if (rate := applied.term.compiled_rate) else 0 for applied in self.terms], dtype=np.int64
        )
        teeth = self.spindle.teeth if self.spindle else 1
        return oscillator(knots, table, len(self.modes), teeth, forces, np.array(columns[:-1], dtype=np.int64), rates)

    def _slots(self) -> dict[str, tuple[int, float, float]]:
        """Column of every parameter in the kernels' table, the factor to their units, and its value."""
        slots: dict[str, tuple[int, float, float]] = {}
        for i, mode in enumerate(self.modes):
            slots[f"mode.{i + 1}.frequency_hz"] = (PER_MODE * i, 2.0 * math.pi, mode.frequency_hz)
            slots[f"mode.{i + 1}.damping_ratio"] = (PER_MODE * i + 1, 1.0, mode.damping_ratio)
            slots[f"mode.{i + 1}.participation"] = (PER_MODE * i + 2, 1.0, mode.participation)
        if self.spindle:
            slots["spindle.speed_rpm"] = (PER_MODE * len(self.modes), 2.0 * math.pi / 60.0, self.spindle.speed_rpm)
        for k, (column, applied) in enumerate(zip(self._term_columns(), self.terms, strict=False)):
            for j, (parameter, value) in enumerate(zip(applied.term.parameters, applied.values, strict=True)):
                slots[f"term.{k + 1}.{parameter.name}"] = (column + j, 1.0, value)
        return slots

    def _term_columns(self) -> list[int]:
        """Column of the first parameter of each term in the kernels' table, and the width of the table."""
        start = PER_MODE * len(self.modes) + PER_SPINDLE
        return list(accumulate((len(applied.term.parameters) for applied in self.terms), initial=start))
