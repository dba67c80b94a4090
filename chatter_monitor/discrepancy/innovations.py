"""Whitened prediction errors of a model on a recording, and whitened signatures of forces in them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.observer import Linear, observer, sized
from chatter_monitor.discrepancy.side_by_side import each
from chatter_monitor.discrepancy.whitening import ORDER, trusted, whitened, whitener
from chatter_monitor.kernels.forces import MOST_PARAMETERS
from chatter_monitor.kernels.forces_along import Tried, forces_along
from chatter_monitor.kernels.observer import SMOOTH, SUBSTEPS, Forces, Motion, cut_by_the_tooth_before, observe
from chatter_monitor.kernels.signatures import LANES, response_of, signatures, unseen_of
from chatter_monitor.physics.parts import AppliedTerm
from chatter_monitor.physics.terms import ABOVE, Term

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
_SIDE_BY_SIDE = 8  # terms: few enough for a share to each core
_MEMORY_DECAYS = 5.0  # samples before a used one that have to be there, in decay times of the filter


def known_forces(terms: Sequence[AppliedTerm], between: Sequence[tuple[float, float]] = ()) -> Forces:
    """Terms as the kernels take them.

    Parameters
    ----------
    terms : sequence of AppliedTerm
    between : sequence of (float, float)
        Samples between which each acts; always where nothing is said.
    """
    laws = [applied.term.law or applied.term for applied in terms]
    columns = [0, *accumulate(len(applied.values) for applied in terms)]
    return Forces(
        np.array([applied.term.compiled_force.address for applied in terms], dtype=np.int64),
        np.array([rate_of(applied.term) for applied in terms], dtype=np.int64),
        np.array([substeps_of(applied.term) for applied in terms], dtype=np.int64),
        np.array(columns[:-1], dtype=np.int64),
        np.array([value for applied in terms for value in applied.values] or [0.0]),
        np.array([law.compiled_force.address for law in laws], dtype=np.int64),
        np.array([applied.parameters.get(ABOVE.name, 0.0) for applied in terms]),
        np.array([*between] or [(-math.inf, math.inf)] * len(terms)).reshape(len(terms), 2),
    )


def tried_forces(terms: Sequence[tuple[Term, Sequence[float]]]) -> Tried:
    """Terms and their parameters as the kernels take them that evaluate forces along rows."""
    parameters = np.zeros((len(terms), MOST_PARAMETERS))
    for row, (_, values) in zip(parameters, terms, strict=True):
        row[: len(values)] = values
    return Tried(
        np.array([term.compiled_row.address for term, _ in terms], dtype=np.int64),
        np.array([rate_of(term) for term, _ in terms], dtype=np.int64),
        np.array([term.compiled_lanes.address if term.memory_rate else 0 for term, _ in terms], dtype=np.int64),
        np.array([substeps_of(term) for term, _ in terms], dtype=np.int64),
        parameters,
    )


def rate_of(term: Term) -> int:
    """Address of the rate of a term's memory, 0 for none."""
    rate = term.compiled_rate
    return rate.address if rate else 0


def substeps_of(term: Term) -> int:
    """Into how many parts the kernels cut a step for a term."""
    return SMOOTH if term.smooth else SUBSTEPS


def chip_of(term: Term, values: Sequence[float]) -> float:
    """Chip thickness beyond which a term takes the tool for out of the cut; infinite for those that do not ask."""
    return next((v for p, v in zip(term.parameters, values, strict=True) if p.name == term.chip_thickness), math.inf)


class Diverged(ArithmeticError):
    """A model whose prediction runs away from the recording."""


class Innovations:
    """Prediction errors of a model, whitened.

    Parameters
    ----------
    recorded : Recorded
        Within its band.
    linear : Linear
        The linear part of the model.
    terms : sequence of AppliedTerm
        Its forces.
    taps : ndarray of float64, optional
        Whitener to use; fitted if not given.
    error_sd : float, optional
        About the standard deviation of the errors. What the filter does not know of the motion, over which it averages
        the forces, is of that size; if it is not given, a first run tells it.
    between_s : sequence of (float, float), optional
        When each of the terms acts; always if not given.

    Attributes
    ----------
    error_sd : float
        Standard deviation of the errors.
    errors, white : ndarray of float64, shape (n,)
        Prediction errors, before and after whitening.
    settled : ndarray of bool, shape (n,)
        Samples at which the filter has forgotten where it began.
    used : ndarray of bool, shape (n,)
        Samples whose prediction rests on such samples.
    motion : Motion
        Of the tool.
    """

    def __init__(
        self,
        recorded: Recorded,
        linear: Linear,
        terms: Sequence[AppliedTerm] = (),
        taps: Vector | None = None,
        error_sd: float | None = None,
        between_s: Sequence[tuple[float, float]] = (),
    ) -> None:
        self.recorded, self.linear, self.terms = recorded, linear, tuple(terms)
        n = recorded.samples.size
        steady = observer(linear, recorded.rate_hz, bool(self.terms))._replace(
            chip=min((chip_of(applied.term, applied.values) for applied in self.terms), default=math.inf)
        )
        self.observer = steady if error_sd is None else sized(steady, error_sd)
        self.errors = np.empty(n)
        self.motion = Motion(*(np.zeros((2, n)) for _ in range(3)))
        memory = self.memory()
        self.settled = trusted(recorded.missing, memory)
        self.used = trusted(recorded.missing, ORDER + 2 * memory)
        known = known_forces(self.terms, [(a * recorded.rate_hz, b * recorded.rate_hz) for a, b in between_s])
        for _ in range(2 if self.terms and error_sd is None else 1):
            observe(self.observer, known, recorded.samples, recorded.missing, self.settled, self.errors, self.motion)
            self.error_sd = float(np.std(self.errors[self.used]))
            if not math.isfinite(self.error_sd):
                raise Diverged("the prediction errors grow without bound")
            self.observer = sized(steady, self.error_sd)
        self.taps = whitener(self.errors, self.used) if taps is None else taps
        self.white = whitened(self.errors, self.taps)

    def memory(self) -> int:
        """Samples after which the filter has forgotten an error."""
        o = self.observer
        closed = o.transition @ (np.eye(o.gain.size) - np.outer(o.gain, o.output))
        slowest = min(float(np.max(np.abs(np.linalg.eigvals(closed)))), 0.9999)
        return min(math.ceil(_MEMORY_DECAYS / max(1e-3, -math.log(slowest))), self.recorded.samples.size // 20)

    def force(self, term: Term, values: Sequence[float]) -> Matrix:
        """Force of one term along the motion, shape (2, n)."""
        return np.asarray(self.forces([(term, values)])[0])

    def forces(self, terms: Sequence[tuple[Term, Sequence[float]]]) -> Matrix:
        """Forces of terms along the motion, shape (len(terms), 2, n); see `kernels.forces_along`."""
        out = np.empty((len(terms), 2, self.errors.size))

        def some(part: slice) -> None:
            motion = self._where_cut(*terms[part.start])
            forces_along(self.observer, motion, self.settled, tried_forces(terms[part]), out[part])

        leaving = [chip_of(*tried) < math.inf for tried in terms]  # each over a surface of its own
        shares: list[slice] = []
        for i, leaves in enumerate(leaving):
            if shares and not leaves and not leaving[i - 1] and i - shares[-1].start < _SIDE_BY_SIDE:
                shares[-1] = slice(shares[-1].start, i + 1)
            else:
                shares.append(slice(i, i + 1))
        each(some, shares)
        return out

    def _where_cut(self, term: Term, values: Sequence[float]) -> Motion:
        """The motion, with the surface that the tooth before leaves if the tool leaves the cut by that term."""
        chip = chip_of(term, values)
        if chip == self.observer.chip or chip == math.inf:
            return self.motion
        lagged = np.empty_like(self.motion.lagged)
        cut_by_the_tooth_before(self.observer, chip, self.motion, lagged)
        return self.motion._replace(lagged=lagged)

    def respond(
        self, left: Sequence[Matrix] | Matrix, right: Sequence[Matrix | NDArray[np.bool_]] | Matrix | None = None
    ) -> Matrix:
        """Whitened signatures of forces, as functions of the state of `motion`, or from `forces`.

        Parameters
        ----------
        left : a times ndarray of float64, shape (2, n)
        right : b times ndarray of float64, shape (2, n), optional
            Each force is the product of two factors, one of these and one of those; 1 if not given.

        Returns
        -------
        ndarray of float64, shape (a b, n)
            Those of one left factor beside each other.
        """
        n = self.errors.size
        one, other = (
            np.asarray(factor, dtype=np.float64) for factor in (left, [np.ones((2, n))] if right is None else right)
        )
        found = np.empty((len(one) * len(other), n))
        how = response_of(self.observer, self.taps), unseen_of(self.observer, self.taps)

        def some(first: int) -> None:
            signatures(*how, one, other, first, self.recorded.missing, found[first : first + LANES])

        each(some, range(0, len(found), LANES))
        return found

    def impulse_answers(self, length: int) -> Matrix:
        """Whitened signatures of a force of 1 at a single sample, once it is known and as it was predicted.

        Shape (2, length), from that sample on.
        """
        forces = np.zeros((2, 2, length + 2))
        forces[0, 0, 2] = forces[1, 1, 1] = 1.0
        found = np.empty((2, length + 2))
        how = response_of(self.observer, self.taps), unseen_of(self.observer, self.taps)
        signatures(*how, forces, np.ones((1, 2, length + 2)), 0, np.zeros(length + 2, dtype=bool), found)
        return found[:, 2:]

    def of_terms(self, terms: Sequence[tuple[Term, Sequence[float]]]) -> Matrix:
        """Whitened signatures of terms with their parameters, shape (len(terms), n)."""
        return self.respond(self.forces(terms))
