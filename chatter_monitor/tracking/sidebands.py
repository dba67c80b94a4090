"""Sidebands around a line: a vibration of its own in a machine that turns, told without knowing how fast.

Lines at a f + b d, for a from 0 to 2, of a vibration's frequency f and the spacing d of its sidebands are held against
chance, and against a comb: of all lines, and of all but that at f, for a tone beside a comb has no sidebands.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.kernels import sidebands as kernel
from chatter_monitor.tracking.comb import HUMS_BELOW_HZ, LOG_FACTORIAL, Lines, Target, beside_hum

# Two lines are explained for certain, and two more are not enough.
ENOUGH_LINES = 5
# The vibration is one of so many of the strongest lines.
CARRIERS = 4
# Distances of lines from it are up to so many times the spacing; whatever times it, where that is told.
PARTS, ANY_PART = 3, 1 << 30
# Log odds against chance; what has turned out to be none was refused for a comb, not for want of these.
ENOUGH = math.log(1e4)
# Log odds by which they have to be ahead of a comb.
AHEAD = 5.0
# And those by which a comb has to be ahead of sidebands.
AHEAD_OF_SIDEBANDS = 3.0
# Where the spacing may as well be the vibration, and the vibration a sideband of that, it has so many lines itself:
# with one sideband, which may be there by chance, it is a tone beside a comb.
BOTH_WAYS = 3
NO_LINE = -1


class Sidebands(NamedTuple):
    """A line with sidebands.

    Attributes
    ----------
    carrier_hz, tolerance_hz : float
        Its frequency, and how exactly that is known.
    spacing_hz : float
        That of the sidebands.
    evidence : float
        Log odds over chance.
    either : bool
        Whether only its strength speaks for it, and more lines are explained the other way round: by a vibration at
        ``spacing_hz`` with sidebands ``carrier_hz`` apart. What has not been steady before is the vibration.
    """

    carrier_hz: float
    tolerance_hz: float
    spacing_hz: float
    evidence: float
    either: bool = False

    def of(self, lines: Lines) -> NDArray[np.bool_]:
        """Which lines are the vibration's, its overtone's, or sidebands of either."""
        return lines.beside(self.carrier_hz, self.spacing_hz) | lines.beside(2.0 * self.carrier_hz, self.spacing_hz)

    def apart_hz(self, hertz: float, reach_hz: float) -> float | None:
        """How far the sidebands of the line at a frequency are apart; None if it is not the one that has any."""
        if abs(self.carrier_hz - hertz) < reach_hz:
            return self.spacing_hz
        return self.carrier_hz if self.either and abs(self.spacing_hz - hertz) < reach_hz else None

    def order(self, fundamental_hz: float) -> int | None:
        """That multiple of a frequency which the vibration cannot be told from; None if it is at none."""
        order = round(self.carrier_hz / fundamental_hz)
        return order if abs(self.carrier_hz - order * fundamental_hz) <= self.tolerance_hz else None


class _Range(NamedTuple):
    """Where the spacing may be (Hz), the teeth of the spindle if it is its rotation, and the parts that are tried."""

    low_hz: float
    high_hz: float
    teeth: int
    parts: int


class _Found(NamedTuple):
    """Frequency of a vibration, spacing of its sidebands, log odds over and logarithm of all that were tried, teeth."""

    carrier_hz: float
    spacing_hz: float
    evidence: float
    tried: float
    teeth: int


def find_sidebands(lines: Lines, slowest_hz: float, told: Target | None = None) -> Sidebands | None:
    """The line with sidebands that explain the lines best; None where a comb does as well, or chance may.

    Parameters
    ----------
    lines : Lines
        Strongest first, faint ones among them (`Spectrum.faint_lines`).
    slowest_hz : float
        Least spacing.
    told : Target, optional
        The spindle, where its speed is told: the spacing may be that of its rotation or of its teeth, and a narrow
        range leaves less to chance.
    """
    lines = beside_hum(lines, told, HUMS_BELOW_HZ)
    if len(lines.frequency_hz) < ENOUGH_LINES:
        return None
    ranges = [_Range(slowest_hz, math.inf, 1, PARTS)]
    if told is not None and told.teeth is not None:
        ranges.append(_Range(told.low_hz, told.high_hz, told.teeth, ANY_PART))
        ranges.append(_Range(told.low_hz * told.teeth, told.high_hz * told.teeth, 1, ANY_PART))
    found = max((_best_sidebands(lines, each) for each in ranges), key=lambda best: best.evidence)
    if found.evidence < ENOUGH:
        return None
    carrier = _carrier(lines, found)
    carrier_hz, tolerance_hz = lines.at(carrier)
    if not kernel.is_clear(carrier_hz, found.spacing_hz, tolerance_hz):
        return None
    if any(comb > found.evidence - AHEAD for comb in _combs(lines, carrier, found, ranges, told)):
        return None
    sidebands = Sidebands(carrier_hz, tolerance_hz, found.spacing_hz, found.evidence)
    is_told = told is not None and told.may_be(found.spacing_hz)
    if is_told or np.count_nonzero(sidebands.of(lines)) < BOTH_WAYS:
        return sidebands
    # each of two frequencies has the other between its lines: the stronger is the vibration's
    away_hz = np.abs(lines.frequency_hz[:carrier] - found.spacing_hz)
    stronger = np.flatnonzero(away_hz <= lines.tolerance_hz[:carrier])
    if not len(stronger):
        return sidebands
    return Sidebands(*lines.at(stronger[0]), carrier_hz, found.evidence, either=True)


def may_be_sidebands(lines: Lines, fundamental_hz: float, slowest_hz: float) -> bool:
    """Whether a comb may be a vibration with sidebands, which it has among its lines and which explain them as well.

    A frequency that is nearly a fraction of the spacing has lines at multiples of a small part of both.
    """
    if len(lines.frequency_hz) < ENOUGH_LINES:
        return False
    found = _best_sidebands(lines, _Range(slowest_hz, math.inf, 1, PARTS))
    if not found.evidence > 0.0 or not lines.on(fundamental_hz)[_carrier(lines, found)]:
        return False
    frequency, tolerance = lines.frequency_hz, lines.tolerance_hz
    highest_hz, beside = frequency.max(), _beside(lines, found)
    comb = kernel.best_comb(frequency, tolerance, NO_LINE, slowest_hz, highest_hz, 1, beside, LOG_FACTORIAL)
    return bool(found.evidence > comb - AHEAD_OF_SIDEBANDS)


def _carrier(lines: Lines, found: _Found) -> int:
    """Which line gives the name: of these each has the others as sidebands, and it is the strongest."""
    return int(np.argmax(lines.beside(found.carrier_hz, found.spacing_hz)))


def _best_sidebands(lines: Lines, among: _Range) -> _Found:
    best = np.empty(3)
    evidence = kernel.best_sidebands(
        lines.frequency_hz, lines.tolerance_hz, CARRIERS, among.low_hz, among.high_hz, among.teeth, among.parts,
        LOG_FACTORIAL, best,
    )  # fmt: skip
    carrier_hz, spacing_hz, tried = best.tolist()
    return _Found(carrier_hz, spacing_hz, evidence, tried, among.teeth)


def _beside(lines: Lines, found: _Found, told: Target | None = None) -> kernel.Beside:
    """What combs are held against."""
    scattered = kernel.scattered_sidebands(
        lines.frequency_hz, lines.tolerance_hz, found.carrier_hz, found.spacing_hz, found.teeth
    )
    return kernel.Beside(found.spacing_hz, scattered, 1 if told is None else _teeth_apart(told, found.spacing_hz))


def _teeth_apart(told: Target, spacing_hz: float) -> int:
    """How many teeth a told spindle has, if they are so far apart; else 1."""
    teeth = told.teeth or 1
    return teeth if told.admits(spacing_hz / teeth) else 1


def _combs(lines: Lines, carrier: int, found: _Found, ranges: list[_Range], told: Target | None) -> Iterator[float]:
    """Log odds of combs, of all lines and of all but one: of the sidebands' spacing with as many tried, then of any."""
    frequency, tolerance = lines.frequency_hz, lines.tolerance_hz
    beside = _beside(lines, found, told)
    for without in (NO_LINE, carrier):
        alike = kernel.comb_of(frequency, tolerance, without, beside, found.teeth, LOG_FACTORIAL)
        yield alike - found.tried
    highest_hz = frequency.max()
    for without in (NO_LINE, carrier):
        for low_hz, high_hz, teeth, _ in ranges:
            high_hz = min(high_hz, highest_hz)
            yield kernel.best_comb(frequency, tolerance, without, low_hz, high_hz, teeth, beside, LOG_FACTORIAL)
