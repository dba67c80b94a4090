"""How far vibrations swing up by themselves and come down again, in a cut that stays calm.

A mode close to its limit is driven by noise, too: it doubles its amplitude in a moment, as chatter does, and loses it
again. Nothing tells the next swing from the onset of chatter but the swings before. So for every range of frequencies
the highest amplitude is kept that went down to half by itself, without an alarm. What is no louder has not risen. But
what swings in a cut that chatters there later on was on its way to that, and says nothing of the next cut.

Where the first swing that is heard has been taken for chatter, every later one would be, too. But chatter keeps its
amplitude, from the moment that it is limited, and what noise drives does not. So what has come down by itself after an
alarm within which it came and went like noise has swung, however far: not the first time, but when that happens again.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.heard import HERTZ
from chatter_monitor.kernels.kinds import LOUDER
from chatter_monitor.kernels.lines import ABSOLUTE_RISE, ARRIVAL, LONG_RISE, NEWS, RISE, SHARE
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.prominence import TINY
from chatter_monitor.kernels.testimony import is_carrier
from chatter_monitor.kernels.vibrations import explain

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
# Like noise: the logarithm of its mean power is above the mean of its logarithm by so much, within a second and since
# it was highest; that is Euler's constant, 0.58, if it comes and goes many times in it. Of chatter it is 0.2 at most,
# nearly always, in an unsteady cut, too.
DISPERSED = 0.4
# Intervals in that second, and those after an alarm within which the tool would have left, if that was why it ended.
SECOND, SINCE = 20, 10
# Intervals of which something can be said, each counted as far as the averages of a second had settled in it: what one
# second has of them.
ENOUGH = SECOND * math.exp(-1.0)


class SwingState(NamedTuple):
    """Logarithms of amplitudes, an entry for each range of frequencies; minus infinity where there is nothing.

    Attributes
    ----------
    highest, here : ndarray of float64, shape (RANGES,)
        Of what came down by itself in the cuts before, and in this one; counts.
    alarmed : ndarray of float64, shape (RANGES,)
        Highest of what came down by itself after one alarm in which it was like noise.
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
    alarmed: np.ndarray
    lately: np.ndarray
    before: np.ndarray
    crest: np.ndarray
    now: np.ndarray
    chattered: np.ndarray
    clock: np.ndarray


def new_swings() -> SwingState:
    """Nothing has been heard."""
    highest, here, alarmed, lately, before, crest, now = np.full((7, RANGES), -math.inf)
    chattered, clock = np.zeros(RANGES, np.bool_), np.zeros(1, np.int64)
    return SwingState(highest, here, alarmed, lately, before, crest, now, chattered, clock)


@njit(**OPTIONS)
def hold_back(heard, power, usual, calm, carrier, vibrations, state):
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
    carrier : Carrier
        What noise drives has no sidebands. So when a line that has came with the tool it was not there before, however
        far it has swung since.
    vibrations : ndarray of VIBRATION, shape (m,)
        Those that are followed, for which of them an alarm is about.
    state : SwingState
        Changed in place.
    """
    for i in range(RANGES):
        state.highest[i] -= FORGETTING
        state.here[i] -= FORGETTING
        state.alarmed[i] -= FORGETTING
    _count_later(state)
    _forget_onset(vibrations, state)
    _learn_from_alarms(heard, power, vibrations, state)
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
            most = LOUDER + amplitude - max(_around(state.highest, place), _around(state.here, place))
            _limit(line, most, is_carrier(heard, i, carrier))
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
def _learn_from_alarms(heard, power, vibrations, state):
    """What came and went like noise in an alarm, and came down by itself, has swung so far, if not for the first time.

    That is asked some time after the alarm, in the same cut; until then the tool may have been about to leave. An alarm
    that began by the memory of another goes on with that: noise comes back for so short a time that one alone does not
    tell.
    """
    for i in range(vibrations.shape[0]):
        vibration = vibrations[i]
        alarm = vibration.alarm_for > 0
        if not (alarm or (vibration.chattered and vibration.over == SINCE)):
            continue
        place = _place(vibration.frequency_hz)
        here = power * _largest_share(heard, place)
        if alarm:
            _disperse(vibration, here)
        elif _swung(vibration, here):
            before = _around(state.alarmed, place)
            state.alarmed[place] = max(before, vibration.crest)
            if before > -math.inf:
                state.highest[place] = max(state.highest[place], state.alarmed[place])
            state.chattered[max(place - 1, 0) : min(place + 2, RANGES)] = False
            explain(vibration)


@njit(**OPTIONS)
def _disperse(vibration, power):
    """Tell how far what an alarm is about, with those whose memory it needed, comes and goes."""
    if vibration.alarm_for == 1:
        vibration.crest = -math.inf
        if not vibration.recalled:
            vibration.dispersion = vibration.listened = 0.0
    if not power > 0.0:
        return
    logarithm = math.log(power)
    if 0.5 * logarithm > vibration.crest:  # to grow is not to come and go
        vibration.crest, vibration.mean, vibration.logarithm = 0.5 * logarithm, power, logarithm
        vibration.settled = 0.0
    vibration.mean += (power - vibration.mean) / SECOND
    vibration.logarithm += (logarithm - vibration.logarithm) / SECOND
    vibration.settled += (1.0 - vibration.settled) / SECOND
    vibration.listened += vibration.settled
    beyond = math.log(vibration.mean) - vibration.logarithm - vibration.settled * vibration.dispersion
    vibration.dispersion += beyond / vibration.listened


@njit(**OPTIONS)
def _swung(vibration, power):
    """Whether it came and went like noise in the alarms about it, and has come down to this power since the last."""
    return (
        vibration.listened >= ENOUGH
        and vibration.dispersion > DISPERSED
        and 0.5 * math.log(power + TINY) < vibration.crest - DOWN
    )


@njit(**OPTIONS)
def _largest_share(heard, place):
    """That which the loudest line in a range or next to it has of the power, 0 without one."""
    loudest = 0.0
    for i in range(heard.shape[0]):
        if abs(_place(heard[i, HERTZ]) - place) <= 1:
            loudest = max(loudest, heard[i, SHARE])
    return loudest


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
def _limit(line, most, carrier):
    """Let a line have risen by so much at most, and have come by no more but for a carrier; what has not stays so."""
    most = max(most, 0.0)
    for measure in (RISE, LONG_RISE, ABSOLUTE_RISE, NEWS):
        line[measure] = min(line[measure], most)
    if not carrier:
        line[ARRIVAL] = min(line[ARRIVAL], most)
