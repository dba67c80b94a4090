"""What the lines of an interval say for self-excitation by where they are, and how much of the power each takes."""

import math
from typing import NamedTuple

from numba import njit

from chatter_monitor.kernels.heard import (
    BY_CHANCE,
    CLEAR_COHERENCE,
    DAMPING_RATIO,
    HERTZ,
    NEAR,
    NEAR_TEETH,
    TEETH_BY_CHANCE,
)
from chatter_monitor.kernels.kinds import LOUDER, own_rise
from chatter_monitor.kernels.lines import (
    ABSOLUTE_RISE,
    ARRIVAL,
    COHERENCE,
    GROWTH,
    LONG_RISE,
    NEWS,
    PROMINENCE,
    RISE,
    SHARE,
    VARIATION,
)
from chatter_monitor.kernels.multiples import FORCED_AT_ROTATION, FORCED_AT_TEETH, FORCED_OFF_ORDERS
from chatter_monitor.kernels.options import OPTIONS
from chatter_monitor.kernels.vibrations import DIED_DOWN, LINE_WIDTH_HZ, SUSPECT_SHARE

# Log odds of what is on no order for certain.
OFF_ORDERS = -math.log(FORCED_OFF_ORDERS)
# Of told speeds that are not heard so many are not the spindle's any more.
NOT_THIS = 0.2
# What came with the tool tells of chatter where it takes most of the power: each mode that noise drives comes with it.
MOST = 0.5
# A line is the one with sidebands when it is so near: a bin of the short-time spectrum. Those that are nearer to each
# other than its windows can tell are one line there, anywhere between.
CARRIER_HZ, APART_HZ = 12.0, 40.0
# A line is as loud as in the cut before when it has up to so many times its power.
AS_LOUD = 2.0
# Multiples that count as overtones, and how near to one a line has to be.
OVERTONES, OVERTONE_HZ = 5, 8.0


class Carrier(NamedTuple):
    """A line with sidebands, its frequency and their spacing (Hz), and whether it may be ``either`` of these two."""

    hertz: float
    spacing_hz: float
    either: bool


# Where no line has any.
NO_CARRIER = Carrier(math.nan, math.nan, False)


@njit(**OPTIONS)
def witness(heard, taken, found, spindle, carrier, growth, power, usual, odds, lines):
    """Tell of each line what the following of vibrations takes.

    Parameters
    ----------
    heard : ndarray of float64, shape (n, FIELDS)
        The lines (`kernels.heard`).
    taken : ndarray of float64, shape (m, 3)
        Frequency and rms of each line that has been taken out with what turns; and power of what was taken out there in
        the last minute and is not now (`verdict.known_orders`).
    found : bool
        Whether what turns has been found in the signal alone: it may be another machine's.
    spindle : bool
        Whether a spindle of known speed is heard.
    carrier : Carrier
        The line with sidebands is on no order, whatever the speed is.
    growth : float
        By how much what repeats has grown from rotation to rotation (natural logarithm): many lines, too near to each
        other to be told. It counts as the strongest.
    power : float
        That which the lines have their shares of.
    usual : float
        That of the cut before, 0 where it is not known: what grows by itself comes on top of it.
    odds : Odds
    lines : ndarray of LINE, shape (>= n,)
        The result.
    """
    strongest = 0
    quieter = power / usual if power < usual else 1.0
    for i in range(heard.shape[0]):
        strongest = i if heard[i, SHARE] > heard[strongest, SHARE] else strongest
    risen = 0.0
    for other in heard:
        risen += _risen_share(other, _own_share(other, taken, power))
    for i in range(heard.shape[0]):
        seen, line = heard[i], lines[i]
        _copy(seen, line)
        line.power = power
        line.arrival = 0.0
        line.carrier = is_carrier(heard, i, carrier) and seen[ABSOLUTE_RISE] > DIED_DOWN
        line.order_odds = OFF_ORDERS if line.carrier else _order_odds(seen, found, spindle, odds)
        own = _own_share(seen, taken, power)
        line.dominance = own * quieter
        if line.order_odds > 0.0:  # teeth have overtones, too
            overtones = 0.0
            for other in heard:
                if _is_overtone(other[HERTZ], seen[HERTZ]):
                    overtones += _own_share(other, taken, power)
            line.dominance += overtones
            # beside what is as loud as ever, chatter takes nearly all of what has got louder
            if own >= SUSPECT_SHARE and seen[ABSOLUTE_RISE] >= LOUDER and seen[COHERENCE] >= CLEAR_COHERENCE:
                line.dominance = max(line.dominance, _risen_share(seen, own) / risen * quieter)
            # an order of the rotation is what a forced line may be on, too, however dense they are
            if line.carrier or (spindle and not (seen[NEAR] > 0.0 or seen[NEAR_TEETH] > 0.0)):
                _add_news(seen[NEWS], line)
                line.arrival = seen[ARRIVAL] if line.carrier or line.dominance > MOST else 0.0
        line.growth = growth if i == strongest else 0.0
        if line.growth > 0.0:
            # out of step is off the orders, whatever the speed; and all power is its but what there was before
            line.order_odds = max(line.order_odds, odds.off_found)
            line.dominance = max(line.dominance, 1.0 - math.exp(-2.0 * growth))


@njit(**OPTIONS)
def is_carrier(heard, i, carrier):
    """Whether a line is the one with sidebands, or may be."""
    if carrier.either and _is_at(heard, i, carrier.spacing_hz, carrier.hertz):
        return True
    return _is_at(heard, i, carrier.hertz, carrier.spacing_hz)


@njit(**OPTIONS)
def _is_at(heard, i, carrier_hz, spacing_hz):
    """Whether a line is the one at a frequency, or twice that and louder: which of the two sidebands do not tell."""
    reach_hz = max(CARRIER_HZ, spacing_hz) if spacing_hz < APART_HZ else CARRIER_HZ
    half = 0.0
    for other in heard:
        if abs(other[HERTZ] - carrier_hz) < reach_hz:
            half = max(half, other[SHARE])
    twice = abs(heard[i, HERTZ] - 2.0 * carrier_hz) < reach_hz and 0.0 < half < heard[i, SHARE]
    return abs(heard[i, HERTZ] - carrier_hz) < reach_hz or twice


@njit(**OPTIONS)
def _copy(seen, line):
    line.frequency_hz, line.share, line.prominence_db = seen[HERTZ], seen[SHARE], seen[PROMINENCE]
    line.variation, line.growth_per_s, line.coherence = seen[VARIATION], seen[GROWTH], seen[COHERENCE]
    line.rise, line.long_rise, line.absolute_rise = seen[RISE], seen[LONG_RISE], seen[ABSOLUTE_RISE]
    # where the speed is unknown what the surroundings have risen may be a load's
    unknown = math.isnan(seen[TEETH_BY_CHANCE])
    line.own_rise = own_rise(line.long_rise, line.absolute_rise) if unknown else line.absolute_rise
    line.damping_ratio = seen[DAMPING_RATIO]


@njit(**OPTIONS)
def _add_news(news, line):
    """Count a line as risen by as much as it is more than in the cuts before and in the air between.

    Chatter that is there as soon as the tool enters has not been seen to grow. Forced lines are new, too, when a job
    is; so this is for lines off the orders of the spindle, where its speed is known and it is heard.
    """
    line.long_rise, line.absolute_rise = max(line.long_rise, news), max(line.absolute_rise, news)
    line.own_rise = max(line.own_rise, news)


@njit(**OPTIONS)
def _is_overtone(hertz, fundamental_hz):
    """Whether a line is at a multiple of another: what throws the tool out of the cut is periodic, not harmonic.

    An accelerometer hears overtones louder than what they belong to.
    """
    order = round(hertz / fundamental_hz)
    return 1 < order <= OVERTONES and abs(hertz - order * fundamental_hz) < OVERTONE_HZ


@njit(**OPTIONS)
def _own_share(seen, taken, power):
    """Share of the power that is a line's own: what has been taken out at its frequency with what turns is another's.

    Beside a strong order something is always left, for it is neither quite steady nor its speed quite known. And where
    an order was taken out that is not now, it is heard again: only what is louder is something else.
    """
    here = seen[SHARE] * power
    there = missed = 0.0
    for i in range(taken.shape[0]):
        if abs(taken[i, 0] - seen[HERTZ]) < LINE_WIDTH_HZ:
            there = max(there, taken[i, 1] ** 2)
            missed += taken[i, 2]
    if here <= 0.0:
        return seen[SHARE]
    here -= min(AS_LOUD * missed, here)
    return here / power * (here / (here + there)) if here > 0.0 else 0.0


@njit(**OPTIONS)
def _risen_share(seen, own):
    """Share of the power that is a line's own, less what it was before it got louder."""
    return own * (1.0 - math.exp(-2.0 * max(seen[ABSOLUTE_RISE], 0.0)))


@njit(**OPTIONS)
def _order_odds(seen, found, spindle, odds):
    """Log odds for self-excitation by its place among the orders: chatter may be anywhere, forced lines are not."""
    if math.isnan(seen[TEETH_BY_CHANCE]):
        return odds.unknown_speed
    if math.isnan(seen[BY_CHANCE]):
        return 0.0
    forced = (
        FORCED_AT_TEETH * seen[NEAR_TEETH] / seen[TEETH_BY_CHANCE]
        + FORCED_AT_ROTATION * seen[NEAR] / seen[BY_CHANCE]
        + FORCED_OFF_ORDERS * (1.0 - seen[NEAR]) / (1.0 - seen[BY_CHANCE])
    )
    if not (found or spindle):
        forced = NOT_THIS + (1.0 - NOT_THIS) * forced
    if found and forced < 1.0:  # what was found may be another machine's comb
        return odds.off_found
    return -math.log(forced)
