"""Octaves of the signal, each with a recursion of its own.

RARMA(4, 3) has two modes. A cut has vibrations from below 100 Hz (an angle of 0.05 rad a sample at 12.8 kHz, where the
fit is ill-conditioned) to some kHz (MATHS: the paper's milling case has 95 Hz and 990 Hz at once). So the same model
is fitted to the signal and to what remains of it after halving its rate once, twice, three times. Each recursion
answers for the octave in the middle of its band, where it is well conditioned: it is at home there. Which of their
modes a frame reports is told in `kernels.slots`.
"""

from __future__ import annotations


def homes(source_rate_hz: float, octaves: range) -> list[tuple[float, float]]:
    """Frequencies that the band of each octave answers for: without gap or overlap from 0 to the top."""
    edges = [source_rate_hz / 2 ** (octave + 3) for octave in octaves[:-1]]
    tops = [source_rate_hz / 2 ** (octaves[0] + 1), *edges]
    return list(zip([*edges, 0.0], tops, strict=True))
