"""The linear base of a running signal, fitted anew; one small step of work at a time.

The likelihood, what may be missing, and the evidence it takes are those of `discrepancy.linear`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage, stats

from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.basis import scales
from chatter_monitor.discrepancy.innovations import Innovations
from chatter_monitor.discrepancy.known import linearised
from chatter_monitor.discrepancy.linear import NEEDED_NATS
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.discrepancy.spectrum import Periodogram, SpectralFit, fit, periodogram
from chatter_monitor.physics.parts import AppliedTerm, Mode
from chatter_monitor.physics.terms import CATALOGUE

COARSE_BINS = 600  # over the band, away from the modes
_WIDTH = 0.15  # of the bins about the modes, over half the bandwidth of the narrowest
_ABOUT = 10.0  # half bandwidths to either side of a mode that are about it
_SPEED_ERROR = 0.06  # of a configured speed
_AT_ONCE = 3  # speeds that are tried in one step of work
SEPARATE = 4.0  # half bandwidths between two modes
_WHITENED_S = 8.0  # of the signal, for the whitening filter
_SEARCHED = {"second_mode": 0, "regenerative_delay": 1, "spindle_speed": 1}  # parameters besides those of the fit


@dataclass(frozen=True, slots=True, eq=False)
class Refit:
    """A linear base.

    Attributes
    ----------
    base : Innovations
        The calibrated model, on the newest part of the signal.
    linear : Linear
        The linear machine as it was found, beside the forces of the model file.
    retuned_p, retuned_nats : float
        Of the modes of the model file against the fitted ones: how often chance does as much, and the gain.
    omission : str or None
        What linear the model lacks: "second_mode", "regenerative_delay", or "spindle_speed": the regeneration that
        it has, at another speed.
    gain_nats : float
        Of that.
    runner_up : (str, float) or None
        What explains next most, and its gain.
    rms : float
        Of the tool's displacement.
    """

    base: Innovations
    linear: Linear
    retuned_p: float
    retuned_nats: float
    omission: str | None
    gain_nats: float
    runner_up: tuple[str, float] | None
    rms: float


def refit(recorded: Recorded, given: Linear, terms: tuple[AppliedTerm, ...]) -> Iterator[Refit | None]:
    """Fit the base to some signal; yields None after every step of work, and the result in the end.

    Parameters
    ----------
    recorded : Recorded
    given : Linear
        As in the model file; with the delay of its regeneration if it has one.
    terms : tuple of AppliedTerm
        Forces of the model but its regeneration.
    """
    shown, spring, damper = recorded, 0.0, 0.0
    if terms:  # what they are in the spectrum is not the machine's
        rough = _fit_base(_spectrum(recorded, given), given).linear
        yield None
        shown, (spring, damper) = linearised(recorded, rough, terms, given.modes[0].omega)
        given = given.beside(spring, damper)
        yield None
    spectrum = _spectrum(shown, given)
    yield None
    as_given = _fit_base(spectrum, given, fixed_modes=True)
    yield None
    fits = []
    for start in _starts(spectrum, given):
        fits.append(_fit_base(spectrum, start))
        yield None
    base = min(fits, key=lambda each: each.nll)
    found: list[tuple[str, float, SpectralFit]] = []
    starts = [*_omissions(spectrum, base, given)]

    def consider(name: str, trial: SpectralFit) -> None:
        price_nats = trial.parameters - base.parameters + _SEARCHED[name]
        if _plausible(name, trial, base, spectrum):
            found.append((name, base.nll - trial.nll - price_nats, trial))

    if given.delay_s is not None:
        # The same machine at another speed: its modes are kept until the speed is found.
        speeds = []
        for start in _other_speeds(replace(as_given.linear, delay_s=given.delay_s), given):
            speeds.append(fit(spectrum, start, fixed_modes=True))
            if len(speeds) % _AT_ONCE == 0:
                yield None
        nearest = min(speeds, key=lambda each: each.nll)
        consider("spindle_speed", nearest)  # nothing but the speed differs
        at_speed = replace(base.linear, delay_s=nearest.linear.delay_s, regeneration=nearest.linear.regeneration)
        starts.append(("spindle_speed", at_speed))
    for number, (name, start) in enumerate(starts):
        consider(name, fit(spectrum, start))
        if name == "second_mode" or number % _AT_ONCE == 0:
            yield None
    best: dict[str, tuple[str, float, SpectralFit]] = {}
    for each in sorted(found, key=lambda each: each[1]):
        best[each[0]] = each
    ranked = sorted(best.values(), key=lambda each: -each[1])
    leader = ranked[0] if ranked and ranked[0][1] > NEEDED_NATS else None
    fitted = leader[2] if leader else base
    runner_up = next(((name, gain) for name, gain, _ in ranked if leader is None or name != leader[0]), None)
    freedom = 3 * len(given.modes) - 1
    retuned_nats = max(as_given.nll - base.nll, 0.0)
    p = float(stats.chi2.sf(2.0 * retuned_nats, freedom))
    newest = slice(-round(_WHITENED_S * recorded.rate_hz), None)
    part = Recorded(recorded.samples[newest], recorded.missing[newest], recorded.rate_hz)
    machine = fitted.linear.beside(-spring, -damper)
    innovations = Innovations(part, *_observed(machine, terms))
    omission, gain_nats = leader[:2] if leader else (None, 0.0)
    yield Refit(innovations, machine, p, retuned_nats, omission, gain_nats, runner_up, scales(innovations.motion)[0])


def _fit_base(spectrum: Periodogram, start: Linear, *, fixed_modes: bool = False) -> SpectralFit:
    """Fit a base; one that would regenerate backwards, which no cut does, does not regenerate."""
    base = fit(spectrum, start, fixed_modes=fixed_modes)
    if base.linear.regeneration >= 0.0:
        return base
    return fit(spectrum, replace(start, delay_s=None, regeneration=0.0), fixed_modes=fixed_modes)


def _spectrum(recorded: Recorded, given: Linear) -> Periodogram:
    """Periodogram with narrow bins about the modes, where wide ones would smear the peaks, and wide ones elsewhere."""
    half_widths = [mode.frequency_hz * mode.damping_ratio for mode in given.modes]
    width_hz = _WIDTH * min(half_widths)
    fine = periodogram(recorded, width_hz)
    together = round(0.5 * recorded.rate_hz / COARSE_BINS / width_hz)
    if together < 2:
        return fine
    about = np.zeros(fine.count.size, dtype=bool)
    for mode, half_width in zip(given.modes, half_widths, strict=True):
        about |= abs(fine.frequency_hz - mode.frequency_hz) < _ABOUT * half_width
    first = np.arange(fine.count.size) % together == 0
    begins = np.flatnonzero(first | about | np.append(False, about[:-1]))
    count = np.add.reduceat(fine.count, begins)
    frequency, density = (np.add.reduceat(x * fine.count, begins) / count for x in (fine.frequency_hz, fine.density))
    return Periodogram(frequency, density, count, fine.nyquist_hz)


def _starts(spectrum: Periodogram, given: Linear) -> list[Linear]:
    """The given modes, and the highest peak near the first of them."""
    mode = given.modes[0]
    near = abs(np.log(spectrum.frequency_hz / mode.frequency_hz)) < 0.2
    if not near.any():
        return [given]
    peak = float(spectrum.frequency_hz[near][np.argmax(ndimage.uniform_filter1d(spectrum.density, 5)[near])])
    return [given, replace(given, modes=(replace(mode, frequency_hz=peak), *given.modes[1:]))]


def _omissions(spectrum: Periodogram, base: SpectralFit, given: Linear) -> Iterator[tuple[str, Linear]]:
    """Starts of what may be missing."""
    linear, main = base.linear, base.linear.modes[0]
    half_width = main.damping_ratio * main.frequency_hz
    away = abs(spectrum.frequency_hz - main.frequency_hz) > SEPARATE * half_width
    for width in (2.0, 8.0):
        bins = max(3, round(width * half_width / float(spectrum.frequency_hz[1] - spectrum.frequency_hz[0])))
        if away.any():
            at = float(spectrum.frequency_hz[away][np.argmax(ndimage.uniform_filter1d(base.ratio, bins)[away])])
            yield "second_mode", replace(linear, modes=(*linear.modes, Mode(at, main.damping_ratio, 0.5)))
    if given.spindle is not None and given.delay_s is None:
        nominal = given.spindle.delay_s
        yield "regenerative_delay", replace(linear, delay_s=nominal, regeneration=0.0)
        for start in _other_speeds(linear, given):
            yield "regenerative_delay", replace(start, regeneration=0.0)


def _other_speeds(linear: Linear, given: Linear) -> Iterator[Linear]:
    """A machine at speeds about the given one, on a grid."""
    if given.spindle is None:
        return
    nominal = given.spindle.delay_s
    # The comb has teeth 1 / tau apart: between two speeds of the grid it moves by a tenth of a period of the mode.
    step = max(0.1 / (linear.modes[0].frequency_hz * nominal), 2.0 * _SPEED_ERROR / 40)
    shifts = np.arange(step, _SPEED_ERROR, step)
    for shift in [*-shifts[::-1], *shifts]:
        yield replace(linear, delay_s=float(nominal * (1.0 + shift)))


def _plausible(name: str, trial: SpectralFit, base: SpectralFit, spectrum: Periodogram) -> bool:
    if name != "second_mode":
        return trial.linear.regeneration > 0.0
    main, added = trial.linear.modes[0], trial.linear.modes[-1]
    inside = 2.0 * spectrum.frequency_hz[0] < added.frequency_hz < 0.95 * spectrum.frequency_hz[-1]
    apart = abs(added.frequency_hz - main.frequency_hz)
    separate = apart > SEPARATE * base.linear.modes[0].damping_ratio * main.frequency_hz
    return inside and separate and added.damping_ratio < 0.15 and main.damping_ratio < 0.3


def _observed(linear: Linear, terms: tuple[AppliedTerm, ...]) -> tuple[Linear, tuple[AppliedTerm, ...]]:
    """Linear part and forces for the observer, to which regeneration is a force."""
    if linear.delay_s is None or linear.spindle is None:
        return linear, terms
    speed_rpm = 60.0 / (linear.spindle.teeth * linear.delay_s)
    linear = replace(linear, spindle=replace(linear.spindle, speed_rpm=speed_rpm))
    regeneration = AppliedTerm(CATALOGUE["regenerative_delay"], {"coefficient": max(linear.regeneration, 0.0)})
    return linear, (*terms, regeneration)
