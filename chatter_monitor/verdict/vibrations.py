"""Every vibration of a channel followed by itself, so that a hum or a tooth's line hides no chatter beside it.

Two questions are kept apart. Has it risen and stayed? The chain of `kernels.kinds` answers that. And does something
that turns explain it? A forced line rises, too, when the tool enters the cut, but it is on an order of the spindle, and
one among others; chatter takes nearly all of the power. Self-excited is what has risen and is not explained; the answer
changes when the speed becomes known. What an interval does to a vibration is told in `kernels.vibrations`; of all that
are followed only those become objects that something is said about.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.kernels import overview as kernel
from chatter_monitor.kernels.binding import bound
from chatter_monitor.kernels.kinds import LINE, Kinds
from chatter_monitor.kernels.overview import NONE
from chatter_monitor.kernels.vibrations import CALMED, FORGOTTEN_CHATTER, NO_LINE, VIBRATION, Odds, Rules
from chatter_monitor.tracking.orders import Orders
from chatter_monitor.tracking.spectrum import Line
from chatter_monitor.verdict.evidence import LINE_WIDTH_HZ, Evidence, Vibration
from chatter_monitor.verdict.weights import CALM, GROWTH

# Shares of forced lines that are at multiples of the passing of teeth, of the rotation, and at neither.
FORCED_AT_TEETH, FORCED_AT_ROTATION, FORCED_OFF_ORDERS = 0.75, 0.2, 0.05

# Multiples that count as overtones, and how near to one a line has to be.
OVERTONES, OVERTONE_HZ = 5, 8.0

# Vibrations that there is room for at first.
ROOM = 64

NO_LINES = np.empty(0, LINE)
_WEIGHTS = np.array([(*weights.per_measure, weights.offset) for weights in (GROWTH, CALM)])


class Followed(NamedTuple):
    """One vibration and what is known of it.

    Attributes
    ----------
    frequency_hz : float
        Where it was heard last.
    kinds : Kinds
        Whether it is noise, grows, has grown, or was steady from the start.
    unexplained : float
        Probability that nothing that turns explains it, if it has risen.
    alarm_for : int
        Intervals since an alarm began that is about it; 0 without one.
    chattered : bool
        Whether there has been an alarm about it, within the last minute.
    heard : Vibration or None
        Its line in this interval.
    """

    frequency_hz: float
    kinds: Kinds
    unexplained: float = 0.0
    alarm_for: int = 0
    chattered: bool = False
    heard: Vibration | None = None

    @property
    def self_excited(self) -> float:
        """Probability that it has risen and nothing that turns explains it."""
        return self.kinds.risen * self.unexplained


class Told(NamedTuple):
    """What is told of all vibrations of an interval (`kernels.overview`).

    Attributes
    ----------
    suspicion : float
        Probability that the most suspicious has risen and nothing that turns explains it.
    alarm, suspect, steadiest : Followed or None
        The one that the running alarm began with; the most suspicious that is heard; that with most steady power.
    steady_share, chattered_share : float
        Shares of the power that are steady, and in lines of what has chattered.
    vibrations : ndarray of VIBRATION
        All of them, the most suspicious first, until the next interval.
    """

    suspicion: float = 0.0
    alarm: Followed | None = None
    suspect: Followed | None = None
    steadiest: Followed | None = None
    steady_share: float = 0.0
    chattered_share: float = 0.0
    vibrations: NDArray[np.void] = np.empty(0, VIBRATION)

    def is_forced(self, frequency_hz: float, reach: float) -> bool:
        """Whether there is a forced vibration within so much of a frequency (natural logarithm)."""
        return bool(kernel.forced_at(self.vibrations, frequency_hz, reach))


class Following:
    """The vibrations of one channel, from interval to interval."""

    def __init__(self) -> None:
        self._known = 0  # of the vibrations, the most suspicious first; behind them there is room for more
        self._vibrations, self._work = np.empty((2, ROOM), VIBRATION)
        self._taken = np.empty(ROOM, np.bool_)
        rules = Rules(0.5, 0.5)
        self._another_interval = bound(
            kernel.another_interval, self._vibrations, 0, NO_LINES, rules, _WEIGHTS, self._taken, self._work
        )

    def follow(self, evidence: Evidence, rules: Rules) -> Told:
        """Follow them through another interval."""
        lines = lines_of(evidence, rules.odds)
        self._make_room(len(lines))
        self._known, (suspicion, *numbers, steady, chattered) = self._another_interval(
            self._vibrations, self._known, lines, rules, _WEIGHTS, self._taken, self._work
        )
        alarm, suspect, steadiest = (
            None if number == NONE else self._followed(number, evidence.vibrations) for number in numbers
        )
        return Told(suspicion, alarm, suspect, steadiest, steady, chattered, self._vibrations[: self._known])

    def _make_room(self, lines: int) -> None:
        """Take more memory, if that many lines may be more than there is room for."""
        size = len(self._vibrations)
        if self._known + lines > size:
            self._vibrations = np.concatenate([self._vibrations, np.empty(size, VIBRATION)])
            self._work, self._taken = np.empty_like(self._vibrations), np.empty(2 * size, np.bool_)

    def rest(self) -> None:
        """Remember, while nothing is cut, only which vibrations have chattered."""
        known = self._vibrations[: self._known]
        known = known[known["chattered"] & (known["over"] < FORGOTTEN_CHATTER)]
        for name, probability in zip(Kinds._fields, CALMED, strict=True):
            known[name] = probability
        known["missed"] += 1
        known["over"] += 1
        known["alarm_for"] = 0
        known["line"] = NO_LINE
        self._known = len(known)
        self._vibrations[: self._known] = known

    def _followed(self, number: int, vibrations: tuple[Vibration, ...]) -> Followed:
        """One of them, in an interval with these lines."""
        frequency_hz, noise, growing, saturated, steady, unexplained, alarm_for, chattered, line, *_ = self._vibrations[
            number
        ].tolist()
        heard = None if line == NO_LINE else vibrations[line]
        return Followed(
            frequency_hz, Kinds(noise, growing, saturated, steady), unexplained, alarm_for, chattered, heard
        )


def steady_share(synchronous: float, told: Told) -> float:
    """Share of the power that turns with the spindle, or is in steady lines that have not chattered."""
    return synchronous + (1.0 - synchronous) * min(told.steady_share, 1.0)


def repeating_share(orders: Orders, told: Told) -> float:
    """Share of the power that repeats, but for that of what has chattered or regenerates: that repeats, too."""
    if orders.growth > 0.0:
        return 0.0
    return orders.repeating_share - (1.0 - orders.synchronous_share) * told.chattered_share


def lines_of(evidence: Evidence, odds: Odds) -> NDArray[np.void]:
    """Prominent lines of an interval as the kernel takes them, shape (vibrations,)."""
    vibrations, orders = evidence.vibrations, evidence.orders
    own = [v.line.share * left(v.line, evidence) for v in vibrations]
    heard = orders.source == "refined" and orders.heard
    # what grows from rotation to rotation is many lines, too near to each other to be told: it counts as the strongest
    strongest = max(vibrations, key=lambda v: v.line.share, default=None) if orders.growth > 0.0 else None
    numbers: list[float] = []  # one after the other they are put into an array several times faster than as records
    for v, dominance in zip(vibrations, own, strict=True):
        line = v.line
        at_its_place = order_odds(v, orders, odds)
        if at_its_place > 0.0:  # teeth have overtones, too
            dominance += sum(more for o, more in zip(vibrations, own, strict=True) if is_overtone(o.line, line))
            if heard:
                line = with_news(line)
        growth = orders.growth if v is strongest else 0.0
        if growth > 0.0:
            # out of step is off the orders, whatever the speed; and all power is its but what there was before
            at_its_place = max(at_its_place, odds.off_found)
            dominance = max(dominance, 1.0 - math.exp(-2.0 * growth))
        numbers += (*line[:-1], v.damping_ratio, at_its_place, dominance, growth, evidence.power)
    return np.array(numbers, dtype=np.float64).view(LINE)


def with_news(line: Line) -> Line:
    """A line that counts as risen by as much as it is more than in the cuts before and in the air between.

    Chatter that is there as soon as the tool enters has not been seen to grow. Forced lines are new, too, when a job
    is; so this is for lines off the orders of the spindle, where its speed is known and it is heard.
    """
    return line._replace(long_rise=max(line.long_rise, line.news), absolute_rise=max(line.absolute_rise, line.news))


def is_overtone(line: Line, fundamental: Line) -> bool:
    """Whether a line is at a multiple of another: what throws the tool out of the cut is periodic, not harmonic.

    An accelerometer hears overtones louder than what they belong to.
    """
    order = round(line.frequency_hz / fundamental.frequency_hz)
    return 1 < order <= OVERTONES and abs(line.frequency_hz - order * fundamental.frequency_hz) < OVERTONE_HZ


def left(line: Line, evidence: Evidence) -> float:
    """Share of the power at a line's frequency that has not been taken out with what turns.

    Beside a strong order something is always left, for it is neither quite steady nor its speed quite known.
    """
    orders = evidence.orders
    if not orders.lines and not orders.other_lines:
        return 1.0
    here = line.share * evidence.power
    lines = (*orders.lines, *orders.other_lines)
    taken = max((o.rms**2 for o in lines if abs(o.frequency_hz - line.frequency_hz) < LINE_WIDTH_HZ), default=0.0)
    return here / (here + taken) if here > 0.0 else 1.0


def order_odds(vibration: Vibration, orders: Orders, odds: Odds) -> float:
    """Log odds for self-excitation by its place among the orders: chatter may be anywhere, forced lines are not."""
    teeth, place = vibration.teeth, vibration.place
    if teeth is None:
        return odds.unknown_speed
    if place is None:
        return 0.0
    at_teeth = FORCED_AT_TEETH * teeth.near / teeth.by_chance
    at_rotation = FORCED_AT_ROTATION * place.near / place.by_chance
    off_orders = FORCED_OFF_ORDERS * (not place.near) / (1.0 - place.by_chance)
    forced = at_teeth + at_rotation + off_orders
    if orders.source == "found" and forced < 1.0:  # what was found may be another machine's comb
        return odds.off_found
    return -math.log(forced)
