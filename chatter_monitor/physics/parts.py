"""The parts of a machining system: mode, excitation, spindle, sensor, applied term, drift, cut.

All are frozen and check themselves: a part that exists is one that can be simulated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from chatter_monitor.errors import InputError
from chatter_monitor.physics.terms import Term

Quantity = Literal["displacement", "velocity", "acceleration", "pressure"]
ExcitationKind = Literal["white_noise", "coloured", "impulsive", "modulated", "measured"]


@dataclass(frozen=True, slots=True)
class Mode:
    """One mode, mass-normalised.

    Attributes
    ----------
    frequency_hz, damping_ratio : float
        Undamped natural frequency and damping ratio of the structure alone.
    participation : float
        Share g of the mode in the motion of the tool, x = sum g_i q_i; it also scales the force on the mode.
    """

    frequency_hz: float
    damping_ratio: float
    participation: float = 1.0

    def __post_init__(self) -> None:
        _require("frequency_hz", self.frequency_hz, self.frequency_hz > 0.0, "> 0")
        _require("damping_ratio", self.damping_ratio, -1.0 < self.damping_ratio < 1.0, "> -1 and < 1")
        _require("participation", self.participation, self.participation != 0.0, "any number but 0")

    @property
    def omega(self) -> float:
        """Undamped natural frequency in rad/s."""
        return 2.0 * math.pi * self.frequency_hz


@dataclass(frozen=True, slots=True)
class Excitation:
    """The force that nobody measures, per unit mass.

    Attributes
    ----------
    kind : str
        "white_noise" is eqs. (5), (6); "coloured" the same through a second-order low-pass; "impulsive" has a share of
        its intensity in random impacts (same spectrum, heavy tails); "modulated" swells and fades; "measured" is given
        to the simulation as an array.
    intensity : float, optional
        S_0 in u^2/s^3. By default such that the first mode, alone and linear, moves by 1 u rms.
    corner_hz : float
        Of the low-pass, for "coloured".
    impacts_per_s, impact_share : float
        Rate of the impacts and their share of the intensity, for "impulsive".
    modulation_hz, modulation_depth : float
        Of the amplitude, for "modulated".
    """

    kind: ExcitationKind = "white_noise"
    intensity: float | None = None
    corner_hz: float = 1000.0
    impacts_per_s: float = 20.0
    impact_share: float = 0.5
    modulation_hz: float = 1.0
    modulation_depth: float = 0.5

    def __post_init__(self) -> None:
        if self.kind not in get_args(ExcitationKind):
            raise InputError("kind is not known", got=self.kind, allowed=", ".join(get_args(ExcitationKind)))
        if self.intensity is not None:
            _require("intensity", self.intensity, self.intensity >= 0.0, ">= 0")
        for key in ("corner_hz", "impacts_per_s", "modulation_hz"):
            _require(key, getattr(self, key), getattr(self, key) > 0.0, "> 0")
        for key in ("impact_share", "modulation_depth"):
            _require(key, getattr(self, key), 0.0 <= getattr(self, key) <= 1.0, "0 to 1")


@dataclass(frozen=True, slots=True)
class Spindle:
    """Speed and number of teeth; a turning tool has one."""

    speed_rpm: float
    teeth: int = 1

    def __post_init__(self) -> None:
        _require("speed_rpm", self.speed_rpm, self.speed_rpm > 0.0, "> 0")
        _require("teeth", self.teeth, self.teeth >= 1, "1 or more")

    @property
    def omega(self) -> float:
        """Angular speed in rad/s."""
        return 2.0 * math.pi * self.speed_rpm / 60.0

    @property
    def delay_s(self) -> float:
        """Time from one tooth to the next, tau = 60 / (N n)."""
        return 60.0 / (self.teeth * self.speed_rpm)


@dataclass(frozen=True, slots=True)
class Sensor:
    """What the sensor makes of the motion.

    Attributes
    ----------
    quantity : str
        "pressure" is that of a small radiating surface, proportional to its acceleration, above `low_cut_hz`.
    gain : float
        Output per u, u/s or u/s^2.
    low_cut_hz : float
        First-order high-pass of the microphone, for "pressure".
    noise_rms, hum_amplitude, hum_hz, offset, drift_per_s : float
        What is added, in units of the output: white noise, mains hum, a constant and a slope.
    clip_level : float, optional
        Largest magnitude that comes out.
    """

    quantity: Quantity = "displacement"
    gain: float = 1.0
    low_cut_hz: float = 20.0
    noise_rms: float = 0.0
    hum_amplitude: float = 0.0
    hum_hz: float = 50.0
    offset: float = 0.0
    drift_per_s: float = 0.0
    clip_level: float | None = None

    def __post_init__(self) -> None:
        if self.quantity not in get_args(Quantity):
            raise InputError("quantity is not known", got=self.quantity, allowed=", ".join(get_args(Quantity)))
        _require("noise_rms", self.noise_rms, self.noise_rms >= 0.0, ">= 0")
        for key in ("low_cut_hz", "hum_hz"):
            _require(key, getattr(self, key), getattr(self, key) > 0.0, "> 0")
        if self.clip_level is not None:
            _require("clip_level", self.clip_level, self.clip_level > 0.0, "> 0")


@dataclass(frozen=True)
class AppliedTerm:
    """A term of the catalogue with numbers; the parameters left out get their defaults."""

    term: Term
    parameters: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        known = {parameter.name: parameter for parameter in self.term.parameters}
        for name in self.parameters:
            if name not in known:
                raise InputError(f"{self.term.name} has no parameter {name}", allowed=", ".join(known))
        for parameter in self.term.parameters:
            value = self.parameters.get(parameter.name, parameter.default)
            if value is None:
                raise InputError(
                    f"{self.term.name} lacks its parameter {parameter.name}",
                    allowed=parameter.allowed,
                    remedy=f"Add {parameter.name} = ... ({parameter.meaning}, in {parameter.unit}).",
                )
            _require(f"{parameter.name} of {self.term.name}", value, parameter.allows(value), parameter.allowed)

    @property
    def values(self) -> tuple[float, ...]:
        """Values in the order of the term's parameters."""
        return tuple(float(self.parameters.get(p.name, p.default or 0.0)) for p in self.term.parameters)

    @property
    def units(self) -> dict[str, tuple[float, ...]]:
        """Values with each coefficient 1 in turn and the others 0, shapes as they are; by the coefficient's name."""
        both = list(zip(self.term.parameters, self.values, strict=True))
        return {
            unit.name: tuple(float(p is unit) if p.linear else value for p, value in both)
            for unit in self.term.parameters
            if unit.linear
        }


@dataclass(frozen=True, slots=True)
class Drift:
    """A parameter that changes along the cut: linear between the given times, constant outside.

    Attributes
    ----------
    parameter : str
        "mode.1.frequency_hz", "mode.1.damping_ratio", "mode.1.participation", "spindle.speed_rpm",
        "excitation.intensity" or "term.1.NAME"; modes and terms are counted from 1 in the order of the file.
    time_s, value : tuple of float
        Where the parameter stands when.
    """

    parameter: str
    time_s: tuple[float, ...]
    value: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.time_s) != len(self.value) or len(self.time_s) < 2:
            raise InputError(
                f"drift of {self.parameter} needs as many values as times, two at least",
                got=f"{len(self.time_s)} times, {len(self.value)} values",
            )
        if any(late <= early for early, late in zip(self.time_s, self.time_s[1:], strict=False)):
            raise InputError(f"time_s of the drift of {self.parameter} has to increase", got=list(self.time_s))


@dataclass(frozen=True, slots=True)
class Cut:
    """What is different in one recording of a machine; everything else is shared by all of them.

    Attributes
    ----------
    recording : str
        Name of the file, without directories.
    speed_rpm : float
        Spindle speed.
    cutting_speed_m_s, width_m : float, optional
        Cutting speed v_c and chip width b of eq. (4); without them those of the term count.
    """

    recording: str
    speed_rpm: float
    cutting_speed_m_s: float | None = None
    width_m: float | None = None

    def __post_init__(self) -> None:
        if not self.recording:
            raise InputError("a cut needs the name of its recording", got=self.recording)
        _require("speed_rpm", self.speed_rpm, self.speed_rpm > 0.0, "> 0")
        for key in ("cutting_speed_m_s", "width_m"):
            value = getattr(self, key)
            if value is not None:
                _require(key, value, value > 0.0, "> 0")


def _require(name: str, value: float, fulfilled: bool, allowed: str) -> None:
    if not (math.isfinite(value) and fulfilled):
        raise InputError(f"{name} is out of range", got=value, allowed=allowed)
