"""Numbers of one verdict interval that a verdict is made from; no decision yet."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.kernels import heard as kernel
from chatter_monitor.kernels.kinds import own_rise
from chatter_monitor.kernels.lines import ABSOLUTE_RISE, LONG_RISE, SHARE
from chatter_monitor.records import Flag, ModeStatus
from chatter_monitor.tracking.channel import Observation
from chatter_monitor.tracking.margin import Margin
from chatter_monitor.tracking.orders import Orders
from chatter_monitor.tracking.spectrum import LOWEST_HZ, Cycle, Line
from chatter_monitor.tracking.spindle import SpindleSettings

STATUSES = len(ModeStatus)


class ModeEvidence(NamedTuple):
    """One mode over one interval: medians over its samples, with the median of their standard deviations."""

    frequency_hz: float
    damping_ratio: float
    damping_sd: float
    share: float


class Place(NamedTuple):
    """Whether a frequency cannot be told from a multiple of another one, and how likely that is of any frequency."""

    near: bool
    by_chance: float


class Vibration(NamedTuple):
    """A line, the tracker's mode at it, and its place among the orders.

    Attributes
    ----------
    line : Line
        What the short-time spectrum says.
    mode : ModeEvidence or None
        What the recursion says; None where it has no mode there.
    place : Place or None
        Its place among the multiples of the rotation, or of the passing of teeth where those of the rotation are too
        dense to be told apart; None where both are, and where the speed is unknown.
    teeth : Place or None
        Its place among those of the teeth; None where the speed is unknown.
    """

    line: Line
    mode: ModeEvidence | None
    place: Place | None = None
    teeth: Place | None = None

    @property
    def on_order(self) -> bool:
        """Whether it is on an order."""
        return self.place is not None and self.place.near

    @property
    def damping_ratio(self) -> float:
        """The mode's, or that of the line where the recursion has none."""
        return self.line.damping_ratio if self.mode is None else self.mode.damping_ratio


class Heard(Sequence[Vibration]):
    """Vibrations of an interval, of which those become objects that somebody asks for.

    Parameters
    ----------
    table : ndarray of float64, shape (n, FIELDS)
        Their numbers (`kernels.heard`).
    modes : ndarray of float64, shape (slots, 4)
        Fields of `ModeEvidence`.
    """

    def __init__(self, table: NDArray[np.float64], modes: NDArray[np.float64]) -> None:
        self.table = table
        self._modes = modes

    def __len__(self) -> int:
        return len(self.table)

    @property
    def loudest(self) -> Vibration | None:
        """That with most of the power."""
        return self[int(self.table[:, SHARE].argmax())] if len(self) else None

    def nearest(self, frequency_hz: float, within_hz: float = math.inf) -> Vibration | None:
        """That nearest to a frequency, if it is near."""
        away = np.abs(self.table[:, kernel.HERTZ] - frequency_hz)
        return self[int(away.argmin())] if away.size and away.min() <= within_hz else None

    @property
    def own_rise(self) -> float:
        """By how much that has got louder by itself (natural logarithm of the amplitude); 0 where there is none."""
        if not len(self):
            return 0.0
        loudest = self.table[self.table[:, SHARE].argmax()]
        return float(own_rise(loudest[LONG_RISE], loudest[ABSOLUTE_RISE]))

    def copy(self) -> Heard:
        """The same with a table of its own."""
        return Heard(self.table.copy(), self._modes)

    @overload
    def __getitem__(self, index: int) -> Vibration: ...
    @overload
    def __getitem__(self, index: slice) -> Heard: ...
    def __getitem__(self, index: int | slice) -> Vibration | Heard:
        if isinstance(index, slice):
            return Heard(self.table[index], self._modes)
        *line, mode, _, near, by_chance, near_teeth, teeth_by_chance = self.table[index].tolist()
        return Vibration(
            Line._make(line),
            _mode(self._modes, int(mode)),
            None if math.isnan(by_chance) else Place(near > 0.0, by_chance),
            None if math.isnan(teeth_by_chance) else Place(near_teeth > 0.0, teeth_by_chance),
        )


def _mode(modes: NDArray[np.float64], number: int) -> ModeEvidence | None:
    return None if number == kernel.NO_MODE else ModeEvidence._make(modes[number].tolist())


class Evidence(NamedTuple):
    """What one interval says.

    Attributes
    ----------
    critical : ModeEvidence or None
        The least damped of the modes that carry a significant share of the power.
    vibrations : Heard
        The lines that stand out.
    orders : Orders
        What turns with the spindle.
    margin : Margin
        How far the cut is from chatter.
    cutting, entering, alone : bool
        The tool is in the cut, as far as is known; it enters it just now; of the cut before nothing was heard but
        lines.
    grown : bool
        The line that stands out most has grown out of a mode that sounded in the cut before.
    cycle : Cycle or None
        What the loudest band keeps of amplitude and phase.
    same_cut : bool
        What forces the cut is the same as in the passes before, in which the spindle was heard to turn as it is said
        to now (`verdict.earlier`).
    held : bool
        No sample of the interval could be adapted to: nothing moves.
    starting : bool
        The tracker knows too little yet, at the start or after a gap.
    rms : float
        Of the signal without its offset, what turns with the spindle included.
    flags : Flag
        What is wrong with the samples.
    """

    critical: ModeEvidence | None
    vibrations: Heard
    orders: Orders
    margin: Margin
    cutting: bool
    held: bool
    starting: bool
    rms: float
    flags: Flag
    entering: bool = False
    alone: bool = False
    grown: bool = False
    cycle: Cycle | None = None
    same_cut: bool = False

    @property
    def spindle_heard(self) -> bool:
        """Whether the spindle is heard, at a speed that is told, or at that at which it turned in the passes before."""
        return self.orders.spindle_heard or self.same_cut

    @property
    def grown_hz(self) -> float | None:
        """Frequency of the line that has grown out of a mode, if one has."""
        return self.vibrations[0].line.frequency_hz if self.grown and len(self.vibrations) else None

    @property
    def power(self) -> float:
        """Of what does not turn with the spindle: that which lines have their shares of."""
        return self.rms**2 * (1.0 - self.orders.synchronous_share)

    @property
    def turning(self) -> float:
        """Of what does turn with it."""
        return self.rms**2 * self.orders.synchronous_share


def weigh(observation: Observation, spindle: SpindleSettings) -> Evidence:
    """Reduce an interval to evidence."""
    frame, orders = observation.odp, observation.orders
    samples, slots = frame.status.shape
    teeth = 1 if orders.doubted else spindle.teeth  # who turns at another speed may have other teeth
    modes, heard = np.empty((slots, 4)), np.empty((len(observation.lines), kernel.FIELDS))
    count, critical, held, starting = kernel.weigh(
        (frame.frequency_hz, frame.damping_ratio, frame.damping_sd),
        *(frame.status, frame.hold, frame.share, observation.lines, LOWEST_HZ, speed(orders), teeth),
        *(np.empty(samples, np.float32), np.empty((slots, STATUSES), np.int64), modes, heard),
    )
    return Evidence(
        critical=_mode(modes, critical),
        vibrations=Heard(heard[:count], modes),
        orders=orders,
        margin=observation.margin,
        cutting=observation.cutting,
        held=held,
        starting=starting,
        rms=frame.rms / math.sqrt(max(1.0 - orders.synchronous_share, 1e-6)),
        flags=frame.flags,
        entering=observation.entering,
        alone=observation.alone,
        grown=observation.grown,
        cycle=observation.cycle,
    )


def speed(orders: Orders) -> tuple[float, float, bool]:
    """What is known of the rotation, as `kernels.heard.place` takes it."""
    if orders.rotation_hz is None:
        return math.nan, 0.0, False
    return orders.rotation_hz, (orders.rotation_sd_hz or 0.0) / orders.rotation_hz, orders.source == "given"


def probability_below(mode: ModeEvidence, damping_ratio: float) -> float:
    """Probability that the mode's damping is below a value, its estimate being normally distributed."""
    if not mode.damping_sd < math.inf:
        return 0.5
    return 0.5 * math.erfc((mode.damping_ratio - damping_ratio) / (math.sqrt(2.0) * max(mode.damping_sd, 1e-9)))


def spindle_order(frequency_hz: float, orders: Orders) -> float | None:
    """Frequency in multiples of the rotation, None where its speed is unknown."""
    return None if orders.rotation_hz is None else frequency_hz / orders.rotation_hz
