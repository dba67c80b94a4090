"""Each vibration of a channel from one interval to the next: the rules that `verdict.vibrations` tells about."""

import math
from typing import NamedTuple

from numba import njit

from chatter_monitor.kernels.kinds import (
    LOUDER,
    NOTHING,
    PRIOR,
    REGENERATED,
    Chain,
    Kinds,
    Likeness,
    beyond_chance,
    coherence_damping,
    follow,
    likeness,
)
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.relatives import forced_odds, has_left, taken_along
from chatter_monitor.kernels.rotations import GROWN, NO_MORE
from chatter_monitor.kernels.vibration import AS_EVER, NO_LINE, SURELY_STEADY

# A line belongs to a vibration when it is this near, relatively or in Hz.
SAME_VIBRATION = 0.06
LINE_WIDTH_HZ = 25.0
# What comes back after a silence is the same vibration only when it is nearer: nobody has followed it there.
COMES_BACK, COMES_BACK_HZ = 0.03, 6.0
# What an interval says of a vibration that none of its prominent lines belongs to.
NOT_HEARD = Likeness(-1.0, -1.0, -1.0)
# Intervals without a line after which it is forgotten; a minute after an alarm about it, because it will chatter again.
# An alarm that needed that memory does not renew it: else what was wrong once would be so as long as the job goes on.
FORGOTTEN, FORGOTTEN_CHATTER = 10, 1200
# Intervals after an alarm in which another vibration needs no more for one than a running alarm does: what chatters may
# jump to another mode, which takes the power and leaves the first without a line.
JUST_NOW = 40
# What grows by itself is coherent; noise that comes and goes is not, nor is a mode that it drives: beyond this damping
# ratio, or below this coherence, nothing is taken for growth.
COHERENT_DAMPING, LEAST_COHERENCE = 0.004, 0.4
# What chatters as the tool comes is calm from then on: what is noise so many intervals later did not come like that.
ARRIVED = 20
# A vibration is over when its amplitude has fallen below half of what it was for seconds (natural logarithm), in itself
# or, if it is fainter at all, beyond its surroundings: that of a saturated one does not, whatever its damping reads.
DIED_DOWN = -0.7
# Nor does it still chatter with no more power than before it rose to the alarm; another one takes so many times that,
# half of what the first one took (logarithm).
STILL, AGAIN = 1.0, math.exp(LOUDER)

# Chatter takes the power: what has risen and takes less than so much of it is hardly ever chatter.
SUSPECT_SHARE = 0.2
# Weight of an interval in the average of where it was steady.
SLOWLY = 0.05
# Of a vibration that has chattered and does no more.
CALMED = Kinds(noise=1.0 - 6e-4, growing=2e-4, saturated=2e-4, steady=2e-4)
# Log odds by its place, averaged, of what is off the orders for more than a moment, where these are told apart; and on
# one, likewise.
SURELY_OFF, SURELY_ON = 1.0, -1.0
# What was on an order of what turned is still, while nothing is heard to turn, within so much (natural logarithm).
STILL_THERE = 0.01
# Weight of an interval in the averages of odds and power, which are over a few intervals.
AVERAGING = 0.35

# A forced line follows the spindle when that changes its speed; what excites itself stays near its mode. Gains of the
# filter that follows the logarithm of a frequency; a glide in an interval that counts (2 % in a second), and as a share
# of how far the filter misses (five standard deviations); intervals in a row for which it has to, and for which it is
# remembered; log odds of what has glided.
FREQUENCY_GAIN, GLIDE_GAIN = 0.35, 0.074
LEAST_GLIDE, SIGNIFICANT_GLIDE = 1e-3, 0.4
GLIDING, GLIDED = 10, 100
GLIDES = -6.0
# What grows by itself takes its time: with so much of its rise (natural logarithm) besides what has come at once it has
# climbed; log odds of that.
CLIMB, CLIMBS = 1.0, 2.0
# Nor does it fall by so much (half of its power) in an interval.
FALLS = 0.35


class Odds(NamedTuple):
    """Log odds that what has risen is self-excited; chosen like the constants of the chain.

    What a cut that begins or grows louder wakes is many lines beside each other; chatter takes nearly all of the power
    that is not synchronous. And forced lines are on the orders of the teeth, mostly.

    Attributes
    ----------
    offset, dominance : float
        Of a vibration that has none of the power, and what it has more with all of it.
    unknown_speed, off_found : float
        Added where the speed is unknown, for forced lines may be anywhere, and off the orders of a comb that was found,
        for it may be another machine's.
    """

    offset: float = -1.7
    dominance: float = 5.0
    unknown_speed: float = -0.6
    off_found: float = 0.5


class Rules(NamedTuple):
    """What the following goes by: at which probability an alarm begins and ends, and the constants.

    And whether a speed is known that is not heard now: the spindle may turn at another, if something has glided.
    """

    alarm_probability: float
    calm_probability: float
    chain: Chain = Chain()
    odds: Odds = Odds()
    unheard: bool = False


@njit(**OPTIONS)
def follow_all(vibrations, known, lines, rules, weights, taken, work):
    """Follow every vibration through an interval.

    Parameters
    ----------
    vibrations : ndarray of VIBRATION, shape (>= known + m,)
        The first ``known`` are the vibrations so far; overwritten with those after the interval, the most suspicious
        first.
    known : int
    lines : ndarray of LINE, shape (m,)
        Prominent lines of the interval. What none has taken begins a vibration.
    rules : Rules
    weights : ndarray of float64
        As in `kinds.likeness`.
    taken, work : ndarray of bool and of VIBRATION, shape (>= m,) and (>= known + m,)
        Work space.

    Returns
    -------
    int
        How many there are.
    """
    _share_out(vibrations, known, lines, taken)
    if _any_chattered(vibrations, known):
        rules = Rules(rules.calm_probability, rules.calm_probability, rules.chain, rules.odds, rules.unheard)
    count = 0
    for i in range(known):
        vibration = work[count]
        work[count] = vibrations[i]
        if vibration.line == NO_LINE:
            _unheard(vibration, rules)
        else:
            line = lines[vibration.line]
            if rules.unheard and has_left(vibration, line):
                line.order_odds = max(line.order_odds, rules.odds.unknown_speed)
            along = taken_along(vibration, line, vibrations[:known], lines)
            if rules.unheard or line.order_odds == rules.odds.unknown_speed:
                line.order_odds = min(line.order_odds, along, forced_odds(vibration, line, vibrations[:known], lines))
            _heard(vibration, line, rules, weights)
        if vibration.missed < FORGOTTEN or vibration.chattered:
            count += 1
    for i in range(lines.shape[0]):
        if not taken[i]:
            vibration = work[count]
            _begin(vibration, lines[i])
            vibration.line = i
            _heard(vibration, lines[i], rules, weights)
            count += 1
    for i in range(count):
        place = i
        while place > 0 and suspicion_of(vibrations[place - 1]) < suspicion_of(work[i]):
            vibrations[place] = vibrations[place - 1]
            place -= 1
        vibrations[place] = work[i]
    return count


@njit(**OPTIONS)
def suspicion_of(vibration):
    """Probability that it has risen and that nothing that turns explains it."""
    return (vibration.growing + vibration.saturated) * vibration.unexplained


@njit(**OPTIONS)
def _any_chattered(vibrations, known):
    """Whether there has been an alarm within the last intervals, about whichever."""
    just_now = False
    for i in range(known):
        just_now |= chattered_just_now(vibrations[i])
    return just_now


@njit(**OPTIONS)
def chattered_just_now(vibration):
    """Whether there has been one about this vibration."""
    return vibration.chattered and vibration.over < JUST_NOW


@njit(**OPTIONS)
def _share_out(vibrations, known, lines, taken):
    """Give each line to the vibration that it is nearest to, the nearest pair first, each at most one of the other.

    Not to the most suspicious within reach: one that wanders would take the line of another with its own past. But what
    an alarm is about comes first.
    """
    taken[:] = False
    for i in range(known):
        vibrations[i].line = NO_LINE
    for alarmed in (True, False):
        for _ in range(lines.shape[0]):
            owner, owned = _nearest(vibrations, known, lines, taken, alarmed)
            if owner == NO_LINE:
                break
            vibrations[owner].line = owned
            taken[owned] = True


@njit(**OPTIONS)
def _nearest(vibrations, known, lines, taken, alarmed):
    """The vibration without a line and the line that is left that are nearest to each other, if near enough."""
    least = math.inf
    owner = owned = NO_LINE
    for i in range(known):
        vibration = vibrations[i]
        if vibration.line == NO_LINE and (vibration.alarm_for > 0) == alarmed:
            reach = _reach(vibration)
            for j in range(lines.shape[0]):
                if not taken[j]:
                    away = abs(math.log(lines[j].frequency_hz / vibration.frequency_hz))
                    if away < min(reach, least):
                        least, owner, owned = away, i, j
    return owner, owned


@njit(**OPTIONS)
def _reach(vibration):
    """How far away a line may be that belongs to it (natural logarithm)."""
    if vibration.missed < FORGOTTEN:
        return max(SAME_VIBRATION, LINE_WIDTH_HZ / vibration.frequency_hz)
    return max(COMES_BACK, COMES_BACK_HZ / vibration.frequency_hz)


@njit(**OPTIONS)
def _begin(vibration, line):
    """A vibration that is heard for the first time."""
    _set_kinds(vibration, PRIOR)
    vibration.order_odds = line.order_odds
    vibration.dominance = line.dominance
    vibration.power = line.power
    vibration.rise = vibration.told = 0.0
    vibration.height = vibration.step = vibration.leap = 0.0
    vibration.level = line.absolute_rise
    vibration.alarm_for = 0
    vibration.chattered = False
    vibration.heard = vibration.over = vibration.own = 0
    vibration.late = vibration.recalled = False
    vibration.dispersion = vibration.listened = 0.0
    vibration.place = math.log(line.frequency_hz)
    vibration.on_order = math.nan
    vibration.stood_hz = vibration.family = vibration.calm = 0.0
    vibration.glide = vibration.jitter = vibration.carried = vibration.along = 0.0
    vibration.gliding = vibration.glided = 0


@njit(**OPTIONS)
def _heard(vibration, line, rules, weights):
    """An interval in which this line of a vibration was heard."""
    vibration.missed = 0
    vibration.frequency_hz = line.frequency_hz
    if line.carrier:  # no spindle takes that along
        vibration.gliding = vibration.glided = 0
    _glide(vibration, rules.unheard)
    _stay_on_order(vibration, line, rules.odds)
    vibration.order_odds += AVERAGING * (line.order_odds - vibration.order_odds)
    if vibration.heard == ARRIVED:
        vibration.late = vibration.noise > 0.5
    # Where the speed wanders, a forced line is off the orders for a moment; one with sidebands is so for certain.
    if (vibration.late or vibration.order_odds < SURELY_OFF) and not line.carrier:
        line.arrival = 0.0
    rise = min(line.long_rise, line.absolute_rise)
    vibration.rise += AVERAGING * (rise - vibration.rise)
    _climb(vibration, rise)
    dominance = _dominance(vibration, line)
    # what it had of a power that no order had been taken out of says nothing of what is on one
    keeps = vibration.alarm_for > 0 and vibration.order_odds > SURELY_ON
    vibration.dominance = max(dominance, vibration.dominance) if keeps else dominance
    seen = _likeness(vibration, line, weights)
    # of one with sidebands they have the rest
    enough = line.carrier or vibration.dominance >= SUSPECT_SHARE
    _another_interval(vibration, seen, _news(vibration, line, seen), rules, line.arrival > LOUDER, enough)
    if vibration.alarm_for > 0 and not _died_down(line):
        vibration.chattered_hz = line.frequency_hz
    if vibration.alarm_for == 1 and not vibration.recalled:
        vibration.calm = line.share * line.power * math.exp(-2.0 * rise) if rise >= LOUDER else 0.0
    if vibration.steady >= SURELY_STEADY:
        weight = SLOWLY if vibration.stood_hz > 0.0 else 1.0
        vibration.stood_hz += weight * (line.frequency_hz - vibration.stood_hz)


@njit(**OPTIONS)
def _stay_on_order(vibration, line, odds):
    """Leave a line its place where a comb is lost: the order that it was on has not left it by that."""
    at = math.log(line.frequency_hz)
    if line.order_odds != odds.unknown_speed:
        if line.order_odds < SURELY_ON:
            vibration.on_order = at
    elif vibration.order_odds < SURELY_ON and abs(at - vibration.on_order) < STILL_THERE:
        line.order_odds = vibration.order_odds


@njit(**OPTIONS)
def _climb(vibration, rise):
    """Follow how it comes to its height: where a force sets in, or a tool enters, within two intervals."""
    if rise < AS_EVER:
        vibration.height = vibration.step = vibration.leap = 0.0
        return
    step = max(rise - vibration.height, 0.0)
    vibration.leap = max(vibration.leap, vibration.step + step)
    vibration.height += step
    vibration.step = step


@njit(**OPTIONS)
def climbs(vibration):
    """Whether it has come to its height by and by."""
    return vibration.height - vibration.leap > CLIMB


@njit(**OPTIONS)
def _dominance(vibration, line):
    """Its share of the power of some intervals: what gets louder soon has most of it."""
    vibration.power += AVERAGING * (line.power - vibration.power)
    weight = AVERAGING * line.power / vibration.power if vibration.power > 0.0 else AVERAGING
    return vibration.dominance + weight * (line.dominance - vibration.dominance)


@njit(**OPTIONS)
def _news(vibration, line, seen):
    """What its rise says that it has not said before: how loud it is by now counts once, and not when it falls again.

    The ring of a blow is coherent only as it dies away. Whatever wakes many lines, a tool that enters or a load, leaves
    each a share of the power: so much of it counts.
    """
    falls = line.absolute_rise < vibration.level - FALLS
    vibration.level = line.absolute_rise
    if vibration.alarm_for > 0 or chattered_just_now(vibration):
        return 0.0
    tells = min(line.dominance, 1.0) * beyond_chance(line) if seen.growth > 0.0 else 0.0
    news = tells - vibration.told
    if falls and news > 0.0:
        return 0.0
    vibration.told = tells
    return news


@njit(**OPTIONS)
def _glide(vibration, unheard):
    """Follow its frequency, and tell whether that glides: an alpha-beta filter of its logarithm.

    That is remembered for a while, or until the spindle is heard again, if it is not. Whatever it had risen by then is
    explained; it would have to rise anew.
    """
    miss = math.log(vibration.frequency_hz) - vibration.place - vibration.glide
    vibration.heard += 1
    gain = max(FREQUENCY_GAIN, 1.0 / vibration.heard)
    vibration.place += vibration.glide + gain * miss
    vibration.glide += GLIDE_GAIN * miss if vibration.heard > 1.0 / FREQUENCY_GAIN else 0.0
    vibration.jitter += gain * (miss**2 - vibration.jitter)
    glides = abs(vibration.glide) > max(LEAST_GLIDE, SIGNIFICANT_GLIDE * math.sqrt(vibration.jitter))
    vibration.gliding = vibration.gliding + 1 if glides else 0
    if vibration.gliding >= GLIDING:
        vibration.glided = GLIDED
    elif vibration.glided > 0 and not unheard:
        vibration.glided -= 1
        if vibration.glided == 0:
            explain(vibration)


@njit(**OPTIONS)
def explain(vibration):
    """Take it for something that turns, or that noise drives: it has not chattered, nor risen by itself."""
    _set_kinds(vibration, CALMED)
    vibration.chattered = False


@njit(**OPTIONS)
def withdraw(vibrations):
    """Take all of these that an alarm was about just now, of an array of VIBRATION, for something that turns."""
    for i in range(vibrations.shape[0]):
        if chattered_just_now(vibrations[i]):
            explain(vibrations[i])


@njit(**OPTIONS)
def _unheard(vibration, rules):
    """An interval in which none was."""
    vibration.missed += 1
    vibration.stood_hz = 0.0
    _another_interval(vibration, NOT_HEARD, 0.0, rules, False, vibration.dominance >= SUSPECT_SHARE)


@njit(**OPTIONS)
def _another_interval(vibration, seen, news, rules, arrived, enough):
    """Whether it has risen and stayed, whether something that turns explains it, and whether that is an alarm."""
    kinds = follow(_kinds(vibration), seen, news, rules.chain, vibration.chattered or arrived)
    risen = kinds.growing + kinds.saturated
    place = vibration.order_odds
    odds = rules.odds.offset + rules.odds.dominance * vibration.dominance
    if vibration.glided > 0:
        odds += GLIDES
        place = min(place, rules.odds.unknown_speed)  # if the spindle takes it along, nobody knows its speed
    elif climbs(vibration):
        odds += CLIMBS
    odds += place
    vibration.unexplained = 1.0 / (1.0 + math.exp(-odds))
    alarmed = vibration.alarm_for > 0
    limit = rules.calm_probability if alarmed else rules.alarm_probability
    if (enough or vibration.chattered) and risen * vibration.unexplained >= limit:
        if not alarmed:
            vibration.recalled = vibration.chattered
            vibration.chattered_hz = vibration.frequency_hz
        vibration.own = vibration.own + 1 if vibration.recalled else 0
        vibration.alarm_for += 1
        vibration.chattered = True
        vibration.told = 0.0
        vibration.over = 0
    else:
        vibration.alarm_for = 0
        vibration.over += 1
        vibration.own += 1
        vibration.chattered &= vibration.own < FORGOTTEN_CHATTER
        if alarmed and risen < 0.5:  # what is over does not come back for want of evidence against it
            kinds = CALMED
    _set_kinds(vibration, kinds)


@njit(**OPTIONS)
def _likeness(vibration, line, weights):
    """What a line says of its vibration."""
    if line.growth >= (NO_MORE if vibration.chattered else GROWN):
        return REGENERATED
    if vibration.chattered and (_died_down(line) or _is_calm(vibration, line)):
        return NOTHING
    seen = likeness(line, weights)
    damping_ratio = coherence_damping(line.coherence, line.frequency_hz)
    if line.coherence < LEAST_COHERENCE or damping_ratio > COHERENT_DAMPING:
        return Likeness(min(seen.growth, 0.0), seen.calm, seen.steady)
    return seen


@njit(**OPTIONS)
def _died_down(line):
    """Whether a line is far below what it was for seconds.

    What is louder than it was has not died down, however much more stood out there before: a forced line beside it.
    """
    return line.absolute_rise < DIED_DOWN or (line.absolute_rise < 0.0 and line.long_rise < DIED_DOWN)


@njit(**OPTIONS)
def _is_calm(vibration, line):
    """Whether a line is no louder than it was before it rose to the alarm, or not enough so for another one."""
    return line.share * line.power < vibration.calm * (STILL if vibration.alarm_for > 0 else AGAIN)


@njit(**OPTIONS)
def _kinds(vibration):
    return Kinds(vibration.noise, vibration.growing, vibration.saturated, vibration.steady)


@njit(**OPTIONS)
def _set_kinds(vibration, kinds):
    vibration.noise, vibration.growing, vibration.saturated, vibration.steady = kinds
