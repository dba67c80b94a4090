"""How far a cut is from chatter: what the fit of a mode with a regenerative delay means.

Kappa and the modal parameters give the limit at the present speed and the rightmost characteristic root.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.kernels.delay_roots import critical_coefficient, ratio_and_damping, rightmost_root, sensitivity
from chatter_monitor.kernels.regenerative_spectrum import KAPPA, LOG_OMEGA, LOG_TAU, LOG_ZETA
from chatter_monitor.tracking.regeneration import Fit

Interval = tuple[float, float]

_CONFIDENCE_95 = 1.96
# Standard deviation of kappa, over itself, because of what the model leaves out: other modes and loads that vary; and,
# over the waves within the delay, paths to the sensor that are not smooth, which look like a delay of few waves. With
# about both the errors in the development cuts of `benchmarks.verdict` are likeliest.
_LEFT_OUT, _LEFT_OUT_OF_ONE_WAVE = 0.05, 0.3
# Regeneration is visible when kappa, and its ratio to the critical one, are so many standard deviations above zero.
_VISIBLE = 2.0
_PHYSICAL = [LOG_OMEGA, LOG_ZETA, KAPPA, LOG_TAU]
_PAIRS = np.ix_(_PHYSICAL, _PHYSICAL)
_OF_KAPPA = 2 * (_PHYSICAL.index(KAPPA),)  # its variance among theirs
UNLIKE = "the spectrum is not that of one mode with regeneration"
UNTOLD = "beside the strongest vibration stands another one, and how near to chatter that is cannot be told"


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

    @property
    def decay(self) -> float:
        """How fast it dies out while the machine cuts, in hertz: damping ratio times frequency; NaN if unknown."""
        if self.damping_rightmost is None or self.frequency_hz is None:
            return math.nan
        return self.damping_rightmost * self.frequency_hz


def margin_of(found: Fit, lack_of_fit: float) -> Margin:
    """What a fit means for the cut, intervals by the delta method."""
    physical = found.theta[_PHYSICAL]
    covariance = lack_of_fit * found.covariance[_PAIRS]
    if not np.isfinite(covariance).all():
        return Margin(reason=UNLIKE)
    omega, zeta, kappa, tau = _natural(physical)
    waves = omega * tau / (2.0 * math.pi)
    covariance[_OF_KAPPA] += (_LEFT_OUT**2 + (_LEFT_OUT_OF_ONE_WAVE / waves) ** 2) * kappa**2
    kappa_sd = math.sqrt(covariance[_OF_KAPPA])
    if kappa < -_VISIBLE * kappa_sd:  # no cut pulls its tool in
        return Margin(reason=UNLIKE)
    root = rightmost_root(omega, zeta, kappa, tau)
    gradients = np.empty((2, len(physical)))
    sensitivity(physical, root, 1e-5, gradients)
    ratio, damping = ratio_and_damping(physical, root)
    ratio_sd, damping_sd = np.sqrt(((gradients @ covariance) * gradients).sum(axis=1)).tolist()
    if not math.isfinite(ratio_sd + damping_sd):
        return Margin(reason=UNLIKE)
    low, high = ratio - _CONFIDENCE_95 * ratio_sd, ratio + _CONFIDENCE_95 * ratio_sd
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
    if kappa < _VISIBLE * kappa_sd or ratio < _VISIBLE * ratio_sd:
        return replace(
            margin, reason=f"no regeneration visible: kappa is {kappa:.4f} +- {_CONFIDENCE_95 * kappa_sd:.4f}"
        )
    return replace(
        margin,
        margin_percent=_percent(ratio),
        margin_ci95=(_percent(high), _percent(low)),  # low is above zero, or no regeneration would be visible
    )


def _natural(physical: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Omega, zeta, kappa, tau."""
    log_omega, log_zeta, kappa, log_tau = physical.tolist()
    return math.exp(log_omega), math.exp(log_zeta), kappa, math.exp(log_tau)


def _percent(ratio: float) -> float:
    return 100.0 * (1.0 / ratio - 1.0)


def beside(strongest: Margin, other: Margin | None) -> Margin:
    """Margin of the strongest mode; none where another one is untold, or dies out more slowly and may be nearer."""
    if other is None or strongest.ratio is None:
        return strongest
    if other.ratio_ci95 is None:
        return Margin(reason=UNTOLD)
    if other.decay > strongest.decay or other.ratio_ci95[1] < strongest.ratio:
        return strongest
    where = f"at {other.frequency_hz:.0f} Hz"
    return Margin(reason=f"{where} a vibration dies out more slowly than the strongest, and may be nearer to chatter")
