"""Octaves of the signal, each with a recursion of its own, and the choice of the modes that a frame reports.

RARMA(4, 3) has two modes. A cut has vibrations from below 100 Hz (an angle of 0.05 rad a sample at 12.8 kHz, where the
fit is ill-conditioned) to some kHz (MATHS: the paper's milling case has 95 Hz and 990 Hz at once). So the same model
is fitted to the signal and to what remains of it after halving its rate once, twice, three times. Each recursion
answers for the octave in the middle of its band, where it is well conditioned: it is at home there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.kernels import odp, poles, rarma, track
from chatter_monitor.kernels.share import modal_shares

# frequency, damping, their standard deviations (float32), status (uint8); shape (samples, modes) each
Columns = tuple[NDArray[Any], ...]

# A mode that is reported from one octave stays with it up to this relative distance beyond the octave's edge, so that
# a vibration at the edge does not change sides with every frame.
LOYALTY = 0.1
# Two octaves that report frequencies closer than this (relative) see the same vibration.
SAME_VIBRATION = 0.03


def new_columns(samples: int, modes: int) -> Columns:
    """Room for frequency, damping, their standard deviations, and status."""
    shape = (samples, modes)
    return (*(np.empty(shape, np.float32) for _ in range(4)), np.empty(shape, np.uint8))


class Band:
    """One recursion on the signal halved ``octave`` times.

    Parameters
    ----------
    orders : (int, int)
        Of A and C.
    memory_s : float
        Time constant of the forgetting.
    source_rate_hz : float
        Rate of the signal before halving.
    octave : int
        How often the rate is halved.
    interval : int
        Samples of the source in a frame.
    home_hz : (float, float)
        Frequencies that this band answers for.
    """

    def __init__(
        self,
        orders: tuple[int, int],
        memory_s: float,
        source_rate_hz: float,
        octave: int,
        interval: int,
        home_hz: tuple[float, float],
    ) -> None:
        self.octave = octave
        self.home_hz = home_hz
        self._orders = orders
        self._rate_hz = source_rate_hz / 2**octave
        self._forgetting = 1.0 - 1.0 / (memory_s * self._rate_hz)
        self._recursion = rarma.new_state(*orders)
        self._poles = poles.new_state(orders[0])
        self._tile = odp.new_tile(orders[0])
        self._columns = new_columns(2 + interval // 2**octave, orders[0] // 2)  # row 0 is the last of the frame before
        for column in self._columns[:4]:
            column[0] = np.nan
        self._columns[4][0] = track.STARTING
        self._filled = 1
        self._shares = np.zeros(orders[0] // 2)

    def process(self, signal: NDArray[np.float64]) -> None:
        """Take samples at the band's rate."""
        rows = slice(self._filled, self._filled + len(signal))
        out = tuple(column[rows] for column in self._columns)
        track.track(
            *self._orders, signal, self._recursion, self._poles, self._tile, self._forgetting, self._rate_hz, out
        )
        self._filled += len(signal)

    @property
    def columns(self) -> Columns:
        """Values since the last frame, at the band's rate; row 0 is the last one before."""
        return tuple(column[: self._filled] for column in self._columns)

    def rows(self, first_sample: int, samples: int) -> NDArray[np.intp]:
        """Row of `columns` that holds at each sample of the source in a frame, which ends at the last one processed."""
        decimation = 2**self.octave  # the first of so many samples makes an output
        made: NDArray[np.intp] = np.arange(first_sample, first_sample + samples) // decimation
        made -= (first_sample - 1) // decimation
        return made

    def next_frame(self) -> None:
        """Keep the last values only."""
        for column in self._columns:
            column[0] = column[self._filled - 1]
        self._filled = 1

    def powers(self) -> NDArray[np.float64]:
        """Power of each mode at this moment, by the model and the recent power of the band's signal."""
        p, q = self._orders
        if self._poles.known[0]:
            modal_shares(p, q, self._recursion.theta, self._poles.factors, self._poles.roots, self._shares)
        power: float = self._recursion.level[rarma.POWER]
        return self._shares * power


def homes(source_rate_hz: float, octaves: range) -> list[tuple[float, float]]:
    """Frequencies that the band of each octave answers for: without gap or overlap from 0 to the top."""
    edges = [source_rate_hz / 2 ** (octave + 3) for octave in octaves[:-1]]
    tops = [source_rate_hz / 2 ** (octaves[0] + 1), *edges]
    return list(zip([*edges, 0.0], tops, strict=True))


@dataclass(frozen=True, slots=True)
class Vibration:
    """One mode of one band in a frame: a candidate for a slot."""

    band: int
    mode: int
    frequency_hz: float
    power: float

    def distance(self, later: Vibration) -> float:
        """How far a vibration of a later frame is, as the logarithm of the frequencies' ratio."""
        return abs(math.log(later.frequency_hz / self.frequency_hz))

    def is_mode_of(self, later: Vibration) -> bool:
        """Whether the recursion takes both for the same mode."""
        return (self.band, self.mode) == (later.band, later.mode)


class Slots:
    """Gives each vibration of a frame a slot that it keeps from frame to frame, whichever band sees it best.

    Parameters
    ----------
    bands : sequence of Band
        From the highest octave to the lowest.
    count : int
        Slots; the weaker ones of more vibrations are left out.
    """

    def __init__(self, bands: list[Band], count: int) -> None:
        self._bands = bands
        self._last: list[Vibration | None] = [None] * count
        self._present = [False] * count

    def assign(self, rows: list[NDArray[np.intp]]) -> list[Vibration | None]:
        """Vibration of each slot in a frame that shows these rows of each band; None where there is none."""
        chosen = self._distinct(self._candidates(rows))[: len(self._last)]
        slots: list[Vibration | None] = [None] * len(self._last)
        pairs = sorted(
            (*self._rank(slot, known, new), slot, i)
            for slot, known in enumerate(self._last)
            if known is not None
            for i, new in enumerate(chosen)
        )
        placed: set[int] = set()
        for *_, slot, i in pairs:
            if slots[slot] is None and i not in placed:
                slots[slot] = chosen[i]
                placed.add(i)
        free = (slot for slot, taken in enumerate(slots) if taken is None)
        for i, new in enumerate(chosen):
            if i not in placed:
                slots[next(free)] = new
        self._last = [new or known for new, known in zip(slots, self._last, strict=True)]
        self._present = [new is not None for new in slots]
        return slots

    def _rank(self, slot: int, known: Vibration, new: Vibration) -> tuple[int, float]:
        """What goes on before what comes back.

        Of what goes on, the recursion's own mode goes first, then the strongest that is near: when another octave takes
        a vibration over, a weak mode beside it may happen to be nearer.
        """
        distance = known.distance(new)
        if not self._present[slot] or distance > LOYALTY:
            return 2, distance
        return (0, distance) if known.is_mode_of(new) else (1, -known.power)

    def _candidates(self, rows: list[NDArray[np.intp]]) -> list[Vibration]:
        owned = {(known.band, known.mode) for known in self._last if known is not None}
        found = []
        for index, (band, shown) in enumerate(zip(self._bands, rows, strict=True)):
            frequency, *_, status = (column[shown[0] :] for column in band.columns)
            low, high = band.home_hz
            powers = band.powers().tolist()
            for mode, power in enumerate(powers):
                known = frequency[status[:, mode] != track.STARTING, mode]
                known = known[~np.isnan(known)]
                if 2 * len(known) <= len(frequency):
                    continue
                middle = float(np.partition(known, len(known) // 2)[len(known) // 2])
                spread = LOYALTY if (index, mode) in owned else 0.0
                if low * (1.0 - spread) <= middle <= high * (1.0 + spread) and middle > 0.0:
                    found.append(Vibration(index, mode, middle, power))
        return found

    def _distinct(self, candidates: list[Vibration]) -> list[Vibration]:
        """Strongest first, without what a stronger one of another band has reported already."""
        distinct: list[Vibration] = []
        for new in sorted(candidates, key=lambda vibration: -vibration.power):
            if all(
                new.band == known.band
                or abs(new.frequency_hz - known.frequency_hz) > SAME_VIBRATION * known.frequency_hz
                for known in distinct
            ):
                distinct.append(new)
        return distinct
