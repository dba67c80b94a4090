"""How real recordings are altered before they are told."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.verdict.altered import RECORDINGS, Altered, ways
from benchmarks.verdict.cut import RATE_HZ


def test_a_moment_is_heard_where_it_is_said_to_be():
    """A click a second after the beginning of a recording that is begun a quarter later, twice as fast, upside down."""
    rate_hz, altered = 10_000.0, Altered(times=2.0, later_s=0.25, sign=-1.0)
    samples = np.zeros(20_000)
    samples[10_000] = 1.0
    heard = altered.play(samples, rate_hz)
    assert len(heard) == pytest.approx(1.75 / 2.0 * RATE_HZ, abs=2)
    assert np.argmin(heard) / RATE_HZ == pytest.approx(altered.moment(1.0), abs=1e-3)


def test_noise_is_as_loud_as_it_is_said_to_be():
    """10 dB below the recording."""
    samples = np.sin(np.arange(50_000.0))
    noise = Altered(snr_db=10.0).play(samples, RATE_HZ) - Altered().play(samples, RATE_HZ)
    assert np.var(noise) == pytest.approx(0.1 * np.var(samples), rel=0.05)


@pytest.mark.parametrize("recording", RECORDINGS, ids=lambda recording: recording.name)
def test_each_way_is_another(recording):
    """No recording is played in the same way twice."""
    played = [altered for _, altered in ways(recording)]
    assert len(set(played)) == len(played)
