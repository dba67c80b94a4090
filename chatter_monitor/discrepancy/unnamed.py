"""What a force of no name explains beside a model: the test that decides between a name and `unknown`.

Three questions are asked of the errors that a fitted model leaves. Is there a smooth force of any shape: over
displacement and velocity, over one of them, a spring and a damper that change with the amplitude or with the energy of
the last moments? Does one follow the displacement of a while before? And is the law that was named quite that law, or
is its power another, or does it differ between the sides?
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy import basis
from chatter_monitor.discrepancy.candidates import NO_COMB, SHAPES
from chatter_monitor.discrepancy.case import Case
from chatter_monitor.discrepancy.delayed import Echo, find_echo
from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.innovations import Innovations
from chatter_monitor.discrepancy.name import within
from chatter_monitor.physics.parts import AppliedTerm

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

_SIZES = np.geomspace(0.1, 1e5, 19)  # of a smooth force, tried; over what the recording can tell apart
_LEAST = 0.05  # of a displacement or velocity whose logarithm is taken, over its rms
_BEYOND_SD = 1.645  # standard deviations by which a shape has to be out of range, one-sided 95 %
POWERS_AND_SIDES = {
    "displacement_power": "grows with the displacement by another power",
    "velocity_power": "grows with the velocity by another power",
    "displacement_side": "differs between the two sides of the displacement",
    "velocity_side": "differs between the two directions of the velocity",
}


@dataclass(frozen=True, slots=True)
class Unnamed:
    """What is left to explain beside a model.

    Attributes
    ----------
    smooth : dict of str to float
        Logarithm of the Bayes factor of a smooth force over none, nats, by what it depends on.
    variations : dict of (str, str) to float
        By named term and key of `POWERS_AND_SIDES`: gain of a law with that difference, nats.
    echo : Echo
        What of it follows the displacement of a while before.
    """

    smooth: dict[str, float]
    variations: dict[tuple[str, str], float]
    echo: Echo


class Rest:
    """The errors of a model beside all that may explain them.

    Parameters
    ----------
    case : Case
    inn : Innovations
        Of the model, about which everything is linear again.
    fitted : sequence of ndarray of float64, shape (n,)
        What a change of each parameter that was fitted adds to the errors.
    named : sequence of AppliedTerm
        What was named, with its fitted parameters.

    Attributes
    ----------
    evidence : Evidence
    """

    def __init__(
        self, case: Case, inn: Innovations, fitted: Sequence[Vector], named: Sequence[AppliedTerm] = ()
    ) -> None:
        motion = inn.motion
        sd_x, sd_v = basis.scales(motion)
        families = {
            "phase_plane": basis.surface(inn),
            "displacement": inn.respond(basis.along(motion.x / sd_x)),
            "velocity": inn.respond(basis.along(motion.v / sd_v)),
            "amplitude": basis.by_amplitude(inn),
            "memory": basis.by_memory(inn),
        }
        columns, self._groups = [*fitted], dict[str, list[int]]()
        for name, family in families.items():
            self._groups[name] = list(range(len(columns), len(columns) + len(family)))
            columns.extend(family)
        varied = [(applied.term.name, difference) for applied in named for difference in POWERS_AND_SIDES]
        self._varied = dict(zip(varied, range(len(columns), len(columns) + len(varied)), strict=True))
        columns.extend(signature for applied in named for signature in inn.respond(_varied(inn, applied)))
        self.evidence = Evidence(inn.white, columns, case.weight, range(len(fitted)), case.evidence.block)
        self._case, self._inn, self._fitted = case, inn, fitted

    def examined(self, usual: Sequence[Rest] = ()) -> Unnamed:
        """What of it forces of no name explain.

        Parameters
        ----------
        usual : sequence of Rest
            What the model leaves of simulations of itself, which is none of the machine's.
        """
        smooth = {
            name: smooth_nats(self.evidence, index, self._usual([(rest, rest._groups[name]) for rest in usual]))
            for name, index in self._groups.items()
        }
        variations = {
            key: gain_nats(self.evidence, column, self._usual([(rest, [rest._varied[key]]) for rest in usual]))
            for key, column in self._varied.items()
        }
        return Unnamed(smooth, variations, self._echo)

    def _usual(self, others: Sequence[tuple[Rest, Sequence[int]]]) -> Vector | float:
        """Products of errors and columns in other rests, what was fitted there taken out, for as many samples as here.

        The mean of the others; 0 if there are none. Their fits may have other nuisance columns than this one.
        """
        found = []
        for rest, columns in others:
            right, _, size = within(rest.evidence, columns)
            found.append(right * size * float(self.evidence.samples.sum() / rest.evidence.samples.sum()))
        return np.asarray(np.mean(found, axis=0)) if found else 0.0

    @cached_property
    def _echo(self) -> Echo:
        left = self._inn.white.copy()
        for coefficient, column in zip(self.evidence.regress([]).all_coefficients, self._fitted, strict=True):
            left -= coefficient * column
        return find_echo(self._inn, left, self._case.weight)


def smooth_nats(evidence: Evidence, columns: Sequence[int], usual: Vector | float = 0.0) -> float:
    """Logarithm of the Bayes factor of a force that is a sum of bumps over no force, nats.

    Beforehand the coefficients of all bumps are normal with one variance, the one that explains best. For a variance
    told in advance the Bayes factor of a force that is not there is 1 on average, so that chance exceeds n nats at most
    once in exp(n) recordings (Markov's inequality). Choosing the variance adds to that, but not its order of size.

    Parameters
    ----------
    evidence : Evidence
    columns : sequence of int
        Of the bumps; all in the same unit.
    usual : ndarray of float64, shape (c,)
        Products of errors and columns, the nuisance taken out, that are none of a force's.
    """
    right, normal, size = within(evidence, columns)
    right -= usual / size
    unit = size / np.sqrt(np.mean(size**2))
    values, vectors = np.linalg.eigh(normal * np.outer(unit, unit))
    values = np.maximum(values, 0.0)
    seen = (vectors.T @ (right * unit)) ** 2
    best = 0.0
    for variance in _SIZES / values[-1]:
        gained = 1.0 + variance * values
        best = max(best, 0.5 * float(np.sum(variance * seen / gained - np.log(gained))))
    return best


def gain_nats(evidence: Evidence, column: int, usual: Vector | float = 0.0) -> float:
    """Gain of one column beside the nuisance, nats; `usual` as of `smooth_nats`."""
    right, normal, size = within(evidence, [column])
    [explained] = right - usual / size
    return 0.5 * float(explained**2 / normal[0, 0])


def _varied(inn: Innovations, applied: AppliedTerm) -> list[Matrix]:
    """A named force times what would change its power or its symmetry, in the order of `POWERS_AND_SIDES`."""
    motion = inn.motion
    force = inn.force(applied.term, applied.values)
    powers = [np.log(np.maximum(np.abs(u) / np.std(u[0]), _LEAST)) for u in (motion.x, motion.v)]
    return [force * change for change in (*powers, np.sign(motion.x), np.sign(motion.v))]


def out_of_range(inn: Innovations, applied: AppliedTerm, parameters: dict[str, tuple[float, float]]) -> str | None:
    """A shape beyond the widest one of its term's candidates, which makes it another force; its name.

    Parameters
    ----------
    inn : Innovations
    applied : AppliedTerm
    parameters : dict of str to (float, float)
        Fitted parameters and their standard deviations.
    """
    sd_x, sd_v = basis.scales(inn.motion)
    scale = {"x": sd_x, "v": sd_v, "1": np.inf}  # others have bounds of their own
    for name, (value, sd) in parameters.items():
        relative, multiples = SHAPES.get((applied.term.name, name), ("1", (1.0,)))
        longest = max(multiples)
        if name == applied.term.chip_thickness and inn.linear.delay_s is None:
            longest = NO_COMB
        if value - _BEYOND_SD * sd > longest * scale[relative]:
            return name
    return None
