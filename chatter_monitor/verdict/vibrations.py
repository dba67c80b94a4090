"""Every vibration of a channel followed by itself, so that a hum or a tooth's line hides no chatter beside it.

Two questions are kept apart. Has it risen out of its surroundings and stayed? The chain of `verdict.kinds` answers
that. And does something that turns explain it? A forced line rises, too, when the tool enters the cut, but it is on an
order of the spindle. Self-excited is what has risen and is not explained; the answer changes when the speed becomes
known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from chatter_monitor.tracking.orders import Orders
from chatter_monitor.verdict.evidence import Evidence, Vibration
from chatter_monitor.verdict.kinds import CHAIN, NOTHING, PRIOR, Chain, Kinds, Likeness, follow, likeness

# A line belongs to a vibration when it is this near, relatively or in Hz.
SAME_VIBRATION = 0.06
LINE_WIDTH_HZ = 25.0
# What an interval says of a vibration that none of its prominent lines belongs to.
NOT_HEARD = Likeness(-1.0, -1.0)
# Intervals without a line after which it is forgotten; a minute if it has chattered, because it will again.
FORGOTTEN, FORGOTTEN_CHATTER = 10, 1200
# What grows by itself is coherent; noise that comes and goes is not. More so where nothing stood out before: a cut that
# begins wakes modes that noise drives.
COHERENT, COHERENT_IF_NEW = 0.6, 0.77
UNHEARD_DB = 8.0
RISEN = 0.7  # natural logarithm: to twice its usual amplitude
OVER = 0.02  # probability of having risen below which that is forgotten
# A vibration is over when its amplitude has fallen below half of what it was for seconds (natural logarithm): that of a
# saturated one does not, whatever its damping reads.
DIED_DOWN = -0.7

# Of a vibration that has chattered and does no more.
CALMED = Kinds(noise=1.0 - 6e-4, growing=2e-4, saturated=2e-4, steady=2e-4)
# Weight of an interval in the average of the odds over half a second.
AVERAGING = 0.2


@dataclass(frozen=True, slots=True)
class Odds:
    """Log odds that what has risen is self-excited; chosen like the constants of the chain.

    Attributes
    ----------
    heard, new : float
        Where something stood out before it rose, and where nothing did.
    unknown_speed, off_found : float
        Added where the speed is unknown, for forced lines may be anywhere, and off the orders of a comb that was found,
        for it may be another machine's.
    forced_off_orders : float
        Share of forced lines that are off the orders.
    """

    heard: float = 3.0
    new: float = 2.0
    unknown_speed: float = -0.7
    off_found: float = 1.5
    forced_off_orders: float = 0.05


@dataclass(frozen=True, slots=True)
class Rules:
    """What the following goes by: at which probability an alarm begins and ends, and the constants."""

    alarm_probability: float
    calm_probability: float
    chain: Chain = CHAIN
    odds: Odds = Odds()


@dataclass(frozen=True, slots=True)
class Followed:
    """One vibration and what is known of it.

    Attributes
    ----------
    frequency_hz : float
        Where it was heard last.
    kinds : Kinds
        Whether it is noise, grows, has grown, or was steady from the start.
    order_odds : float
        Log odds for self-excitation by its place among the orders, averaged over half a second.
    new : bool or None
        Whether nothing stood out there before it rose; None while it has not risen.
    missed : int
        Intervals since its line was heard.
    alarm_for : int
        Intervals since an alarm began that is about it; 0 without one.
    chattered : bool
        Whether there has been one.
    unexplained : float
        Probability that nothing that turns explains it, if it has risen.
    heard : Vibration or None
        Its line in this interval.
    """

    frequency_hz: float
    kinds: Kinds = PRIOR
    order_odds: float = 0.0
    new: bool | None = None
    missed: int = 0
    alarm_for: int = 0
    chattered: bool = False
    unexplained: float = 0.0
    heard: Vibration | None = None

    @property
    def self_excited(self) -> float:
        """Probability that it has risen and nothing that turns explains it."""
        return self.kinds.risen * self.unexplained

    @property
    def forced(self) -> float:
        """Probability that something forces it: steady from the start, or risen and explained."""
        return self.kinds.steady + self.kinds.risen * (1.0 - self.unexplained)


def follow_all(before: tuple[Followed, ...], evidence: Evidence, rules: Rules) -> tuple[Followed, ...]:
    """Vibrations after another interval, the most suspicious first."""
    lines = list(evidence.vibrations)
    after = []
    for vibration in before:
        line = _line_of(vibration, lines)
        if line is not None:
            lines.remove(line)
        after.append(_another_interval(vibration, line, evidence.orders, rules))
    for line in lines:
        new = Followed(line.line.frequency_hz, order_odds=order_odds(line, evidence.orders, rules.odds))
        after.append(_another_interval(new, line, evidence.orders, rules))
    kept = [v for v in after if v.missed < (FORGOTTEN_CHATTER if v.chattered else FORGOTTEN)]
    return tuple(sorted(kept, key=lambda vibration: -vibration.self_excited))


def at_rest(vibrations: tuple[Followed, ...]) -> tuple[Followed, ...]:
    """What is remembered while nothing is cut: which vibrations have chattered."""
    return tuple(
        replace(v, kinds=CALMED, missed=v.missed + 1, alarm_for=0, heard=None)
        for v in vibrations
        if v.chattered and v.missed < FORGOTTEN_CHATTER
    )


def order_odds(vibration: Vibration, orders: Orders, odds: Odds) -> float:
    """Log odds for self-excitation by how likely it is to be on an order, or off all of them, by chance."""
    if vibration.on_order and vibration.by_chance is not None:
        return math.log(vibration.by_chance)
    if orders.source in (None, "found"):  # what was found may be another machine's comb
        return odds.unknown_speed if orders.source is None else odds.off_found
    if vibration.by_chance is None:
        return 0.0
    return math.log((1.0 - vibration.by_chance) / odds.forced_off_orders)


def _line_of(vibration: Followed, lines: list[Vibration]) -> Vibration | None:
    """The nearest of the lines, if it is near enough."""
    distances = [(abs(math.log(v.line.frequency_hz / vibration.frequency_hz)), v) for v in lines]
    distance, nearest = min(distances, key=lambda pair: pair[0], default=(math.inf, None))
    return nearest if distance < max(SAME_VIBRATION, LINE_WIDTH_HZ / vibration.frequency_hz) else None


def _another_interval(before: Followed, heard: Vibration | None, orders: Orders, rules: Rules) -> Followed:
    """A vibration after an interval in which this line of its was heard, or none."""
    frequency_hz, average, new, seen = before.frequency_hz, before.order_odds, before.new, NOT_HEARD
    if heard is not None:
        frequency_hz = heard.line.frequency_hz
        average += AVERAGING * (order_odds(heard, orders, rules.odds) - average)
        new = False if before.chattered else _is_new(before, heard)
        seen = _likeness(heard, new=bool(new), chattered=before.chattered)
    kinds = follow(before.kinds, seen, rules.chain, again=before.chattered)
    odds = average + (rules.odds.new if new else rules.odds.heard)
    unexplained = 1.0 / (1.0 + math.exp(-odds))
    alarm = kinds.risen * unexplained >= (rules.calm_probability if before.alarm_for else rules.alarm_probability)
    if before.alarm_for and not alarm and kinds.risen < 0.5:
        kinds, new = CALMED, None  # what is over does not come back for want of evidence against it
    return Followed(
        frequency_hz,
        kinds,
        order_odds=average,
        new=new,
        missed=0 if heard is not None else before.missed + 1,
        alarm_for=before.alarm_for + 1 if alarm else 0,
        chattered=before.chattered or alarm,
        unexplained=unexplained,
        heard=heard,
    )


def _is_new(before: Followed, heard: Vibration) -> bool | None:
    """Kept from when it rose until that is over."""
    rises = heard.line.long_rise >= RISEN
    if before.new is not None and (rises or before.kinds.risen >= OVER):
        return before.new
    return heard.line.usual_db < UNHEARD_DB if rises else None


def _likeness(heard: Vibration, *, new: bool, chattered: bool) -> Likeness:
    """What a line says of its vibration."""
    line = heard.line
    if chattered and line.long_rise < DIED_DOWN:
        return NOTHING
    seen = likeness(line, heard.damping_ratio)
    if line.coherence < (COHERENT_IF_NEW if new else COHERENT):
        return Likeness(min(seen.growth, 0.0), seen.calm)
    return seen
