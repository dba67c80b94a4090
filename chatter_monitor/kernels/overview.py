"""What all vibrations of an interval come to: which of them an opinion is about, and how much power is whose."""

import math
from typing import NamedTuple

from numba import njit

from chatter_monitor.kernels.kinds import coherence_damping, steady_share
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.testimony import witness
from chatter_monitor.kernels.vibration import NO_LINE
from chatter_monitor.kernels.vibrations import (
    SURELY_ON,
    SUSPECT_SHARE,
    chattered_just_now,
    climbs,
    follow_all,
    suspicion_of,
)

NONE = -1

# What may be on its way to chatter is louder by so much than it has been for seconds (natural logarithm), coherent as
# a mode of so much damping, and with at least such a probability nothing that turns explains it.
RISES, NARROW, MAYBE = 0.6, 0.006, 0.35


class Overview(NamedTuple):
    """What they come to.

    Attributes
    ----------
    suspicion, heard_suspicion : float
        Probability that the most suspicious has risen and that nothing that turns explains it; that of the suspect.
    alarm, suspect, riser, steadiest, loudest_chattered : int
        Number of the one that the running alarm began with; of the most suspicious that is heard and takes
        `SUSPECT_SHARE`; of that which takes as much and most of what has got louder; of that with most steady power,
        which is none of what has chattered, for that dies down as calmly; of that with most power of what has. `NONE`
        where there is none.
    steady_share, chattered_share : float
        Shares of the power that are steady, and in lines of what has chattered.
    """

    suspicion: float = 0.0
    heard_suspicion: float = 0.0
    alarm: int = NONE
    suspect: int = NONE
    riser: int = NONE
    steadiest: int = NONE
    loudest_chattered: int = NONE
    steady_share: float = 0.0
    chattered_share: float = 0.0


@njit(**OPTIONS)
def overview(vibrations, lines):
    """Look over vibrations after an interval, an array of VIBRATION, and its lines, an array of LINE.

    Returns what an `Overview` consists of. To make a named tuple for its caller Numba calls Python, and minds no
    exception there: a keyboard interrupt in that moment ended the process with a segmentation fault.
    """
    suspicion = heard_suspicion = 0.0
    alarm = suspect = riser = steadiest = loudest_chattered = NONE
    longest = 0
    most = steady = loudest = chattered = 0.0
    largest = SUSPECT_SHARE
    for i in range(vibrations.shape[0]):
        vibration = vibrations[i]
        suspicious = suspicion_of(vibration)
        suspicion = max(suspicion, suspicious)
        if vibration.alarm_for > longest:
            alarm, longest = i, vibration.alarm_for
        if vibration.line == NO_LINE:
            continue
        if suspect == NONE and vibration.dominance >= SUSPECT_SHARE:
            suspect, heard_suspicion = i, suspicious
        line = lines[vibration.line]
        if vibration.dominance >= largest and _rises(vibration, line):
            riser, largest = i, vibration.dominance
        if vibration.chattered:
            chattered += line.share
            if line.share > loudest:
                loudest_chattered, loudest = i, line.share
            continue
        own = steady_share(line.share, line.variation)
        steady += own
        if own > most:
            steadiest, most = i, own
    return suspicion, heard_suspicion, alarm, suspect, riser, steadiest, loudest_chattered, steady, chattered


@njit(**OPTIONS)
def _rises(vibration, line):
    """Whether it has got louder, is narrow, and nothing that turns may explain it."""
    narrow = coherence_damping(line.coherence, line.frequency_hz) < NARROW
    return narrow and vibration.rise > RISES and vibration.unexplained > MAYBE


@njit(**OPTIONS)
def forced_at(vibrations, frequency_hz, reach):
    """Whether one of them, within so much of a frequency (natural logarithm), is rather forced than not.

    Forced is what was steady from the start, or has risen and is explained.
    """
    for i in range(vibrations.shape[0]):
        vibration = vibrations[i]
        forced = vibration.steady + (vibration.growing + vibration.saturated) * (1.0 - vibration.unexplained)
        if forced > 0.5 and abs(math.log(vibration.frequency_hz / frequency_hz)) < reach:
            return True
    return False


@njit(**OPTIONS)
def alarm_climbs(vibrations):
    """Whether any that an alarm is about has come to its height by and by."""
    climbing = False
    for i in range(vibrations.shape[0]):
        climbing |= vibrations[i].alarm_for > 0 and climbs(vibrations[i])
    return climbing


@njit(**OPTIONS)
def only_orders_chattered(vibrations):
    """Whether an alarm was about any just now, and all of these are on orders."""
    orders = 0
    for i in range(vibrations.shape[0]):
        if chattered_just_now(vibrations[i]):
            if vibrations[i].order_odds >= SURELY_ON:
                return False
            orders += 1
    return orders > 0


@njit(**OPTIONS)
def another_interval(vibrations, known, testimony, rules, weights, lines, taken, work):
    """Follow every vibration through an interval; return how many there are, and what makes up an `Overview`.

    Parameters
    ----------
    testimony : tuple
        What `witness` is told of the interval's lines, but for the odds.
    lines : ndarray of LINE, shape (>= m,)
        Work space. All else is as `follow_all` takes it.
    """
    witness(*testimony, rules.odds, lines)
    lines = lines[: testimony[0].shape[0]]
    known = follow_all(vibrations, known, lines, rules, weights, taken, work)
    return known, overview(vibrations[:known], lines)
