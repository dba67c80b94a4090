"""Which modes of which octaves a frame reports, and in which slot: `tracking.bands` tells why.

Each vibration of a frame is given a slot that it keeps from frame to frame, whichever octave sees it best.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.options import OPTIONS

# A mode that is reported from one octave stays with it up to this relative distance beyond the octave's edge, so that
# a vibration at the edge does not change sides with every frame.
LOYALTY = 0.1
# Two octaves that report frequencies closer than this (relative) see the same vibration.
SAME_VIBRATION = 0.03

# One mode of one octave in a frame: a candidate for a slot.
VIBRATION = np.dtype([("octave", np.int64), ("mode", np.int64), ("frequency", float), ("power", float)], align=True)
NOTHING = -1  # instead of an octave and its mode

# What is to go on in a slot, first things first: the recursion's own mode, then the strongest that is near, for when
# another octave takes a vibration over, a weak mode beside it may happen to be nearer. What comes back is last.
OWN, NEAR, ANY = range(3)


class Slots(NamedTuple):
    """Slots and what was in them.

    Attributes
    ----------
    homes : ndarray of float64, shape (octaves, 2)
        Frequencies that each octave answers for.
    last : ndarray of VIBRATION, shape (slots,)
        What each slot reported last.
    present : ndarray of bool, shape (slots,)
        Whether that was in the frame before.
    frequencies, powers : ndarray of float64, shape (octaves, modes)
        Modes of the frame; a mode without a frequency has NaN.
    candidates : ndarray of VIBRATION, shape (octaves modes,)
        Work space.
    placed : ndarray of bool, shape (octaves modes,)
        Likewise.
    chosen : ndarray of int64, shape (slots, 2)
        Octave and mode to be reported in each slot of the frame.
    power : ndarray of float64, shape (slots,)
        Of that mode; 0 without one.
    hold : ndarray of int64, shape (slots,)
        For how many samples of the source a value of that octave stands; of the highest octave without a mode.
    """

    homes: np.ndarray
    last: np.ndarray
    present: np.ndarray
    frequencies: np.ndarray
    powers: np.ndarray
    candidates: np.ndarray
    placed: np.ndarray
    chosen: np.ndarray
    power: np.ndarray
    hold: np.ndarray


def new_slots(homes: np.ndarray, modes: int, count: int) -> Slots:
    """Slots that have reported nothing yet; the weaker ones of more vibrations than slots are left out."""
    last = np.zeros(count, VIBRATION)
    last["octave"] = NOTHING
    octaves = len(homes)
    return Slots(
        homes=homes,
        last=last,
        present=np.zeros(count, np.bool_),
        frequencies=np.zeros((octaves, modes)),
        powers=np.zeros((octaves, modes)),
        candidates=np.zeros(octaves * modes, VIBRATION),
        placed=np.zeros(octaves * modes, np.bool_),
        chosen=np.zeros((count, 2), np.int64),
        power=np.zeros(count),
        hold=np.ones(count, np.int64),
    )


@njit(**OPTIONS)
def assign(slots):
    """Give the modes of a frame, in ``frequencies`` and ``powers``, their slots: fills ``chosen`` and ``power``."""
    last, candidates, placed = slots.last, slots.candidates, slots.placed
    count = min(_distinct(slots, _strongest_first(slots)), last.shape[0])
    slots.chosen[:] = NOTHING
    slots.power[:] = 0.0
    placed[:] = False
    while True:  # the best of the pairs that are left
        best, order, value, slot = NOTHING, ANY, math.inf, 0
        for s in range(last.shape[0]):
            if last[s].octave == NOTHING or slots.chosen[s, 0] != NOTHING:
                continue
            for i in range(count):
                if placed[i]:
                    continue
                this_order, this_value = _rank(last[s], slots.present[s], candidates[i])
                if best == NOTHING or this_order < order or (this_order == order and this_value < value):
                    best, order, value, slot = i, this_order, this_value, s
        if best == NOTHING:
            break
        _place(slots, slot, best)
    slot = 0
    for i in range(count):
        if not placed[i]:
            while slots.chosen[slot, 0] != NOTHING:
                slot += 1
            _place(slots, slot, i)
    for s in range(last.shape[0]):
        slots.present[s] = slots.chosen[s, 0] != NOTHING


@njit(**OPTIONS)
def _place(slots, slot, i):
    """Report a candidate in a slot."""
    new = slots.candidates[i]
    slots.last[slot] = new
    slots.placed[i] = True
    slots.chosen[slot, 0], slots.chosen[slot, 1] = new.octave, new.mode
    slots.power[slot] = new.power


@njit(**OPTIONS)
def _rank(known, present, new):
    """How readily a vibration goes on as another one, and the less of what goes first among equals."""
    distance = abs(math.log(new.frequency / known.frequency))
    if not present or distance > LOYALTY:
        return ANY, distance
    if known.octave == new.octave and known.mode == new.mode:
        return OWN, distance
    return NEAR, -new.power


@njit(**OPTIONS)
def _strongest_first(slots):
    """Fill the candidates with the modes that are at home in their octave, by power; returns how many there are."""
    candidates = slots.candidates
    count = 0
    for octave in range(slots.frequencies.shape[0]):
        low, high = slots.homes[octave, 0], slots.homes[octave, 1]
        for mode in range(slots.frequencies.shape[1]):
            frequency = slots.frequencies[octave, mode]
            spread = LOYALTY if _owned(slots, octave, mode) else 0.0
            if not (low * (1.0 - spread) <= frequency <= high * (1.0 + spread) and frequency > 0.0):  # or NaN
                continue
            power = slots.powers[octave, mode]
            place = count
            while place > 0 and candidates[place - 1].power < power:
                candidates[place] = candidates[place - 1]
                place -= 1
            new = candidates[place]
            new.octave, new.mode, new.frequency, new.power = octave, mode, frequency, power
            count += 1
    return count


@njit(**OPTIONS)
def _owned(slots, octave, mode):
    """Whether a slot has reported this mode."""
    owned = False
    for s in range(slots.last.shape[0]):
        owned = owned or (slots.last[s].octave == octave and slots.last[s].mode == mode)
    return owned


@njit(**OPTIONS)
def _distinct(slots, count):
    """Leave out what a stronger candidate of another octave has reported already; returns how many are left."""
    candidates = slots.candidates
    kept = 0
    for i in range(count):
        new = candidates[i]
        alone = True
        for k in range(kept):
            known = candidates[k]
            apart = abs(new.frequency - known.frequency) > SAME_VIBRATION * known.frequency
            alone = alone and (new.octave == known.octave or apart)
        if alone:
            candidates[kept] = new
            kept += 1
    return kept
