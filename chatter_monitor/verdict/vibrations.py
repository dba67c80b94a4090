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
from chatter_monitor.kernels.heard import FIELDS
from chatter_monitor.kernels.kinds import LINE, Kinds
from chatter_monitor.kernels.overview import NONE, Overview
from chatter_monitor.kernels.relatives import NEARLY_ALWAYS
from chatter_monitor.kernels.swings import end_cut, hold_back, new_swings
from chatter_monitor.kernels.testimony import NO_CARRIER, Carrier, witness
from chatter_monitor.kernels.vibration import NO_LINE, VIBRATION
from chatter_monitor.kernels.vibrations import CALMED, FORGOTTEN_CHATTER, Odds, Rules, withdraw
from chatter_monitor.tracking.orders import Orders
from chatter_monitor.verdict.evidence import Evidence, Heard, Vibration
from chatter_monitor.verdict.known_orders import NOTHING_TAKEN, KnownOrders
from chatter_monitor.verdict.weights import CALM, GROWTH

# Vibrations that there is room for at first.
ROOM = 64

NOTHING_KNOWN, NO_VIBRATIONS = Overview(), np.empty(0, VIBRATION)
NOT_HEARD = Heard(np.empty((0, FIELDS)), np.empty((0, 4)))
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
        Whether there has been an alarm about it, within the last minute, that needed no memory of another.
    heard : Vibration or None
        Its line in this interval.
    glided : bool
        Whether a spindle has taken it along.
    carried : bool
        Whether it is nearly always a multiple of a line with less of the power.
    """

    frequency_hz: float
    kinds: Kinds
    unexplained: float = 0.0
    alarm_for: int = 0
    chattered: bool = False
    heard: Vibration | None = None
    glided: bool = False
    carried: bool = False

    @property
    def self_excited(self) -> float:
        """Probability that it has risen and nothing that turns explains it."""
        return self.kinds.risen * self.unexplained


class Told:
    """What is told of all vibrations of an interval; those become objects that something is said about.

    Parameters
    ----------
    overview : Overview
        What they come to.
    vibrations : ndarray of VIBRATION
        All of them, the most suspicious first, until the next interval.
    heard : Heard
        Lines of the interval.
    """

    __slots__ = ("_heard", "overview", "vibrations")

    def __init__(
        self,
        overview: Overview = NOTHING_KNOWN,
        vibrations: NDArray[np.void] = NO_VIBRATIONS,
        heard: Heard = NOT_HEARD,
    ) -> None:
        self.overview = overview
        self.vibrations = vibrations
        self._heard = heard

    @property
    def alarm(self) -> Followed | None:
        """The one that the running alarm began with."""
        return self._followed(self.overview.alarm)

    @property
    def suspect(self) -> Followed | None:
        """The most suspicious that is heard and takes enough of the power to be chatter."""
        return self._followed(self.overview.suspect)

    @property
    def riser(self) -> Followed | None:
        """That which takes most of what has got louder and may be on its way to chatter."""
        return self._followed(self.overview.riser)

    @property
    def steadiest(self) -> Followed | None:
        """That with most steady power."""
        return self._followed(self.overview.steadiest)

    @property
    def chattered(self) -> Followed | None:
        """Of those that are heard and have chattered the one with most power."""
        return self._followed(self.overview.loudest_chattered)

    @property
    def climbs(self) -> bool:
        """Whether any that an alarm is about has come to its height by and by."""
        return bool(kernel.alarm_climbs(self.vibrations))

    @property
    def recalls(self) -> bool:
        """Whether the running alarm began by the memory of another."""
        number = self.overview.alarm
        return number != NONE and bool(self.vibrations["recalled"][number])

    @property
    def only_orders_chattered(self) -> bool:
        """Whether an alarm was about any just now, and all of these are on orders."""
        return bool(kernel.only_orders_chattered(self.vibrations))

    def is_forced(self, frequency_hz: float, reach: float) -> bool:
        """Whether there is a forced vibration within so much of a frequency (natural logarithm)."""
        return bool(kernel.forced_at(self.vibrations, frequency_hz, reach))

    def _followed(self, number: int) -> Followed | None:
        if number == NONE:
            return None
        known = self.vibrations[number].tolist()
        hertz, noise, growing, saturated, steady, unexplained, alarm_for, chattered, line, *_, carried, glided = known
        kinds = Kinds(noise, growing, saturated, steady)
        heard = None if line == NO_LINE else self._heard[line]
        about = hertz, kinds, unexplained, alarm_for, chattered, heard
        return Followed(*about, glided=glided > 0, carried=carried > NEARLY_ALWAYS)


class Following:
    """The vibrations of one channel, from interval to interval."""

    def __init__(self) -> None:
        self._orders = KnownOrders()
        self._swings = new_swings()
        cut = np.empty((0, FIELDS)), 0.0, 0.0, True, NO_CARRIER
        self._hold_back = bound(hold_back, *cut, NO_VIBRATIONS, self._swings)
        self._end_cut = bound(end_cut, self._swings)
        self._known = 0  # of the vibrations, the most suspicious first; behind them there is room for more
        self._vibrations, self._work = np.empty((2, ROOM), VIBRATION)
        self._lines, self._taken = np.empty(ROOM, LINE), np.empty(ROOM, np.bool_)
        testimony = (np.empty((0, FIELDS)), NOTHING_TAKEN, False, False, NO_CARRIER, 0.0, 0.0, 0.0)
        self._another_interval = bound(
            kernel.another_interval,
            *(self._vibrations, 0, testimony, Rules(0.5, 0.5), _WEIGHTS, self._lines, self._taken, self._work),
        )

    def follow(self, evidence: Evidence, rules: Rules, usual: float = 0.0, *, calm: bool = True) -> Told:
        """Follow them through another interval, of a cut that usually has so much power, and is calm or in alarm."""
        heard = evidence.vibrations.copy()
        known = self._vibrations[: self._known]
        self._hold_back(heard.table, evidence.power, usual, calm, _carrier(evidence), known, self._swings)
        taken = self._orders.hear(evidence.orders, evidence.power, calm=calm)
        self._make_room(len(heard))
        self._known, seen = self._another_interval(
            *(self._vibrations, self._known, _testimony(evidence._replace(vibrations=heard), taken, usual), rules),
            *(_WEIGHTS, self._lines, self._taken, self._work),
        )
        return Told(Overview(*seen), self._vibrations[: self._known], heard)

    def _make_room(self, lines: int) -> None:
        """Take more memory, if that many lines may be more than there is room for."""
        size = len(self._vibrations)
        if self._known + lines > size:
            self._vibrations = np.concatenate([self._vibrations, np.empty(size, VIBRATION)])
            self._work = np.empty_like(self._vibrations)
            self._lines, self._taken = np.empty(2 * size, LINE), np.empty(2 * size, np.bool_)

    def withdraw(self) -> None:
        """Take what an alarm was about just now for something that turns."""
        withdraw(self._vibrations[: self._known])

    def rest(self, *, forget: bool = False) -> None:
        """Remember, while nothing is cut, only which vibrations have chattered; or forget those, too."""
        self._end_cut(self._swings)
        known = self._vibrations[: 0 if forget else self._known]
        known = known[known["chattered"] & (known["own"] < FORGOTTEN_CHATTER)]
        for name, probability in zip(Kinds._fields, CALMED, strict=True):
            known[name] = probability
        known["frequency_hz"] = known["chattered_hz"]  # as the tool left, another mode may have been heard nearby
        for since in ("missed", "over", "own"):
            known[since] += 1
        known["alarm_for"] = 0
        known["crest"] = -math.inf  # it has not come down by itself
        known["calm"] = 0.0  # of the next cut that is not known
        known["line"] = NO_LINE
        self._known = len(known)
        self._vibrations[: self._known] = known


def steady_share(synchronous: float, told: Told) -> float:
    """Share of the power that turns with the spindle, or is in steady lines that have not chattered."""
    return synchronous + (1.0 - synchronous) * min(told.overview.steady_share, 1.0)


def repeating_share(orders: Orders, told: Told) -> float:
    """Share of the power that repeats, but for that of what has chattered or regenerates: that repeats, too."""
    if orders.growth > 0.0:
        return 0.0
    return orders.repeating_share - (1.0 - orders.synchronous_share) * told.overview.chattered_share


def lines_of(evidence: Evidence, odds: Odds) -> NDArray[np.void]:
    """Prominent lines of an interval as vibrations take them, shape (lines,)."""
    lines = np.empty(len(evidence.vibrations), LINE)
    witness(*_testimony(evidence, KnownOrders().hear(evidence.orders, evidence.power), 0.0), odds, lines)
    return lines


def _testimony(
    evidence: Evidence, taken: NDArray[np.float64], usual: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], bool, bool, Carrier, float, float, float]:
    """What `kernels.testimony` takes of an interval."""
    orders = evidence.orders
    return (
        evidence.vibrations.table,
        taken,
        orders.source == "found" and not evidence.same_cut,
        evidence.spindle_heard,
        _carrier(evidence),
        orders.growth,
        evidence.power,
        usual,
    )


def _carrier(evidence: Evidence) -> Carrier:
    """The line with sidebands."""
    beside = evidence.orders.sidebands
    return NO_CARRIER if beside is None else Carrier(beside.carrier_hz, beside.spacing_hz, beside.either)
