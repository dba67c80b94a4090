"""Whitened prediction errors of a running signal, and whitened signatures of forces in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy.candidates import Candidate
from chatter_monitor.discrepancy.innovations import Innovations, known_forces, tried_forces
from chatter_monitor.discrepancy.live.decimate import CHUNK
from chatter_monitor.discrepancy.whitening import whitener
from chatter_monitor.kernels import live_signatures as kernel
from chatter_monitor.kernels.binding import bound
from chatter_monitor.kernels.forces_along import Tried
from chatter_monitor.kernels.observer import SUBSTEPS, Forces, Motion, Observer
from chatter_monitor.kernels.signatures import LANES, Response, response_of

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

ORDER = 12  # of the whitening filter
_SETTLING = 4  # memories of the filter after which its errors and their signatures are used


class Stream:
    """A calibrated observer and the forces that it is watched for.

    Parameters
    ----------
    base : Innovations
        Of the calibrated model on some of the signal: its observer, its forces, its whitening filter.
    tried : sequence of (Candidate, int)
        Forces to watch for: the unit of one coefficient each.

    Attributes
    ----------
    linear : int
        Columns after the errors that stand for displacement and velocity, and with a delay for those before it.
    """

    def __init__(self, base: Innovations, tried: Sequence[tuple[Candidate, int]]) -> None:
        self._observer = base.observer
        self._known = known_forces(base.terms)
        self._tried = tried_forces([(candidate.term, candidate.unit(i)) for candidate, i in tried])
        self._response = response_of(base.observer, whitener(base.errors, base.used, ORDER))
        self.linear = 4 if any(applied.term.delayed for applied in base.terms) else 2
        self._used = 1 + self.linear + len(tried)
        self._lanes = -(-self._used // LANES) * LANES
        self._along = scratch()
        self.settling = _SETTLING * base.memory() + ORDER
        self.restart()
        nothing = np.zeros(CHUNK), np.zeros(CHUNK, dtype=bool)
        self._watch = bound(kernel.watch, *self._arguments(0, *nothing, self.rows(CHUNK)))

    def restart(self) -> None:
        """Forget everything: what comes next does not follow on what came last."""
        self._path = at_rest(self._observer, self._known, self._tried)
        self._answers = no_answers(self._response, self._lanes)
        self._since = 0

    def rows(self, samples: int) -> Matrix:
        """Room for what comes of so many samples."""
        return np.zeros((samples, self._lanes))

    def columns(self, rows: Matrix) -> Matrix:
        """Errors, and signatures of what is linear and what is tried, shape (samples, 1 + linear + c)."""
        return rows[:, : self._used]

    def take(self, first: int, samples: Vector, missing: NDArray[np.bool_], rows: Matrix) -> bool:
        """Take a chunk; whether what comes of it can be used.

        Parameters
        ----------
        first : int
            Number of the first sample.
        samples : ndarray of float64, shape (CHUNK,)
        missing : ndarray of bool, shape (CHUNK,)
        rows : ndarray of float64, shape (CHUNK, lanes)
            Part of `rows`; filled.
        """
        if missing.any():
            self.restart()
            return False
        self._watch(*self._arguments(first, samples, missing, rows))
        self._since += CHUNK
        if self._since <= self.settling // 2:  # a force along a motion that is not known yet is none
            self._answers.states[:] = 0.0
        return self._since > self.settling

    def _arguments(self, first: int, samples: Vector, missing: NDArray[np.bool_], rows: Matrix) -> tuple[object, ...]:
        """What the kernel is told."""
        return (
            self._observer, self._known, self._tried, self.linear, self._response, samples, missing, first,
            self._path, self._along, self._answers, rows,
        )  # fmt: skip


def scratch() -> kernel.Along:
    """Room for the motion over some samples, and for forces along it."""
    few, nodes = kernel.FEW, SUBSTEPS * kernel.FEW
    motion = Motion(*(np.zeros((2, few)) for _ in range(3)))
    rows = np.zeros((2, 2, 4, nodes)), np.zeros((2, few)), np.zeros((2, few)), np.zeros((2, nodes)), np.zeros(nodes)
    return kernel.Along(np.zeros(few), motion, *rows, np.zeros(few))


def at_rest(observer: Observer, known: Forces, tried: Tried) -> kernel.Path:
    """What an observer begins with."""
    order, past = observer.gain.size, int(np.ceil(observer.delay)) + 4 + kernel.FEW
    sizes = order, order, 1, 2, known.forces.size, tried.rows.size, past
    return kernel.Path(*(np.zeros(size) for size in sizes))


def no_answers(response: Response, lanes: int) -> kernel.Answers:
    """What the signatures begin with."""
    few = kernel.FEW * lanes
    before = (response.taps.size - 1) * lanes
    return kernel.Answers(
        np.zeros(few), np.zeros(lanes + few), np.zeros((response.output.size, lanes + few)), np.zeros(before + few)
    )
