"""What the samples can tell at all: a detector that is told the truth about the mode, for comparison with the monitor.

It is told where the root is and will be (frequency and damping), the exact speed, tones from elsewhere, what the teeth
do in the stable part of this very cut and the colour of the noise there; and, if wanted, the path of the load. What is
left to decide from the samples is whether what remains in the band around the root is still that noise, or whether
there is a vibration in it that grows with the unstable root or is limited (no damping). That is a likelihood ratio with
a prior for the moment of the change: the forward recursion of a hidden Markov chain over three hypotheses. With u the
complex amplitude in the band, whitened by an AR(6) model of the stable part, and z that of the vibration,

    noise:      u[k] = v[k]
    vibration:  u[k] = z[k] + v[k],    z[k + 1] = exp(s dt) z[k] + w[k]

with the root s, or its frequency alone. It is optimal for this model and no bound for others: what it misses may be
told by another band or by the waveform of the tool leaving the cut.

Is it a memory or evidence that is short? The scores are given as they are, and *held*: within an unstable stretch the
largest so far, as if an alarm once raised would stay as long as it is due.

Run: python -m benchmarks.verdict.oracle [--split S] [--first N] [--cuts N] [--cache DIR]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.signal import firwin, upfirdn

from benchmarks.verdict.cache import cached_cuts
from benchmarks.verdict.curves import (
    ALLOWED,
    Detector,
    by_family,
    lags_at,
    recall,
    threshold,
    threshold_of_all_families,
)
from benchmarks.verdict.cut import INTERVAL_S, INTERVAL_SAMPLES, RATE_HZ, Cut, Label, Truth
from benchmarks.verdict.families import FAMILIES
from benchmarks.verdict.generator import SEEDS, Split, family_of
from benchmarks.verdict.labels import UNSTABLE_DAMPING
from benchmarks.verdict.monitor import listen
from benchmarks.verdict.recipe import Recipe
from benchmarks.verdict.scoring import Heard

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

HOP = 40  # samples from one amplitude to the next: 320 Hz
STEPS = INTERVAL_SAMPLES // HOP
BAND_HZ = 120.0  # either side of the root's frequency
FILTER = firwin(321, BAND_HZ, fs=RATE_HZ)
STARTING = FILTER.size // HOP + 1  # amplitudes of which the filter has not seen all samples
COLOUR_ORDER = 6
# Median of what the truth calls unstable, for cuts that never are.
USUAL_UNSTABLE = -0.004
# Variance of what drives the vibration, over that of the whitened noise.
DRIVING = 0.1
# What is idle would be scaled to infinity.
LEAST_LOAD = 0.05
# Waves of teeth and tones that are fainter in the band than this part of the strongest are none.
AUDIBLE = 0.05
# Probabilities of a change in one step, from and to: noise, growing, limited.
CHANGES = np.array([[0.99999, 1e-5, 0.0], [0.001, 0.979, 0.02], [0.001, 0.001, 0.998]])
# No hypothesis is ever given up.
LEAST = 1e-12


def recipe_of(split: Split, number: int) -> Recipe:
    """Return what a cut was made from."""
    return FAMILIES[family_of(number)](np.random.default_rng([SEEDS[split], number]))


def log_odds(cut: Cut, recipe: Recipe, *, load_told: bool) -> Floats:
    """Log odds of having crossed at the end of each interval, shape (intervals,)."""
    damping, frequency_hz = _unstable_root(cut.truth)
    centre_hz = float(np.median(frequency_hz))
    t = np.arange(cut.samples.size) / RATE_HZ
    load = recipe.loudness(t) * recipe.feed(t) * recipe.depth(t) if load_told else np.ones(t.size)
    load = np.maximum(load / np.mean(load), LEAST_LOAD)
    white = _whitened(
        _demodulated(cut.samples / load, centre_hz), _waves(cut, recipe, t, load, centre_hz), _stable_part(cut.truth)
    )
    at = np.minimum(np.arange(white.size) // STEPS, len(cut.truth) - 1)
    step_s = HOP / RATE_HZ
    turning = np.exp(2j * np.pi * (frequency_hz - centre_hz) * step_s)[at]
    growth = np.exp(-damping * 2.0 * np.pi * frequency_hz * step_s)[at]
    noise = -np.log(np.pi) - np.abs(white) ** 2
    likelihoods = np.array([noise, _vibration(white, growth * turning, DRIVING), _vibration(white, turning, DRIVING)])
    return np.asarray(_forward(likelihoods, CHANGES, LEAST)[STEPS - 1 :: STEPS][: len(cut.truth)])


def held(truth: Truth, score: Floats) -> Floats:
    """Return the largest score so far within each unstable stretch, until the vibration has died down."""
    kept = score.copy()
    unstable = np.zeros(len(truth), bool)
    for stretch in truth.unstable:
        unstable |= truth.start_s >= stretch.zero_s - INTERVAL_S
    unstable &= np.isin(truth.label, (Label.SELF_EXCITED, Label.UNSCORED))
    for i in np.flatnonzero(unstable[1:] & unstable[:-1]) + 1:
        kept[i] = max(kept[i], kept[i - 1])
    return kept


def _unstable_root(truth: Truth) -> tuple[Floats, Floats]:
    """Damping and frequency, in each interval, of the root as it is once it has crossed, or would be."""
    crossed = np.flatnonzero(truth.damping_ratio < UNSTABLE_DAMPING)
    if not crossed.size:
        return np.full(len(truth), USUAL_UNSTABLE), truth.frequency_hz
    coming = crossed[np.minimum(np.searchsorted(crossed, np.arange(len(truth))), crossed.size - 1)]
    return truth.damping_ratio[coming], truth.frequency_hz[coming]


def _stable_part(truth: Truth) -> slice:
    """Steps before the first crossing."""
    last_s = truth.unstable[0].zero_s if truth.unstable else INTERVAL_S * len(truth)
    return slice(STARTING, STARTING + max(int(last_s * RATE_HZ / HOP) - STARTING, 8 * COLOUR_ORDER))


def _demodulated(signal: Floats | Complexes, frequency_hz: float) -> Complexes:
    """Complex amplitude around a frequency, `HOP` samples apart; number k needs the samples before (k + 1) HOP."""
    t = np.arange(signal.size) / RATE_HZ
    turned = signal * np.exp(-2j * np.pi * frequency_hz * t)
    return np.asarray(upfirdn(FILTER, turned, 1, HOP)[: signal.size // HOP])


def _waves(cut: Cut, recipe: Recipe, t: Floats, load: Floats, frequency_hz: float) -> Complexes:
    """Amplitudes that orders of the spindle and tones from elsewhere have in the band, shape (steps, waves)."""
    turns_hz = cut.true_rpm(t) / 60.0
    angle = 2.0 * np.pi * np.cumsum(turns_hz) / RATE_HZ
    lowest = max(1, int((frequency_hz - BAND_HZ) / turns_hz.max()))
    highest = int((frequency_hz + BAND_HZ) / turns_hz.min()) + 1
    waves = [_demodulated(np.exp(1j * order * angle), frequency_hz) for order in range(lowest, highest + 1)]
    waves += [
        _demodulated(np.exp(2j * np.pi * tone_hz * t) / load, frequency_hz)
        for tone_hz, _ in recipe.tones
        if abs(tone_hz - frequency_hz) < 1.5 * BAND_HZ
    ]
    sizes = [float(np.sqrt(np.mean(np.abs(wave) ** 2))) for wave in waves]
    heard = [wave / size for wave, size in zip(waves, sizes, strict=True) if size > AUDIBLE * max(sizes)]
    return np.array(heard).T


def _whitened(y: Complexes, waves: Complexes, stable: slice) -> Complexes:
    """What no wave explains, as white noise of unit variance in the stable part."""
    rest = y - waves @ np.linalg.lstsq(waves[stable], y[stable], rcond=None)[0]
    past = np.zeros((y.size, COLOUR_ORDER), complex)
    for lag in range(1, COLOUR_ORDER + 1):
        past[lag:, lag - 1] = rest[:-lag]
    white = rest - past @ np.linalg.lstsq(past[stable], rest[stable], rcond=None)[0]
    return np.asarray(white / np.sqrt(np.mean(np.abs(white[stable]) ** 2)))


@njit(cache=True)
def _vibration(white, poles, driving):  # type: ignore[no-untyped-def]
    """Kalman filter: logarithm of the likelihood of each amplitude, given those before, if a vibration is in it."""
    found = np.empty(white.size)
    state, spread = 0.0 + 0.0j, driving
    for k in range(white.size):
        state *= poles[k]
        spread = abs(poles[k]) ** 2 * spread + driving
        variance = 1.0 + spread
        error = white[k] - state
        found[k] = -np.log(np.pi * variance) - abs(error) ** 2 / variance
        state += spread * error / variance
        spread /= variance
    return found


@njit(cache=True)
def _forward(likelihoods, changes, least):  # type: ignore[no-untyped-def]
    """Log odds of not being noise any more after each step."""
    steps = likelihoods.shape[1]
    odds = np.empty(steps)
    kinds = np.array([1.0, least, least])
    for k in range(steps):
        kinds = (kinds @ changes) * np.exp(likelihoods[:, k] - likelihoods[:, k].max())
        kinds = np.maximum(kinds / kinds.sum(), least)
        odds[k] = np.log(kinds[1] + kinds[2]) - np.log(kinds[0])
    return odds


def show(console: Console, found: list[Detector], heard: list[Heard], allowed: float) -> None:
    """Print recall and lag of every detector at equally many false alarms, and its recall by family.

    The last two columns are of a threshold with which no family has more false alarms than are allowed.
    """
    families = list(dict.fromkeys(h.cut.family for h in heard if (h.cut.truth.label == Label.SELF_EXCITED).any()))
    table = Table(title=f"At {100 * allowed:g} % false alarms")
    table.add_column("detector")
    for heading in ("recall", "median lag", "over the limit", "95 %", "never", *families, "in every family", "never"):
        table.add_column(heading.replace("_", " "), justify="right")
    for detector in found:
        everywhere, strictest = (choose(detector, heard, allowed) for choose in (threshold, threshold_of_all_families))
        lag, of_family = lags_at(detector, heard, everywhere), by_family(detector, heard)
        table.add_row(
            detector.name,
            f"{100 * recall(detector, heard, everywhere):.1f}",
            *(f"{lag[name]:.3g}" for name in ("median_ms", "median_over_limit", "p95_over_limit", "never")),
            *(f"{100 * recall(*of_family[family], everywhere):.0f}" for family in families),
            f"{100 * recall(detector, heard, strictest):.1f}",
            f"{lags_at(detector, heard, strictest)['never']}",
        )
    console.print(table)


def main() -> None:
    """Score the monitor and the oracle on the same cuts."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.verdict.oracle", description=__doc__)
    parser.add_argument("--split", choices=("development", "report"), default="development")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--cuts", type=int, default=150)
    parser.add_argument("--cache", type=Path, help="directory to keep generated cuts in")
    chosen = parser.parse_args()
    heard: list[Heard] = []
    scores: dict[str, list[Floats]] = {}
    made = enumerate(cached_cuts(chosen.split, chosen.cuts, chosen.cache, chosen.first), start=chosen.first)
    for number, cut in track(made, total=chosen.cuts, console=Console(stderr=True)):
        recipe = recipe_of(chosen.split, number)
        heard.append(Heard(cut, listen(cut, (cut.nominal_rpm, cut.teeth))))
        for name, score in (
            ("this monitor", heard[-1].said.score),
            ("told the mode", log_odds(cut, recipe, load_told=False)),
            ("and the load", log_odds(cut, recipe, load_told=True)),
        ):
            scores.setdefault(name, []).append(score)
            scores.setdefault(f"{name}, held", []).append(held(cut.truth, score))
    found = [Detector(name, of_cuts) for name, of_cuts in scores.items()]
    for allowed in ALLOWED:
        show(Console(width=200), found, heard, allowed)


if __name__ == "__main__":
    main()
