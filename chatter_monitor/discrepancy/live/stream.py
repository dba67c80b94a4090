"""Whitened prediction errors of a running signal, and whitened signatures of forces in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy.candidates import Candidate
from chatter_monitor.discrepancy.innovations import Innovations, known_forces
from chatter_monitor.discrepancy.whitening import whitener
from chatter_monitor.kernels import live_signatures as kernel
from chatter_monitor.physics.parts import AppliedTerm

Vector = NDArray[np.float64]

CHUNK = 512  # samples that are taken at once: fewer, and the calls would cost more than what they do
NUISANCE = 3  # first columns: a spring, a damper, a constant force
LANES = 16  # columns that the compiler takes side by side
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

    """

    def __init__(self, base: Innovations, tried: Sequence[tuple[Candidate, int]]) -> None:
        self._observer, self._taps = base.observer, whitener(base.errors, base.used, ORDER)
        self._known = known_forces(base.terms)
        self._used = 1 + NUISANCE + len(tried)
        columns = -(-self._used // LANES) * LANES
        self._tried = known_forces([_unit(candidate, i) for candidate, i in tried])
        self._forces = np.zeros((2, kernel.FEW, columns))
        self._delay = int(np.ceil(base.observer.delay)) + 3
        self.settling = _SETTLING * base.memory() + ORDER
        self._white = np.zeros((CHUNK, columns))
        self.restart()

    def restart(self) -> None:
        """Forget everything: what comes next does not follow on what came last."""
        order, columns = self._observer.gain.size, self._forces.shape[2]
        self._path = kernel.Path(
            np.zeros(order),
            np.zeros(order),
            np.zeros(1),
            np.zeros(2),
            np.zeros(self._known.forces.size),
            np.zeros(self._used - 1 - NUISANCE),
            np.zeros(self._delay + kernel.FEW),
            np.zeros((2, 4, kernel.NODES)),
        )
        ended, news, seen = (np.zeros(columns) for _ in range(3))
        self._answers = kernel.Answers(np.zeros((2, order, columns)), ended, news, seen, np.zeros(kernel.FEW))
        self._raw = np.zeros((self._taps.size - 1 + kernel.FEW, columns))
        self._since = 0

    def take(self, first: int, samples: Vector, missing: NDArray[np.bool_]) -> bool:
        """Take a chunk; whether its `white` can be used.

        Parameters
        ----------
        first : int
            Number of the first sample.
        samples : ndarray of float64, shape (CHUNK,)
        missing : ndarray of bool, shape (CHUNK,)
        """
        if missing.any():
            self.restart()
            return False
        kernel.watch(
            self._observer, self._known, self._tried, samples, missing, first, self._since == 0, self._path,
            self._answers, self._forces, self._taps, self._raw, self._white,
        )  # fmt: skip
        self._since += CHUNK
        if self._since <= self.settling // 2:  # a force along a motion that is not known yet is none
            self._answers.state[:] = 0.0
        return self._since > self.settling

    @property
    def white(self) -> NDArray[np.float64]:
        """Errors, nuisance and what is tried of the newest chunk, shape (CHUNK, 1 + NUISANCE + c)."""
        return self._white[:, : self._used].copy()


def _unit(candidate: Candidate, i: int) -> AppliedTerm:
    values = dict(zip((p.name for p in candidate.term.parameters), candidate.unit(i), strict=True))
    return AppliedTerm(candidate.term, values)
