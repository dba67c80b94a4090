"""What is done to a signal before a model is fitted to it: halving the rate, and taking away offset and drift."""

from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.options import OPTIONS

HALF_BAND_TAPS = 63
HALF_BAND_DELAY = HALF_BAND_TAPS // 2  # inputs
RING = 64  # a power of two that holds the taps


def half_band() -> np.ndarray:
    """Linear-phase half-band filter, -6 dB at a quarter of its rate, Kaiser window of 80 dB.

    What lies around the new Nyquist frequency folds back at half its amplitude, so that the band after halving is full
    to its edge. That is wanted: an ARMA fit weighs all frequencies by the logarithm of the spectrum, and a band that a
    steep filter has emptied would claim its zeros and upset its poles
    (docs/decisions/0003-the-band-is-full.md).
    """
    n = np.arange(HALF_BAND_TAPS) - HALF_BAND_DELAY
    taps = 0.5 * np.sinc(n / 2) * np.kaiser(HALF_BAND_TAPS, 7.86)
    taps[n % 2 == 0] = 0.0
    taps[n == 0] = 0.5
    taps[n % 2 == 1] *= 0.5 / taps[n % 2 == 1].sum()
    return taps


class HalfBandState(NamedTuple):
    """Filter taps, a ring of the last inputs, and ``position[0]``, the count of inputs so far."""

    taps: np.ndarray
    ring: np.ndarray
    position: np.ndarray


def new_half_band() -> HalfBandState:
    """Fresh state: silence before the first sample, which makes the first output."""
    return HalfBandState(half_band(), np.zeros(RING), np.zeros(1, dtype=np.int64))


@njit(**OPTIONS)
def halve(samples, state, out):
    """Filter and keep every second sample; returns how many were written to ``out``.

    Output k is the filtered signal at input 2 k - HALF_BAND_DELAY: the filter's delay is left in.
    """
    taps, ring, position = state
    written = 0
    for t in range(samples.shape[0]):
        now = position[0]
        ring[now % RING] = samples[t]
        if now % 2 == 0:
            total = taps[HALF_BAND_DELAY] * ring[(now - HALF_BAND_DELAY) % RING]
            for i in range(0, HALF_BAND_TAPS, 2):  # the others are zero
                total += taps[i] * ring[(now - i) % RING]
            out[written] = total
            written += 1
        position[0] = now + 1
    return written


@njit(**OPTIONS)
def high_pass(samples, corner, state, out):
    """First-order high-pass without delay; ``corner`` in radians per sample, ``state[2]`` = last input, last output.

    A non-finite sample stays what it is in ``out`` and leaves the state alone.
    """
    pole = (1.0 - 0.5 * corner) / (1.0 + 0.5 * corner)
    gain = 0.5 * (1.0 + pole)
    for t in range(samples.shape[0]):
        sample = samples[t]
        if not abs(sample) < np.inf:
            out[t] = sample
            continue
        state[1] = gain * (sample - state[0]) + pole * state[1]
        state[0] = sample
        out[t] = state[1]


@njit(**OPTIONS)
def copy_present(samples, largest, out):
    """Copy samples, zeros for those not finite or beyond ``largest``; returns how many come after the last of these."""
    after = 0
    for t in range(samples.shape[0]):
        present = abs(samples[t]) < largest
        out[t] = samples[t] if present else 0.0
        after = after + 1 if present else 0
    return after
