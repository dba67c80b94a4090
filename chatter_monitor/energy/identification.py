"""Nonparametric identification of a vibrating mode from its response alone (paper, sections 3 and 4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import get_args

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from chatter_monitor.energy import blocks
from chatter_monitor.energy.band import Band, Quantity, choose_band
from chatter_monitor.energy.damping import Damping, estimate_damping
from chatter_monitor.energy.excitation import Excitation
from chatter_monitor.energy.kinematics import motion
from chatter_monitor.energy.natural_period import NaturalPeriod, natural_period
from chatter_monitor.energy.stiffness import LINEAR, Stiffness, estimate_stiffness, half_cycles
from chatter_monitor.errors import InputError

FEWEST_PERIODS = 100
SHORT = 50.0  # independent samples below which a damping is known to worse than about 30 %
NOISY = 0.02  # share of noise in the kinetic energy that biases h and S0 as much
DISAGREE = 4.0  # mean square of normalised differences, 1 expected
BENT = 0.002  # second-order error of U, (pi zeta)^2 / 2, that is worth a word


@dataclass(frozen=True, slots=True, eq=False)
class Identification:
    """Everything that the response of one mode says about it. All forces are per unit mass.

    Attributes
    ----------
    quantity : str
        What the signal was taken for. Displacement has the signal's unit for ``displacement``, unit s for
        ``velocity``, unit s^2 for ``acceleration``.
    seconds : float
        Length of the motion after trimming its ends.
    band : Band
        The mode and the band it was looked at.
    stiffness : Stiffness
        U(x), k(x), k1, k3.
    period : NaturalPeriod
        T(E) from U and from the zero crossings.
    damping : Damping
        H(E), h_eq(E), S0.
    excitation : Excitation
        Self-excited or noise-driven.
    warnings : tuple of str
        What stands between these numbers and the truth.
    """

    quantity: Quantity
    seconds: float
    band: Band
    stiffness: Stiffness
    period: NaturalPeriod
    damping: Damping
    excitation: Excitation
    warnings: tuple[str, ...]

    def to_json(self) -> bytes:
        """JSON object with the same names as the attributes; not-a-number becomes null."""
        return msgspec.json.encode(self, enc_hook=_plain)


def identify(
    signal: ArrayLike,
    sample_rate_hz: float,
    quantity: Quantity = "displacement",
    *,
    band_hz: tuple[float, float] | None = None,
    replicates: int = 200,
    seed: int = 0,
) -> Identification:
    """Identify stiffness, damping and excitation of the strongest mode in a recording.

    Parameters
    ----------
    signal : array_like, shape (n,)
        Displacement, velocity or acceleration of a point that moves with the mode.
    sample_rate_hz : float
        Its rate; at least about 5 samples a period.
    quantity : {"displacement", "velocity", "acceleration"}
        What `signal` is.
    band_hz : (float, float), optional
        Band to look at instead of the one chosen from the spectrum.
    replicates, seed : int
        Of the block bootstrap.

    Raises
    ------
    InputError
        If the signal is not one-dimensional, not finite, constant or too short, or `quantity` is unknown.

    Examples
    --------
    >>> result = identify(displacement, 12800.0)
    >>> result.stiffness.k1, result.damping.s0, result.excitation.kind
    """
    samples = _checked(signal, sample_rate_hz, quantity, band_hz)
    band = choose_band(samples, sample_rate_hz, quantity, band_hz)
    moved = motion(samples, sample_rate_hz, quantity, band)
    seconds = moved.x.size / moved.rate_hz
    if seconds * band.peak_hz < FEWEST_PERIODS:
        raise InputError(
            "the recording holds too few periods of its strongest mode",
            got=f"{seconds:.3g} s at {band.peak_hz:.4g} Hz after trimming",
            allowed=f"at least {FEWEST_PERIODS} periods",
            remedy="Give a longer recording, or a wider band.",
        )
    count = blocks.count(moved, band.peak_hz)
    draws = blocks.weights(count, replicates, seed)
    cycles = half_cycles(moved)
    stiffness = estimate_stiffness(cycles, replicates, seed)
    damping, excitation = estimate_damping(moved, stiffness.potential, band, draws)
    period = natural_period(cycles, stiffness.potential)
    warnings = _warnings(band, stiffness, damping, excitation)
    return Identification(quantity, seconds, band, stiffness, period, damping, excitation, warnings)


def _checked(
    signal: ArrayLike, sample_rate_hz: float, quantity: Quantity, band_hz: tuple[float, float] | None
) -> NDArray[np.float64]:
    """The signal as float64, or an error that says what is wrong with it."""
    samples = np.asarray(signal, dtype=np.float64)
    if samples.ndim != 1:
        raise InputError("the signal has to be one channel", got=samples.shape, allowed="shape (n,)")
    if quantity not in get_args(Quantity):
        raise InputError("unknown quantity", got=quantity, allowed=", ".join(get_args(Quantity)))
    if not sample_rate_hz > 0.0:
        raise InputError("the sample rate has to be positive", got=sample_rate_hz)
    if band_hz is not None and not 0.0 < band_hz[0] < band_hz[1] < 0.5 * sample_rate_hz:
        raise InputError("impossible band", got=band_hz, allowed=f"0 < low < high < {0.5 * sample_rate_hz:g} Hz")
    if samples.size < 4 * FEWEST_PERIODS:
        raise InputError(
            "the signal is too short", got=f"{samples.size} samples", allowed=f"{4 * FEWEST_PERIODS} or more"
        )
    if not np.isfinite(samples).all():
        raise InputError("the signal holds values that are not finite", remedy="Cut the recording there.")
    if np.ptp(samples) == 0.0:
        raise InputError("the signal is constant", got=float(samples[0]))
    return samples


def _warnings(band: Band, stiffness: Stiffness, damping: Damping, excitation: Excitation) -> tuple[str, ...]:
    found = []
    quarter = 0.5 * (np.pi * damping.damping_ratio) ** 2
    if damping.damping_ratio > 0.0 and quarter > BENT:
        found.append(
            f"damping is {100 * damping.damping_ratio:.1f} %: within a quarter period the energy changes so much that "
            f"U(x) is bent by up to {100 * quarter:.1f} %, which matters for a k3 of that size"
        )
    if damping.independent_samples < SHORT:
        found.append(
            f"record too short: worth {damping.independent_samples:.0f} independent samples of the energy, so damping "
            f"and its shape are known to about {100 * np.sqrt(2 / damping.independent_samples):.0f} %"
        )
    if band.other_peaks_hz:
        peaks = ", ".join(f"{peak:.0f}" for peak in band.other_peaks_hz[:5])
        found.append(
            f"more than one mode or line: also {peaks} Hz; only {band.low_hz:.0f}-{band.high_hz:.0f} Hz was used"
        )
    if band.noise_share > NOISY:
        found.append(f"noise makes up {100 * band.noise_share:.0f} % of the kinetic energy in the band")
    if band.high_hz < 3.0 * band.peak_hz:
        found.append("the third harmonic lies outside the band: a strong nonlinearity of the stiffness is underrated")
    if stiffness.powers == LINEAR:
        found.append("the energy varies too little to tell a nonlinear stiffness from a linear one")
    if not damping.band_corrected:
        found.append(
            "no damping of one mode explains the decay in this band (too narrow, too steady, or several modes): h and "
            "S0 are raw and not to be trusted; give a band with one mode"
        )
    if excitation.kind == "self_excited":
        found.append("a steady forced line has the same density as a limit cycle: see whether it is a spindle order")
    if damping.disagreement > DISAGREE:
        found.append(
            "covariances and density disagree about h(E): not one mode in white noise (a forced line, a coloured "
            "force, or a second mode in the band)"
        )
    return tuple(found)


def _plain(value: object) -> object:
    """Arrays as lists, NumPy scalars as numbers."""
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise NotImplementedError(f"no JSON form for {type(value).__name__}")
