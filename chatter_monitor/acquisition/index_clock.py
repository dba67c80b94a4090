"""When a sample was heard: the sample index against the computer's clocks, and how fast the sound card really runs."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from datetime import UTC, datetime
from typing import NamedTuple, Protocol

import numpy as np

WINDOW_S = 1.0
WINDOWS = 120  # that the rate is fitted to: the slope of two minutes is known to a few millionths
FEWEST_WINDOWS = 30  # before that the rate is not told from a computer that is busy, or a server that settles


class WallClock(Protocol):
    """Tells the time of samples."""

    @property
    def sample_rate_hz(self) -> float:
        """Samples per second of signal."""
        ...

    def utc_of(self, sample: int) -> str:
        """Time of a sample in UTC, ISO 8601 with microseconds."""
        ...

    def sample_at(self, t: float) -> int:
        """Index of the sample at a time in seconds of signal."""
        ...


class _Anchor(NamedTuple):
    """A sample with its time on both clocks, and the rate at which samples follow it."""

    sample: float
    steady_s: float
    utc_s: float
    rate_hz: float


class IndexClock(WallClock):
    """The sample index of a live input, tied to the computer's clocks again and again.

    A delivery comes late by chance and never early, so of each second the least late one counts. The slope through
    those of the last two minutes is the card's rate (Theil-Sen: the median of the slopes between all pairs, which a
    quarter of wrong points does not move), the median distance from it the offset.

    The thread that takes the samples calls `restart` and `observe`. The others may ask: what they see is one anchor,
    replaced as a whole.

    Parameters
    ----------
    sample_rate_hz : float
        Rate of the index.
    steady, utc : callable
        Seconds on a clock that never jumps, and seconds since 1970.

    Attributes
    ----------
    drift_ppm : float or None
        By how many millionths the card runs faster than the computer's clock; None until it is known.
    """

    def __init__(
        self,
        sample_rate_hz: float,
        steady: Callable[[], float] = time.monotonic,
        utc: Callable[[], float] = time.time,
    ) -> None:
        self.drift_ppm: float | None = None
        self._rate_hz = sample_rate_hz
        self._steady = steady
        self._utc = utc
        self._deliveries: deque[tuple[float, float]] = deque(maxlen=WINDOWS)  # the least late one of each window
        self._best: tuple[float, float] | None = None  # of the current window
        self._window_end_s = 0.0
        self.restart(0, steady())

    @property
    def sample_rate_hz(self) -> float:
        """Nominal rate of the index."""
        return self._rate_hz

    def restart(self, sample: float, arrived_s: float) -> None:
        """Begin anew at a sample: another stretch of deliveries, perhaps from another card."""
        self.drift_ppm = None
        self._deliveries.clear()
        self._best = None
        self._window_end_s = arrived_s + WINDOW_S
        self._anchor = _Anchor(sample, arrived_s, self._utc_at(arrived_s), self._rate_hz)

    def observe(self, sample: float, arrived_s: float) -> None:
        """Take note that all samples before `sample` had been delivered at `arrived_s`."""
        if self._best is None or arrived_s - self._best[1] < (sample - self._best[0]) / self._rate_hz:
            self._best = (sample, arrived_s)
        if arrived_s >= self._window_end_s:
            self._deliveries.append(self._best)
            self._best = None
            self._window_end_s = arrived_s + WINDOW_S
            self._fit()

    def index_at(self, steady_s: float) -> float:
        """Index of the sample that is heard at a time of the steady clock."""
        anchor = self._anchor
        return anchor.sample + (steady_s - anchor.steady_s) * anchor.rate_hz

    def utc_of(self, sample: int) -> str:
        """Time of a sample in UTC, ISO 8601 with microseconds."""
        anchor = self._anchor
        utc_s = anchor.utc_s + (sample - anchor.sample) / anchor.rate_hz
        return datetime.fromtimestamp(utc_s, UTC).isoformat(timespec="microseconds")

    def sample_at(self, t: float) -> int:
        """Index of the sample at a time in seconds of signal."""
        return round(t * self._rate_hz)

    def _fit(self) -> None:
        samples, times_s = np.array(self._deliveries).T
        late_s = times_s - times_s[-1] - (samples - samples[-1]) / self._rate_hz
        slope = 0.0  # seconds by which a nominal second falls short
        if len(samples) >= FEWEST_WINDOWS:
            first, second = np.triu_indices(len(samples), 1)
            slope = float(np.median((late_s[second] - late_s[first]) / (samples[second] - samples[first])))
            slope *= self._rate_hz
            self.drift_ppm = 1e6 * (1.0 / (1.0 + slope) - 1.0)
        offset_s = float(np.median(late_s - slope * (samples - samples[-1]) / self._rate_hz))
        steady_s = float(times_s[-1]) + offset_s
        self._anchor = _Anchor(float(samples[-1]), steady_s, self._utc_at(steady_s), self._rate_hz / (1.0 + slope))

    def _utc_at(self, steady_s: float) -> float:
        return self._utc() + (steady_s - self._steady())
