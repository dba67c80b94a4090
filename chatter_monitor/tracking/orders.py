"""What turns, taken out of one channel before the tracker: the spindle, and then what else makes a comb.

A drive, a fan or the mains put combs of their own into the signal, whose lines are as steady as the spindle's and read
as undamped just the same. So there are two followers in a row: the first is after the spindle, the second takes what
the first leaves.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated, Literal, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from chatter_monitor.kernels.binding import bound
from chatter_monitor.kernels.recurrence import new_past, recurring_share
from chatter_monitor.kernels.repeats import new_repeats
from chatter_monitor.kernels.rotations import another_frame, new_rotations, new_slower
from chatter_monitor.kernels.taken import share_taken
from chatter_monitor.tracking.comb import Target, is_locked, is_mains
from chatter_monitor.tracking.follower import CombFollower
from chatter_monitor.tracking.harmonics import Harmonics
from chatter_monitor.tracking.long_spectrum import LongSpectrum, Power
from chatter_monitor.tracking.sidebands import Sidebands, find_sidebands
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.tracking.tracker import INTERVAL_S
from chatter_monitor.tracking.turns import TURNS, Piecemeal, in_turn

Source = Literal["given", "refined", "found"]
Positive = Annotated[float, msgspec.Meta(gt=0)]

SHOWN_LINES = 8  # of each comb
# Something that turns is heard when it has this share of the power.
HEARD_SHARE = 0.02
# What has come back into the signal matters when it is this share of the power: of what is less nothing comes that
# takes the power. A comb that is lost because something else grew loud beside it is next to nothing of that.
RETURNED_SHARE = 0.1
# What is left gets fainter when a comb is taken out that was not before, as long as that has so much of the power.
MOST = 0.5
# Relative standard deviation of a nominal speed: real ones are 1 to 3 % off.
NOMINAL_SD = 0.015
# A speed that was heard stays known when it is heard no more, because the spindle goes on turning; its relative
# variance grows by this much in a second.
FORGETTING = 0.002**2


class OrderSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the spindle-synchronous part is found and taken out: the table ``[orders]`` of a machine configuration.

    Attributes
    ----------
    memory_s : float
        Time over which a line has to be steady. What is taken out at each order is about 1 / (pi memory_s) Hz wide.
    window_s : float
        Stretch of signal in which a comb is looked for; half of it does at the start.
    speed_tolerance : float
        Largest relative distance of the real speed from the given one where it is looked for; once heard it is
        followed beyond.
    slowest_hz, fastest_hz : float
        Range of the fundamental when no speed is given. Lines that are all multiples of something above `fastest_hz`
        are not taken for a comb: a self-excited vibration has overtones, too.
    lowest_hz : float
        Below this is offset and drift, not vibration.
    lost_s : float
        Time without a comb after which it is given up.
    """

    memory_s: Positive = 1.0
    window_s: Positive = 2.55
    speed_tolerance: Positive = 0.035
    slowest_hz: Positive = 5.0
    fastest_hz: Positive = 250.0
    lowest_hz: Positive = 20.0
    lost_s: Positive = 1.5


class OrderLine(NamedTuple):
    """One harmonic: its order, its frequency, and its root mean square in the source's units."""

    order: int
    frequency_hz: float
    rms: float


class Orders(NamedTuple):
    """What turned in one frame.

    Attributes
    ----------
    first_sample : int
        Of the frame.
    rotation_hz, rotation_sd_hz : float or None
        Fundamental of the spindle's comb with its standard deviation; None while nothing is known. With a given speed
        it is the spindle's rotation. Without, it is the comb with more power, and may be the tooth passing frequency.
    source : "given", "refined", "found" or None
        Whether it is the given speed as it came, that speed refined by the signal, or comes from the signal alone.
    synchronous_share : float
        Share of the frame's power that was taken out, all combs together.
    lines : tuple of OrderLine
        What was taken out at the spindle's orders, strongest first, at most `SHOWN_LINES`.
    other_hz : float or None
        Fundamental of another comb beside the spindle's.
    other_lines : tuple of OrderLine
        What was taken out at that comb's orders.
    returned : bool
        Whether a comb is not taken out any more that was in the frame before: its lines are in the signal again.
    repeating_share : float
        Share of the power that repeats what was 50 to 100 ms before, combs taken out or not (`kernels.repeats`).
    recurring_share : float or None
        Share of the power that comes back after whole rotations of a spindle that has been heard, at a told speed or,
        where none is told, at that of a comb that was found (`kernels.recurrence`).
    fainter : bool
        Whether what is left has just got fainter, and the tool has not left: most of the signal goes on repeating,
        or is in a comb that has been taken out for no longer than its memory.
    power : float
        Variance of the signal with what turns.
    growth : float
        By how much a comb that is out of step with the rotation has grown (natural logarithm of the amplitude), 0 if
        there is none (`kernels.rotations`).
    sidebands : Sidebands or None
        A line with sidebands that is no multiple of their spacing, in the window before.
    doubted : bool
        Whether the speed that was told is not believed any more: what turns speaks against it.
    spectrum : ndarray of float64 or None
        Of the signal with all that turns, until the frame before this one, with every fourth frame
        (`tracking.long_spectrum`).
    stands : bool
        Whether the orders that were clear of the spindle's comb last are one of its rotation (`Target.stands`).
    """

    first_sample: int
    rotation_hz: float | None
    rotation_sd_hz: float | None
    source: Source | None
    synchronous_share: float
    lines: tuple[OrderLine, ...] = ()
    other_hz: float | None = None
    other_lines: tuple[OrderLine, ...] = ()
    returned: bool = False
    repeating_share: float = 0.0
    fainter: bool = False
    power: float = 0.0
    growth: float = 0.0
    sidebands: Sidebands | None = None
    doubted: bool = False
    recurring_share: float | None = None
    spectrum: Power | None = None
    stands: bool = True

    @property
    def spindle(self) -> tuple[float | None, float | None]:
        """Rotation of a spindle of told speed and its standard deviation (Hz); of a comb that was found, nothing."""
        return (None, None) if self.source == "found" else (self.rotation_hz, self.rotation_sd_hz)

    @property
    def heard(self) -> bool:
        """Whether something turns that can be heard."""
        return self.synchronous_share > HEARD_SHARE

    @property
    def rotation_heard(self) -> bool:
        """Whether the rotation is that of what turns now, and not what is remembered or was told."""
        return self.source != "given" and bool(self.lines) and self.heard

    @property
    def spindle_heard(self) -> bool:
        """Whether that is the spindle's, of a told speed that nothing speaks against, and not another comb's alone.

        Some lines of another job may be on orders of a speed that was heard before: 15 and 30 are a comb of the 15th.
        """
        return self.source == "refined" and self.rotation_heard and self.stands

    @property
    def spindle_unheard(self) -> bool:
        """Whether a speed has been told and no spindle is heard at it."""
        return self.spindle[0] is not None and not self.spindle_heard


class OrderTracker:
    """Takes what turns out of one channel, sample by sample, without delay.

    Parameters
    ----------
    settings : OrderSettings
        Memory, windows, ranges.
    sample_rate_hz : float
        Rate of the samples.
    spindle : SpindleSettings
        Speed and teeth, where known.
    turn : int
        Frame of a round in which it looks for combs (`tracking.turns`).
    """

    def __init__(self, settings: OrderSettings, sample_rate_hz: float, spindle: SpindleSettings, turn: int = 0) -> None:
        self._settings = settings
        self._spindle = spindle
        self._rate_hz = sample_rate_hz
        size = round(INTERVAL_S * sample_rate_hz)
        anything = Target(settings.slowest_hz, settings.fastest_hz)
        self._followers = [
            CombFollower(
                target,
                anything,
                size,
                sample_rate_hz,
                window_s=settings.window_s,
                memory_s=settings.memory_s,
                lowest_hz=settings.lowest_hz,
                lost_s=settings.lost_s,
                turn=turn,
            )
            for target in (self._target(), anything)
        ]
        self._signals = np.empty((len(self._followers) + 1, size))  # before, between and after the followers
        self._heard_before = new_repeats(size), new_rotations(), new_slower(size)
        self._listen = bound(another_frame, self._signals[0], *self._heard_before)
        self._repeating = 0.0, False, 0.0  # share, fainter, growth
        self._past = new_past(size)
        self._compare = bound(recurring_share, self._signals[0], self._past, 0.0)
        self._recurring: float | None = None
        self._comb_hz: float | None = None  # where no speed is told, of the comb with most power, the mains apart
        self._long_spectrum = LongSpectrum(sample_rate_hz, size)
        self._spectrum: Power | None = None
        self._filled = 0
        self._undigested = False  # whether the signals are those of a whole frame that has ended
        self._next_sample = 0
        self._taken = (0, 0.0)  # combs taken out of the last frame, and their power
        self._taken_s = math.inf  # since another comb has been taken out
        self._heard: tuple[float, float, int] | None = None  # speed and its deviation (Hz), and the sample then
        self._share = 0.0  # of the last frame's power that was taken out
        self._turn = turn
        self._sidebands: Sidebands | None = None
        self._search: Piecemeal[Sidebands | None] | None = None  # for sidebands
        self._rest = 0  # frames until the next one

    def set_spindle(self, spindle: SpindleSettings) -> None:
        """Go by another speed or number of teeth."""
        self.digest()
        self._spindle = spindle
        self._heard = self._comb_hz = None
        self._search, self._rest = None, 0
        self._followers[0].aim(self._target())

    def process(self, first_sample: int, samples: NDArray[np.float64]) -> tuple[NDArray[np.float64], list[Orders]]:
        """Take in the next samples.

        Parameters
        ----------
        first_sample : int
            Index of the first one; samples that were skipped since the last call count as missing.
        samples : ndarray of float64, shape (n,)
            The signal; NaN for what is missing.

        Returns
        -------
        ndarray of float64, shape (n,)
            The samples without what turns.
        list of Orders
            Of the frames that have ended, on the fixed grid of the sample index.
        """
        frames: list[Orders] = []
        while self._next_sample < first_sample:
            missing = min(self._signals.shape[1], first_sample - self._next_sample)
            self._take(np.full(missing, np.nan), frames)
        return self._take(samples, frames), frames

    def digest(self) -> None:
        """Learn from the frame that has ended, and look for combs; later, before the next sample, if not now."""
        if not self._undigested:
            return
        self._undigested = False
        self._spectrum = self._long_spectrum.hear(self._signals[0])
        first, second = self._followers
        rotation_hz = self._rotation_hz
        found = first.end_frame(self._signals[0], sidebands=self._sidebands, rotation_hz=rotation_hz)
        # With a comb that the first one takes from now on, the past is no guide to what is left; and where the spindle
        # itself is not heard, lines that are evenly spaced are more likely a self-excited vibration's, or the mains'.
        unheard = first.harmonics is None
        if found or (unheard and self._spindle.speed_rpm is None):
            second.forget()
        taken_hz = None if first.harmonics is None else first.harmonics.rotation_hz
        second.end_frame(self._signals[1], taken_hz, self._sidebands, rotation_hz=rotation_hz, mains_only=unheard)
        self._look_for_sidebands()

    def _look_for_sidebands(self) -> None:
        """Do a frame's part of the search: twice within the window, but where the power is explained."""
        if not self._followers[0].has_heard_enough:
            self._sidebands = self._search = None
            self._rest = 0
            return
        if self._rest == 0:
            self._rest = max(TURNS + 1, round(self._settings.window_s / (2.0 * INTERVAL_S)))
            if self._is_explained:
                self._sidebands = None
            else:
                self._search = in_turn(self._turn, partial(self._find_sidebands, self._followers[0].frames))
        self._rest -= 1
        if self._search is not None:
            try:
                next(self._search)
            except StopIteration as over:
                self._search, self._sidebands = None, over.value

    @property
    def _is_explained(self) -> bool:
        """Whether the spindle takes most of the power; any other comb may be one of sidebands."""
        spindle, other = (follower.harmonics for follower in self._followers)
        turns = self._believed and spindle is not None and other is None
        return turns and self._share > MOST

    @property
    def _believed(self) -> bool:
        """Whether a speed was told that nothing speaks against."""
        return self._spindle.speed_rpm is not None and not self._followers[0].doubts

    @property
    def _rotation_hz(self) -> float | None:
        """Rotation of a spindle of told speed that has been heard and is remembered."""
        hertz, _, source = self._from_memory(self._next_sample)
        return hertz if source == "refined" else None

    def _may_be_the_spindle(self, comb_hz: float) -> bool:
        """Whether a comb, while no speed is told, may be that of what forces the cut."""
        locked = self._comb_hz is not None and is_locked(comb_hz, self._comb_hz)
        return not (locked or is_mains(comb_hz))

    def _find_sidebands(self, last: int) -> Sidebands | None:
        """Those of the window, or of its last half: of what has begun since then nothing else is heard there."""
        return self._sidebands_of(last, 1) or self._sidebands_of(last, 2)

    def _sidebands_of(self, last: int, part: int) -> Sidebands | None:
        """A vibration wanders, and its sidebands with it: in step with it they are narrow."""
        told = self._target() if self._believed else None
        turns = self._followers[0].harmonics
        known_hz = turns.rotation_hz if told is not None and turns is not None else None
        found = find_sidebands(self._followers[0].faint_lines(last, part, known_hz), self._settings.slowest_hz, told)
        if found is not None:
            return found
        lines = self._followers[0].lines_in_step(last, part)
        return None if lines is None else find_sidebands(lines, self._settings.slowest_hz, told)

    def finish(self) -> list[Orders]:
        """What can be said of the last, shorter frame."""
        return [self._frame()] if self._filled else []

    def _target(self) -> Target:
        """What the first follower is after."""
        settings, spindle = self._settings, self._spindle
        if spindle.speed_rpm is None:
            return Target(settings.slowest_hz, settings.fastest_hz)
        nominal_hz, tolerance = spindle.speed_rpm / 60.0, settings.speed_tolerance
        return Target(nominal_hz * (1.0 - tolerance), nominal_hz * (1.0 + tolerance), spindle.teeth)

    def _take(self, samples: NDArray[np.float64], frames: list[Orders]) -> NDArray[np.float64]:
        residual = np.empty(len(samples))
        begin = 0
        while begin < len(samples):
            size = min(len(samples) - begin, self._signals.shape[1] - self._filled)
            self.digest()
            signals = self._signals[:, self._filled : self._filled + size]
            signals[0] = samples[begin : begin + size]
            for follower, before, after in zip(self._followers, signals[:-1], signals[1:], strict=True):
                follower.subtract(before, after)
            residual[begin : begin + size] = signals[-1]
            self._filled += size
            self._next_sample += size
            begin += size
            if self._filled == self._signals.shape[1]:
                frames.append(self._frame())
                self._filled = 0
                self._undigested = True
        return residual

    def _frame(self) -> Orders:
        """Describe the frame that has come in so far."""
        first_sample = self._next_sample - self._filled
        if self._filled == self._signals.shape[1]:  # a last, shorter frame tells nothing new
            self._repeating = self._listen(self._signals[0], *self._heard_before)
            period_hz = self._rotation_hz if self._believed else self._comb_hz
            rotation = 0.0 if period_hz is None else self._rate_hz / period_hz
            recurring = self._compare(self._signals[0], self._past, rotation)
            self._recurring = None if math.isnan(recurring) else recurring
        share, power = share_taken(self._signals[0, : self._filled], self._signals[-1, : self._filled])
        combs_before, taken_before = self._taken
        self._taken = sum(follower.harmonics is not None for follower in self._followers), share * power
        self._share = share
        self._taken_s = 0.0 if self._taken[0] > combs_before else self._taken_s + INTERVAL_S
        returned = self._taken[0] < combs_before and taken_before - share * power >= RETURNED_SHARE * power
        combs = [(follower.harmonics, _lines(follower.harmonics)) for follower in self._followers]
        if not self._believed:  # nobody knows which is the spindle's
            combs.sort(key=lambda comb: -sum(line.rms**2 for line in comb[1]))
        (spindle, lines), (other, other_lines) = combs
        other_hz = None if other is None else other.rotation_hz
        hertz, sd_hz, source = self._from_memory(first_sample)
        # A comb that has just gone is followed for a while, through noise: what was heard of it is known better.
        heard = bool(lines) and share > HEARD_SHARE
        if spindle is not None and (heard or source != "refined"):
            hertz, sd_hz = spindle.rotation_hz, spindle.rotation_sd_hz
            source = "refined" if self._believed else "found"
            if self._believed:
                self._heard = (hertz, sd_hz, first_sample)
            elif self._may_be_the_spindle(hertz):
                self._comb_hz = hertz
        repeating, fainter, growth = self._repeating
        fainter |= self._taken_s < self._settings.memory_s and share > MOST
        return Orders(
            *(first_sample, hertz, sd_hz, source, share),
            *(lines, other_hz, other_lines, returned),
            *(repeating, fainter),
            power=power,
            growth=growth,
            sidebands=self._sidebands,
            doubted=self._followers[0].doubts,
            recurring_share=self._recurring,
            spectrum=self._spectrum,
            stands=self._followers[0].stands,
        )

    def _from_memory(self, sample: int) -> tuple[float | None, float | None, Source | None]:
        """Speed, standard deviation and source while the spindle is not heard."""
        rpm = self._spindle.speed_rpm
        if rpm is None or not self._believed:
            return None, None, None
        nominal_hz = rpm / 60.0
        nominal_sd_hz = NOMINAL_SD * nominal_hz
        if self._heard is not None:
            hertz, sd_hz, then = self._heard
            sd_hz = math.sqrt(sd_hz**2 + FORGETTING * hertz**2 * (sample - then) / self._rate_hz)
            if sd_hz < nominal_sd_hz:
                return hertz, sd_hz, "refined"
        return nominal_hz, nominal_sd_hz, "given"


def _lines(harmonics: Harmonics | None) -> tuple[OrderLine, ...]:
    if harmonics is None:
        return ()
    rotation_hz = harmonics.rotation_hz
    return tuple(OrderLine(order, order * rotation_hz, rms) for order, rms in harmonics.strongest(SHOWN_LINES))
