"""How far vibrations swing up by themselves and come down again, in a cut that stays calm.

A mode close to its limit is driven by noise, too: it doubles its amplitude in a moment, as chatter does, and loses it
again. Nothing tells the next swing from the onset of chatter but the swings before. So for every range of frequencies
the highest amplitude is kept that went down to half by itself, without an alarm. What is no louder has not risen. But
what swings in a cut that chatters there later on was on its way to that, and says nothing of the next cut.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.heard import HERTZ
from chatter_monitor.kernels.kinds import LOUDER
from chatter_monitor.kernels.lines import ABSOLUTE_RISE, ARRIVAL, LONG_RISE, NEWS, RISE, SHARE
from chatter_monitor.kernels.options import OPTIONS

# Ranges of frequencies as wide as this (natural logarithm), from the lowest line that is looked at on.
LOWEST_HZ, WIDTH = 50.0, 0.06
RANGES = math.ceil(math.log(6400.0 / LOWEST_HZ) / WIDTH)
# An amplitude has come down when it is lower by so much (natural logarithm): half of it. It is taken for lower by a
# fifth of that in each interval in which the line is not heard: one interval alone tells little of an amplitude.
DOWN, FADES = 0.7, 0.14
# Intervals after which that counts, up to twice as many: what begins to chatter comes and goes before it stays.
LATER = 40
# By how much an amplitude that was kept is forgotten in an interval: e-fold in 20 minutes.
FORGETTING = 0.05 / 1200.0
# What has so many times the power that the cut usually has (18 dB) is beyond all swings: a lighter cut than those.
BEYOND = 64.0


class SwingState(NamedTuple):
    """Logarithms of amplitudes, an entry for each range of frequencies; minus infinity where there is nothing.

    Attributes
    ----------
    highest, here : ndarray of float64, shape (RANGES,)
        Of what came down by itself in the cuts before, and in this one; counts.
    lately, before : ndarray of float64, shape (RANGES,)
        The same within the last up to `LATER` intervals, and within as many before those; does not count yet.
    crest, now : ndarray of float64, shape (RANGES,)
        Highest amplitude since it came down last; that of this interval, or as far as it may have faded since it was
        heard.
    chattered : ndarray of bool, shape (RANGES,)
        Whether there has been an alarm there in this cut.
    clock : ndarray of int64, shape (1,)
        Intervals.
    """

    highest: np.ndarray
    here: np.ndarray
    lately: np.ndarray
    before: np.ndarray
    crest: np.ndarray
    now: np.ndarray
    chattered: np.ndarray
    clock: np.ndarray


def new_swings() -> SwingState:
    """Nothing has been heard."""
    highest, here, lately, before, crest, now = np.full((6, RANGES), -math.inf)
    chattered, clock = np.zeros(RANGES, np.bool_), np.zeros(1, np.int64)
    return SwingState(highest, here, lately, before, crest, now, chattered, clock)


@njit(**OPTIONS)
def hold_back(heard, power, usual, calm, vibrations, state):
    """Let no line have risen by more than it is beyond earlier swings, and learn from an interval.

    Parameters
    ----------
    heard : ndarray of float64, shape (n, FIELDS)
        The lines (`kernels.heard`); their rises are changed in place.
    power, usual : float
        That which they have their shares of, and that of the cut before or of a calm while of this one, 0 where it is
        not known.
    calm : bool
        Whether there is no alarm, and was none just now.
    vibrations : ndarray of VIBRATION, shape (m,)
        Those that are followed, for which of them an alarm is about.
    state : SwingState
        Changed in place.
    """
    for i in range(RANGES):
        state.highest[i] -= FORGETTING
        state.here[i] -= FORGETTING
    _count_later(state)
    _forget_onset(vibrations, state)
    if not calm:
        forget_the_last(state)
    for i in range(RANGES):
        state.now[i] -= FADES
    for i in range(heard.shape[0]):
        line = heard[i]
        here = line[SHARE] * power
        if not here > 0.0:
            continue
        amplitude = 0.5 * math.log(here)
        place = _place(line[HERTZ])
        if not (usual > 0.0 and here > BEYOND * usual):
            _limit(line, LOUDER + amplitude - max(_around(state.highest, place), _around(state.here, place)))
        if calm:
            state.now[place] = max(state.now[place], amplitude)
            state.crest[place] = max(state.crest[place], amplitude)
    for i in range(RANGES):
        if _around(state.now, i) < state.crest[i] - DOWN:
            state.lately[i] = max(state.lately[i], state.crest[i])
            state.crest[i] = state.now[i]


@njit(**OPTIONS)
def _place(hertz):
    """The range of a frequency."""
    return min(max(int(math.log(hertz / LOWEST_HZ) / WIDTH), 0), RANGES - 1)


@njit(**OPTIONS)
def _forget_onset(vibrations, state):
    """What swings in this cut where there is an alarm, or was one, is how that began, or goes on."""
    for i in range(vibrations.shape[0]):
        if vibrations[i].alarm_for > 0:
            place = _place(vibrations[i].frequency_hz)
            state.chattered[max(place - 1, 0) : min(place + 2, RANGES)] = True
    for i in range(RANGES):
        if state.chattered[i]:
            state.here[i] = state.lately[i] = state.before[i] = state.crest[i] = state.now[i] = -math.inf


@njit(**OPTIONS)
def end_cut(state):
    """The tool leaves: what is heard by now does not come down by itself, and what did counts for the next cut."""
    for i in range(RANGES):
        state.highest[i] = max(state.highest[i], state.here[i])
        state.here[i] = -math.inf
        state.chattered[i] = False
    forget_the_last(state)


@njit(**OPTIONS)
def forget_the_last(state):
    """What is heard by now does not come down by itself: the tool leaves, or there is an alarm."""
    state.crest[:] = -math.inf
    state.now[:] = -math.inf


@njit(**OPTIONS)
def _count_later(state):
    """Let what came down long enough ago count."""
    state.clock[0] += 1
    if state.clock[0] % LATER == 0:
        for i in range(RANGES):
            state.here[i] = max(state.here[i], state.before[i])
            state.before[i] = state.lately[i]
            state.lately[i] = -math.inf


@njit(**OPTIONS)
def _around(amplitudes, place):
    """The largest of a range and those next to it: a line that moves is the same."""
    largest = amplitudes[place]
    if place > 0:
        largest = max(largest, amplitudes[place - 1])
    if place + 1 < RANGES:
        largest = max(largest, amplitudes[place + 1])
    return largest


@njit(**OPTIONS)
def _limit(line, most):
    """Let a line have risen by so much at most; what has not risen stays as it is."""
    most = max(most, 0.0)
    for measure in (RISE, LONG_RISE, ABSOLUTE_RISE, NEWS, ARRIVAL):
        line[measure] = min(line[measure], most)
