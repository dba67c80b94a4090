"""The spindle-synchronous part of one channel: found, followed, and taken out of the signal before the tracker.

A comb is looked for in a long stretch of the signal (`tracking.comb`), again and again while there is none, seldom when
there is one. What is found is followed through that stretch before it is used (`tracking.harmonics`), so that it is
known when its first sample comes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from chatter_monitor.tracking.comb import Comb, Lines, find_comb, find_lines
from chatter_monitor.tracking.harmonics import Harmonics
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.tracking.tracker import INTERVAL_S

Source = Literal["given", "refined", "found"]
Positive = Annotated[float, msgspec.Meta(gt=0)]

SHOWN_LINES = 8
# Standard deviation of a nominal speed: real ones are 1 to 3 % off.
NOMINAL_SD = 0.015
# Doubt about a speed that was averaged over the search window: it wanders.
START_SD = 0.002
FEWEST_CLEAR = 3  # harmonics without which a comb is being lost


class OrderSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the spindle-synchronous part is found and taken out: the table ``[orders]`` of a machine configuration.

    Attributes
    ----------
    memory_s : float
        Time over which a line has to be steady. What is taken out at each order is about 1 / (pi memory_s) Hz wide.
    window_s : float
        Stretch of signal in which a comb is looked for.
    speed_tolerance : float
        Largest relative distance of the real speed from the given one.
    slowest_hz, fastest_hz : float
        Range of the fundamental when no speed is given. Lines that are all multiples of something above `fastest_hz`
        are not taken for a comb: a self-excited vibration has overtones, too.
    lowest_hz : float
        Below this is offset and drift, not vibration.
    lost_s : float
        Time without a comb after which it is given up.
    """

    memory_s: Positive = 1.0
    window_s: Positive = 2.55
    speed_tolerance: Positive = 0.035
    slowest_hz: Positive = 5.0
    fastest_hz: Positive = 250.0
    lowest_hz: Positive = 20.0
    lost_s: Positive = 1.5


@dataclass(frozen=True, slots=True)
class OrderLine:
    """One harmonic: its order, its frequency, and its root mean square in the source's units."""

    order: int
    frequency_hz: float
    rms: float


@dataclass(frozen=True, slots=True)
class Orders:
    """What turned with the spindle in one frame.

    Attributes
    ----------
    first_sample : int
        Of the frame.
    rotation_hz, rotation_sd_hz : float or None
        Fundamental of the comb with its standard deviation; None while nothing is known. With a given speed it is the
        spindle's rotation; a found one may be the tooth passing frequency.
    source : "given", "refined", "found" or None
        Whether it is the given speed as it came, that speed refined by the signal, or comes from the signal alone.
    synchronous_share : float
        Share of the frame's power that was taken out.
    lines : tuple of OrderLine
        What was taken out, strongest first, at most `SHOWN_LINES`.
    """

    first_sample: int
    rotation_hz: float | None
    rotation_sd_hz: float | None
    source: Source | None
    synchronous_share: float
    lines: tuple[OrderLine, ...] = ()


class OrderTracker:
    """Takes the spindle-synchronous part out of one channel, sample by sample, without delay.

    Parameters
    ----------
    settings : OrderSettings
        Memory, windows, ranges.
    sample_rate_hz : float
        Rate of the samples.
    spindle : SpindleSettings
        Speed and teeth, where known.
    """

    def __init__(self, settings: OrderSettings, sample_rate_hz: float, spindle: SpindleSettings) -> None:
        self._settings = settings
        self._rate_hz = sample_rate_hz
        self._spindle = spindle
        self._size = round(INTERVAL_S * sample_rate_hz)
        self._samples = np.empty(self._size)
        self._residual = np.empty(self._size)
        self._filled = 0
        self._next_sample = 0
        self._frames = 0
        self._past = np.zeros((math.floor(settings.window_s / INTERVAL_S), self._size))
        self._heard = 0  # frames of the past that can be looked through
        self._harmonics: Harmonics | None = None
        self._faint_frames = 0
        self._rival: Comb | None = None

    def set_spindle(self, spindle: SpindleSettings) -> None:
        """Go by another speed or number of teeth, from the next frame on."""
        self._spindle = spindle
        if self._harmonics is not None and not self._in_range(self._harmonics.rotation_hz):
            self._harmonics = None

    def process(self, first_sample: int, samples: NDArray[np.float64]) -> tuple[NDArray[np.float64], list[Orders]]:
        """Take in the next samples.

        Parameters
        ----------
        first_sample : int
            Index of the first one; samples that were skipped since the last call count as missing.
        samples : ndarray of float64, shape (n,)
            The signal; NaN for what is missing.

        Returns
        -------
        ndarray of float64, shape (n,)
            The samples without the synchronous part.
        list of Orders
            Of the frames that have ended, on the fixed grid of the sample index.
        """
        frames: list[Orders] = []
        while self._next_sample < first_sample:
            self._take(np.full(min(self._size, first_sample - self._next_sample), np.nan), frames)
        return self._take(samples, frames), frames

    def finish(self) -> list[Orders]:
        """What can be said of the last, shorter frame."""
        return [self._frame()] if self._filled else []

    def _take(self, samples: NDArray[np.float64], frames: list[Orders]) -> NDArray[np.float64]:
        residual = np.empty(len(samples))
        begin = 0
        while begin < len(samples):
            size = min(len(samples) - begin, self._size - self._filled)
            rows = slice(self._filled, self._filled + size)
            self._samples[rows] = samples[begin : begin + size]
            if self._harmonics is None:
                self._residual[rows] = self._samples[rows]
            else:
                self._harmonics.subtract(self._samples[rows], self._residual[rows])
            residual[begin : begin + size] = self._residual[rows]
            self._filled += size
            self._next_sample += size
            begin += size
            if self._filled == self._size:
                frames.append(self._frame())
                self._end_frame()
        return residual

    def _end_frame(self) -> None:
        """Learn from a full frame, and look for a comb when it is time."""
        self._filled = 0
        self._frames += 1
        if self._harmonics is not None:
            self._harmonics.learn()
            self._faint_frames = 0 if self._harmonics.clear >= FEWEST_CLEAR else self._faint_frames + 1
            lost = self._faint_frames * INTERVAL_S > self._settings.lost_s
            if lost or not self._in_range(self._harmonics.rotation_hz):
                self._harmonics = None
        present = np.abs(self._samples) < np.inf
        self._past[self._frames % len(self._past)] = np.where(present, self._samples, 0.0)
        self._heard = min(self._heard + 1, len(self._past)) if present.all() else 0
        if self._heard == len(self._past) and self._frames % self._search_frames() == 0:
            self._search()

    def _search_frames(self) -> int:
        """Frames from one search to the next: half of its window, and seldom while there is a comb."""
        half = len(self._past) // 2
        return half if self._harmonics is None or self._rival is not None else 4 * half

    def _range(self) -> tuple[float, float]:
        """Where the fundamental may be."""
        rpm = self._spindle.speed_rpm
        if rpm is None:
            return self._settings.slowest_hz, self._settings.fastest_hz
        return rpm / 60.0 * (1.0 - self._settings.speed_tolerance), rpm / 60.0 * (1.0 + self._settings.speed_tolerance)

    def _in_range(self, rotation_hz: float) -> bool:
        low, high = self._range()
        return low <= rotation_hz <= high

    def _search(self) -> None:
        """Look through the past for a comb; one that is new has to turn up twice when another is being followed."""
        newest = self._frames % len(self._past)
        past = np.concatenate([self._past[newest + 1 :].ravel(), self._past[: newest + 1].ravel()])
        lines = find_lines(past, self._rate_hz, self._settings.lowest_hz)
        known = self._spindle.speed_rpm is not None
        comb = find_comb(lines, *self._range(), self._spindle.teeth if known else None)
        rival, self._rival = self._rival, None
        if comb is None:
            return
        if self._harmonics is not None:
            if not _better(comb, self._harmonics.rotation_hz, lines):
                return
            if rival is None or abs(rival.fundamental_hz - comb.fundamental_hz) > 0.003 * comb.fundamental_hz:
                self._rival = comb
                return
        self._harmonics = self._follow(comb, past)
        self._faint_frames = 0

    def _follow(self, comb: Comb, past: NDArray[np.float64]) -> Harmonics:
        """Follow a comb from the start of the past to now."""
        harmonics = Harmonics(
            comb.fundamental_hz,
            max(comb.fundamental_sd_hz, START_SD * comb.fundamental_hz),
            self._rate_hz,
            memory_s=self._settings.memory_s,
            lowest_hz=self._settings.lowest_hz,
        )
        for samples in past.reshape(-1, self._size):
            harmonics.subtract(samples, np.empty(self._size))
            harmonics.learn()
        return harmonics

    def _frame(self) -> Orders:
        """Describe the frame that has come in so far."""
        first_sample = self._next_sample - self._filled
        harmonics, rpm = self._harmonics, self._spindle.speed_rpm
        if harmonics is None:
            if rpm is None:
                return Orders(first_sample, None, None, None, 0.0)
            return Orders(first_sample, rpm / 60.0, NOMINAL_SD * rpm / 60.0, "given", 0.0)
        rotation_hz = harmonics.rotation_hz
        return Orders(
            first_sample,
            rotation_hz,
            harmonics.rotation_sd_hz,
            "found" if rpm is None else "refined",
            self._synchronous_share(),
            tuple(OrderLine(order, order * rotation_hz, rms) for order, rms in harmonics.strongest(SHOWN_LINES)),
        )

    def _synchronous_share(self) -> float:
        """Share of the frame's power that was taken out."""
        samples, residual = self._samples[: self._filled], self._residual[: self._filled]
        present = np.abs(samples) < np.inf
        before = float(np.var(samples[present])) if present.any() else 0.0
        if before == 0.0:
            return 0.0
        return max(0.0, 1.0 - float(np.var(residual[present])) / before)


def _better(comb: Comb, rotation_hz: float, lines: Lines) -> bool:
    """Whether a comb explains lines of at least twice the power that the present one explains."""
    off = np.abs(lines.frequency_hz - np.round(lines.frequency_hz / rotation_hz) * rotation_hz)
    return comb.power > 2.0 * float(lines.power[off <= lines.tolerance_hz].sum())
