"""What is done to a signal before a model is fitted to it: halving the rate, and taking away offset and drift."""

from typing import NamedTuple

import numpy as np
from numba import njit

from chatter_monitor.kernels.options import OPTIONS

HALF_BAND_TAPS = 63
HALF_BAND_DELAY = HALF_BAND_TAPS // 2  # inputs
MIDDLE_TAP = 0.5
PAST = (HALF_BAND_TAPS + 1) // 2  # of the inputs with an even number, and of those with an odd one
CHUNK = 256  # inputs that are filtered at a time


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
    taps[n == 0] = MIDDLE_TAP
    taps[n % 2 == 1] *= 0.5 / taps[n % 2 == 1].sum()
    return taps


class HalfBandState(NamedTuple):
    """What the filter remembers.

    Attributes
    ----------
    taps : ndarray of float64, shape (PAST,)
        Every second one; the others are zero, but for the one in the middle.
    even, odd : ndarray of float64, shape (PAST + CHUNK / 2,)
        Inputs with an even number, which each make an output, and those with an odd one: the last `PAST` of either,
        oldest first, and room for a chunk.
    position : ndarray of int64, shape (1,)
        Inputs so far.
    """

    taps: np.ndarray
    even: np.ndarray
    odd: np.ndarray
    position: np.ndarray


def new_half_band() -> HalfBandState:
    """Fresh state: silence before the first sample, which makes the first output."""
    even, odd = np.zeros((2, PAST + CHUNK // 2))
    return HalfBandState(half_band()[::2].copy(), even, odd, np.zeros(1, dtype=np.int64))


@njit(**OPTIONS)
def halve(samples, state, out):
    """Filter and keep every second sample; returns how many were written to ``out``, which may be the same array.

    Output k is the filtered signal at input 2 k - HALF_BAND_DELAY: the filter's delay is left in. The inner loop goes
    over a chunk's outputs, so that several are summed at a time.
    """
    taps, even, odd, position = state
    written = 0
    for begin in range(0, samples.shape[0], CHUNK):
        count = min(CHUNK, samples.shape[0] - begin)
        first_even = position[0] % 2
        evens = (count + 1 - first_even) // 2
        odds = count - evens
        for k in range(evens):
            even[PAST + k] = samples[begin + first_even + 2 * k]
        for k in range(odds):
            odd[PAST + k] = samples[begin + 1 - first_even + 2 * k]
        middle = odd[PAST - PAST // 2 + first_even :]
        filtered = out[written : written + evens]
        for i in range(0, PAST, 4):  # a sum is fetched and put back once for four taps
            a, b, c, d = taps[i], taps[i + 1], taps[i + 2], taps[i + 3]
            before = even[PAST - 3 - i :]
            for k in range(evens):
                total = (filtered[k] if i else MIDDLE_TAP * middle[k]) + a * before[k + 3]
                total += b * before[k + 2]
                total += c * before[k + 1]
                filtered[k] = total + d * before[k]
        for k in range(PAST):
            even[k], odd[k] = even[k + evens], odd[k + odds]
        position[0] += count
        written += evens
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
