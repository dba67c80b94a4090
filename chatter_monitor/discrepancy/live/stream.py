"""Whitened prediction errors of a running signal, and whitened signatures of forces in them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

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
from chatter_monitor.kernels.signatures import GROUP, Response, response_of
from chatter_monitor.physics.terms import Term

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

ORDER = 12  # of the whitening filter
_SETTLING = 4  # memories of the filter after which its errors and their signatures are used


class _Columns(NamedTuple):
    """What is made of a block: errors, signatures of what is linear, and of some forces."""

    tried: Tried
    used: int
    answers: kernel.Answers
    rows: Matrix  # (samples, lanes)


class Stream:
    """A calibrated observer and the forces that it is watched for, a block at a time.

    Parameters
    ----------
    base : Innovations
        Of the calibrated model on some of the signal: its observer, its forces, its whitening filter.
    tried : sequence of (Candidate, int)
        Forces to watch for: the unit of one coefficient each.
    scouts : int
        How many of them, the first, are watched for when the others rest; none of these has a memory.
    samples : int
        Of a block; a multiple of CHUNK.

    Attributes
    ----------
    linear : int
        Columns after the errors that stand for displacement and velocity, and with a delay for those before it.
    """

    def __init__(self, base: Innovations, tried: Sequence[tuple[Candidate, int]], scouts: int, samples: int) -> None:
        self._since = self._filled = 0
        self._observer = base.observer
        self._known = known_forces(base.terms)
        self._response = response_of(base.observer, whitener(base.errors, base.used, ORDER))
        self.linear = 4 if any(applied.term.delayed for applied in base.terms) else 2
        self._along = scratch()
        forces = [(candidate.term, candidate.unit(i)) for candidate, i in tried]
        self._path = at_rest(self._observer, self._known, tried_forces(forces))
        self._columns = [self._columns_of(some, samples) for some in (forces[:scouts], forces)]
        self._now = self._columns[True]
        self._kept = 1 + self.linear + scouts
        self._settling = _SETTLING * base.memory() + ORDER
        self._watch = bound(kernel.watch, *self._arguments(0, np.zeros(CHUNK), np.zeros(CHUNK, dtype=bool)))

    def _columns_of(self, forces: Sequence[tuple[Term, Sequence[float]]], samples: int) -> _Columns:
        """Room for what is made of a block if these are tried."""
        tried, used = tried_forces(forces), 1 + self.linear + len(forces)
        lanes = -(-used // GROUP) * GROUP
        return _Columns(tried, used, no_answers(self._response, lanes), np.zeros((samples, lanes)))

    def restart(self) -> None:
        """Forget everything: what comes next does not follow on what came last."""
        for each in (self._path, *(columns.answers for columns in self._columns)):
            for array in each:
                array[:] = 0.0
        self._since = self._filled = 0

    @property
    def begins(self) -> bool:
        """Whether a block begins with what comes next."""
        return self._filled == 0

    @property
    def settles(self) -> int:
        """How many samples after a start no block holds."""
        return -(-self._settling // CHUNK) * CHUNK

    def try_all(self, wanted: bool) -> None:
        """Try all forces from the block on that begins, or only scouts."""
        before, now = self._now, self._columns[wanted]
        if before is now:
            return
        self._path.memory[:] = 0.0
        for old, new in zip(before.answers, now.answers, strict=True):
            lanes = (*old.shape[:-1], -1, before.rows.shape[1]), (*new.shape[:-1], -1, now.rows.shape[1])
            new[:] = 0.0
            new.reshape(lanes[1])[..., : self._kept] = old.reshape(lanes[0])[..., : self._kept]
        self._now = now

    def take(self, first: int, samples: Vector, missing: NDArray[np.bool_]) -> Matrix | None:
        """Take a chunk.

        Parameters
        ----------
        first : int
            Number of the first sample.
        samples : ndarray of float64, shape (CHUNK,)
        missing : ndarray of bool, shape (CHUNK,)

        Returns
        -------
        ndarray of float64, shape (samples of a block, 1 + linear + c), or None
            The block that is completed: errors, signatures of what is linear and of what is tried, all or scouts.
            Valid until the next call.
        """
        if missing.any():
            self.restart()
            return None
        now = self._now
        self._watch(*self._arguments(first, samples, missing))
        self._since += CHUNK
        if 2 * self._since <= self.settles:  # a force along a motion that is not known yet is none
            now.answers.states[:] = 0.0
        if self._since <= self.settles:
            return None
        self._filled = (self._filled + CHUNK) % len(now.rows)
        return None if self._filled else now.rows[:, : now.used]

    def _arguments(self, first: int, samples: Vector, missing: NDArray[np.bool_]) -> tuple[object, ...]:
        """What the kernel is told."""
        now = self._now
        return (
            self._observer, self._known, now.tried, self.linear, self._response, samples, missing, first,
            self._path, self._along, now.answers, now.rows[self._filled : self._filled + CHUNK],
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
