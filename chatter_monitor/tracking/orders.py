"""The spindle-synchronous part of one channel: found, followed, and taken out of the signal before the tracker.

Two clocks: every tile (one verdict interval) the harmonic series is predicted, subtracted and corrected
(`kernels.orders`); once in a while a long stretch of the signal is looked through for a comb (`tracking.comb`), to
begin, to begin anew, or to be sure. A comb that is found is followed through that stretch before it is used, so that
it is known when its first tile comes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from chatter_monitor.kernels import orders as kernel
from chatter_monitor.tracking.comb import Comb, Lines, find_comb, find_lines
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.tracking.tracker import INTERVAL_S

Source = Literal["given", "refined", "found"]
Positive = Annotated[float, msgspec.Meta(gt=0)]

MOST_ORDERS = 256  # above that the series of a slow spindle ends
SHOWN_LINES = 8
# Standard deviation of a nominal speed: real ones are 1 to 3 % off.
NOMINAL_SD = 0.015
# Relative change of speed in a second that is nothing special, and doubt about a speed averaged over the search window.
WANDER = 0.003
START_SD = 0.001
FEWEST_CLEAR = 2  # harmonics without which a comb is being lost


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
        self._memory = max(2, round(settings.memory_s / INTERVAL_S))
        self._samples = np.empty(self._size)
        self._prediction = np.zeros(self._size)
        self._filled = 0
        self._next_sample = 0
        self._tiles = 0
        self._past = np.zeros((math.floor(settings.window_s / INTERVAL_S), self._size))
        self._heard = 0  # tiles of the past that can be looked through
        self._series: kernel.OrderState | None = None
        self._source: Source | None = None
        self._faint_tiles = 0
        self._rival: Comb | None = None

    def set_spindle(self, spindle: SpindleSettings) -> None:
        """Go by another speed or number of teeth, from the next tile on."""
        if spindle == self._spindle:
            return
        self._spindle = spindle
        if self._series is not None:
            self._source = "found" if spindle.speed_rpm is None else "refined"
            if not self._in_range(self._hertz(self._series)):
                self._lose()

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
            residual[begin : begin + size] = self._samples[rows] - self._prediction[rows]
            self._filled += size
            self._next_sample += size
            begin += size
            if self._filled == self._size:
                frames.append(self._frame())
                self._end_tile()
        return residual

    def _end_tile(self) -> None:
        """Learn from a full tile, look for a comb when it is time, and predict the next tile."""
        self._filled = 0
        self._tiles += 1
        present = np.abs(self._samples) < np.inf
        whole = bool(present.all())
        if self._series is not None:
            if 2 * np.count_nonzero(present) > self._size:
                residual = np.where(present, self._samples - self._prediction, 0.0)
                self._follow(self._series, residual - residual.mean())
            else:
                kernel.coast(self._size, self._series, self._drift(self._series))
        self._past[self._tiles % len(self._past)] = np.where(present, self._samples, 0.0)
        self._heard = min(self._heard + 1, len(self._past)) if whole else 0
        if self._heard == len(self._past) and self._tiles % self._search_tiles() == 0:
            self._search()
        if self._series is None:
            self._prediction[:] = 0.0
        else:
            kernel.predict(self._series, self._prediction)

    def _search_tiles(self) -> int:
        """Tiles from one search to the next: half of its window, and seldom while there is a comb."""
        half = len(self._past) // 2
        return half if self._series is None or self._rival is not None else 4 * half

    def _follow(self, series: kernel.OrderState, residual: NDArray[np.float64]) -> None:
        lowest = math.ceil(self._settings.lowest_hz / self._hertz(series))
        clear = kernel.follow(residual, series, lowest, self._memory, self._drift(series))
        self._faint_tiles = 0 if clear >= FEWEST_CLEAR else self._faint_tiles + 1
        if self._faint_tiles * INTERVAL_S > self._settings.lost_s or not self._in_range(self._hertz(series)):
            self._lose()

    def _drift(self, series: kernel.OrderState) -> float:
        """Variance per sample of the speed's random walk."""
        return float((WANDER * series.angle[kernel.SPEED]) ** 2 / self._rate_hz)

    def _lose(self) -> None:
        self._series = None
        self._source = None
        self._faint_tiles = 0

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
        newest = self._tiles % len(self._past)
        past = np.concatenate([self._past[newest + 1 :].ravel(), self._past[: newest + 1].ravel()])
        lines = find_lines(past, self._rate_hz, self._settings.lowest_hz)
        known = self._spindle.speed_rpm is not None
        comb = find_comb(lines, *self._range(), self._spindle.teeth if known else None)
        rival, self._rival = self._rival, None
        if comb is None:
            return
        if self._series is not None:
            if not _better(comb, self._hertz(self._series), lines):
                return
            if rival is None or abs(rival.fundamental_hz - comb.fundamental_hz) > 0.003 * comb.fundamental_hz:
                self._rival = comb
                return
        self._begin(comb, past)

    def _begin(self, comb: Comb, past: NDArray[np.float64]) -> None:
        """Follow a comb from the start of the past to now."""
        orders = min(MOST_ORDERS, math.floor(0.49 * self._rate_hz / comb.fundamental_hz))
        speed = 2.0 * math.pi * comb.fundamental_hz / self._rate_hz
        sd = max(comb.fundamental_sd_hz / comb.fundamental_hz, START_SD) * speed
        self._series = series = kernel.new_state(orders, speed, sd)
        self._source = "found" if self._spindle.speed_rpm is None else "refined"
        for tile in past.reshape(-1, self._size):
            kernel.predict(series, self._prediction)
            residual = tile - self._prediction
            self._follow(series, residual - residual.mean())

    def _hertz(self, series: kernel.OrderState) -> float:
        return float(series.angle[kernel.SPEED]) * self._rate_hz / (2.0 * math.pi)

    def _frame(self) -> Orders:
        """Describe the tile that has come in so far."""
        samples = self._samples[: self._filled]
        samples = samples[np.abs(samples) < np.inf]
        first_sample = self._next_sample - self._filled
        if self._series is None:
            rpm = self._spindle.speed_rpm
            if rpm is None:
                return Orders(first_sample, None, None, None, 0.0)
            return Orders(first_sample, rpm / 60.0, NOMINAL_SD * rpm / 60.0, "given", 0.0)
        series = self._series
        rotation_hz = self._hertz(series)
        sd = math.sqrt(series.angle[kernel.SPEED_VAR]) * self._rate_hz / (2.0 * math.pi)
        rms = series.gate * np.hypot(series.real, series.imag) / math.sqrt(2.0)
        strongest = np.argsort(-rms, kind="stable")[:SHOWN_LINES]
        lines = tuple(
            OrderLine(int(i) + 1, (int(i) + 1) * rotation_hz, float(rms[i])) for i in strongest if rms[i] > 0.0
        )
        return Orders(first_sample, rotation_hz, sd, self._source, self._share(), lines)

    def _share(self) -> float:
        """Share of the tile's power that the prediction took out."""
        samples, prediction = self._samples[: self._filled], self._prediction[: self._filled]
        present = np.abs(samples) < np.inf
        before = float(np.var(samples[present])) if present.any() else 0.0
        if before == 0.0:
            return 0.0
        return min(1.0, max(0.0, 1.0 - float(np.var((samples - prediction)[present])) / before))


def _better(comb: Comb, rotation_hz: float, lines: Lines) -> bool:
    """Whether a comb explains lines of at least twice the power that the present one explains."""
    off = np.abs(lines.frequency_hz - np.round(lines.frequency_hz / rotation_hz) * rotation_hz)
    return comb.power > 2.0 * float(lines.power[off <= lines.tolerance_hz].sum())
