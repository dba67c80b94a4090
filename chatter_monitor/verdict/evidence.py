"""Numbers of one verdict interval that a verdict is made from; no decision yet."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from chatter_monitor.kernels.median import medians_where
from chatter_monitor.records import Flag, ModeStatus, OdpFrame
from chatter_monitor.tracking.channel import Observation
from chatter_monitor.tracking.margin import Margin
from chatter_monitor.tracking.orders import Orders
from chatter_monitor.tracking.spectrum import LOWEST_HZ, WINDOW_S, Line
from chatter_monitor.tracking.spindle import SpindleSettings

# A mode is looked at when it carries at least this share of the signal's power: the poles of a fit to little more than
# noise wander anywhere, zero damping included.
SIGNIFICANT_SHARE = 0.05
# A line is looked at when it carries at least this share: a sensor hears most of the structure, not all of it loud.
AUDIBLE_SHARE = 0.003
# A mode belongs to a line when their frequencies are this near, relatively or in Hz: lines are 40 Hz wide.
SAME_FREQUENCY = 0.05
LINE_WIDTH_HZ = 25.0
# How near to an order a line has to be: the frequency of a line 40 Hz wide is known to some Hz, and the order to so
# many standard deviations of the speed.
ORDER_TOLERANCE_HZ = 6.0
SPEED_DEVIATIONS = 2.33
# Orders that any frequency is this likely to be near are not told apart.
TELLING = 0.8
# Lines nearer to each other are one line to the short-time spectrum, somewhere between them.
RESOLUTION_HZ = 2.0 / WINDOW_S

# Plain numbers, as kernels take them.
OSCILLATORY, HELD, STARTING = int(ModeStatus.OSCILLATORY), int(ModeStatus.HELD), int(ModeStatus.STARTING)
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

    @property
    def telling(self) -> bool:
        """Whether multiples can be told apart."""
        return self.by_chance < TELLING


class Vibration(NamedTuple):
    """A line, the tracker's mode at it, and its place among the orders.

    Attributes
    ----------
    line : Line
        What the short-time spectrum says.
    mode : ModeEvidence or None
        What the recursion says; None where it has no mode there.
    rotation, teeth : Place or None
        Its place among the multiples of the rotation, and of the passing of teeth; None where the speed is unknown.
    """

    line: Line
    mode: ModeEvidence | None
    rotation: Place | None = None
    teeth: Place | None = None

    @property
    def place(self) -> Place | None:
        """Among the multiples of the rotation, or of the teeth where those are too dense; None where both are."""
        for place in (self.rotation, self.teeth):
            if place is not None and place.telling:
                return place
        return None

    @property
    def on_order(self) -> bool:
        """Whether it is on an order."""
        return self.place is not None and self.place.near

    @property
    def damping_ratio(self) -> float:
        """The mode's, or that of the line where the recursion has none."""
        return self.line.damping_ratio if self.mode is None else self.mode.damping_ratio


class Evidence(NamedTuple):
    """What one interval says.

    Attributes
    ----------
    critical : ModeEvidence or None
        The least damped of the modes that carry a significant share of the power.
    vibrations : tuple of Vibration
        The lines that stand out.
    orders : Orders
        What turns with the spindle.
    margin : Margin
        How far the cut is from chatter.
    cutting, entering : bool
        The tool is in the cut, as far as is known; it enters it just now.
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
    vibrations: tuple[Vibration, ...]
    orders: Orders
    margin: Margin
    cutting: bool
    held: bool
    starting: bool
    rms: float
    flags: Flag
    entering: bool = False

    @property
    def power(self) -> float:
        """Of what does not turn with the spindle: that which lines have their shares of."""
        return self.rms**2 * (1.0 - self.orders.synchronous_share)


def modes_evidence(frame: OdpFrame) -> tuple[list[ModeEvidence | None], list[list[int]]]:
    """Summarise each mode slot.

    Returns
    -------
    list of ModeEvidence or None
        None where it had no frequency for half of the interval or longer.
    list of list of int
        For each slot, how many of its samples have each `ModeStatus`.
    """
    columns = (frame.frequency_hz, frame.damping_ratio, frame.damping_sd)
    samples, slots = frame.status.shape
    medians, counts = np.empty((slots, len(columns))), np.empty((slots, STATUSES), np.int64)
    medians_where(columns, frame.status, frame.hold, OSCILLATORY, np.empty(samples, np.float32), medians, counts)
    modes = [
        None if math.isnan(frequency_hz) else ModeEvidence(frequency_hz, damping_ratio, damping_sd, share)
        for (frequency_hz, damping_ratio, damping_sd), share in zip(medians.tolist(), frame.share.tolist(), strict=True)
    ]
    return modes, counts.tolist()


def weigh(observation: Observation, spindle: SpindleSettings) -> Evidence:
    """Reduce an interval to evidence."""
    frame, orders = observation.odp, observation.orders
    slots, statuses = modes_evidence(frame)
    modes = [mode for mode in slots if mode is not None]
    significant = [mode for mode in modes if mode.share >= SIGNIFICANT_SHARE]
    vibrations = []
    for line in observation.lines:
        hertz = line.frequency_hz
        if line.share >= AUDIBLE_SHARE and hertz >= LOWEST_HZ:  # the crest of what is below is beside it
            rotation = place_among_orders(hertz, orders, 1)
            teeth = rotation if spindle.teeth == 1 else place_among_orders(hertz, orders, spindle.teeth)
            vibrations.append(Vibration(line, _mode_at(line, modes), rotation, teeth))
    return Evidence(
        critical=min(significant, key=lambda mode: mode.damping_ratio, default=None),
        vibrations=tuple(vibrations),
        orders=orders,
        margin=observation.margin,
        cutting=observation.cutting,
        held=all(counts[HELD] == len(frame) for counts in statuses),
        starting=any(counts[STARTING] for counts in statuses),
        rms=frame.rms / math.sqrt(max(1.0 - orders.synchronous_share, 1e-6)),
        flags=frame.flags,
        entering=observation.entering,
    )


def _mode_at(line: Line, modes: list[ModeEvidence]) -> ModeEvidence | None:
    """The least damped mode at a line's frequency."""
    hertz = line.frequency_hz
    reach = max(SAME_FREQUENCY, LINE_WIDTH_HZ / hertz)
    least = None
    for mode in modes:
        if abs(math.log(mode.frequency_hz / hertz)) < reach and (
            least is None or mode.damping_ratio < least.damping_ratio
        ):
            least = mode
    return least


def place_among_orders(frequency_hz: float, orders: Orders, spacing: int) -> Place | None:
    """Place of a frequency among the multiples of so many times the rotation; None where that is unknown.

    As long as the spindle is not heard its lines are still in the signal; those that are not resolved may be anywhere.
    """
    rotation_hz = orders.rotation_hz
    if rotation_hz is None:
        return None
    spacing_hz = rotation_hz * spacing
    if orders.source == "given" and spacing_hz < RESOLUTION_HZ:
        return Place(near=True, by_chance=1.0)
    deviation = (orders.rotation_sd_hz or 0.0) / rotation_hz
    tolerance_hz = max(ORDER_TOLERANCE_HZ, SPEED_DEVIATIONS * deviation * frequency_hz)
    order = round(frequency_hz / spacing_hz)
    near = order >= 1 and abs(frequency_hz - order * spacing_hz) < tolerance_hz
    return Place(near, min(2.0 * tolerance_hz / spacing_hz, 1.0))


def probability_below(mode: ModeEvidence, damping_ratio: float) -> float:
    """Probability that the mode's damping is below a value, its estimate being normally distributed."""
    if not mode.damping_sd < math.inf:
        return 0.5
    return 0.5 * math.erfc((mode.damping_ratio - damping_ratio) / (math.sqrt(2.0) * max(mode.damping_sd, 1e-9)))


def spindle_order(frequency_hz: float, orders: Orders) -> float | None:
    """Frequency in multiples of the rotation, None where its speed is unknown."""
    return None if orders.rotation_hz is None else frequency_hz / orders.rotation_hz
