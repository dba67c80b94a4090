"""Whether a pass is as the ones before, but for power that is new: chatter from the first contact on.

Who goes on with a job a little deeper may hear chatter as soon as the tool is in the cut. Nothing is seen to grow then,
and a line that comes with a tool may be forced. But where the forced lines are the same as in the passes before, at the
same frequencies and in the same relations, it is the same cut at the same speed; and what forces it makes all of it
louder alike. Power beyond that is forced by nothing that was there before. No speed has to be told for that, nor has
a comb to be found, nor does it matter whether chatter is near an order.

It says nothing in a first pass, nor of a new job, nor where nothing forces the cut that can be heard.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.tracking.long_spectrum import BIN_HZ, BINS, LENGTH_S, Spectrum

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

# A tool enters, or leaves, within so long; what is heard in a spectrum is to be cut, or air, all along.
ENTERING_S = 0.1
# A pass of which so many spectra are calm can be compared with; so many of the latest are remembered.
FEWEST, REMEMBERED = 5, 40
# What comes within so many seconds before an alarm may have been chatter, too.
BEFORE_ALARM_S = 1.0

# Bins of a stretch of which the median is the level around a line; the mean of noise over its median.
STRETCH, MEAN_OVER_MEDIAN = 64, 1.0 / math.log(2.0)
# A line stands out by so much (power), and comes and goes by less (half of the changes of its logarithm between two
# spectra that share no sample; ln 3 of noise). In the air it has less of its power than one in so many.
STANDS_OUT, COMES_AND_GOES, IN_AIR = 5.0, 0.6, 10.0
LINES = 12
# A speed is the same within this; a line may be in the next bin besides.
SAME_SPEED = 0.003
# Logarithms of how far lines stand out count from -1 to 4; their mean, times the root of their number, has to be this.
# Half of them are in the relations of before within so much (natural logarithm of power).
LEAST, MOST, STAND_OUT = -1.0, 4.0, 4.0
RELATIONS = 0.75
# Lines within so many bins of what is new do not tell of what forces the cut.
BESIDE = 14
# New is what a band has beyond so many times its largest power before, its neighbours' included.
BAND, BEYOND = 10, math.exp(1.2)
# Share of new power that speaks for chatter, and by how much it has to be beyond that, summed over spectra.
BETWEEN, ENOUGH = 0.2, 0.25
# What a spectrum counts in which the cut is the same, and in which it is not, for it is drowned; and within which bounds
# their sum stays: a pass is the same as long as that is positive.
SAME, NOT_SAME, SURELY = 2, -1, 5


class New(NamedTuple):
    """What is new in a pass: its share of the power, and the frequency of the strongest of it (Hz)."""

    share: float
    hertz: float


class _Reference:
    """What passes were like, from the spectra of calm ones, shape (n, BINS)."""

    def __init__(self, spectra: NDArray[np.float32], air: Floats) -> None:
        self.mean = spectra.mean(axis=0, dtype=float)
        self.lines = _steady_lines(spectra, self.mean, air)
        largest = np.max([_bands(each) for each in spectra], axis=0)
        self.power = float(np.median([_bands(each).sum() for each in spectra]))
        self.bands = np.max([largest, np.append(largest[1:], 0.0), np.append(0.0, largest[:-1])], axis=0)


class FormerPasses:
    """Passes of one channel, and the air between.

    Parameters
    ----------
    interval_s : float
        Length of an interval.
    """

    def __init__(self, interval_s: float) -> None:
        self._whole = round((LENGTH_S + ENTERING_S) / interval_s)
        self._cutting, self._since = False, 0  # and for how many intervals
        self._air: Floats | None = None  # largest powers in the last air
        self._reference: _Reference | None = None
        self._remembered: list[Spectrum] = []  # of which that is
        self._pass = deque[Spectrum](maxlen=REMEMBERED)
        self._unsure = deque[Spectrum](maxlen=round(BEFORE_ALARM_S / (LENGTH_S / 2)))
        self._same, self._was_same = 0, False  # what spectra of this pass counted; whether it ever was the same
        self._gain = 1.0
        self._told, self._certain = 0.0, False
        self._new = New(0.0, math.nan)

    def rest(self, spectrum: Spectrum | None) -> None:
        """Nothing is cut: hear the air, if there is a spectrum."""
        if self._cutting:
            self._end_pass()
        self._since += 1
        if spectrum is not None and self._since >= self._whole:
            heard = spectrum.astype(float)
            self._air = heard if self._air is None else np.maximum(self._air, heard)

    @property
    def same(self) -> bool:
        """Whether it is the same cut as before, for all that is heard just now."""
        return self._same > 0

    @property
    def new(self) -> New | None:
        """What is new in this pass, if that is an alarm."""
        return self._new if self._certain else None

    def cut(self, spectrum: Spectrum | None, *, calm: bool) -> None:
        """Hear an interval of cutting.

        Parameters
        ----------
        spectrum : ndarray of float32, shape (BINS,), or None
            Of the signal with all that turns, if there is one.
        calm : bool
            Whether there is no alarm, and was none just now.
        """
        if not self._cutting:
            self._begin_pass()
        self._since += 1
        if not calm:
            self._unsure.clear()
        if spectrum is not None and self._since >= self._whole:
            self._compare(spectrum)
            if calm and not self._certain:
                self._learn(spectrum)

    def _begin_pass(self) -> None:
        self._cutting, self._since = True, 0
        self._same, self._was_same = 0, False
        self._told, self._certain = 0.0, False
        if self._remembered and self._air is not None:
            self._reference = _Reference(np.array(self._remembered), self._air)

    def _end_pass(self) -> None:
        """Remember a calm pass, with those before if it was the same cut, instead of them if not."""
        heard = list(self._pass)
        if len(heard) >= FEWEST:
            self._remembered = [*(self._remembered if self._was_same else []), *heard][-REMEMBERED:]
        self._pass.clear()
        self._unsure.clear()
        self._air = None
        self._cutting, self._since = False, 0

    def _learn(self, spectrum: Spectrum) -> None:
        if len(self._unsure) == self._unsure.maxlen:
            self._pass.append(self._unsure[0])
        self._unsure.append(spectrum)

    def _compare(self, spectrum: Spectrum) -> None:
        """Tell whether it is the same cut, and what is new in it."""
        reference, air = self._reference, self._air
        if reference is None or air is None:
            return
        bands, in_air = _bands(spectrum), _bands(air)
        gain = self._same_cut(spectrum, bands, reference)
        if gain is not None or not self._certain:  # what chatters may drown it
            self._same += NOT_SAME if gain is None else SAME
            self._same = min(max(self._same, -SURELY), SURELY)
        self._gain = self._gain if gain is None else gain
        self._was_same |= self.same
        share = BETWEEN
        if self.same:
            new = _beyond(bands, reference, in_air, self._gain)
            share = float(new.sum() / max(bands.sum(), self._gain * reference.power))
            self._new = New(share, (float(new.argmax()) + 0.5) * BAND * BIN_HZ)
        self._told = min(max(self._told + share - BETWEEN, 0.0), ENOUGH) if self.same else 0.0
        self._certain = self._told >= ENOUGH or (self._certain and self._told > 0.0)

    def _same_cut(self, spectrum: Spectrum, bands: Floats, reference: _Reference) -> float | None:
        """By how much what forces the cut has more power than before, at least 1; None where it is another."""
        level = _level(spectrum)
        lines = reference.lines
        gain = _gain(spectrum, level, reference.mean, lines)
        if gain is None:
            return None
        new = _beyond(bands, reference, _bands(self._air), gain)
        if new.max() > BETWEEN * bands.sum():
            beside = np.abs(lines - (new.argmax() + 0.5) * BAND) < BESIDE
            gain = _gain(spectrum, level, reference.mean, lines[~beside]) if beside.any() else gain
        return gain


def _gain(spectrum: Spectrum, level: Floats, before: Floats, lines: Indices) -> float | None:
    """By how much lines have more power than before, at least 1, if they are the same ones; None if not."""
    if lines.size < 2:
        return None
    heard, stand_out = spectrum[lines], np.full(1, -math.inf)
    for factor in np.linspace(1.0 - SAME_SPEED, 1.0 + SAME_SPEED, 7):
        at = np.minimum(np.rint(factor * lines).astype(int), BINS - 1)
        by = np.clip(np.log(spectrum[at] / level[at]), LEAST, MOST)
        if by.sum() > stand_out.sum():
            heard, stand_out = spectrum[at], by
    if stand_out.mean() * math.sqrt(lines.size) < STAND_OUT:
        return None
    louder = np.log(heard / before[lines])
    gain = np.median(louder)
    return max(math.exp(gain), 1.0) if np.median(np.abs(louder - gain)) < RELATIONS else None


def _beyond(bands: Floats, reference: _Reference, air: Floats, gain: float) -> Floats:
    """Power of each band beyond what forces the cut makes of it, and beyond that of the air."""
    return np.maximum(bands - BEYOND * np.maximum(gain * reference.bands, air), 0.0)


def _steady_lines(spectra: NDArray[np.float32], mean: Floats, air: Floats) -> Indices:
    """Bins of the lines that stand out most of what is steady and not in the air, shape (at most LINES,)."""
    above = mean / _level(mean)
    middle = slice(1, -1)
    peaks = 1 + np.flatnonzero((above[middle] > STANDS_OUT) & (mean[middle] >= mean[:-2]) & (mean[middle] > mean[2:]))
    peaks = peaks[mean[peaks] > IN_AIR * np.maximum.reduce([air[peaks - 1], air[peaks], air[peaks + 1]])]
    logs = np.log(spectra[:, peaks])
    peaks = peaks[np.median(np.abs(logs[2:] - logs[:-2]), axis=0) < COMES_AND_GOES]
    return np.sort(peaks[np.argsort(-above[peaks])][:LINES])


def _level(spectrum: NDArray[np.floating]) -> Floats:
    """Mean power of the noise around each bin."""
    stretches = np.median(spectrum.reshape(-1, STRETCH), axis=1) * MEAN_OVER_MEDIAN
    middles = (np.arange(stretches.size) + 0.5) * STRETCH
    return np.interp(np.arange(BINS), middles, np.maximum(stretches, np.finfo(np.float32).tiny))


def _bands(spectrum: NDArray[np.floating]) -> Floats:
    """Power of each band but the lowest, which is offset and drift."""
    bands = spectrum.astype(float)[: BINS // BAND * BAND].reshape(-1, BAND).sum(axis=1)
    bands[0] = 0.0
    return bands
