"""What is wrong with a recording itself: clipping, silence, impacts and swelling of the excitation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, stats

Vector = NDArray[np.float64]

SILENCE_S = 0.005  # a sensor that repeats its value for so long is not listening
_PILE = 0.005  # width of the bins at the extremes, as a share of the largest magnitude
_PILED, _RATIO = 12, 5.0  # samples in the outermost bin, and over those in the next, that mean clipping
SIGNIFICANT = 1e-6
SWELL_S = 0.1  # resolution of the local size of the errors
_LEAST_SWELL = 0.05  # relative spread of the local variance, beyond chance, worth a word
_LEAST_KURTOSIS = 0.3
# Size of the errors, over their rms, below which a force that swells is too weak to tell: the sensor's noise has four
# times its usual share there, and a filter with one gain takes that for the motion.
_TOO_WEAK = 0.5
DRIFT_ORDER = 5  # of the polynomials that a drifting offset is made of


@dataclass(frozen=True, slots=True)
class Clipping:
    """Where a sensor ends and how many samples it cost."""

    level: float
    samples: int


def clipping(samples: Vector) -> tuple[Clipping | None, NDArray[np.bool_]]:
    """Whether samples pile up at the extremes, and which do.

    The outermost values of a vibration become rarer towards the end; those of a sensor that clips crowd there.
    """
    clipped = np.zeros(samples.size, dtype=bool)
    level = math.inf
    for side in (samples, -samples):
        top = float(side.max())
        if top <= 0.0:
            continue
        outer = int(np.count_nonzero(side > (1.0 - _PILE) * top))
        inner = int(np.count_nonzero(side > (1.0 - 2.0 * _PILE) * top)) - outer
        if outer >= _PILED and outer > _RATIO * max(inner, 1):
            clipped |= side > (1.0 - _PILE) * top
            level = min(level, top)
    if not clipped.any():
        return None, clipped
    return Clipping(level, int(np.count_nonzero(clipped))), clipped


def silent(samples: Vector, rate_hz: float) -> NDArray[np.bool_]:
    """Samples within runs of one and the same value that last for `SILENCE_S` or longer."""
    same = np.concatenate([[False], np.diff(samples) == 0.0])
    least = max(3, round(SILENCE_S * rate_hz))
    runs = ndimage.binary_opening(same, np.ones(least - 1, dtype=bool))
    return np.asarray(ndimage.binary_dilation(runs, np.array([False, True, True])) | runs)


@dataclass(frozen=True, slots=True, eq=False)
class Restlessness:
    """Errors that are not of one size.

    Attributes
    ----------
    kind : str or None
        "impacts", "nonstationary_excitation", or None.
    p_value : float
        Of the test that found it.
    gain_nats : float
        What knowing the size of the errors adds to the logarithm of the likelihood.
    scale : ndarray of float64, shape (n,)
        Standard deviation of each error; constant unless a kind was found, and infinite where the force is too weak for
        it to tell anything.
    depth : float
        rms of the relative changes of the local variance beyond chance.
    kurtosis : float
        Excess kurtosis of the errors.
    """

    kind: str | None
    p_value: float
    gain_nats: float
    scale: Vector
    depth: float
    kurtosis: float


def restlessness(whitened: Vector, used: NDArray[np.bool_], rate_hz: float) -> Restlessness:
    """Test whitened errors for heavy tails and for a size that changes with time."""
    e = whitened[used]
    sd = float(np.std(e))
    z = e / sd
    excess = float(np.mean(z**4)) - 3.0
    p_tails = 2.0 * float(stats.norm.sf(abs(excess) / math.sqrt(24.0 / z.size)))
    length = max(32, round(SWELL_S * rate_hz))
    count = z.size // length
    local = np.mean(z[: count * length].reshape(count, length) ** 2, axis=1)
    # Under one size each local mean of squares has the variance of a square over its length.
    square = float(np.var(z**2))
    dispersion = float(np.sum((local - local.mean()) ** 2)) / (square / length)
    p_swell = float(stats.chi2.sf(dispersion, count - 1))
    depth = math.sqrt(max(float(np.var(local)) - square / length, 0.0))
    scale = np.full(whitened.size, sd)
    if p_swell < SIGNIFICANT and depth > _LEAST_SWELL:
        smooth = np.sqrt(ndimage.gaussian_filter1d(np.where(used, whitened, sd) ** 2, length))
        gain = float(np.sum(np.log(sd / smooth[used])) + 0.5 * np.sum(z**2 - (whitened / smooth)[used] ** 2))
        inner = (whitened / smooth)[used]
        if float(np.mean(inner**4)) / float(np.mean(inner**2)) ** 2 - 3.0 < 0.5 * excess or excess < _LEAST_KURTOSIS:
            scale = np.where(smooth > _TOO_WEAK * sd, smooth, np.inf)
            return Restlessness("nonstationary_excitation", p_swell, gain, scale, depth, excess)
    if p_tails < SIGNIFICANT and excess > _LEAST_KURTOSIS:
        # Large errors count as what a mixture of two sizes makes of them.
        core = 1.4826 * float(np.median(np.abs(e)))
        heavy = np.sqrt(ndimage.uniform_filter1d(np.where(used, whitened, core) ** 2, 3))
        scale = np.maximum(core, np.where(heavy > 3.0 * core, heavy, core))
        gain = float(np.sum(np.log(sd / scale[used])) + 0.5 * np.sum(z**2 - (whitened / scale)[used] ** 2))
        return Restlessness("impacts", p_tails, gain, np.asarray(scale), depth, excess)
    return Restlessness(None, min(p_tails, p_swell), 0.0, scale, depth, excess)


def slow_drift(samples: Vector, weight: Vector, expected: float) -> tuple[Vector, float]:
    """Slow polynomials in a recording, and how often chance makes as much of them.

    Parameters
    ----------
    samples : ndarray of float64, shape (n,)
    weight : ndarray of float64, shape (n,)
        How much each counts, 0 to 1; the edges of a long gap have to be smooth.
    expected : float
        Variance of the projection on a wave of unit norm that the machine itself has near 0 Hz.

    Returns
    -------
    ndarray of float64, shape (n,)
        Their sum.
    float
        p-value.
    """
    t = np.linspace(-1.0, 1.0, samples.size)
    # Without the window the ends of the recording would carry the mode itself into the polynomials.
    window = np.cos(0.5 * np.pi * t) ** 2 * weight
    polynomials = np.polynomial.legendre.legvander(t, DRIFT_ORDER)
    slow, _ = np.linalg.qr(window[:, None] * polynomials)
    projections = slow.T @ (samples - np.average(samples, weights=window))
    # QR puts the mean first: what is left of the others is not the mean's.
    value = float(np.sum(projections[1:] ** 2)) / expected
    normal = polynomials.T @ (window[:, None] * polynomials)
    drift = polynomials @ np.linalg.solve(normal, polynomials.T @ (window * samples))
    return drift, float(stats.chi2.sf(value, DRIFT_ORDER))
