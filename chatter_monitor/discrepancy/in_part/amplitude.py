"""An effect that acts above an amplitude only, and above which.

A force that begins at an amplitude has one parameter more than one that acts all along. The likelihood over that
parameter says where it begins, and how far that is known.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy.basis import scales
from chatter_monitor.discrepancy.candidates import Candidate
from chatter_monitor.discrepancy.case import Case, Local, Threshold
from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.in_part.stretch import APART_NATS, swing, told
from chatter_monitor.discrepancy.name import PRICE_NATS

Vector = NDArray[np.float64]
Entry = tuple[Candidate, list[int]]

ABOVE = np.geomspace(0.4, 2.4, 11)  # amplitudes tried, over the rms displacement; then some about the best
_FINER = np.linspace(-1.0, 1.0, 9)[1:-1]  # steps of those
# What the regression may leave of a force above an amplitude, of what it explains: it takes the motion from a machine
# without that force, and no part of the recording shows that machine alone. No name for less.
LEFT_SHARE = 0.2
_INSIDE_NATS = 1.92  # below the most likely: the 95 % interval of one parameter


def find_above(case: Case) -> Local | None:
    """An effect above an amplitude only; None if nothing there beats what acts all along.

    The best shape of each name says where it begins; all names and shapes then compete there.
    """
    leaders = case.contest.best([], case.training).values()
    tried = [(candidate, columns) for _, candidate, columns, _ in leaders]
    amplitudes, gains = _searched(case, tried, case.training)
    above = float(amplitudes[1:][int(np.argmax(gains[:, 1:].max(axis=0)))])
    entries = case.contest.entries
    found = told(case, entries, _confined(case, entries, np.array([above])), [], 1, of_several=1.0 - LEFT_SHARE)
    if found is None:
        return None
    entry = next(entry for entry in entries if entry[0] == found.candidate)
    return replace(found, threshold=begins(case, entry))


def named_above(case: Case) -> Threshold | None:
    """Amplitude above which the one term that is named acts; None if acting all along explains nearly as much."""
    if len(case.named) != 1 or case.local is not None or case.named[0].candidate.term.chip_thickness:
        return None
    named = case.named[0]
    found = begins(case, (named.candidate, named.all_columns))
    return found if found.gain_nats > APART_NATS else None


def begins(case: Case, entry: Entry) -> Threshold:
    """Where a force begins, by the likelihood of all blocks."""
    amplitudes, [gains] = _searched(case, [entry], case.evidence.everything)
    best = int(np.argmax(gains))
    likely = np.flatnonzero(gains > gains[best] - _INSIDE_NATS)
    # To the next amplitudes that are not as likely: between them nothing was tried.
    low, high = max(int(likely[0]) - 1, 0), min(int(likely[-1]) + 1, amplitudes.size - 1)
    ci95 = float(amplitudes[low]), float(amplitudes[high])
    return Threshold(float(amplitudes[best]), ci95, float(gains[best] - gains[0] - PRICE_NATS))


def _searched(case: Case, tried: Sequence[Entry], blocks: NDArray[np.bool_]) -> tuple[Vector, NDArray[np.float64]]:
    """Gains of candidates above amplitudes, the first of which is 0; finer about the best, if it is not the first."""
    sd_x, _ = scales(case.innovations.motion)
    amplitudes = np.concatenate([[0.0], sd_x * ABOVE])
    gains = _gains(case, tried, amplitudes, blocks)
    leader, best = divmod(int(np.argmax(gains)), amplitudes.size)
    if best == 0:
        return amplitudes, gains
    finer = amplitudes[best] * float(ABOVE[1] / ABOVE[0]) ** _FINER
    more = np.zeros((len(tried), finer.size))
    more[leader] = _gains(case, [tried[leader]], finer, blocks)[0]
    both = np.concatenate([amplitudes, finer])
    order = np.argsort(both, kind="stable")
    return both[order], np.concatenate([gains, more], axis=1)[:, order]


def _gains(case: Case, tried: Sequence[Entry], amplitudes: Vector, blocks: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Gain of each candidate above each amplitude, its coefficients and shapes paid for; 0 for none."""
    nuisance = case.matrix[case.evidence.nuisance]
    k = len(nuisance)
    confined = _confined(case, tried, amplitudes)
    first = dict(zip(confined, range(k, k + len(confined) * len(amplitudes), len(amplitudes)), strict=True))
    rows = [*nuisance, *chain.from_iterable(confined.values())]
    evidence = Evidence(case.innovations.white, rows, case.weight, range(k), case.evidence.block)
    gains = np.zeros((len(tried), len(amplitudes)))
    for row, (candidate, columns) in zip(gains, tried, strict=True):
        for i in range(len(amplitudes)):
            left, fit = evidence.bounded([first[c] + i for c in columns], candidate.lower, PRICE_NATS, blocks)
            row[i] = fit.gain - PRICE_NATS * (len(left) + candidate.shapes) if left else 0.0
    return gains


def _confined(case: Case, tried: Sequence[Entry], amplitudes: Vector) -> Mapping[int, NDArray[np.float64]]:
    """Signatures above amplitudes, shape (amplitudes, n), by the columns of what acts all along."""
    inn = case.innovations
    units = {
        column: (candidate.term, candidate.unit(i))
        for candidate, columns in tried
        for column, i in zip(columns, candidate.linear, strict=True)
    }
    amplitude = swing(inn)
    signatures = inn.respond(inn.forces([*units.values()]), [amplitude > above for above in amplitudes])
    return dict(zip(units, signatures.reshape(len(units), len(amplitudes), -1), strict=True))
