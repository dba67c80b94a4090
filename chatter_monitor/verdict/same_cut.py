"""Whether a cut is the same as before, and which power is new in it, by spectra of the whole signal.

The same is what is forced by the same: steady lines at the same frequencies and in the same relations, all of them
louder alike where the tool goes deeper. What is beyond that, in whatever band, nothing forces that was there before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import median
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc

from chatter_monitor.tracking.long_spectrum import BIN_HZ, SILENCE, Power

Indices = NDArray[np.int64]

# Bins of a stretch whose median is the level around a line; the mean of noise over its median.
STRETCH, MEAN_OVER_MEDIAN = 64, 1.0 / math.log(2.0)
# A line stands out by so much (power), and comes and goes by less: half of the changes of its logarithm between two
# spectra that share no sample are below this (ln 3 of noise). In the air it has less than one in so many of its power.
STANDS_OUT, COMES_AND_GOES, IN_AIR = 5.0, 0.6, 10.0
# So many bins beside a line there is less than in it.
WIDE = 2
# So many that stand out most are asked, and so many have to be there. As many as are on orders of the spindle are on
# any orders with such a probability at most.
MOST_LINES, FEWEST_LINES, BY_CHANCE = 12, 2, 0.02
# A spindle wanders by so much to either side; speeds are tried in steps.
WANDERS, STEP = 0.003, 0.001
# How far a line stands out (natural logarithm) counts between these bounds; their mean, times the root of how many
# there are, tells that it is no chance, from so much on.
LEAST, MOST, NO_CHANCE = -1.0, 4.0, 4.0
# Half of them are within so much (natural logarithm of power) of the relations of before.
RELATIONS = 0.75
# Half of them have so much less power (natural logarithm) where they are not drowned but gone.
GONE = math.log(4.0)
# Bins of a band, and by how many times its largest power before it has to be louder than what forces the cut explains.
BAND, BEYOND = 10, math.exp(1.2)
BAND_HZ = BAND * BIN_HZ


class New(NamedTuple):
    """What is new in a cut: its share of the power, and what each band has of it, shape (bands,)."""

    share: float
    bands: Power

    @property
    def hertz(self) -> float:
        """Middle of the band with most of it."""
        return (float(self.bands.argmax()) + 0.5) * BAND_HZ


class SameCut:
    """What a cut was like.

    Parameters
    ----------
    spectra : sequence of ndarray of float64, shape (bins,)
        Of it while it was calm, in the order of time.
    air : ndarray of float64, shape (bins,), or None
        Largest powers while nothing was cut; None where that was not heard. Then only what is on orders of the spindle
        is known to be of the cut.
    rotation_hz : float or None
        Of the spindle, where it is heard.
    """

    def __init__(self, spectra: Sequence[Power], air: Power | None, rotation_hz: float | None = None) -> None:
        every = np.array(spectra)
        self._mean = every.mean(axis=0)
        heard = np.zeros_like(self._mean) if air is None else air
        self._lines = _steady_lines(every, self._mean, heard)
        if air is None:
            self._lines = _on_orders(self._lines, rotation_hz)
        speeds = _speeds(2.0 * WANDERS)  # now it may be on the other side
        self._places = np.minimum(np.rint(np.outer(speeds, self._lines)).astype(np.int64), self._mean.size - 1)
        bands = np.array([_bands(spectrum) for spectrum in spectra])
        self._power = median(bands.sum(axis=1).tolist())
        largest = bands.max(axis=0)
        self._bands = np.max([largest, np.append(largest[1:], 0.0), np.append(0.0, largest[:-1])], axis=0)
        self._air = _bands(heard)

    def gain(self, spectrum: Power) -> float | None:
        """By how much what forces the cut has more power than before, at least 1; None where it is another cut."""
        if self._lines.size < FEWEST_LINES:
            return None
        stand_out = np.log(spectrum[self._places] / _level(spectrum, self._places))
        by = np.where(_is_peak(spectrum, self._places), np.clip(stand_out, LEAST, MOST), LEAST).sum(axis=1)
        speed = int(np.lexsort((stand_out.sum(axis=1), by))[-1])  # the loudest of those at which all stand out
        if by[speed] < NO_CHANCE * math.sqrt(self._lines.size):
            return None
        louder = np.log(spectrum[self._places[speed]] / self._mean[self._lines]).tolist()
        usual = median(louder)
        alike = median(abs(each - usual) for each in louder) < RELATIONS
        return max(math.exp(usual), 1.0) if alike else None

    def gone(self, spectrum: Power) -> bool:
        """Whether what forced the cut before does so no more; else what is louder now may drown it."""
        louder = np.log(spectrum[self._places] / self._mean[self._lines])
        return self._lines.size == 0 or bool(np.median(louder, axis=1).max() < -GONE)

    def new(self, spectrum: Power, gain: float) -> New:
        """What is new, where what forces the cut has so many times its power: as a share of that of now or of before.

        When the tool leaves what is left is no more than there was.
        """
        bands = _bands(spectrum)
        beyond = self._beyond(bands, gain)
        return New(float(beyond.sum() / max(bands.sum(), gain * self._power, SILENCE)), beyond)

    def _beyond(self, bands: Power, gain: float) -> Power:
        """Power of each band beyond what forces the cut makes of it, and beyond that of the air."""
        explained: Power = BEYOND * np.maximum(gain * self._bands, self._air)
        return np.maximum(bands - explained, 0.0)


def _steady_lines(spectra: NDArray[np.float64], mean: Power, air: Power) -> Indices:
    """Bins of the lines that stand out most of what is steady and not in the air, ascending."""
    above = mean / _level(mean, np.arange(mean.size))
    lines = 1 + np.flatnonzero((above[1:-1] > STANDS_OUT) & (mean[1:-1] >= mean[:-2]) & (mean[1:-1] > mean[2:]))
    lines = lines[mean[lines] > IN_AIR * np.max([air[lines - 1], air[lines], air[lines + 1]], axis=0)]
    logs = np.log(spectra[:, lines])
    lines = lines[np.median(np.abs(logs[2:] - logs[:-2]), axis=0) < COMES_AND_GOES]
    return np.sort(lines[np.argsort(-above[lines])][:MOST_LINES])


def _on_orders(lines: Indices, rotation_hz: float | None) -> Indices:
    """Those on multiples of a rotation, at that of the speeds beside it at which most are; none if that is chance."""
    if rotation_hz is None:
        return lines[:0]
    rotations_hz = rotation_hz * _speeds(WANDERS)[:, None]
    orders = lines * BIN_HZ / rotations_hz
    near = np.abs(orders - np.rint(orders)) * rotations_hz <= BIN_HZ
    on_orders = lines[near[near.sum(axis=1).argmax()]]
    anywhere = min(2.0 * BIN_HZ / rotation_hz, 1.0)
    by_chance = bdtrc(on_orders.size - 1, lines.size, anywhere)  # as many, or more
    return on_orders if by_chance <= BY_CHANCE else lines[:0]


def _speeds(share: float) -> NDArray[np.float64]:
    """Parts of a speed, up to so far to either side."""
    steps = round(share / STEP)
    return np.linspace(1.0 - share, 1.0 + share, 2 * steps + 1)


def _is_peak(spectrum: Power, bins: Indices) -> NDArray[np.bool_]:
    """Whether there is a line, and not the skirt of a stronger one beside it."""
    below, above = np.maximum(bins - WIDE, 0), np.minimum(bins + WIDE, spectrum.size - 1)
    return spectrum[bins] > np.maximum(spectrum[below], spectrum[above])


def _level(spectrum: Power, bins: Indices) -> Power:
    """Mean power of the noise around bins."""
    stretches = _in_rows(spectrum, STRETCH)
    middle = stretches.shape[1] // 2
    medians = np.partition(stretches, middle, axis=1)[:, middle]
    return np.interp(bins, middle + STRETCH * np.arange(medians.size), medians * MEAN_OVER_MEDIAN)


def _bands(spectrum: Power) -> Power:
    """Power of each band; none of the lowest, which is offset and drift."""
    bands: Power = _in_rows(spectrum, BAND).sum(axis=1)
    bands[0] = 0.0
    return bands


def _in_rows(spectrum: Power, bins: int) -> Power:
    """So many bins in each, or all in one, shape (n, bins); of the highest some may be left out."""
    bins = min(bins, spectrum.size)
    return spectrum[: spectrum.size // bins * bins].reshape(-1, bins)
