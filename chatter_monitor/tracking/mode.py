"""One mode with a regenerative delay, followed from one averaged periodogram to the next."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.kernels.regenerative_spectrum import MODULATION
from chatter_monitor.tracking.margin import UNLIKE, Margin, margin_of
from chatter_monitor.tracking.regeneration import Band, Fit, Pieces, Prior, fit, search, without_regeneration

# The mode is looked for anew when its peak is farther than this from it.
_OTHER_MODE = 0.12
_STEPS = 6  # from one fit to the next
# The fit looks at this range of frequency around the mode. Its skirts tell the slope and the floor, and where the delay
# is short and its comb is wide, only they tell regeneration from damping. Other modes in it show as a lack of fit:
# then less is looked at.
_WIDTHS = (1.6, 1.3, 1.12)
_OTHER_MODES = 2.0
_UNEXPLAINED = 4.0
# Regeneration is visible when the spectrum is less likely without it, whatever the damping, by so much (in nats).
_NEEDED = 2.0
# Waves within the delay beyond which the comb of a spindle that wanders as spindles do cannot be told from none.
_MOST_WAVES = 60.0
_TOO_MANY_WAVES = "{:.0f} waves from one tooth to the next are too many to hear regeneration"
_NO_MODE = "no mode stands out"
_NOT_NEEDED = "no regeneration visible: the spectrum may be that of a mode alone"


@dataclass(frozen=True, slots=True, eq=False)
class Average:
    """An averaged periodogram and what is known of it."""

    spectrum: NDArray[np.float64]
    windows: float
    lines: NDArray[np.bool_]
    bin_hz: float
    delay_s: float
    uncertainty: float
    """Relative standard deviation of the delay."""
    line_width: float
    """Half of the width of a line of the teeth, over its frequency."""


class FollowedMode:
    """One mode, followed from average to average.

    Attributes
    ----------
    fit : Fit or None
        The last one.
    margin : Margin or None
        What that means; None before the first.
    """

    def __init__(self) -> None:
        self.fit: Fit | None = None
        self.margin: Margin | None = None
        self._hertz = 0.0
        self._width = 0

    def follow(self, average: Average, peak_hz: float) -> Pieces[None]:
        """Fit the mode to an average in which it is, roughly, the peak that is given."""
        if (waves := peak_hz * average.delay_s) > _MOST_WAVES:
            self.fit, self.margin = None, Margin(reason=_TOO_MANY_WAVES.format(waves))
            return
        if self.fit is None or not self.fit.may_be or abs(peak_hz / self._hertz - 1.0) > _OTHER_MODE:
            self.fit, self._hertz, self._width = None, peak_hz, 0
        theta = None if self.fit is None else self.fit.theta
        for width in range(self._width, len(_WIDTHS)):
            band = Band(average.spectrum, average.lines, average.bin_hz, self._hertz, _WIDTHS[width], average.windows)
            prior = Prior.of(average.delay_s, average.uncertainty, band.floor)
            if theta is None:
                theta = (yield from search(band, prior)).theta
            band.evaluate(theta)
            band.leave_out_outliers()
            band.leave_out_teeth(1.0 / average.delay_s, average.line_width)
            start = theta.copy()
            start[MODULATION] = start[MODULATION] or prior.mean[MODULATION]  # after a search it is none: a saddle
            found = yield from fit(band, prior, start, _STEPS)
            if band.lack_of_fit > _OTHER_MODES:  # where it fits, what is there tells much of the comb
                band.leave_out_skirts(1.0 / average.delay_s)
                found = yield from fit(band, prior, found.theta, 2 * _STEPS)
            lack_of_fit = band.lack_of_fit
            margin = margin_of(found, lack_of_fit) if band.stands_out else Margin(reason=_NO_MODE)
            if margin.margin_percent is not None:
                without = yield from without_regeneration(band, prior, found)
                if without < _NEEDED * lack_of_fit:
                    margin = replace(margin, margin_percent=None, margin_ci95=None, reason=_NOT_NEEDED)
            self.fit, self._width, self.margin = found, width, margin
            if lack_of_fit < _OTHER_MODES:
                return
            theta = None
        if lack_of_fit > _UNEXPLAINED:
            self.margin = Margin(reason=UNLIKE)
