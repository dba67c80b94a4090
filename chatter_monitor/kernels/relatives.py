"""Vibrations of a channel that are in step: some are multiples of others.

Where no comb is heard, multiples of what turns are in step all the same: steady together, louder together, and faster
together.
"""

import math

from numba import njit

from chatter_monitor.kernels.multiples import FORCED_AT_TEETH, LARGEST_CHANCE, by_chance
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.vibration import AS_EVER, NO_LINE, SURELY_STEADY

# Where nothing is heard to turn a line may be a multiple, up to so many times, of another: of one that is steady for
# certain, if that would be within so much of it (Hz); or of one with less of the power that has been heard in so many
# intervals, if it nearly always was that, more nearly, until it rose. Then it is forced, unless chance would have it
# there as soon.
MULTIPLES, MULTIPLE_HZ = 8, 1.5
CARRIED_HZ, LASTED, NEARLY_ALWAYS = 0.7, 5, 0.6
# Weight of an interval in the average of how often it was.
OFTEN = 0.2
# And it is forced when it has nearly always had so many relatives that are rather steady than not, multiples of it or
# what it is a multiple of, until it got louder, still has them, and is where it was: all of a force gets louder.
FAMILY, RATHER_STEADY = 2, 0.5
# What was nearly always so near (Hz) to being in step with something that has glided has glided with it.
IN_STEP_HZ = 1.5
# What is so far from where it was steady, relatively and in Hz, is something else if no spindle has taken it along.
LEFT, LEFT_HZ = 0.01, 2.0

NO_MULTIPLE = 0


@njit(**OPTIONS)
def forced_odds(vibration, line, vibrations, lines):
    """Log odds for self-excitation of a vibration whose line this is, where nothing else tells what turns.

    Parameters
    ----------
    vibration : record of VIBRATION
        How often it was in step is learned in place.
    line : record of LINE
    vibrations, lines : ndarray of VIBRATION and of LINE
        All of the channel, this one among them.

    Returns
    -------
    float
        Infinite where none of the others says that something forces it.
    """
    return min(_multiple_odds(vibration, line, vibrations, lines), _family_odds(vibration, line, vibrations, lines))


@njit(**OPTIONS)
def taken_along(vibration, line, vibrations, lines):
    """Log odds for self-excitation, likewise, by what has glided that it is in step with.

    A spindle that takes one multiple of a frequency along takes all of them. What nearly always is in step has glided.
    """
    odds = math.inf
    glided = 0
    for i in range(vibrations.shape[0]):
        other = vibrations[i]
        if other.line == NO_LINE or other.line == vibration.line or other.glided == 0:
            continue
        in_step = _odds_in_step(line.frequency_hz, lines[other.line].frequency_hz, IN_STEP_HZ)
        if in_step < math.inf:
            odds = min(odds, in_step)
            glided = max(glided, other.glided)
    vibration.along += OFTEN * ((glided > 0) - vibration.along)
    if vibration.along > NEARLY_ALWAYS:
        vibration.glided = max(vibration.glided, glided)
    return odds


@njit(**OPTIONS)
def has_left(vibration, line):
    """Whether a line is not where its vibration was steady."""
    away_hz = abs(line.frequency_hz - vibration.stood_hz)
    return vibration.stood_hz > 0.0 and vibration.glided == 0 and away_hz > max(LEFT * line.frequency_hz, LEFT_HZ)


@njit(**OPTIONS)
def _multiple_odds(vibration, line, vibrations, lines):
    """Log odds for self-excitation of one whose line this is, by those that it is a multiple of.

    Teeth that pass faster than a spindle turns make no comb that is looked for without a speed, nor do two lines: they
    may be one vibration's with its overtone. But what is steady is none. And chatter brings its overtones with it:
    what was the overtone of a fainter line before it rose is not its own.
    """
    odds = carried = math.inf
    fainter = False
    for i in range(vibrations.shape[0]):
        other = vibrations[i]
        if other.line == NO_LINE or other.chattered:
            continue
        lower_hz = lines[other.line].frequency_hz
        if _nearest_multiple(line.frequency_hz, lower_hz) == NO_MULTIPLE:
            continue
        if other.steady >= SURELY_STEADY:
            odds = min(odds, _odds_as_multiple(line.frequency_hz, lower_hz, MULTIPLE_HZ))
        if other.heard >= LASTED and other.dominance < vibration.dominance:
            fainter = True
            carried = min(carried, _odds_as_multiple(line.frequency_hz, lower_hz, CARRIED_HZ))
    if fainter and vibration.growing + vibration.saturated < 0.5:
        vibration.carried += OFTEN * ((carried < math.inf) - vibration.carried)
    return min(odds, carried) if vibration.carried > NEARLY_ALWAYS else odds


@njit(**OPTIONS)
def _family_odds(vibration, line, vibrations, lines):
    """Log odds for self-excitation of one whose line this is, by all that it is a multiple of or that are multiples.

    A force gets louder with all of its multiples; and a line with several that are steady was a force's before, if it
    has not chattered: what has brings its overtones.
    """
    relatives = steady = 0
    together = 0.0
    for i in range(vibrations.shape[0]):
        other = vibrations[i]
        if other.line == NO_LINE or other.chattered:
            continue
        odds = _odds_in_step(line.frequency_hz, lines[other.line].frequency_hz, CARRIED_HZ)
        if odds < math.inf:
            relatives += 1
            together += odds
            steady += other.steady >= RATHER_STEADY
    if line.absolute_rise < AS_EVER:  # what belongs together rises together, and is steady no more then
        vibration.family += OFTEN * ((steady >= FAMILY) - vibration.family)
    lasts = vibration.family > NEARLY_ALWAYS and relatives >= FAMILY
    forced = lasts and not (vibration.chattered or has_left(vibration, line))
    return together if forced else math.inf


@njit(**OPTIONS)
def _odds_in_step(one_hz, other_hz, reach_hz):
    """Log odds for self-excitation of a line beside one that is forced, if either is a multiple of the other."""
    return _odds_as_multiple(max(one_hz, other_hz), min(one_hz, other_hz), reach_hz)


@njit(**OPTIONS)
def _nearest_multiple(upper_hz, lower_hz):
    """Which multiple of a line another is nearest to, of those that are asked for."""
    times = math.floor(upper_hz / lower_hz + 0.5)
    return times if 1 < times <= MULTIPLES else NO_MULTIPLE


@njit(**OPTIONS)
def _odds_as_multiple(upper_hz, lower_hz, reach_hz):
    """Log odds for self-excitation of a line so near to a multiple of another, as to that; infinite if it is not."""
    times = _nearest_multiple(upper_hz, lower_hz)
    if times == NO_MULTIPLE or abs(upper_hz / times - lower_hz) >= reach_hz:
        return math.inf
    return _odds_by_chance(by_chance(times, reach_hz, lower_hz))


@njit(**OPTIONS)
def _odds_by_chance(chance):
    """Log odds for self-excitation of what is where forced lines are, and anything is with this probability."""
    return math.log(chance / FORCED_AT_TEETH) if chance < LARGEST_CHANCE else math.inf
