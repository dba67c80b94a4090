"""The spectrogram: a strip of tiles that scrolls, with tracked modes and orders drawn in.

A tile is logged once, when it is complete, into one of a ring of slots; what scrolls is the transform above them. So a
second of spectrogram costs its own 4 kB, and scrolling back is rerun's own.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from chatter_monitor.outlets.dashboard.plane import HIGHEST_HZ, LOWEST_HZ, axes, height
from chatter_monitor.outlets.dashboard.stream import Stream
from chatter_monitor.outlets.look import WHITE, mode_colour

ROWS_PER_OCTAVE = 24
COLUMNS = 10  # in a tile
WIDTH, HEIGHT = 400.0, 150.0  # of the plot, in units of the view
RANGE_DB = 80.0  # below the loudest so far
LOWEST_DB = -170.0  # code 0 of a pixel; a code is a decibel
QUIETEST_DB = -80.0  # of the loudest: digital silence stays dark
ORDER_COLOUR: tuple[int, ...] = (*WHITE, 110)
BIN_HZ = 10.0


class Spectrogram:
    """Draws one channel.

    Parameters
    ----------
    stream : Stream
        Where to.
    path : str
        Entity that everything lies under.
    span_s : float
        How much time the view is wide.
    """

    def __init__(self, stream: Stream, path: str, span_s: float) -> None:
        self._stream = stream
        self._path = path
        self._per_s = WIDTH / span_s
        self._begin_s: float | None = None  # what is 0 on the strip
        self._times: list[float] = []
        self._step_s = 0.0
        self._levels: list[NDArray[np.float64]] = []
        self._marks: list[tuple[float, float, tuple[int, ...]]] = []
        self._span_s = span_s
        self._slot = 0
        self._slots = self._used = 0
        self._loudest_db = QUIETEST_DB
        stream.static(
            f"{path}/axes",
            *axes(-WIDTH, 0.0, HEIGHT, {-self._per_s * s: f"{-s:g} s" if s else "now" for s in _ticks(span_s)}),
        )

    def column(
        self,
        time_s: float,
        step_s: float,
        level_db: NDArray[np.float32],
        orders_hz: Sequence[float],
        modes: Sequence[tuple[int, float]],
    ) -> None:
        """Append a column.

        Parameters
        ----------
        time_s, step_s : float
            Where it begins and how long it is.
        level_db : ndarray, shape (bins,)
            Spectrum, every 10 Hz from 0.
        orders_hz : sequence of float
            What turns.
        modes : sequence of (int, float)
            Slot and frequency of the modes that are tracked.
        """
        if self._times and abs(time_s - self._times[0] - len(self._times) * step_s) > 0.5 * step_s:
            self.flush()  # a gap: the next tile begins elsewhere
        self._times.append(time_s)
        self._step_s = step_s
        self._levels.append(_by_octave(np.asarray(level_db, np.float64)))
        x = len(self._times) - 0.5
        self._marks += [(x, hz, ORDER_COLOUR) for hz in orders_hz if LOWEST_HZ < hz < HIGHEST_HZ]
        self._marks += [(x, hz, mode_colour(mode)) for mode, hz in modes if LOWEST_HZ < hz < HIGHEST_HZ]
        if len(self._times) == COLUMNS:
            self.flush()

    def flush(self) -> None:
        """Log the tile that is being filled and scroll to its end."""
        if not self._times:
            return
        if self._begin_s is None:
            self._begin_s = self._times[0]
            self._slots = 1 + int(self._span_s / (COLUMNS * self._step_s))
        end_s = self._times[-1] + self._step_s
        levels = np.array(self._levels).T[::-1]  # highest frequency on top
        self._used = max(self._used, self._slot + 1)
        places = np.array([(x, height(hz, float(len(levels)))) for x, hz, _ in self._marks]).reshape(-1, 2)
        self._stream.at(
            end_s,
            f"{self._path}/strip/{self._slot}",
            rr.Transform3D(
                translation=((self._times[0] - self._begin_s) * self._per_s, 0.0, 0.0),
                scale=(self._step_s * self._per_s, HEIGHT / len(levels), 1.0),
            ),
            rr.DepthImage(
                np.nan_to_num(levels - LOWEST_DB, nan=0.0).clip(0, 255).astype(np.uint8),
                colormap="Grayscale",  # the colours are for what is drawn in
                depth_range=self._colours(),
            ),
            rr.Points2D(places, colors=[colour for _, _, colour in self._marks], radii=rr.Radius.ui_points(1.3)),
        )
        self._rescale(end_s, levels)
        self._stream.at(
            end_s,
            f"{self._path}/strip",
            rr.Transform3D(translation=(-(end_s - self._begin_s) * self._per_s, 0.0, 0.0)),
        )
        self._slot = (self._slot + 1) % self._slots
        self._times, self._levels, self._marks = [], [], []

    def _colours(self) -> tuple[float, float]:
        """Range of the codes that colours are for."""
        return (self._loudest_db - RANGE_DB - LOWEST_DB, self._loudest_db - LOWEST_DB)

    def _rescale(self, time_s: float, levels: NDArray[np.float64]) -> None:
        """Give all tiles in view the colours of the loudest one so far."""
        loudest_db = float(np.nanmax(levels, initial=self._loudest_db))
        if loudest_db > self._loudest_db + 1.0:
            self._loudest_db = loudest_db
            for slot in range(self._used):
                path = f"{self._path}/strip/{slot}"
                self._stream.at(time_s, path, rr.DepthImage.from_fields(depth_range=self._colours()))


def _by_octave(level_db: NDArray[np.float64]) -> NDArray[np.float64]:
    """Spectrum at rows that are equally many in each octave: the largest bin of a row, or what lies between two."""
    rows = round(ROWS_PER_OCTAVE * np.log2(HIGHEST_HZ / LOWEST_HZ))
    edges = LOWEST_HZ * 2.0 ** ((np.arange(rows + 1) - 0.5) / ROWS_PER_OCTAVE) / BIN_HZ
    between = np.interp(np.sqrt(edges[:-1] * edges[1:]), np.arange(len(level_db)), level_db)
    first = np.minimum(np.ceil(edges).astype(int), len(level_db))
    return np.array(
        [
            level_db[low:high].max() if high > low else each
            for low, high, each in zip(first[:-1], first[1:], between, strict=True)
        ]
    )


def _ticks(span_s: float) -> NDArray[np.float64]:
    """About five round numbers of seconds between 0 and the span."""
    step = min((s for s in (1, 2, 5, 10, 20, 60, 120, 300, 600, 1800)), key=lambda s: abs(s - span_s / 4))
    return np.arange(0, span_s + 1e-9, step)
