"""The margin to chatter of a running signal: the strength of regeneration, heard from the vibration alone.

The averaged periodogram of a channel is fitted by one mode with a regenerative delay (`tracking.mode`): the one with
most power. Another one that stands out is fitted as well, to know whether that may be nearer to chatter.
"""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from chatter_monitor.errors import InputError
from chatter_monitor.tracking.margin import Margin, beside
from chatter_monitor.tracking.mode import Average, FollowedMode
from chatter_monitor.tracking.periodogram import AveragedPeriodogram, other_peak_hz, spindle_lines, strongest_peak_hz
from chatter_monitor.tracking.regeneration import Pieces
from chatter_monitor.tracking.tracker import INTERVAL_S
from chatter_monitor.tracking.turns import TURNS

Array = NDArray[np.float64]

SEGMENT_FRAMES = 50  # 2.5 s: bins of 0.4 Hz
HOP_FRAMES = 20  # windows that overlap by three fifths lose 3 % of what there is to know
FRAMES_PER_FIT = 20
# After so many frames of another vibration a margin is of that alone, if the level is another one, too.
FRAMES_TO_RENEW = SEGMENT_FRAMES + HOP_FRAMES + FRAMES_PER_FIT
_BINS_PER_FRAME = 3000  # evaluated in a fit, about: a quarter of a millisecond
_LOWEST_HZ = 60.0  # of a mode; below are offset and drift
_UNHEARD = "samples are missing, or nothing moves"
# Relative change of the rotation, in its standard deviations, after which the comb of the delay is another one.
_OTHER_SPEED = 4.0


class MarginSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the margin is tracked.

    Attributes
    ----------
    memory_s : float
        Time constant of the exponential forgetting; the effective window is twice as long.
    speed_uncertainty : float
        Least relative standard deviation of the rotation frequency that is given. Within it the delay is estimated from
        the signal itself.
    """

    memory_s: Annotated[float, msgspec.Meta(gt=0)] = 5.0
    speed_uncertainty: Annotated[float, msgspec.Meta(gt=0, lt=0.1)] = 0.003


class MarginTracker:
    """Regeneration of one channel: blocks in, a margin for every frame out.

    Frames are those of the `Tracker`. After every twenty of them a fit begins, unless one is under way. It is shared
    out over the frames, and its margin holds from its end until that of the next. Spindle harmonics should have been
    removed from the signal; what is left of them is kept out of the fit.

    Parameters
    ----------
    settings : MarginSettings
        Memory, and how well the speed is known.
    sample_rate_hz : float
        Of the signal.
    teeth : int
        Cutting edges that pass in one revolution.
    turn : int
        Frame of a round in which it transforms the signal (`tracking.turns`).
    """

    def __init__(self, settings: MarginSettings, sample_rate_hz: float, teeth: int, turn: int = 0) -> None:
        if teeth < 1:
            raise InputError("the number of teeth makes no sense", got=teeth, allowed="1 or more")
        self._settings = settings
        self._teeth = teeth
        self._frame = round(INTERVAL_S * sample_rate_hz)
        self._bin_hz = sample_rate_hz / (SEGMENT_FRAMES * self._frame)
        self._periodogram = AveragedPeriodogram(
            SEGMENT_FRAMES * self._frame,
            HOP_FRAMES * self._frame,
            settings.memory_s * sample_rate_hz,
            lowest_bin=math.ceil(_LOWEST_HZ / self._bin_hz),
        )
        self._turn = turn % TURNS
        self._samples = 0
        self._nothing = np.full(self._frame, np.nan)
        self._undigested = False  # whether a frame has ended
        self._latest_hz: float | None = None  # speed in it
        self._rotation_hz: float | None = None  # with which the average began
        self._margin = Margin(reason="the spindle speed is unknown")
        self._uncertainty = settings.speed_uncertainty
        self._cutting = True
        self._renewed = False
        self._unheard = _UNHEARD  # why there is no margin if nothing has been renewed
        self._strongest, self._other = FollowedMode(), FollowedMode()
        self._under_way: Pieces[None] | None = None

    def process(
        self, samples: Array, rotation_hz: float | None, rotation_sd_hz: float | None = None, *, cutting: bool = True
    ) -> list[Margin]:
        """Take samples and return the margin of each frame that they complete.

        Parameters
        ----------
        samples : ndarray of float64, shape (n,)
            The signal; what is not finite is missing.
        rotation_hz : float or None
            Rotation frequency of the spindle during these samples; None if it is not known.
        rotation_sd_hz : float, optional
            Its standard deviation, if that is larger than the settings' uncertainty.
        cutting : bool
            Whether the tool is in the cut. Air has no margin, and no part in that of the cut before and after it.
        """
        self.digest()
        self._follow_speed(rotation_hz, rotation_sd_hz)
        self._follow_tool(cutting=cutting)
        margins = []
        while len(samples):
            self.digest()
            size = min(len(samples), self._frame - self._samples % self._frame)
            if rotation_hz is None:  # the average begins with the first speed that is known
                self._periodogram.skip(size)
            else:
                self._periodogram.take(samples[:size] if cutting else self._nothing[:size])
            samples = samples[size:]
            self._samples += size
            if self._samples % self._frame == 0:
                self._undigested, self._latest_hz = True, rotation_hz
                margins.append(self._margin)
        return margins

    def digest(self) -> None:
        """Transform when it is its turn, begin a fit when a round is over, and go on with it.

        What comes of it counts from the next frame on: later, before the next sample, if not now.
        """
        if not self._undigested:
            return
        self._undigested = False
        frame, rotation_hz = self._samples // self._frame, self._latest_hz
        if frame % HOP_FRAMES == self._turn:
            self._renewed |= self._periodogram.add()
        if frame % FRAMES_PER_FIT == TURNS and rotation_hz is not None and self._cutting:
            if self._renewed:
                self._under_way = self._under_way or self._update(rotation_hz)
                self._unheard = _UNHEARD
            elif self._strongest.fit is not None:
                self._withdraw(self._unheard)
            self._renewed = False
        evaluated = 0
        while self._under_way is not None and evaluated < _BINS_PER_FRAME:
            try:
                evaluated += next(self._under_way)
            except StopIteration:
                self._under_way = None
                if self._strongest.margin is not None:
                    self._margin = beside(self._strongest.margin, self._other.margin)

    def _follow_tool(self, *, cutting: bool) -> None:
        """Withdraw the margin when the tool leaves; when it is back, the average goes on with the next whole window."""
        if cutting == self._cutting or self._rotation_hz is None:
            return
        self._cutting, self._renewed = cutting, False
        self._unheard = "too little signal yet of this cut" if cutting else "nothing is cut"
        self._withdraw(self._unheard)

    def _withdraw(self, reason: str) -> None:
        self._under_way = self._strongest.margin = self._other.margin = None
        self._margin = Margin(reason=reason)

    def _follow_speed(self, rotation_hz: float | None, rotation_sd_hz: float | None) -> None:
        """Start anew when the teeth pass at another pace, because the comb of their delay is another one."""
        known, uncertainty = self._rotation_hz, self._uncertainty
        if rotation_hz is not None:
            self._uncertainty = max(self._settings.speed_uncertainty, (rotation_sd_hz or 0.0) / rotation_hz)
        if rotation_hz == known:
            return
        if rotation_hz is None:
            self._start_anew("the spindle speed is unknown")
        elif known is None or abs(rotation_hz / known - 1.0) > _OTHER_SPEED * uncertainty:
            self._start_anew("too little signal yet at this speed")
        else:
            return  # that one stays the reference: many small steps are a large one
        self._rotation_hz = rotation_hz

    def _start_anew(self, reason: str) -> None:
        self._periodogram.interrupt()
        self._strongest, self._other = FollowedMode(), FollowedMode()
        self._under_way = None
        self._renewed = False
        self._margin = Margin(reason=reason)

    def _update(self, rotation_hz: float) -> Pieces[None]:
        """Fit the present average."""
        spectrum, windows, bin_hz = self._periodogram.spectrum, self._periodogram.windows, self._bin_hz
        lines = spindle_lines(spectrum, bin_hz, rotation_hz, windows)
        strongest_hz = strongest_peak_hz(spectrum, lines, bin_hz)
        yield _BINS_PER_FRAME
        tooth_hz, width = rotation_hz * self._teeth, self._settings.speed_uncertainty
        average = Average(spectrum, windows, lines, bin_hz, 1.0 / tooth_hz, self._uncertainty, width)
        yield from self._strongest.follow(average, strongest_hz)
        other_hz, margin = None, self._strongest.margin
        if margin is not None and margin.margin_percent is not None:  # else there is nothing to withhold
            turning = rotation_hz, self._teeth, self._uncertainty
            other_hz = other_peak_hz(spectrum, lines, bin_hz, strongest_hz, *turning)
            yield _BINS_PER_FRAME
        if other_hz is None:
            self._other = FollowedMode()
        else:
            yield from self._other.follow(average, other_hz)
