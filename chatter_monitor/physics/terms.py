# ruff: noqa: ARG005 - every term has the same arguments, so that compiled code can call any of them
"""The catalogue of physics terms, each written once: what is simulated, filtered with, searched for and printed.

A term is a force per unit mass on the left-hand side of the equation of motion (positive values push back),

    x'' + 2 zeta w x' + w^2 x + sum_k f_k(x, x', x(t - tau), angle) = W(t)

where x is the displacement of the tool in any unit u, x(t - tau) the surface that the tooth before left (its
displacement, unless it was out of the cut), w the angular frequency of the first mode, tau the time from one
tooth to the next and the angle that of the spindle. Stiffness-like coefficients are relative to w^2, so that they can
be read without knowing the mode: a cubic coefficient of 0.05 / u^2 adds 5 % to the restoring force at x = 1 u.

To add a term, add an entry to `CATALOGUE`; nothing else has to change. The functions are compiled by Numba and are
ordinary Python as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

from chatter_monitor.kernels.forces import above_amplitude, compile_force, compile_lanes, compile_row

Force = Callable[[float, float, float, float, float, float, Sequence[float]], float]


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a term.

    Attributes
    ----------
    name, unit, meaning : str
        As in model files and reports; u stands for the unit of displacement.
    lower, upper : float
        What physics allows, the ends included.
    default : float, optional
        Used when a model file leaves it out; without it the parameter has to be given.
    linear : bool
        The force is proportional to the linear parameters taken together; the others are shapes.
    lower_excluded : bool
        The lower bound itself is not allowed.
    """

    name: str
    unit: str
    meaning: str
    lower: float = -math.inf
    upper: float = math.inf
    default: float | None = None
    linear: bool = False
    lower_excluded: bool = False

    def allows(self, value: float) -> bool:
        """Whether physics permits the value."""
        above = value > self.lower if self.lower_excluded else value >= self.lower
        return above and value <= self.upper

    @property
    def allowed(self) -> str:
        """The bounds as text."""
        if math.isinf(self.lower) and math.isinf(self.upper):
            return "any finite number"
        above = f"{'>' if self.lower_excluded else '>='} {self.lower:g}"
        return above if math.isinf(self.upper) else f"{above} and <= {self.upper:g}"


@dataclass(frozen=True)
class Term:
    """A force per unit mass with everything that is known about it.

    Attributes
    ----------
    name, equation, source : str
        Name in model files, the force as text, and where it comes from.
    parameters : tuple of Parameter
        In the order of `p`.
    force : callable
        ``force(x, v, lagged, angle, w, memory, p)``.
    memory_rate : callable, optional
        Rate of change of the internal state z, same arguments; None for terms without memory.
    delayed, periodic : bool
        Uses ``lagged`` or ``angle``, so the model needs a spindle speed. A parameter named "order" is taken for the
        highest multiple of the spindle frequency in the force.
    chip_thickness : str, optional
        Name of the parameter beyond which x - x(t - tau) means that the tool has left the cut, so that the surface
        stays as the tooth before left it.
    smooth : bool
        Has a slope at rest, so that it counts in the characteristic equation.
    limits_growth : bool
        Grows faster than the velocity, so that a negative damping ratio leads to a limit cycle.
    law : Term, optional
        Of a term that acts above an amplitude only: the same wherever the tool is.
    """

    name: str
    equation: str
    source: str
    parameters: tuple[Parameter, ...]
    force: Force
    memory_rate: Force | None = None
    delayed: bool = False
    periodic: bool = False
    chip_thickness: str | None = None
    smooth: bool = True
    limits_growth: bool = False
    law: Term | None = None

    @property
    def needs_spindle(self) -> bool:
        """Whether the term means nothing without a spindle speed."""
        return self.delayed or self.periodic

    @cached_property
    def above_amplitude(self) -> Term:
        """The same force, but only where the amplitude is at least one more parameter, `ABOVE`."""
        last = len(self.parameters)
        return replace(
            self,
            equation=f"{self.equation} where x^2 + (v / w)^2 >= {ABOVE.name}^2",
            parameters=(*self.parameters, ABOVE),
            force=above_amplitude(self.force, last),
            smooth=False,
            law=self,
        )

    @cached_property
    def compiled_force(self) -> Any:
        """The force as a C function, compiled at first use; kernels take its ``address``."""
        return compile_force(self.force)

    @cached_property
    def compiled_row(self) -> Any:
        """The force at many states as a C function, compiled at first use."""
        return compile_row(self.force)

    @cached_property
    def compiled_rate(self) -> Any:
        """The rate of the internal state as a C function; None for terms without memory."""
        return None if self.memory_rate is None else compile_force(self.memory_rate)

    @cached_property
    def compiled_lanes(self) -> Any:
        """The rate of many internal states beside each other as a C function; None for terms without memory."""
        return None if self.memory_rate is None else compile_lanes(self.memory_rate)


ABOVE = Parameter("above", "u", "amplitude from which on the force acts", lower=0.0)


def _positive(name: str, unit: str, meaning: str, default: float | None = None) -> Parameter:
    return Parameter(name, unit, meaning, lower=0.0, default=default, lower_excluded=True)


_CUTTING_SPEED = _positive("cutting_speed_m_s", "m/s", "cutting speed v_c")
_PROCESS_STIFFNESS = Parameter("coefficient", "1", "process stiffness over modal stiffness", lower=0.0, linear=True)

_ENTRIES = (
    Term(
        name="cubic_stiffness",
        equation="w^2 coefficient x^3",
        source="section 1.1.1, figs. 4-6, 14, 15: joints harden under normal load and soften under tangential load",
        parameters=(Parameter("coefficient", "1/u^2", "> 0 hardening, < 0 softening", linear=True),),
        force=lambda x, v, lagged, angle, w, memory, p: p[0] * w * w * x * x * x,
    ),
    Term(
        name="quadratic_stiffness",
        equation="w^2 coefficient x^2",
        source="section 1.1.1: preload, one-sided contact",
        parameters=(Parameter("coefficient", "1/u", "stiffer in the direction of its sign", linear=True),),
        force=lambda x, v, lagged, angle, w, memory, p: p[0] * w * w * x * x,
    ),
    Term(
        name="clearance",
        equation="w^2 coefficient (x - clip(x, -gap, gap))",
        source="section 1.1.1: clearance in kinematic couplings",
        parameters=(
            Parameter("coefficient", "1", "stiffness that engages beyond the gap, over w^2", lower=0.0, linear=True),
            _positive("gap", "u", "half of the clearance"),
        ),
        force=lambda x, v, lagged, angle, w, memory, p: p[0] * w * w * (x - min(max(x, -p[1]), p[1])),
    ),
    Term(
        name="coulomb_friction",
        equation="coefficient sgn(v), or coefficient tanh(v / width)",
        source="eq. (1)",
        parameters=(
            Parameter("coefficient", "u/s^2", "friction force per unit mass", lower=0.0, linear=True),
            Parameter("width", "u/s", "velocity over which the sign changes", lower=0.0, default=0.0),
        ),
        # math.tanh takes three times as long
        force=lambda x, v, lagged, angle, w, memory, p: (
            p[0]
            * (
                math.copysign(2.0 / (1.0 + math.exp(-2.0 * abs(v) / p[1])) - 1.0, v)
                if p[1] > 0.0
                else (math.copysign(1.0, v) if v != 0.0 else 0.0)
            )
        ),
        smooth=False,
    ),
    Term(
        name="stribeck_friction",
        equation="sgn(v) [coulomb + stiction exp(-(v / stribeck_velocity)^2)]",
        source="section 1.1.1, Stribeck effect",
        parameters=(
            Parameter("coulomb", "u/s^2", "friction at high velocity per unit mass", lower=0.0, linear=True),
            Parameter("stiction", "u/s^2", "what is added near zero velocity", lower=0.0, linear=True),
            _positive("stribeck_velocity", "u/s", "velocity over which the addition fades"),
        ),
        force=lambda x, v, lagged, angle, w, memory, p: (
            math.copysign(p[0] + p[1] * math.exp(-v * v / (p[2] * p[2])), v) if v != 0.0 else 0.0
        ),
        smooth=False,
    ),
    Term(
        name="hysteresis",
        equation="w^2 coefficient z, z' = v - [sharpness abs(v) z + (1 - sharpness) v abs(z)] / yield_displacement",
        source="section 1.1.1: microslip; Bouc-Wen with exponent 1",
        parameters=(
            Parameter("coefficient", "1", "stiffness of the sticking joint over w^2", lower=0.0, linear=True),
            _positive("yield_displacement", "u", "displacement at which the joint slips"),
            Parameter("sharpness", "1", "share of dissipation in the transition", lower=0.5, upper=1.0, default=0.5),
        ),
        force=lambda x, v, lagged, angle, w, memory, p: p[0] * w * w * memory,
        memory_rate=lambda x, v, lagged, angle, w, memory, p: (
            v - (p[2] * abs(v) * memory + (1.0 - p[2]) * v * abs(memory)) / p[1]
        ),
    ),
    Term(
        name="quadratic_damping",
        equation="coefficient v abs(v)",
        source="section 1.1.1: damping in joints and fluids",
        parameters=(Parameter("coefficient", "1/u", "damping per unit mass", lower=0.0, linear=True),),
        force=lambda x, v, lagged, angle, w, memory, p: p[0] * v * abs(v),
        limits_growth=True,
    ),
    Term(
        name="energy_damping",
        equation="coefficient x^2 v",
        source="eqs. (7), (12): damping that depends on the energy",
        parameters=(Parameter("coefficient", "1/(u^2 s)", "> 0 grows with the amplitude", linear=True),),
        force=lambda x, v, lagged, angle, w, memory, p: p[0] * x * x * v,
        limits_growth=True,
    ),
    Term(
        name="regenerative_delay",
        equation="w^2 coefficient [x - x(t - tau)], tau = 60 / (teeth speed_rpm)",
        source="eqs. (2), (3): K_1 times the variation of the uncut chip thickness",
        parameters=(_PROCESS_STIFFNESS,),
        force=lambda x, v, lagged, angle, w, memory, p: p[0] * w * w * (x - lagged),
        delayed=True,
    ),
    Term(
        name="loss_of_contact",
        equation="w^2 coefficient min(x - s(t - tau), chip_thickness), s = min(x, s(t - tau) + chip_thickness)",
        source="eq. (3) with no force once the chip thickness is zero, surface s of [11]; replaces regenerative_delay",
        parameters=(_PROCESS_STIFFNESS, _positive("chip_thickness", "u", "mean uncut chip thickness")),
        force=lambda x, v, lagged, angle, w, memory, p: p[0] * w * w * min(x - lagged, p[1]),
        delayed=True,
        chip_thickness="chip_thickness",
    ),
    Term(
        name="process_damping",
        equation="coefficient width_m / cutting_speed_m_s v",
        source="eq. (4)",
        parameters=(
            Parameter("coefficient", "1/s^2", "C over the modal mass, per metre of width", lower=0.0, linear=True),
            _positive("width_m", "m", "chip width b"),
            _CUTTING_SPEED,
        ),
        force=lambda x, v, lagged, angle, w, memory, p: p[0] * p[1] / p[2] * v,
    ),
    Term(
        name="cutting_force_nonlinearity",
        equation="square (v / cutting_speed_m_s)^2 - cube (v / cutting_speed_m_s)^3",
        source="eq. (3), the K_3 terms with a coefficient each",
        parameters=(
            Parameter("square", "u/s^2", "coefficient of the squared velocity", linear=True),
            Parameter("cube", "u/s^2", "coefficient of the cubed velocity", linear=True),
            _CUTTING_SPEED,
        ),
        force=lambda x, v, lagged, angle, w, memory, p: (v / p[2]) ** 2 * (p[0] - p[1] * v / p[2]),
    ),
    Term(
        name="periodic_forcing",
        equation="-coefficient cos(order angle + phase_rad)",
        source="section 5: tooth passing, run-out, unbalance",
        parameters=(
            Parameter("coefficient", "u/s^2", "amplitude of the driving force per unit mass", linear=True),
            _positive("order", "1", "multiple of the spindle frequency"),
            Parameter("phase_rad", "rad", "phase at spindle angle zero", default=0.0),
        ),
        force=lambda x, v, lagged, angle, w, memory, p: -p[0] * math.cos(p[1] * angle + p[2]),
        periodic=True,
    ),
)

CATALOGUE: Mapping[str, Term] = MappingProxyType({term.name: term for term in _ENTRIES})
