"""The long spectrum: a line is at its bin, and there is none of what is not known."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.tracking.long_spectrum import BIN_HZ, LENGTH_S, MOST_BINS, SILENCE, LongSpectrum

RATE_HZ, FRAME = 12_800.0, 640
FRAMES = round(LENGTH_S * RATE_HZ / FRAME)


def spectra(signal):
    """What is heard of each frame of a signal."""
    long = LongSpectrum(RATE_HZ, FRAME)
    return [long.hear(frame) for frame in signal.reshape(-1, FRAME)]


def tone(hertz, frames=2 * FRAMES):
    """One of unit amplitude."""
    return np.cos(2 * np.pi * hertz * np.arange(frames * FRAME) / RATE_HZ)


def test_every_fourth_frame_has_one_from_the_first_on_that_is_whole():
    """Before that there are no samples yet."""
    heard = [spectrum is not None for spectrum in spectra(tone(400.0))]
    assert heard == [(number + 1) % 4 == 0 and number + 1 >= FRAMES for number in range(2 * FRAMES)]


@pytest.mark.parametrize("hertz", [20.0, 400.0, 402.5, 5000.0])
def test_a_tone_is_in_its_bin_and_nowhere_else(hertz):
    """A frame of each side apart, of a window whose sum is half of its length."""
    middle = round(hertz / BIN_HZ)
    heard = [spectrum for spectrum in spectra(tone(hertz)) if spectrum is not None]
    assert len(heard) == 3  # the ring turns in between
    for spectrum in heard:
        assert spectrum.shape == (MOST_BINS,)
        assert spectrum.argmax() == middle
        assert spectrum[middle] == pytest.approx((0.25 * LENGTH_S * RATE_HZ) ** 2, rel=0.01)
        spectrum[middle - 1 : middle + 2] = 0.0
        assert spectrum.max() < 1e-6 * (LENGTH_S * RATE_HZ) ** 2


@pytest.mark.parametrize("lost", [np.nan, np.inf, 1e200])
def test_there_is_none_as_long_as_samples_are_missing(lost):
    """It comes back when the last of them is so long ago."""
    signal = tone(400.0, 3 * FRAMES)
    signal[FRAMES * FRAME + 5] = lost
    heard = [number + 1 for number, spectrum in enumerate(spectra(signal)) if spectrum is not None]
    assert heard == [FRAMES, 2 * FRAMES + FRAMES // 2, 3 * FRAMES]


def test_silence_has_a_logarithm():
    """And so have samples as large as can be."""
    for samples in (np.zeros(2 * FRAMES * FRAME), 1e99 * tone(400.0)):
        *_, spectrum = spectra(samples)
        assert spectrum.min() >= SILENCE
        assert np.isfinite(np.log(spectrum)).all()
