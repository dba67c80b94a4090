"""What a linear base may lack that is linear itself: told apart by the spectrum, before anything nonlinear is tried.

A second mode, a force that is not white, regeneration, a sensor that measures something else: each is fitted to the
same periodogram by the same likelihood as the base, smooth colour always allowed for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy import ndimage, stats

from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.discrepancy.spectrum import RESOLUTION, Periodogram, SpectralFit, fit, periodogram
from chatter_monitor.physics.parts import Mode, Quantity

MECHANICAL = ("second_mode", "regenerative_delay")  # omissions that make another machine
NEEDED_NATS = 12.0  # of a linear omission, over the base
_OTHER_QUANTITY_NATS = 40.0
_COMB = (0.55, 0.65, 0.75, 0.85, 1.18, 1.33, 1.5, 1.7)  # wrong delays over the right one
_SPEED_ERROR = 0.04  # of the nominal spindle speed
_BEYOND_COMB_NATS = 5.0
_PARTS = 4  # of the recording, in all but one of which a second mode has to be seen
_LASTING_SHARE = 0.3
HARMONIC_WIDTH = 0.1  # about the orders 2 and 3 of the mode


@dataclass(frozen=True, slots=True, eq=False)
class Omission:
    """A linear omission: name, parameters with their standard deviations, evidence."""

    name: str
    fit: SpectralFit
    gain_nats: float
    p_value: float
    parameters: dict[str, tuple[float, float]]


@dataclass(frozen=True, slots=True, eq=False)
class Base:
    """The linear base, calibrated.

    Attributes
    ----------
    given, fitted : SpectralFit
        With the modes of the model file (noise and colour fitted), and with its own.
    omissions : list of Omission
        What it lacks, in the order of evidence.
    quantity : str
        What the sensor really measures.
    alternatives : list of (str, float)
        Linear omissions that were tried, with their gain.
    spectrum : Periodogram
    known : (float, float)
        Spring and damper that forces of the model file stand for in the spectrum (`known.linearised`).
    """

    given: SpectralFit
    fitted: SpectralFit
    omissions: list[Omission]
    quantity: Quantity
    alternatives: list[tuple[str, float]]
    spectrum: Periodogram
    known: tuple[float, float] = (0.0, 0.0)

    @property
    def linear(self) -> Linear:
        """With the omissions that change the linear machine, beside the forces of the model file."""
        for omission in self.omissions:
            if omission.name in MECHANICAL:
                return self._beside_known(omission.fit.linear)
        return self.machine

    @property
    def machine(self) -> Linear:
        """The fitted machine beside the forces of the model file."""
        return self._beside_known(self.fitted.linear)

    def _beside_known(self, linear: Linear) -> Linear:
        spring, damper = self.known
        return linear.beside(-spring, -damper)

    @property
    def retuning_p(self) -> float:
        """Of the modes of the model file against the fitted ones."""
        freedom = self.fitted.parameters - self.given.parameters
        return float(stats.chi2.sf(2.0 * max(self.given.nll - self.fitted.nll, 0.0), freedom))


def fit_base(recorded: Recorded, given: Linear, known: tuple[float, float] = (0.0, 0.0)) -> Base:
    """Calibrate the linear base and look for what it lacks.

    Parameters
    ----------
    recorded : Recorded
        Within its band.
    given : Linear
        As in the model file.
    known : (float, float)
        Spring and damper that forces of the model file stand for.
    """
    given = given.beside(*known)
    spectrum = _spectrum(recorded, given)
    as_given = fit(spectrum, given, fixed_modes=True)
    fitted = _fitted(spectrum, given)
    quantity = given.quantity
    for other in ("displacement", "velocity", "acceleration"):
        if other == given.quantity or {other, given.quantity} == {"acceleration", "pressure"}:
            continue
        trial = _fitted(spectrum, replace(given, quantity=other))
        plausible = all(mode.damping_ratio < 0.3 for mode in trial.linear.modes)
        if plausible and trial.nll < fitted.nll - _OTHER_QUANTITY_NATS and _without_colour(spectrum, trial, fitted):
            fitted, quantity = trial, other
    omissions, alternatives = [], []
    for omission in (_second_mode(spectrum, fitted), _coloured(spectrum, fitted), _regeneration(spectrum, fitted)):
        if omission is not None:
            alternatives.append((omission.name, omission.gain_nats))
            if omission.gain_nats > NEEDED_NATS and _lasting(recorded, fitted, omission):
                omissions.append(omission)
    omissions.sort(key=lambda each: -each.gain_nats)
    # A delay was held against wrong delays; a mode at a multiple may be what a force makes of the first.
    if any(each.name == "regenerative_delay" for each in omissions):
        omissions = [each for each in omissions if not at_multiple(each, fitted)]
    return Base(as_given, fitted, omissions[:1], quantity, alternatives, spectrum, known)


def calibrate(recorded: Recorded, given: Linear) -> SpectralFit:
    """Fit the modes and the noise, nothing else."""
    return _fitted(_spectrum(recorded, given), given)


def _spectrum(recorded: Recorded, given: Linear) -> Periodogram:
    narrowest = min(mode.frequency_hz * mode.damping_ratio for mode in given.modes)
    return periodogram(recorded, RESOLUTION * narrowest)


def _fitted(spectrum: Periodogram, start: Linear) -> SpectralFit:
    """Best fit from the given modes and from the highest peak near the first of them."""
    mode = start.modes[0]
    near = (spectrum.frequency_hz > mode.frequency_hz / 1.25) & (spectrum.frequency_hz < mode.frequency_hz * 1.25)
    smooth = ndimage.uniform_filter1d(spectrum.density, 5)
    peak = float(spectrum.frequency_hz[near][np.argmax(smooth[near])]) if near.any() else mode.frequency_hz
    starts = [start, replace(start, modes=(replace(mode, frequency_hz=peak), *start.modes[1:]))]
    return min((fit(spectrum, each) for each in starts), key=lambda each: each.nll)


def _without_colour(spectrum: Periodogram, trial: SpectralFit, than: SpectralFit) -> bool:
    """Whether one machine explains more than another if the force is white.

    A steep colour turns one quantity into another, and has cosines left for what a strong nonlinear force does to the
    skirts of a peak.
    """
    white, other = (fit(spectrum, each.linear, colours=0).nll for each in (trial, than))
    return white < other


def at_multiple(omission: Omission, base: SpectralFit) -> bool:
    """Whether an omission is a second mode where a nonlinear force makes harmonics of the first."""
    if omission.name != "second_mode":
        return False
    order = omission.parameters["frequency_hz"][0] / base.linear.modes[0].frequency_hz
    return round(order) in (2, 3) and abs(order - round(order)) < HARMONIC_WIDTH


def _second_mode(spectrum: Periodogram, base: SpectralFit) -> Omission | None:
    """A mode more, started where the spectrum exceeds the base most."""
    main = base.linear.modes[0]
    ratio = base.ratio
    best: SpectralFit | None = None
    for width_hz in (2.0 * main.damping_ratio * main.frequency_hz, 8.0 * main.damping_ratio * main.frequency_hz):
        bins = max(3, round(width_hz / float(spectrum.frequency_hz[1] - spectrum.frequency_hz[0])))
        excess = ndimage.uniform_filter1d(ratio, bins)
        away = abs(spectrum.frequency_hz / main.frequency_hz - 1.0) > 4.0 * main.damping_ratio
        if not away.any():
            continue
        at = float(spectrum.frequency_hz[away][np.argmax(excess[away])])
        for g in (0.3, 1.0, 2.5):
            start = replace(base.linear, modes=(*base.linear.modes, Mode(at, main.damping_ratio, g)))
            trial = fit(spectrum, start)
            if best is None or trial.nll < best.nll:
                best = trial
    if best is None:
        return None
    added = best.linear.modes[-1]
    inside = spectrum.frequency_hz[0] * 2.0 < added.frequency_hz < spectrum.frequency_hz[-1] * 0.95
    separate = abs(added.frequency_hz / best.linear.modes[0].frequency_hz - 1.0) > 2.0 * main.damping_ratio
    if not (inside and separate and added.damping_ratio < 0.15 and best.linear.modes[0].damping_ratio < 0.3):
        return None
    gain = base.nll - best.nll - 3.0
    at = 2 + 3 * (len(base.linear.modes) - 1)
    sd = best.sd[at : at + 3]
    values = {
        "frequency_hz": (added.frequency_hz, added.frequency_hz * float(sd[0])),
        "damping_ratio": (added.damping_ratio, added.damping_ratio * float(sd[1])),
        "participation": (abs(added.participation), float(sd[2])),
    }
    return Omission("second_mode", best, gain, float(stats.chi2.sf(2.0 * max(gain, 0.0), 3)), values)


def _lasting(recorded: Recorded, base: SpectralFit, omission: Omission) -> bool:
    """Whether a second mode is there all along: a machine that changes once has two peaks in its spectrum as well."""
    if omission.name != "second_mode":
        return True
    edges = np.linspace(0, recorded.samples.size, _PARTS + 1).astype(int)
    gains = []
    for begin, end in pairwise(edges):
        part = Recorded(recorded.samples[begin:end], recorded.missing[begin:end], recorded.rate_hz)
        spectrum = _spectrum(part, base.linear)
        gains.append(fit(spectrum, base.linear).nll - fit(spectrum, omission.fit.linear).nll)
    return sorted(gains)[1] * _PARTS > _LASTING_SHARE * omission.gain_nats


def _coloured(spectrum: Periodogram, base: SpectralFit) -> Omission | None:
    """A second-order low-pass of the force (`physics.excitation`), instead of a smooth colour."""
    white = fit(spectrum, base.linear, colours=0)
    top = float(spectrum.frequency_hz[-1])
    trials = [
        fit(spectrum, replace(base.linear, corner_hz=corner), colours=0)
        for corner in np.geomspace(0.4 * base.linear.modes[0].frequency_hz, 1.2 * top, 5)
    ]
    best = min(trials, key=lambda each: each.nll)
    corner = best.linear.corner_hz
    if corner is None or corner > top:
        return None
    gain = white.nll - best.nll - 1.0
    sd = float(best.sd[best.corner_at])
    return Omission(
        "coloured_excitation",
        best,
        gain,
        float(stats.chi2.sf(2.0 * max(gain, 0.0), 1)),
        {"corner_hz": (corner, corner * sd)},
    )


def _regeneration(spectrum: Periodogram, base: SpectralFit) -> Omission | None:
    """The delayed spring at the spindle's delay, against the same at delays that are none of the spindle's."""
    spindle = base.linear.spindle
    if spindle is None or base.linear.delay_s is not None:
        return None

    def at(delay_s: float) -> SpectralFit:
        start = replace(base.linear, delay_s=delay_s, regeneration=0.0)
        return fit(spectrum, start)

    nominal = spindle.delay_s
    period = 1.0 / base.linear.modes[0].frequency_hz
    if nominal < 0.6 * period:
        return None
    step = max(min(0.01, 0.1 * period / nominal), _SPEED_ERROR / 12)
    most = math.floor(_SPEED_ERROR / step + 1e-9)
    shifts = step * np.arange(-most, most + 1)  # the speed as given is one of them
    fits = [at(float(nominal * (1.0 + shift))) for shift in shifts]  # it travels into the report
    # No cut regenerates backwards, but a wave of half a period more or less explains as much if it does.
    forwards = [fitted for fitted in fits if fitted.linear.regeneration > 0.0]
    if not forwards:
        return None
    best = min(forwards, key=lambda each: each.nll)
    gain = base.nll - best.nll - 2.0
    if gain < NEEDED_NATS:
        return Omission("regenerative_delay", best, gain, float(stats.chi2.sf(2.0 * max(gain, 0.0), 2)), {})
    wrong = min(at(nominal * factor).nll for factor in _COMB)
    if wrong - best.nll < _BEYOND_COMB_NATS:
        return None
    value, sd = best.linear.regeneration, float(best.sd[best.regeneration_at])
    return Omission("regenerative_delay", best, gain, float(stats.chi2.sf(2.0 * gain, 2)), {"coefficient": (value, sd)})
