"""Force balance: a measured force against the motion that it causes.

With the force F measured beside the displacement x nothing has to be predicted,

    F = m x'' + c x' + k x + offset + sum_i theta_i phi_i(x, x', memory) + rest

is linear in everything but the shapes of phi. Forces are worked out along the motion at the full rate, then all columns
pass the same low-pass and are taken at the rate that its edge allows. What is left of F after the linear part has been
taken out is whitened, the other columns by the same filter; the regression by blocks is that of the innovations.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp

from chatter_monitor.discrepancy import basis
from chatter_monitor.discrepancy.band import Recorded
from chatter_monitor.discrepancy.case import BLOCK_S
from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.innovations import tried_forces
from chatter_monitor.discrepancy.whitening import ORDER, trusted, whitened, whitener
from chatter_monitor.errors import InputError
from chatter_monitor.kernels.forces_along import forces_along
from chatter_monitor.kernels.observer import AHEAD, Motion, Observer
from chatter_monitor.physics.terms import Term

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

FORCE_SHARE = 0.999  # of the power of the force, within the band: what it does not excite tells nothing
_WIDEST = 0.4  # of the sample rate
_HARMONICS = 3.0  # of what is in the band, that forces along the motion are worked out with
_FULL_RATE = 8.0  # at least, over the edge of the band: products of the motion are not to fold back into it
_RATE = 2.6  # sample rate over the edge of the band
_PERIODS = 6.0  # of the edge, that the low-pass reaches to either side
LINEAR = ("mass", "damping", "stiffness", "offset")


@dataclass(frozen=True, slots=True, eq=False)
class Balance:
    """A force and the motion, ready to be compared.

    Attributes
    ----------
    motion : Motion
        Displacement and velocity within the band, at the full rate; row 1 is a sample later than row 0.
    present : ndarray of bool, shape (n,)
    step_s, edge_hz : float
        Of the full rate; end of the band.
    factor : int
        Full rate over the rate of the columns.
    force : ndarray of float64, shape (count,)
        Within the band, at the rate of the columns.
    linear : ndarray of float64, shape (4, count)
        Acceleration, velocity, displacement and 1.
    used : ndarray of bool, shape (count,)
    """

    motion: Motion
    present: NDArray[np.bool_]
    step_s: float
    edge_hz: float
    factor: int
    force: Vector
    linear: Matrix
    used: NDArray[np.bool_]

    @property
    def rate_hz(self) -> float:
        """Of the columns."""
        return 1.0 / (self.step_s * self.factor)

    def seen(self, fine: Vector) -> Vector:
        """What the band leaves of a column at the full rate."""
        return _through(fine, _low_pass(self.edge_hz, self.step_s), self.factor)

    def along(self, term: Term, values: Sequence[float]) -> Vector:
        """Force of a term along the motion, at the full rate; w counts as 1, so that coefficients are forces."""
        still = Observer(
            np.zeros((1, 1)), np.zeros(1), np.zeros(1), np.zeros(1), np.zeros(1), 0.0, np.zeros((2, 1)),
            np.zeros((AHEAD + 1, 2, 2)), np.zeros(2), self.step_s, 1.0, 0.0, 0.0,
        )  # fmt: skip
        [out] = force = np.empty((1, 2, self.present.size))
        forces_along(still, self.motion, self.present, tried_forces([(term, values)]), force)
        # The ends of two straight lines meet at each sample.
        return np.concatenate([out[0, :1], 0.5 * (out[0, 1:] + out[1, :-1])])

    def of_term(self, term: Term, values: Sequence[float]) -> Vector:
        """The same as the balance sees it."""
        return self.seen(self.along(term, values))

    def surface(self) -> list[Vector]:
        """Bumps over the phase plane."""
        x, v = self.motion.x[0], self.motion.v[0]
        over_x, over_v = (basis.splines(each / np.std(each), basis.BUMPS, -basis.REACH, basis.REACH) for each in (x, v))
        return [self.seen(bx * bv) for bx in over_x for bv in over_v]


def balance(force: Recorded, displacement: Recorded) -> Balance:
    """Bring a force and a displacement into one band.

    Parameters
    ----------
    force, displacement : Recorded
        At one rate, sample by sample.

    Raises
    ------
    InputError
        If they do not belong together.
    """
    if force.rate_hz != displacement.rate_hz or force.samples.size != displacement.samples.size:
        raise InputError(
            "input and recording do not belong together",
            got=f"{force.samples.size} samples at {force.rate_hz:g} Hz",
            allowed=f"{displacement.samples.size} samples at {displacement.rate_hz:g} Hz",
            remedy="Record both together.",
        )
    edge_hz, recorded_hz = _edge_hz(force), force.rate_hz
    up = max(1, math.ceil(_FULL_RATE * edge_hz / recorded_hz))
    force, displacement = (_finer(each, up) for each in (force, displacement))
    rate, step_s = force.rate_hz, 1.0 / force.rate_hz
    factor = max(1, math.floor(rate / (_RATE * edge_hz)))
    low_pass = _low_pass(edge_hz, step_s)
    missing = force.missing | displacement.missing
    reach = low_pass[0].size // 2
    present = ~np.asarray(np.convolve(missing, np.ones(2 * reach + 1), "same") > 0.5)
    present[:reach] = present[-reach:] = False  # there the low-pass saw beyond the ends
    moved = displacement.samples
    wide = _low_pass(min(_HARMONICS * edge_hz, 0.48 * recorded_hz), step_s)
    x, v = (_through(moved, (taps,), 1) for taps in wide[:2])
    motion = Motion(*(np.stack([each, np.append(each[1:], each[-1])]) for each in (x, v, np.zeros_like(x))))
    acceleration, velocity, place = (_through(moved, (taps,), factor) for taps in low_pass[::-1])
    seen = _through(force.samples, low_pass, factor)
    used = trusted(~present[::factor], ORDER)
    linear = np.stack([acceleration, velocity, place, np.ones_like(place)])
    return Balance(motion, present, step_s, edge_hz, factor, seen, linear, used)


class BalanceEvidence(Evidence):
    """Evidence that keeps its columns, for the test of what is left.

    Attributes
    ----------
    errors : ndarray of float64, shape (count,)
        What the linear part leaves of the force, whitened.
    columns : ndarray of float64, shape (c, count)
        Whitened; the first four are the linear part, the nuisance.
    used : ndarray of bool, shape (count,)
    """

    def __init__(self, errors: Vector, columns: Matrix, used: NDArray[np.bool_], block: int) -> None:
        self.errors, self.columns, self.used = errors, columns, used
        weight = np.where(used, 1.0 / float(np.std(errors[used])), 0.0)
        super().__init__(errors, columns, weight, range(len(LINEAR)), block)


def evidence_of(found: Balance, columns: Sequence[Vector]) -> tuple[BalanceEvidence, Vector]:
    """Whitened evidence for columns beside the linear part.

    Returns
    -------
    BalanceEvidence
    ndarray of float64, shape (4,)
        Coefficients of the linear part that were taken out.
    """
    used = found.used
    whole = np.array([*found.linear, *columns])[:, used].T
    size = np.maximum(np.sqrt(np.mean(whole**2, axis=0)), 1e-300)  # some bumps were never visited
    # What is missing may be far larger than what is left in the end; that alone has the colour of the errors.
    most = np.linalg.lstsq(whole / size, found.force[used], rcond=1e-4)[0]
    rest = np.zeros(used.size)
    rest[used] = found.force[used] - whole / size @ most
    taps = whitener(rest, used)
    white = np.array([whitened(each, taps) for each in (*found.linear, *columns)])
    target = whitened(found.force, taps)
    linear = white[: len(LINEAR)]
    coefficients = np.linalg.lstsq(linear[:, used].T, target[used], rcond=None)[0]
    block = max(1, round(BLOCK_S * found.rate_hz))
    return BalanceEvidence(target - coefficients @ linear, white, used, block), coefficients


def _finer(recorded: Recorded, up: int) -> Recorded:
    """So many samples for each."""
    if up == 1:
        return recorded
    samples = np.asarray(dsp.resample_poly(recorded.samples, up, 1))
    return Recorded(samples, np.repeat(recorded.missing, up), up * recorded.rate_hz)


def _edge_hz(force: Recorded) -> float:
    """Frequency below which nearly all of the force is."""
    present = force.samples[~force.missing]
    f, density = dsp.welch(present - present.mean(), force.rate_hz, nperseg=min(4096, present.size // 8))
    inside = np.cumsum(density) / np.sum(density)
    return float(min(f[np.searchsorted(inside, FORCE_SHARE)], _WIDEST * force.rate_hz))


def _low_pass(edge_hz: float, step_s: float) -> tuple[Vector, Vector, Vector]:
    """A windowed sinc and its first two derivatives, which differentiate what passes it."""
    reach = math.ceil(_PERIODS / (edge_hz * step_s))
    t = step_s * np.arange(-reach, reach + 1)
    taps = np.sinc(2.0 * edge_hz * t) * np.cos(0.5 * np.pi * t / t[-1]) ** 4
    taps /= taps.sum()
    slope = 2j * np.pi * np.fft.rfftfreq(t.size, step_s)  # differences would fall short near the edge
    first, second = (np.fft.irfft(slope**k * np.fft.rfft(taps), t.size) for k in (1, 2))
    return taps, first, second


def _through(fine: Vector, taps: Sequence[Vector], factor: int) -> Vector:
    return np.asarray(dsp.oaconvolve(fine, taps[0], "same")[::factor])
