"""Candidates for what a base model lacks: terms of the catalogue with their shapes on a grid.

A candidate is a term with its shape parameters fixed; its force is then linear in one or two coefficients, each with
the bounds that physics puts on it. Shapes are relative to the rms displacement and velocity of the tool.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

from chatter_monitor.physics.parts import Spindle
from chatter_monitor.physics.terms import CATALOGUE, Term

# Shape parameters that are searched: which rms they scale with, and multiples of it.
SHAPES: dict[tuple[str, str], tuple[str, tuple[float, ...]]] = {
    ("clearance", "gap"): ("x", (0.15, 0.3, 0.5, 0.75, 1.0, 1.3, 1.6, 2.0, 2.5)),
    ("coulomb_friction", "width"): ("v", (0.0, 0.1, 0.3)),
    ("stribeck_friction", "stribeck_velocity"): ("v", (0.1, 0.2, 0.35, 0.5, 0.75, 1.1)),
    ("hysteresis", "yield_displacement"): ("x", (0.1, 0.2, 0.4, 0.7, 1.0, 1.5, 2.5)),
    ("hysteresis", "sharpness"): ("1", (0.5, 0.9)),
    ("loss_of_contact", "chip_thickness"): ("x", (0.3, 0.6, 1.0, 1.5, 2.2, 3.0)),
    ("cutting_force_nonlinearity", "cutting_speed_m_s"): ("1", (1.0,)),
}
NO_COMB = 1.0  # rms displacements: a tool that leaves the cut at less makes no comb in the spectrum
# What one recording cannot tell from viscous damping, and what the spectrum tells: lines, and the comb of a delay.
ELSEWHERE = ("process_damping", "periodic_forcing", "regenerative_delay")
# x, v, lagged, memory over their rms, as far out as the widest shapes above
_PROBES = tuple((1.3 * s, 0.3 * s * s - 0.8, -0.4 * s, 0.4 * s) for s in (-3.1, -1.3, -0.4, 0.2, 0.9, 2.3))


@dataclass(frozen=True, slots=True)
class Candidate:
    """A term with its shape fixed.

    Attributes
    ----------
    term : Term
    values : tuple of float
        All parameters in the order of the term; the linear ones are 0.
    linear : tuple of int
        Indices of the coefficients.
    shapes : int
        How many shape parameters were searched; one that is at 0 is none. Where the tool leaves the cut, the
        coefficient is that of the regeneration which the machine has already, so one parameter less.
    """

    term: Term
    values: tuple[float, ...]
    linear: tuple[int, ...]
    shapes: int

    @property
    def name(self) -> str:
        """Of the term."""
        return self.term.name

    @property
    def lower(self) -> tuple[float, ...]:
        """Lower bounds of the coefficients."""
        return tuple(self.term.parameters[i].lower for i in self.linear)

    def unit(self, i: int) -> tuple[float, ...]:
        """Parameters with coefficient `i` 1 and the others 0."""
        return tuple(1.0 if j == i else value for j, value in enumerate(self.values))

    def acts(self, i: int, size: tuple[float, float]) -> tuple[float, ...]:
        """What that unit does at a few states: equal for equal forces, whatever they are called.

        Parameters
        ----------
        i : int
            The unit.
        size : (float, float)
            rms displacement and velocity; forces that differ only where the motion does not come count as equal.
        """
        sd_x, sd_v = size
        unit = self.unit(i)
        laws = [self.term.force, *([self.term.memory_rate] if self.term.memory_rate else [])]
        states = [(x * sd_x, v * sd_v, lagged * sd_x, 0.5, sd_v / sd_x, z * sd_x) for x, v, lagged, z in _PROBES]
        return tuple(law(*state, unit) for law in laws for state in states)

    def with_coefficients(self, coefficients: Sequence[float]) -> dict[str, float]:
        """Parameters by name."""
        values = list(self.values)
        for i, coefficient in zip(self.linear, coefficients, strict=True):
            values[i] = float(coefficient)
        return {p.name: value for p, value in zip(self.term.parameters, values, strict=True)}


def candidates(
    sd_x: float,
    sd_v: float,
    spindle: Spindle | None,
    present: Sequence[str] = (),
    regenerates: bool = False,
    shapes: Mapping[tuple[str, str], tuple[str, tuple[float, ...]]] = SHAPES,
) -> list[Candidate]:
    """All candidates for a motion of that size.

    Parameters
    ----------
    sd_x, sd_v : float
        rms displacement and velocity.
    spindle : Spindle, optional
        Delayed terms are candidates only with one.
    present : sequence of str
        Terms that the model has already.
    regenerates : bool
        The machine is known to have a delay. A tool that leaves the cut early has one that the spectrum does not show.
    shapes : mapping
        Grid of the shape parameters.
    """
    scale = {"x": sd_x, "v": sd_v, "1": 1.0}
    found = []
    for term in CATALOGUE.values():
        leaves = regenerates and term.chip_thickness is not None
        if term.name in (*ELSEWHERE, *present) or (term.delayed and spindle is None):
            continue
        linear = tuple(i for i, p in enumerate(term.parameters) if p.linear)
        shaped = [i for i in range(len(term.parameters)) if i not in linear]
        grids = []
        for i in shaped:
            relative, multiples = shapes[term.name, term.parameters[i].name]
            if term.chip_thickness and not regenerates:
                multiples = tuple(m for m in multiples if m <= NO_COMB)
            grids.append([scale[relative] * m for m in multiples])
        for point in product(*grids):
            searched = sum(len(grid) > 1 and value != 0.0 for grid, value in zip(grids, point, strict=True)) - leaves
            values = [0.0] * len(term.parameters)
            for i, value in zip(shaped, point, strict=True):
                values[i] = value
            found.append(Candidate(term, tuple(values), linear, searched))
    return found
