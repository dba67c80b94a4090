"""Whitened prediction errors of a running signal, and whitened signatures of forces in them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy.candidates import Candidate
from chatter_monitor.discrepancy.innovations import Innovations, known_forces, tried_forces
from chatter_monitor.discrepancy.live.history import History
from chatter_monitor.discrepancy.live.windows import no_summary
from chatter_monitor.discrepancy.whitening import whitener
from chatter_monitor.kernels import live_signatures as kernel
from chatter_monitor.kernels.binding import bound
from chatter_monitor.kernels.forces_along import Tried
from chatter_monitor.kernels.live_signatures import FEW
from chatter_monitor.kernels.observer import SUBSTEPS, Forces, Motion, Observer
from chatter_monitor.kernels.signatures import GROUP, Response, response_of
from chatter_monitor.physics.terms import Term

Vector = NDArray[np.float64]

ORDER = 12  # of the whitening filter
_SETTLING = 4  # memories of the filter after which its errors and their signatures are used


class _Columns(NamedTuple):
    """What is made of a block: errors, signatures of what is linear, and of some forces."""

    tried: Tried
    nearly: bool
    used: int
    answers: kernel.Answers
    summary: kernel.Summary


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
        Of a block; a multiple of `FEW`.
    newest : int
        How many of these, the last, are gone through when forces rest; likewise.

    Attributes
    ----------
    linear : int
        Columns after the errors that stand for displacement and velocity, and with a delay for those before it.
    settles : int
        Samples before those of a block that an observer needs which begins with it.
    """

    def __init__(
        self, base: Innovations, tried: Sequence[tuple[Candidate, int]], scouts: int, samples: int, newest: int
    ) -> None:
        self._observer = base.observer
        self._known = known_forces(base.terms)
        self._response = response_of(base.observer, whitener(base.errors, base.used, ORDER))
        self.linear = 4 if any(applied.term.delayed for applied in base.terms) else 2
        self.settles = -(-(_SETTLING * base.memory() + ORDER) // (2 * FEW)) * 2 * FEW
        self._along = scratch()
        forces = [(candidate.term, candidate.unit(i)) for candidate, i in tried]
        self._path = at_rest(self._observer, self._known, tried_forces(forces))
        self._scouts = self._columns_of(forces[:scouts], newest, nearly=True)
        self._all = self._columns_of(forces, samples, nearly=False)
        self._last, self._ended = self._all, -1  # which columns go on, and with which sample
        self._watch = bound(kernel.watch, *self._arguments(self._all, 0, np.zeros(samples)))

    def _columns_of(self, forces: Sequence[tuple[Term, Sequence[float]]], samples: int, *, nearly: bool) -> _Columns:
        """Room for what is made of so many samples if these are tried."""
        tried, used = tried_forces(forces), 1 + self.linear + len(forces)
        lanes = -(-used // GROUP) * GROUP
        return _Columns(tried, nearly, used, no_answers(self._response, lanes), no_summary(lanes, samples))

    def take(self, history: History, first: int, *, rests: bool) -> tuple[kernel.Summary, int] | None:
        """Take a block.

        Parameters
        ----------
        history : History
            Holds it.
        first : int
            Number of its first sample.
        rests : bool
            Whether forces rest: only scouts are tried, and only in the newest part of it.

        Returns
        -------
        (Summary, int), or None
            Of errors, signatures of what is linear and of what is tried; and how many columns that makes. Valid until
            the next call. None where samples are missing, in the block or where the observer settles, or are not kept
            any more.
        """
        now = self._scouts if rests else self._all
        end = first + self._all.summary.errors.size
        begin = end - now.summary.errors.size
        goes_on = now is self._last and begin == self._ended
        earliest = begin if goes_on else begin - self.settles
        self._last, self._ended = now, -1
        if earliest < history.start:
            return None
        part = history.between(earliest, end)
        if part.missing.any():
            return None
        if not goes_on:
            self._settle(now, earliest, part.samples[: self.settles])
        self._watch(*self._arguments(now, begin, part.samples[begin - earliest :]))
        self._ended = end
        return now.summary, now.used

    def _settle(self, now: _Columns, first: int, samples: Vector) -> None:
        """Begin anew; a force along a motion that is not known yet is none."""
        for each in (self._path, now.answers):
            for array in each:
                array[:] = 0.0
        half = self.settles // 2
        for at in (0, half):
            now.answers.states[:] = 0.0
            for few in range(at, at + half, FEW):  # a summary may have less room
                self._watch(*self._arguments(now, first + few, samples[few : few + FEW]))

    def _arguments(self, now: _Columns, first: int, samples: Vector) -> tuple[object, ...]:
        """What the kernel is told."""
        return (
            self._observer, self._known, now.tried, now.nearly, self.linear, self._response, samples, first,
            self._path, self._along, now.answers, now.summary,
        )  # fmt: skip


def scratch() -> kernel.Along:
    """Room for the motion over some samples, and for forces along it."""
    few, nodes = FEW, SUBSTEPS * FEW
    motion = Motion(*(np.zeros((2, few)) for _ in range(3)))
    rows = np.zeros((2, 2, 4, nodes)), np.zeros((2, few)), np.zeros((2, few)), np.zeros((2, nodes)), np.zeros(nodes)
    return kernel.Along(np.zeros(few), motion, *rows, np.zeros(few))


def at_rest(observer: Observer, known: Forces, tried: Tried) -> kernel.Path:
    """What an observer begins with."""
    order, past = observer.gain.size, int(np.ceil(observer.delay)) + 4 + FEW
    sizes = order, order, 1, 2, known.forces.size, tried.rows.size, past
    return kernel.Path(*(np.zeros(size) for size in (*sizes, (order, 1 + FEW))))


def no_answers(response: Response, lanes: int) -> kernel.Answers:
    """What the signatures begin with."""
    few = FEW * lanes
    before = (response.taps.size - 1) * lanes
    return kernel.Answers(
        np.zeros(few), np.zeros(lanes + few), np.zeros((response.output.size, lanes + few)), np.zeros(before + few)
    )
