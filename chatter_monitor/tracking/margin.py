"""How far a cut is from chatter: the strength of regeneration, heard from the vibration alone.

The averaged periodogram of a channel is fitted by one mode with a regenerative delay (`tracking.regeneration`). Kappa
and the modal parameters then give the limit at this speed and the rightmost characteristic root.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from chatter_monitor.errors import InputError
from chatter_monitor.kernels.delay_roots import critical_coefficient, ratio_and_damping, rightmost_root, sensitivity
from chatter_monitor.kernels.whittle import KAPPA, LOG_OMEGA, LOG_TAU, LOG_ZETA
from chatter_monitor.tracking.periodogram import AveragedPeriodogram, spindle_lines, strongest_peak_hz
from chatter_monitor.tracking.regeneration import Band, Fit, Pieces, Prior, fit, search
from chatter_monitor.tracking.tracker import INTERVAL_S
from chatter_monitor.tracking.turns import TURNS

Array = NDArray[np.float64]
Interval = tuple[float, float]

SEGMENT_FRAMES = 50  # 2.5 s: bins of 0.4 Hz
HOP_FRAMES = 20  # windows that overlap by three fifths lose 3 % of what there is to know
FRAMES_PER_FIT = 20
# After so many frames of another vibration a margin is of that alone, if the level is another one, too.
FRAMES_TO_RENEW = SEGMENT_FRAMES + HOP_FRAMES + FRAMES_PER_FIT
_BINS_PER_FRAME = 3000  # evaluated in a fit, about: a quarter of a millisecond
_LOWEST_HZ = 60.0  # of a mode; below are offset and drift
_CONFIDENCE_95 = 1.96
# Regeneration is visible when kappa is so many standard deviations above zero.
_VISIBLE = 2.0
_PHYSICAL = [LOG_OMEGA, LOG_ZETA, KAPPA, LOG_TAU]
_PAIRS = np.ix_(_PHYSICAL, _PHYSICAL)
# Relative change of the rotation, in its standard deviations, after which the comb of the delay is another one.
_OTHER_SPEED = 4.0
# The mode is looked for anew when the strongest peak is farther than this from it.
_OTHER_MODE = 0.12
_STEPS = 6  # from one fit to the next
# The fit looks at this range of frequency around the mode. Its skirts tell the slope and the floor, and where the delay
# is short and its comb is wide, only they tell regeneration from damping. Other modes in it show as a lack of fit:
# then less is looked at.
_WIDTHS = (1.6, 1.3, 1.12)
_OTHER_MODES = 2.0
_UNEXPLAINED = 4.0
_NO_MODE = "no mode stands out"
_UNLIKE = "the spectrum is not that of one mode with regeneration"


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


@dataclass(frozen=True, slots=True)
class Margin:
    """Regeneration of a cut and what it means; everything but the reason is None while nothing is known.

    Attributes
    ----------
    frequency_hz, damping_ratio : float or None
        Of the structure without the cut's regeneration.
    kappa, kappa_sd : float or None
        Process stiffness over modal stiffness, and its standard deviation.
    kappa_critical : float or None
        Where the cut loses its stability at this speed.
    ratio, ratio_ci95 : float or None, pair of float or None
        kappa / kappa_critical.
    damping_rightmost, damping_ci95 : float or None, pair of float or None
        Damping ratio of the rightmost root of the delay equation: of the machine while it is cutting.
    margin_percent, margin_ci95 : float or None, pair of float or None
        How much deeper the cut may be, 100 (kappa_critical / kappa - 1); None when no regeneration is visible.
    reason : str or None
        Why there is no margin; None when there is one.
    """

    frequency_hz: float | None = None
    damping_ratio: float | None = None
    kappa: float | None = None
    kappa_sd: float | None = None
    kappa_critical: float | None = None
    ratio: float | None = None
    ratio_ci95: Interval | None = None
    damping_rightmost: float | None = None
    damping_ci95: Interval | None = None
    margin_percent: float | None = None
    margin_ci95: Interval | None = None
    reason: str | None = None


def margin_of(found: Fit, lack_of_fit: float) -> Margin:
    """What a fit means for the cut, intervals by the delta method."""
    physical = found.theta[_PHYSICAL]
    covariance = lack_of_fit * found.covariance[_PAIRS]
    if not np.isfinite(covariance).all():
        return Margin(reason=_UNLIKE)
    omega, zeta, kappa, tau = _natural(physical)
    root = rightmost_root(omega, zeta, kappa, tau)
    gradients = np.empty((2, len(physical)))
    sensitivity(physical, root, 1e-5, gradients)
    ratio, damping = ratio_and_damping(physical, root)
    ratio_sd, damping_sd = np.sqrt(((gradients @ covariance) * gradients).sum(axis=1)).tolist()
    if not math.isfinite(ratio_sd + damping_sd):
        return Margin(reason=_UNLIKE)
    low, high = ratio - _CONFIDENCE_95 * ratio_sd, ratio + _CONFIDENCE_95 * ratio_sd
    kappa_sd = math.sqrt(covariance[2, 2])
    margin = Margin(
        frequency_hz=omega / (2.0 * math.pi),
        damping_ratio=zeta,
        kappa=kappa,
        kappa_sd=kappa_sd,
        kappa_critical=critical_coefficient(omega, zeta, tau),
        ratio=ratio,
        ratio_ci95=(low, high),
        damping_rightmost=damping,
        damping_ci95=(damping - _CONFIDENCE_95 * damping_sd, damping + _CONFIDENCE_95 * damping_sd),
    )
    if kappa < _VISIBLE * kappa_sd:
        return replace(
            margin, reason=f"no regeneration visible: kappa is {kappa:.4f} +- {_CONFIDENCE_95 * kappa_sd:.4f}"
        )
    return replace(
        margin,
        margin_percent=_percent(ratio),
        margin_ci95=(_percent(high), _percent(low) if low > 0.0 else math.inf),
    )


def _natural(physical: Array) -> tuple[float, float, float, float]:
    """Omega, zeta, kappa, tau."""
    log_omega, log_zeta, kappa, log_tau = physical.tolist()
    return math.exp(log_omega), math.exp(log_zeta), kappa, math.exp(log_tau)


def _percent(ratio: float) -> float:
    return 100.0 * (1.0 / ratio - 1.0)


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
        self._undigested = False  # whether a frame has ended
        self._latest_hz: float | None = None  # speed in it
        self._rotation_hz: float | None = None  # with which the average began
        self._margin = Margin(reason="the spindle speed is unknown")
        self._uncertainty = settings.speed_uncertainty
        self._renewed = False
        self._fit: Fit | None = None
        self._under_way: Pieces[None] | None = None
        self._mode_hz = 0.0
        self._width = 0

    def process(self, samples: Array, rotation_hz: float | None, rotation_sd_hz: float | None = None) -> list[Margin]:
        """Take samples and return the margin of each frame that they complete.

        Parameters
        ----------
        samples : ndarray of float64, shape (n,)
            The signal; what is not finite is missing.
        rotation_hz : float or None
            Rotation frequency of the spindle during these samples; None if it is not known.
        rotation_sd_hz : float, optional
            Its standard deviation, if that is larger than the settings' uncertainty.
        """
        self.digest()
        self._follow_speed(rotation_hz, rotation_sd_hz)
        margins = []
        while len(samples):
            self.digest()
            size = min(len(samples), self._frame - self._samples % self._frame)
            if rotation_hz is None:  # the average begins with the first speed that is known
                self._periodogram.skip(size)
            else:
                self._periodogram.take(samples[:size])
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
        if frame % FRAMES_PER_FIT == TURNS and rotation_hz is not None:
            if self._renewed:
                self._under_way = self._under_way or self._update(rotation_hz)
            elif self._fit is not None:
                self._under_way = None
                self._margin = Margin(reason="samples are missing, or nothing moves")
            self._renewed = False
        evaluated = 0
        while self._under_way is not None and evaluated < _BINS_PER_FRAME:
            try:
                evaluated += next(self._under_way)
            except StopIteration:
                self._under_way = None

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
        self._fit = None
        self._under_way = None
        self._renewed = False
        self._margin = Margin(reason=reason)

    def _update(self, rotation_hz: float) -> Pieces[None]:
        """Fit the present average."""
        spectrum, windows = self._periodogram.spectrum, self._periodogram.windows
        lines = spindle_lines(spectrum, self._bin_hz, rotation_hz, windows)
        strongest = strongest_peak_hz(spectrum, lines, self._bin_hz)
        if self._fit is None or abs(strongest / self._mode_hz - 1.0) > _OTHER_MODE:
            self._fit, self._mode_hz, self._width = None, strongest, 0
        yield _BINS_PER_FRAME
        delay_s = 1.0 / (rotation_hz * self._teeth)
        theta = None if self._fit is None else self._fit.theta
        for width in range(self._width, len(_WIDTHS)):
            band = Band(spectrum, lines, self._bin_hz, self._mode_hz, _WIDTHS[width], windows)
            prior = Prior.of(delay_s, self._uncertainty, band.floor)
            if theta is None:
                theta = (yield from search(band, prior)).theta
            band.evaluate(theta)
            band.leave_out_outliers()
            band.leave_out_teeth(1.0 / delay_s, self._settings.speed_uncertainty)
            found = yield from fit(band, prior, theta, _STEPS)
            lack_of_fit = band.lack_of_fit
            self._fit, self._width = found, width
            self._margin = margin_of(found, lack_of_fit) if band.stands_out else Margin(reason=_NO_MODE)
            if lack_of_fit < _OTHER_MODES:
                return
            theta = None
        if lack_of_fit > _UNEXPLAINED:
            self._margin = Margin(reason=_UNLIKE)
