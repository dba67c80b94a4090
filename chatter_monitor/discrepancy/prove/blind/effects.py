"""What can be hidden: every entry of the catalogue in every sense, what is outside it, faults, and nothing at all.

Shapes are drawn in units of the motion (its rms displacement and velocity), so that an effect is felt whatever the
amplitude. The answers are spelt as the report of `diagnose` spells them: that contract is public, code is not shared.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy.prove.blind import laws

Array = NDArray[np.float64]
Draw = Callable[[np.random.Generator], list[float]]
"""Shapes, each in the unit that `Effect.units` says."""
Parameters = Callable[[Array], dict[str, float]]
"""Parameters as a report names them, from amplitude and shapes."""


def _shapeless(_: np.random.Generator) -> list[float]:
    return []


@dataclass(frozen=True)
class Effect:
    """One thing that may be hidden.

    Attributes
    ----------
    kind : str
        Its name in the tables.
    verdict : str
        The right outcome.
    family : str
        "catalogue", "part" (acts in part of the time), "outside", "fault" (linear omission, excitation or sensor) or
        "linear" (nothing or parameters only).
    names : tuple of str
        Names that are right.
    sense : str, optional
        The right sense.
    law : int
        Hidden force, for what is one.
    sign : float
        Of its amplitude.
    shapes : callable
        Draws the shapes.
    units : str
        Unit of each shape: x, v (rms of the motion), a letter each; 1 for none.
    parameters : callable, optional
        The truth in the words of a report.
    most : float
        Largest strength that leaves the motion bounded.
    open_s : float, optional
        It acts for so long only, somewhere in the recording.
    above : (float, float), optional
        It acts above an amplitude only, drawn from that range, in rms displacements.
    """

    kind: str
    verdict: str
    family: str
    names: tuple[str, ...] = ()
    sense: str | None = None
    law: int = laws.NONE
    sign: float = 1.0
    shapes: Draw = _shapeless
    units: str = ""
    parameters: Parameters | None = None
    most: float = 0.10
    open_s: float | None = None
    above: tuple[float, float] | None = None


def _named(
    kind: str, name: str, law: int, parameters: Parameters | None, *, family: str = "catalogue", **rest: object
) -> Effect:
    return Effect(kind, "missing_physics", family, (name,), law=law, parameters=parameters, **rest)  # type: ignore[arg-type]


def _outside(kind: str, law: int, shapes: Draw, units: str) -> Effect:
    return Effect(kind, "unknown", "outside", law=law, shapes=shapes, units=units)


def _fault(name: str) -> Effect:
    return Effect(name, "missing_physics", "fault", (name,))


def _coefficient(p: Array) -> dict[str, float]:
    return {"coefficient": float(p[0])}


def _gap(p: Array) -> dict[str, float]:
    return {"coefficient": float(p[0]), "gap": float(p[1])}


def _cutting(p: Array) -> dict[str, float]:
    return {"square": float(p[0] * p[2] / p[1] ** 2), "cube": float(p[0] * p[3] / p[1] ** 3)}


def _delay_shapes(rng: np.random.Generator) -> list[float]:
    return [float(np.exp(rng.uniform(np.log(0.004), np.log(0.08))))]


CATALOGUE = (
    _named("cubic hardening", "cubic_stiffness", laws.CUBE, _coefficient, sense="hardening"),
    _named("cubic softening", "cubic_stiffness", laws.CUBE, _coefficient, sense="softening", sign=-1.0, most=0.05),
    _named("quadratic +", "quadratic_stiffness", laws.SQUARE, _coefficient, sense="positive"),
    _named("quadratic -", "quadratic_stiffness", laws.SQUARE, _coefficient, sense="negative", sign=-1.0),
    _named("clearance", "clearance", laws.GAP, _gap, shapes=lambda rng: [rng.uniform(0.6, 1.5)], units="x"),
    _named("coulomb", "coulomb_friction", laws.DRY, _coefficient),
    _named(
        "stribeck",
        "stribeck_friction",
        laws.STRIBECK,
        lambda p: {"coulomb": float(p[0]), "stiction": float(p[0] * p[1]), "stribeck_velocity": float(p[2])},
        shapes=lambda rng: [rng.uniform(0.6, 2.0), rng.uniform(0.2, 0.6)],
        units="1v",
    ),
    _named(
        "hysteresis",
        "hysteresis",
        laws.MICROSLIP,
        lambda p: {"coefficient": float(p[0]), "yield_displacement": float(p[1])},
        shapes=lambda rng: [rng.uniform(0.4, 1.2)],
        units="x",
    ),
    _named("v|v|", "quadratic_damping", laws.DRAG, _coefficient),
    _named("x²v growing", "energy_damping", laws.ENERGY, _coefficient, sense="positive"),
    _named("x²v falling", "energy_damping", laws.ENERGY, _coefficient, sense="negative", sign=-1.0, most=0.012),
    _named("regenerative delay", "regenerative_delay", laws.DELAY, _coefficient, shapes=_delay_shapes, units="1"),
    _named(
        "loss of contact",
        "loss_of_contact",
        laws.CONTACT,
        lambda p: {"coefficient": float(p[0]), "chip_thickness": float(p[2])},
        shapes=lambda rng: [*_delay_shapes(rng), rng.uniform(0.8, 2.0)],
        units="1x",
    ),
    _named(
        "cutting force v²",
        "cutting_force_nonlinearity",
        laws.CUTTING,
        _cutting,
        shapes=lambda rng: [1.0, rng.choice([-1.0, 1.0]), rng.uniform(-0.4, 0.0)],
        units="v11",
    ),
    _named(
        "cutting force -v³",
        "cutting_force_nonlinearity",
        laws.CUTTING,
        _cutting,
        shapes=lambda rng: [1.0, rng.uniform(-0.15, 0.15), -1.0],
        units="v11",
    ),
)

PART = (
    _named(
        "clearance for 4 s",
        "clearance",
        laws.GAP,
        _gap,
        family="part",
        shapes=lambda rng: [rng.uniform(0.5, 1.0)],
        units="x",
        open_s=4.0,
    ),
    _named(
        "coulomb above an amplitude",
        "coulomb_friction",
        laws.DRY,
        _coefficient,
        family="part",
        above=(1.3, 1.9),
    ),
)

OUTSIDE = (
    _outside(
        "stiffness notch",
        laws.NOTCH,
        lambda rng: [rng.choice([-1.0, 1.0]) * rng.uniform(0.0, 1.2), rng.uniform(0.25, 0.5)],
        "xx",
    ),
    _outside("damping √|v|", laws.ROOT, _shapeless, ""),
    _outside("inertia x v²", laws.INERTIA, _shapeless, ""),
    _outside("friction on one side", laws.ONE_SIDED, _shapeless, ""),
    _outside("parametric stiffness", laws.PARAMETRIC, lambda rng: [2.0 * np.pi * rng.uniform(7.0, 60.0)], "1"),
    _outside("stiffness with memory", laws.FADING, lambda rng: [rng.uniform(0.02, 0.3), 1.0], "1x"),
    _outside(
        "delay that follows the amplitude",
        laws.WANDERING_DELAY,
        lambda rng: [*_delay_shapes(rng), rng.uniform(0.8, 1.5)],
        "1x",
    ),
    _outside("damping in one direction", laws.RECTIFIED, _shapeless, ""),
)

FAULTS = (
    _named(
        "periodic forcing",
        "periodic_forcing",
        laws.TONE,
        None,
        family="fault",
        units="11",
    ),
    _named("parameter drift", "parameter_drift", laws.DRIFT, None, family="fault"),
    _fault("second_mode"),
    _fault("coloured_excitation"),
    _fault("impacts"),
    _fault("nonstationary_excitation"),
    _fault("clipping"),
    _fault("mains_hum"),
    _fault("offset_drift"),
)

NOTHING = Effect("nothing", "none", "linear")
LINEAR = (
    Effect("wrong frequency", "parameters", "linear"),
    Effect("wrong damping", "parameters", "linear"),
    Effect("wrong frequency and damping", "parameters", "linear"),
    Effect("process damping", "parameters", "linear"),  # viscous in one recording
)

# How often each stands in a deck: 100 cases hold every entry at least once.
DECK = NOTHING, *LINEAR, *CATALOGUE, *PART, *OUTSIDE, *FAULTS
COUNTS = (14, *(3,) * len(LINEAR), *(3,) * len(CATALOGUE), *(2,) * len(PART), *(2,) * len(OUTSIDE), *(1,) * len(FAULTS))
