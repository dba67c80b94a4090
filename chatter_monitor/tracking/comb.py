"""Combs among the lines of a spectrum.

A comb is harmonic: its lines are integer multiples of one frequency, through zero. Each line that lies closer to a
multiple than chance would have it is evidence, and a low fundamental, whose multiples are everywhere, earns little by
it. A self-excited vibration has overtones and evenly spaced sidebands, and some low frequency nearly divides them all.
So that is tried as an explanation, too, and where it does better its lines do not count.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from chatter_monitor.kernels import comb as kernel
from chatter_monitor.kernels.in_step import new_work as new_step_work
from chatter_monitor.kernels.in_step import read_in_step, start_of
from chatter_monitor.kernels.long_transform import LEAST_POINTS, Tables, new_tables, new_work, power_spectrum

# Power of a line over the noise around it; noise alone reaches it about once in twenty spectra.
LINE_TO_NOISE = 17.0
STRONGEST = 12
# Lines below this share of the strongest one's power (-26 dB) are left alone: there are products of stronger lines, and
# little to take out.
FAINTEST = 1.0 / 400.0
# Sidebands of a line are many, and as faint as this beside it (-40 dB). Of a comb that is known so many lines are
# enough: a tool that strikes has more, and they are louder.
MANY, FAINT, KNOWN = 24, 1e-4, 8
# How far from its mean a line is followed in whose step the others are read, relatively and at least (Hz).
STEP_WIDTH, LEAST_STEP_WIDTH_HZ = 0.012, 3.0
# Time over which its frequency at the beginning is averaged.
START_S = 0.25
# And up to which of its multiples that is a comb's: one of a low fundamental passes near any frequency.
HIGHEST_STEP = 8
# Lines are this exact: of the spectrum's resolution, and of the frequency, for a speed that is not quite constant.
EXACT_BINS = 0.7
EXACT_SHARE = 3e-4
# Log odds by which a comb has to be ahead of that: a false comb hides chatter, a missed one costs time.
AHEAD = 3.0
# Where the lines of a self-excited vibration may be: its overtones with their sidebands, and forced lines beside them.
PLACES = kernel.OVERTONES * (2 * kernel.SIDEBANDS + 1) + kernel.FORCED
# Log of the odds against chance, over all the combs that were tried: of any comb, and of that of a speed that was told.
# That spindle is known to turn, and a told range is narrow; any other comb is one of many that there could be.
ENOUGH = math.log(1000.0)
ENOUGH_TOLD = math.log(20.0)
# Multiples of the told passing of teeth that a few lines may be of. With a speed that may be 3.5 % off, each takes up
# 7 % of the frequencies times its number, and what is there by chance, chatter too, may be taken for it.
FIRST_MULTIPLES = 4
# The mains hum at multiples of their frequency, or of twice that. A grid keeps to that within 0.1 %, at worst 0.2 %,
# and a window is read as exactly; what is farther away may be a spindle.
MAINS_HZ, MAINS_KEEP = (50.0, 60.0), 0.0025
# They hum loudly up to here; what is at a higher multiple of them is there by chance.
HUMS_BELOW_HZ = 700.0
# Rotations after which chatter that has locked to the teeth comes back at most, and how exactly: no speed is quite
# constant.
LOCKED_FOR, LOCKED_WITHIN = 8, 0.003
# Logarithms of the factorials of numbers up to that of the lines.
LOG_FACTORIAL = gammaln(np.arange(max(STRONGEST, MANY) + 1) + 1)


@dataclass(frozen=True, slots=True)
class Lines:
    """Lines of a spectrum, strongest first: frequencies and their tolerances (Hz)."""

    frequency_hz: NDArray[np.float64]
    tolerance_hz: NDArray[np.float64]

    def at(self, number: int | np.intp) -> tuple[float, float]:
        """Frequency and tolerance of one of them."""
        return float(self.frequency_hz[number]), float(self.tolerance_hz[number])

    def on(self, fundamental_hz: float) -> NDArray[np.bool_]:
        """Which lines are on multiples of a frequency."""
        return self.beside(0.0, fundamental_hz) & (np.round(self.frequency_hz / fundamental_hz) >= 1)

    def beside(self, hertz: float, spacing_hz: float) -> NDArray[np.bool_]:
        """Which lines are so many spacings from a frequency, any number of them."""
        away = self.frequency_hz - hertz
        near: NDArray[np.bool_] = np.abs(away - np.round(away / spacing_hz) * spacing_hz) <= self.tolerance_hz
        return near

    def without(self, some: NDArray[np.bool_]) -> Lines:
        """The other lines."""
        return Lines(self.frequency_hz[~some], self.tolerance_hz[~some])

    def orders(self, fundamental_hz: float) -> NDArray[np.int64]:
        """Orders of the lines on multiples of a frequency, ascending."""
        return np.unique(np.round(self.frequency_hz[self.on(fundamental_hz)] / fundamental_hz).astype(np.int64))


@dataclass(frozen=True, slots=True)
class Led:
    """Lines of a stretch that was read in step with one of them: what turns along is narrow there (`kernels.in_step`).

    Attributes
    ----------
    lines : Lines
        Faint ones, too.
    leader_hz : float
        Mean frequency of the line that was in step.
    start : float
        Its frequency at the beginning, as a part of that.
    """

    lines: Lines
    leader_hz: float
    start: float

    def evidence(self) -> Lines:
        """Lines that tell what turns: not the overtones of the strongest, which are in step with it whatever it is."""
        hertz = self.lines.frequency_hz
        if not len(hertz):
            return self.lines
        return self.lines.without(self.lines.on(hertz[0]) & (hertz > 1.5 * hertz[0]))

    def admits(self, fundamental_hz: float) -> bool:
        """Whether the line that was in step is beside a comb of this fundamental, or one of its first multiples."""
        leader = int(np.argmin(np.abs(self.lines.frequency_hz - self.leader_hz)))
        return not self.lines.on(fundamental_hz)[leader] or self.leader_hz < (HIGHEST_STEP + 0.5) * fundamental_hz


@dataclass(frozen=True, slots=True)
class Target:
    """What comb to look for.

    Attributes
    ----------
    low_hz, high_hz : float
        Range of its fundamental.
    teeth : int, optional
        Of the spindle whose speed the range is about.
    """

    low_hz: float
    high_hz: float
    teeth: int | None = None

    @property
    def has_teeth(self) -> bool:
        """Whether it is a known spindle of several teeth: at multiples of these few lines are believed."""
        return self.teeth is not None and self.teeth > 1

    @property
    def enough(self) -> float:
        """Log odds that a comb needs."""
        return ENOUGH_TOLD if self.has_teeth else ENOUGH

    @property
    def fewest(self) -> int:
        """Lines that make a comb at least."""
        return 2 if self.has_teeth else 3

    def admits(self, fundamental_hz: float) -> bool:
        """Whether a fundamental is in the range."""
        return self.low_hz <= fundamental_hz <= self.high_hz

    def may_be(self, fundamental_hz: float) -> bool:
        """Whether a comb of this fundamental may be that of the known spindle: its rotation, teeth, or some of them."""
        alike = [n for n in range(1, (self.teeth or 1) + 1) if (self.teeth or 1) % n == 0]
        return any(self.admits(fundamental_hz / n) for n in alike)

    def stands(self, orders: NDArray[np.int64], fundamental_hz: float) -> bool:
        """Whether these orders, ascending, make a comb of this fundamental, even without any one of them.

        Lines that are all multiples of one order are a comb of that order's frequency. It has to be in the range, or
        the order has to divide the teeth of the known spindle: a self-excited vibration has overtones, too. Where
        there are teeth, two lines are enough to find them, one to go on with; and without any one of them the others
        may be multiples of one of the first multiples of the teeth. Sometimes no more is loud.
        """
        if len(orders) < (1 if self.has_teeth else self.fewest):
            return False
        common = np.empty(len(orders), np.int64)
        kernel.common_without_one(orders, common)
        if self.teeth is None:
            return bool((common * fundamental_hz <= self.high_hz).all())
        first = FIRST_MULTIPLES if self.has_teeth else 1
        at_teeth = (common % self.teeth == 0) & (common <= first * self.teeth)
        together = len(orders) == 1 or self.teeth % np.gcd.reduce(orders) == 0
        return bool(together and (at_teeth | (self.teeth % common == 0)).all())


@dataclass(frozen=True, slots=True)
class Comb:
    """Fundamental (Hz) with its standard deviation, and log odds against chance."""

    fundamental_hz: float
    fundamental_sd_hz: float
    evidence: float


@cache
def _window(samples: int) -> NDArray[np.float64]:
    """Hann window. All channels have the same ones: of 64, windows alone would take 50 MB."""
    window = np.hanning(samples)
    window.flags.writeable = False
    return window


@cache
def _tables(points: int) -> Tables:
    """What the transform of so many points takes; shared likewise."""
    tables = new_tables(points)
    for table in tables:
        table.flags.writeable = False
    return tables


class Spectrum:
    """Lines of one stretch of a signal after the other.

    Parameters
    ----------
    samples : int
        Of each stretch.
    sample_rate_hz : float
        Rate of the samples.
    lowest_hz : float
        Lines below are let alone.
    """

    def __init__(self, samples: int, sample_rate_hz: float, lowest_hz: float) -> None:
        self._window = _window(samples)
        self._rate_hz = sample_rate_hz
        self._size = max(LEAST_POINTS, 1 << (samples - 1).bit_length())
        self._bin_hz = sample_rate_hz / self._size
        self._exact_hz = EXACT_BINS * sample_rate_hz / samples
        self._windowed = np.zeros(self._size)  # and as many zeros as make a fast transform
        self._power = np.empty(self._size // 2)
        self._scratch = np.empty(kernel.FLOOR_BINS // 2)
        self._peaks = np.empty(self._size // 2, np.int64)
        self._lowest = math.ceil(lowest_hz / self._bin_hz)

    def transform(self, *pieces: NDArray[np.float64]) -> None:
        """Take in a stretch, in one piece or several."""
        begin = 0
        for samples in pieces:
            part = slice(begin, begin + len(samples))
            np.multiply(samples, self._window[part], out=self._windowed[part])
            begin = part.stop
        power_spectrum(self._windowed, _tables(self._size), new_work(self._size), self._power)

    def lines_in_step(self, leader_hz: float, *pieces: NDArray[np.float64]) -> Led | None:
        """Lines of a stretch read in step with one of them, faint ones, too; None where that leads nowhere."""
        samples = np.concatenate(pieces)
        width_hz = max(STEP_WIDTH * leader_hz, LEAST_STEP_WIDTH_HZ)
        read, work = np.empty(len(samples)), new_step_work(len(samples))
        leader = read_in_step(samples, leader_hz / self._rate_hz, width_hz / self._rate_hz, work, read)
        if math.isnan(leader):
            return None
        self.transform(read)
        return Led(self.faint_lines(), leader * self._rate_hz, start_of(work, round(START_S * self._rate_hz)))

    def lines(self) -> Lines:
        """The strongest lines of the stretch that stand out of the noise around them."""
        power = self._power
        peaks = self._peaks[: kernel.crests(power, LINE_TO_NOISE, self._lowest, self._scratch, self._peaks)]
        return self._apart(peaks[power[peaks] >= FAINTEST * power[peaks].max(initial=0.0)], STRONGEST)

    def faint_lines(self, known_hz: float | None = None) -> Lines:
        """More lines, and fainter ones, that stand out of the noise next to them: beside stronger ones, too.

        Few of them are of a comb of known fundamental.
        """
        power = self._power
        least = FAINT * power[self._lowest :].max()
        count = kernel.crests_beside(power, LINE_TO_NOISE, self._lowest, least, self._peaks)
        return self._apart(self._peaks[:count], MANY, known_hz)

    def _apart(self, peaks: NDArray[np.int64], most: int, known_hz: float | None = None) -> Lines:
        """So many lines at most, from crests of the spectrum."""
        power = self._power
        strongest = peaks[np.argsort(-power[peaks], kind="stable")][: 4 * most]
        left, middle, right = (np.log(power[strongest + shift]) for shift in (-1, 0, 1))
        frequency = (strongest + 0.5 * (left - right) / (left - 2.0 * middle + right)) * self._bin_hz
        tolerance = self._exact_hz + EXACT_SHARE * frequency
        lines = Lines(frequency, tolerance)
        if known_hz is not None:
            on = lines.on(known_hz)
            lines = lines.without(on & (np.cumsum(on) > KNOWN))
        # a line whose frequency moves has several crests
        kept = np.empty(most, np.int64)
        kept = kept[: kernel.apart(lines.frequency_hz, 3.0 * lines.tolerance_hz, kept)]
        return Lines(lines.frequency_hz[kept], lines.tolerance_hz[kept])


def find_comb(lines: Lines, target: Target) -> Comb | None:
    """The comb for which there is most evidence, None where there is not enough."""
    while len(lines.frequency_hz) >= target.fewest:
        comb = _best_comb(lines, target)
        if comb is None:
            return None
        evidence, family = _best_family(lines)
        if evidence < comb.evidence - AHEAD or not family.any():
            return comb
        lines = lines.without(family)
    return None


def find_any_comb(lines: Lines, target: Target) -> Comb | None:
    """The comb for which there is most evidence; what the mains explain is no evidence for another one.

    The mains hum, and a vibration with overtones beside that, nearly always have a low divisor in common.
    """
    comb = find_comb(lines, target)
    if comb is None or is_mains(comb.fundamental_hz):
        return comb
    hum = _hum(lines)
    return comb if hum is None else find_comb(lines.without(lines.on(hum.fundamental_hz)), target) or hum


def find_told_comb(lines: Lines, told: Target) -> Comb | None:
    """The comb of a told spindle for which there is most evidence; what the mains explain is nothing to be explained.

    The more lines there are that are not its own, the more of its own it takes to tell it from chance.
    """
    return find_comb(beside_hum(lines, told), told)


def beside_hum(lines: Lines, told: Target | None, below_hz: float = math.inf) -> Lines:
    """Lines but those that the mains explain below a frequency; all where a told spindle may turn as they hum."""
    hum = _hum(lines)
    if hum is None or (told is not None and told.may_be(hum.fundamental_hz)):
        return lines
    return lines.without(lines.on(hum.fundamental_hz) & (lines.frequency_hz < below_hz))


def _hum(lines: Lines) -> Comb | None:
    """The comb of the mains, if it is among lines."""
    for mains_hz in MAINS_HZ:
        hum = find_comb(lines, Target((1.0 - MAINS_KEEP) * mains_hz, (1.0 + MAINS_KEEP) * mains_hz))
        if hum is not None:
            return hum
    return None


def speaks_against(rival: Comb, comb: Comb | None, lines: Lines, told: Target) -> bool:
    """Whether a comb among lines says that the spindle does not turn as fast as was told.

    It cannot be that spindle's, nor the mains', there is more evidence for it than for what was found at the told speed
    (`comb`), by as much as a comb needs, and without its lines nothing is found there: another machine's comb leaves
    the spindle's.
    """
    if told.may_be(rival.fundamental_hz) or is_mains(rival.fundamental_hz):
        return False
    if comb is not None and rival.evidence < comb.evidence + ENOUGH:
        return False
    return find_comb(lines.without(lines.on(rival.fundamental_hz)), told) is None


def speaks_for(comb: Comb, rival: Comb | None, lines: Lines, told: Target) -> bool:
    """Whether a comb at a speed that was told, and doubted since, is that of that spindle after all.

    There is as much evidence for it as if no speed had been told; or, where there is more for another comb, without the
    lines of that.
    """
    if rival is None or told.may_be(rival.fundamental_hz) or comb.evidence >= rival.evidence:
        return comb.evidence > ENOUGH
    beside = find_comb(lines.without(lines.on(rival.fundamental_hz)), told)
    return beside is not None and beside.evidence > ENOUGH


def is_locked(fundamental_hz: float, rotation_hz: float) -> bool:
    """Whether a comb comes back after a few rotations, and not after one: chatter that has locked to the teeth does.

    What forces a cut is the same in every rotation, but for a gear or a belt of so simple a ratio. What regenerates may
    settle to a motion of two or more of them (Honeycutt and Schmitz, A study of milling bifurcations, 2016).
    """
    if is_mains(fundamental_hz):
        return False
    for rotations in range(2, LOCKED_FOR + 1):
        turns = rotations * fundamental_hz / rotation_hz
        nearest = round(turns)
        if nearest and nearest % rotations and abs(turns / nearest - 1.0) <= LOCKED_WITHIN:
            return True
    return False


def is_mains(fundamental_hz: float) -> bool:
    """Whether a comb of this fundamental is that of the mains, as far as can be told."""
    return any(abs(fundamental_hz / (n * mains) - 1.0) < MAINS_KEEP for mains in MAINS_HZ for n in (0.5, 1, 2))


def _best_comb(lines: Lines, target: Target) -> Comb | None:
    frequency, low_hz, high_hz = lines.frequency_hz, target.low_hz, target.high_hz
    room = int(np.sum(frequency / low_hz)) + 1
    candidates, gains, hits = np.empty(room), np.empty(room), np.empty(room, dtype=np.int64)
    made = kernel.surprise(frequency, lines.tolerance_hz, low_hz, high_hz, target.teeth or 1, candidates, gains, hits)
    gains = gains[:made] - _choices(len(frequency) - 1, hits[:made] - 1) - math.log(max(1, made))
    promising = np.flatnonzero(gains > target.enough)
    for i in promising[np.argsort(-gains[promising], kind="stable")]:
        if target.stands(lines.orders(candidates[i]), candidates[i]):
            return _fit(lines, candidates[i], float(gains[i]))
    return None


def _best_family(lines: Lines) -> tuple[float, NDArray[np.bool_]]:
    """Lines that a self-excited vibration explains best: its overtones, sidebands around them, the forced lines beside.

    Returns
    -------
    float
        Log odds against chance, counted as for a comb.
    ndarray of bool, shape (lines,)
        Which lines these are, without the forced ones.
    """
    frequency, tolerance = lines.frequency_hz, lines.tolerance_hz
    surprises = -np.log(np.minimum(1.0, PLACES * 4.0 * tolerance / frequency.max()))
    choices = _choices(len(frequency) - 2, np.arange(len(frequency)))
    family = np.empty((2, len(frequency)), np.bool_)
    evidence = kernel.best_family(frequency, tolerance, surprises, choices, family)
    return evidence, family[0]


def _choices(n: int, k: NDArray[np.int64]) -> NDArray[np.float64]:
    """Log of the number of ways to choose k of n."""
    k = np.minimum(np.maximum(k, 0), n)
    result: NDArray[np.float64] = LOG_FACTORIAL[n] - LOG_FACTORIAL[k] - LOG_FACTORIAL[n - k]
    return result


def _fit(lines: Lines, fundamental_hz: float, evidence: float) -> Comb:
    """Least squares over the comb's lines."""
    on = lines.on(fundamental_hz)
    frequency, weight = lines.frequency_hz[on], lines.tolerance_hz[on] ** -2.0
    order = np.round(frequency / fundamental_hz)
    information = float(np.sum(weight * order * order))
    fundamental = float(np.sum(weight * order * frequency)) / information
    return Comb(fundamental, information**-0.5, evidence)
