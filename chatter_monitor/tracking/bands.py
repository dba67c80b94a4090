"""Octaves of the signal, each with a recursion of its own, and the choice of the modes that a frame reports.

RARMA(4, 3) has two modes. A cut has vibrations from below 100 Hz (an angle of 0.05 rad a sample at 12.8 kHz, where the
fit is ill-conditioned) to some kHz (MATHS: the paper's milling case has 95 Hz and 990 Hz at once). So the same model
is fitted to the signal and to what remains of it after halving its rate once, twice, three times. Each recursion
answers for the octave in the middle of its band, where it is well conditioned: it is at home there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

Table = Sequence[Sequence[float]]

# A mode that is reported from one octave stays with it up to this relative distance beyond the octave's edge, so that
# a vibration at the edge does not change sides with every frame.
LOYALTY = 0.1
# Two octaves that report frequencies closer than this (relative) see the same vibration.
SAME_VIBRATION = 0.03


def homes(source_rate_hz: float, octaves: range) -> list[tuple[float, float]]:
    """Frequencies that the band of each octave answers for: without gap or overlap from 0 to the top."""
    edges = [source_rate_hz / 2 ** (octave + 3) for octave in octaves[:-1]]
    tops = [source_rate_hz / 2 ** (octaves[0] + 1), *edges]
    return list(zip([*edges, 0.0], tops, strict=True))


class Vibration(NamedTuple):
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
    homes_hz : sequence of (float, float)
        Frequencies that each band answers for, from the highest octave to the lowest.
    count : int
        Slots; the weaker ones of more vibrations are left out.
    """

    def __init__(self, homes_hz: list[tuple[float, float]], count: int) -> None:
        self._homes_hz = homes_hz
        self._last: list[Vibration | None] = [None] * count
        self._present = [False] * count

    def assign(self, frequencies_hz: Table, powers: Table) -> list[Vibration | None]:
        """Vibration of each slot in a frame whose modes are these; None where there is none.

        Parameters
        ----------
        frequencies_hz, powers : sequence by band of sequence by mode of float
            A mode without a frequency has NaN.
        """
        chosen = self._distinct(self._candidates(frequencies_hz, powers))[: len(self._last)]
        slots: list[Vibration | None] = [None] * len(self._last)
        pairs = [
            (*self._rank(slot, known, new), slot, i)
            for slot, known in enumerate(self._last)
            if known is not None
            for i, new in enumerate(chosen)
        ]
        pairs.sort()
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

    def _candidates(self, frequencies_hz: Table, powers: Table) -> list[Vibration]:
        owned = {(known.band, known.mode) for known in self._last if known is not None}
        found = []
        for band, (low, high) in enumerate(self._homes_hz):
            for mode, middle in enumerate(frequencies_hz[band]):
                spread = LOYALTY if (band, mode) in owned else 0.0
                if low * (1.0 - spread) <= middle <= high * (1.0 + spread) and middle > 0.0:  # not where it is NaN
                    found.append(Vibration(band, mode, middle, powers[band][mode]))
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
